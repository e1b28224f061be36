#include "dynamics/potential.hpp"

#include <pybind11/stl.h>

#include <limits>
#include <utility>

#include "dynamics/built_in_potential.hpp"
#include "module.hpp"

namespace elliptude::python {

namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

/// f() with the interpreter's lock; after a failure, its own or an earlier one, what the core takes for one.
template <typename Result, typename Function>
[[nodiscard]] Result guarded(Failure& failure, const Result& failed, const Function& f) noexcept {
  if (failure.happened()) {
    return failed;
  }
  const py::gil_scoped_acquire acquire;
  try {
    return f();
  } catch (...) {
    failure.keep_current_exception();
    return failed;
  }
}

/// What a function of (attitude, time) written in Python returns, checked.
[[nodiscard]] Items called(const py::object& function, const std::string& name, const Shape& item,
                           const Matrix3<double>& attitude, double time) {
  return single(function(to_array(attitude), time), name + "(attitude, time)", item);
}

const Vector3<double> failed_vector = Vector3<double>::Constant(nan);
const Matrix3<double> failed_matrix = Matrix3<double>::Constant(nan);

struct NoSettings {};
using FreeBodyPotential = BuiltIn<FreeBody<double>, NoSettings>;

struct UniformGravitySettings {
  double mass;
  double gravity;
  Vector3<double> center_of_mass;
};
using UniformGravityPotential = BuiltIn<UniformGravity<double>, UniformGravitySettings>;

struct GravityGradientSettings {
  RigidBody<double> body;
  double orbit_rate;
  Matrix3<double> orbit;
};
using GravityGradientPotential = BuiltIn<GravityGradient<double>, GravityGradientSettings>;

class SumOfPotentials final : public Potential {
 public:
  explicit SumOfPotentials(std::vector<PotentialReference> terms) : terms_(std::move(terms)) {}

  [[nodiscard]] const std::vector<PotentialReference>& terms() const noexcept { return terms_; }

  [[nodiscard]] double energy(const Matrix3<double>& attitude, double time, Failure& failure) const noexcept override {
    return sum_from(0.0, [&](const Potential& term) { return term.energy(attitude, time, failure); });
  }
  [[nodiscard]] Vector3<double> torque(const Matrix3<double>& attitude, double time,
                                       Failure& failure) const noexcept override {
    return sum_from(Vector3<double>(Vector3<double>::Zero()),
                    [&](const Potential& term) { return term.torque(attitude, time, failure); });
  }
  [[nodiscard]] Matrix3<double> torque_jacobian(const Matrix3<double>& attitude, double time,
                                                Failure& failure) const noexcept override {
    return sum_from(Matrix3<double>(Matrix3<double>::Zero()),
                    [&](const Potential& term) { return term.torque_jacobian(attitude, time, failure); });
  }
  [[nodiscard]] std::optional<double> torque_curvature_bound() const override {
    double sum = 0;
    for (const PotentialReference& term : terms_) {
      const std::optional<double> bound = (*term).torque_curvature_bound();
      if (!bound) {
        return std::nullopt;
      }
      sum += *bound;
    }
    return sum;
  }
  [[nodiscard]] Added add_to(BoundedPotential& sum) const noexcept override {
    for (const PotentialReference& term : terms_) {
      if (const Added added = (*term).add_to(sum); added != Added::yes) {
        return added;
      }
    }
    return Added::yes;
  }
  [[nodiscard]] int traverse(visitproc visit, void* argument) const noexcept override {
    for (const PotentialReference& term : terms_) {
      if (const int result = term.traverse(visit, argument); result != 0) {
        return result;
      }
    }
    return 0;
  }

 private:
  template <typename Value, typename OfTerm>
  [[nodiscard]] Value sum_from(Value sum, const OfTerm& of_term) const noexcept {
    for (const PotentialReference& term : terms_) {
      sum += of_term(*term);
    }
    return sum;
  }

  std::vector<PotentialReference> terms_;
};

/// By the paper's formula from an energy and a gradient written in Python.
class PotentialOfGradient final : public Potential {
 public:
  PotentialOfGradient(py::object energy, py::object gradient, std::optional<double> bound)
      : energy_(std::move(energy)), gradient_(std::move(gradient)), bound_(bound) {}

  [[nodiscard]] const py::object& energy_function() const noexcept { return energy_; }
  [[nodiscard]] const py::object& gradient_function() const noexcept { return gradient_; }

  [[nodiscard]] double energy(const Matrix3<double>& attitude, double time, Failure& failure) const noexcept override {
    return guarded(failure, nan, [&] { return called(energy_, "energy", {}, attitude, time).number(0); });
  }
  [[nodiscard]] Vector3<double> torque(const Matrix3<double>& attitude, double time,
                                       Failure& failure) const noexcept override {
    return of_gradient<Vector3<double>>(failure,
                                        [&](const auto& potential) { return potential.torque(attitude, time); });
  }
  [[nodiscard]] Matrix3<double> torque_jacobian(const Matrix3<double>& attitude, double time,
                                                Failure& failure) const noexcept override {
    return of_gradient<Matrix3<double>>(
        failure, [&](const auto& potential) { return potential.torque_jacobian(attitude, time); });
  }
  [[nodiscard]] std::optional<double> torque_curvature_bound() const override { return bound_; }
  [[nodiscard]] int traverse(visitproc visit, void* arg) const noexcept override {
    Py_VISIT(energy_.ptr());
    Py_VISIT(gradient_.ptr());
    return 0;
  }

 private:
  /// f of the core's potential that has this gradient.
  template <typename Result, typename Function>
  [[nodiscard]] Result of_gradient(Failure& failure, const Function& f) const noexcept {
    const auto energy = [&](const Matrix3<double>& attitude, double time) {
      return this->energy(attitude, time, failure);
    };
    const auto gradient = [&](const Matrix3<double>& attitude, double time) {
      return guarded(failure, failed_matrix,
                     [&] { return called(gradient_, "gradient", {3, 3}, attitude, time).matrix3(0); });
    };
    return f(GradientPotential<double, decltype(energy), decltype(gradient)>(energy, gradient));
  }

  py::object energy_;
  py::object gradient_;
  std::optional<double> bound_;
};

/// \throws ValueError unless it is a finite number that is not negative.
[[nodiscard]] double curvature_bound(const py::object& value) {
  const double bound = single(value, "torque_curvature_bound", {}).number(0);
  if (!(bound >= 0)) {
    value_error("torque_curvature_bound must not be negative, but is " + text(bound));
  }
  return bound;
}

/// A potential written in Python. It does not own the object: a PotentialReference does.
class PythonPotential final : public Potential {
 public:
  explicit PythonPotential(const py::handle& object) noexcept : object_(object) {}

  [[nodiscard]] double energy(const Matrix3<double>& attitude, double time, Failure& failure) const noexcept override {
    return guarded(failure, nan,
                   [&] { return called(object_.attr("energy"), "energy", {}, attitude, time).number(0); });
  }
  [[nodiscard]] Vector3<double> torque(const Matrix3<double>& attitude, double time,
                                       Failure& failure) const noexcept override {
    return guarded(failure, failed_vector,
                   [&] { return called(object_.attr("torque"), "torque", {3}, attitude, time).vector<3>(0); });
  }
  [[nodiscard]] Matrix3<double> torque_jacobian(const Matrix3<double>& attitude, double time,
                                                Failure& failure) const noexcept override {
    return guarded(failure, failed_matrix, [&] {
      return called(object_.attr("torque_jacobian"), "torque_jacobian", {3, 3}, attitude, time).matrix3(0);
    });
  }
  [[nodiscard]] std::optional<double> torque_curvature_bound() const override {
    if (!py::hasattr(object_, "torque_curvature_bound")) {
      return std::nullopt;
    }
    return curvature_bound(object_.attr("torque_curvature_bound")());
  }

 private:
  py::handle object_;
};

[[nodiscard]] py::object callable(const py::object& function, const std::string& name) {
  if (PyCallable_Check(function.ptr()) == 0) {
    throw py::type_error(name + " must be a function of (attitude, time), not " + Py_TYPE(function.ptr())->tp_name);
  }
  return function;
}

/// f(attitude, time, failure) of attitudes and times that broadcast.
template <typename Function>
[[nodiscard]] py::object of_attitude_and_time(const py::object& attitude, const py::object& time, const Shape& item,
                                              const Function& f) {
  Items at = attitudes(attitude, "attitude");
  Items times(time, "time", {});
  const Shape leading = broadcast({&at, &times});
  Failure failure;
  py::object result = map_items(leading, item, [&](Index i) { return f(at.matrix3(i), times.number(i), failure); });
  failure.rethrow();
  return result;
}

}  // namespace

Failure& failure_of_this_thread() noexcept {
  thread_local Failure failure;
  return failure;
}

void rethrow_failure_of_this_thread() {
  const Failure failure = std::exchange(failure_of_this_thread(), Failure());
  failure.rethrow();
}

Vector3<double> TorqueOfPotential::torque(const Matrix3<double>& attitude, const double& time) const noexcept {
  return potential->torque(attitude, time, failure_of_this_thread());
}

Matrix3<double> TorqueOfPotential::torque_jacobian(const Matrix3<double>& attitude, const double& time) const noexcept {
  return potential->torque_jacobian(attitude, time, failure_of_this_thread());
}

double not_negative(const py::object& value, const std::string& name) {
  const double number = single(value, name, {}).number(0);
  if (!(number >= 0)) {
    value_error(name + " must not be negative, but is " + text(number));
  }
  return number;
}

PotentialReference::PotentialReference(py::object object, const std::string& name, bool has_energy)
    : object_(std::move(object)) {
  if (py::isinstance<Potential>(object_)) {
    target_ = &object_.cast<const Potential&>();
    return;
  }
  for (const char* method : {"energy", "torque", "torque_jacobian"}) {
    if ((has_energy || std::string(method) != "energy") && !py::hasattr(object_, method)) {
      throw py::type_error(name + " must be a " + (has_energy ? "potential" : "torque") + ", but " +
                           Py_TYPE(object_.ptr())->tp_name + " has no method " + method + "(attitude, time)");
    }
  }
  adapter_ = std::make_shared<PythonPotential>(object_);
  target_ = adapter_.get();
}

int PotentialReference::traverse(visitproc visit, void* arg) const noexcept {
  Py_VISIT(object_.ptr());
  return 0;
}

void define_potentials(py::module_& module) {
  py::class_<Potential>(module, "Potential",
                        R"(A potential U(C, t) of the attitude, in J, and the torque that it exerts.

The base class of this module's potentials. Your own need not derive from it: any object with the methods of
`PotentialLike` will do.
)")
      .def(
          "energy",
          [](const Potential& self, const py::object& attitude, const py::object& time) {
            return of_attitude_and_time(attitude, time, {}, [&](const Matrix3<double>& c, double t, Failure& failure) {
              return self.energy(c, t, failure);
            });
          },
          py::arg("attitude"), py::arg("time") = 0.0, R"(energy(self, attitude, time=0.0)
--

The potential energy U(C, t).

Parameters
----------
attitude : array_like, shape (..., 3, 3), or scipy.spatial.transform.Rotation
    C, from body to reference axes.
time : array_like, shape (...), optional
    t in s; broadcasts against the attitudes.

Returns
-------
float or ndarray, shape (...)
    In J.

Raises
------
ValueError
    If an attitude is not a rotation or a time not finite.
)")
      .def(
          "torque",
          [](const Potential& self, const py::object& attitude, const py::object& time) {
            return of_attitude_and_time(attitude, time, {3}, [&](const Matrix3<double>& c, double t, Failure& failure) {
              return self.torque(c, t, failure);
            });
          },
          py::arg("attitude"), py::arg("time") = 0.0, R"(torque(self, attitude, time=0.0)
--

The torque M, the paper's moment: S(M) = (∂U/∂C)ᵀC − Cᵀ(∂U/∂C).

Parameters
----------
attitude : array_like, shape (..., 3, 3), or scipy.spatial.transform.Rotation
    C, from body to reference axes.
time : array_like, shape (...), optional
    t in s; broadcasts against the attitudes.

Returns
-------
ndarray, shape (..., 3)
    In N m, body axes.

Raises
------
ValueError
    If an attitude is not a rotation or a time not finite.
)")
      .def(
          "torque_jacobian",
          [](const Potential& self, const py::object& attitude, const py::object& time) {
            return of_attitude_and_time(attitude, time, {3, 3},
                                        [&](const Matrix3<double>& c, double t, Failure& failure) {
                                          return self.torque_jacobian(c, t, failure);
                                        });
          },
          py::arg("attitude"), py::arg("time") = 0.0, R"(torque_jacobian(self, attitude, time=0.0)
--

The torque's derivative ∂M/∂ζ at C = Ĉ exp(S(ζ)), ζ = 0.

Parameters
----------
attitude : array_like, shape (..., 3, 3), or scipy.spatial.transform.Rotation
    Ĉ, from body to reference axes.
time : array_like, shape (...), optional
    t in s; broadcasts against the attitudes.

Returns
-------
ndarray, shape (..., 3, 3)
    In N m/rad, body axes.

Raises
------
ValueError
    If an attitude is not a rotation or a time not finite.
)")
      .def("torque_curvature_bound", &Potential::torque_curvature_bound, R"(torque_curvature_bound(self)
--

A bound κ of the remainder of the torque's linearization.

‖M(Ĉ exp(S(ζ))) − M(Ĉ) − (∂M/∂ζ) ζ‖ ≤ κ ‖ζ‖² for every Ĉ, ζ and time.

Returns
-------
float or None
    κ in N m/rad²; None if the potential promises no bound.
)");

  py::class_<FreeBodyPotential, Potential>(module, "FreeBody", py::is_final(), R"(FreeBody()
--

No potential: a free body.
)")
      .def(py::init([] { return FreeBodyPotential({}, {}); }), "__init__(self)\n--\n\n")
      .def("__repr__", [](const FreeBodyPotential&) { return "FreeBody()"; })
      .def("__reduce__", [](const py::object& self) { return py::make_tuple(py::type::of(self), py::tuple()); });

  py::class_<UniformGravityPotential, Potential>(module, "UniformGravity", py::is_final(),
                                                 R"(UniformGravity(mass, gravity, center_of_mass)
--

Uniform gravity on a body held at a point, the 3D pendulum: U = −m g e₃ᵀCρ.

The third reference axis points down. M = m g ρ × Cᵀe₃.

Parameters
----------
mass : float
    m in kg, not negative.
gravity : float
    g in m/s², not negative.
center_of_mass : array_like, shape (3,)
    ρ in m, from the fixed point, body axes.

Raises
------
ValueError
    If an entry is not finite, the shape is another one, or the mass or gravity is negative.
)")
      .def(py::init([](const py::object& mass, const py::object& gravity, const py::object& center_of_mass) {
             const double m = not_negative(mass, "mass");
             const double g = not_negative(gravity, "gravity");
             const Vector3<double> rho = single(center_of_mass, "center_of_mass", {3}).vector<3>(0);
             UniformGravity<double> core;
             raise_unless_ok(UniformGravity<double>::make(m, g, rho, core), "mass, gravity, center_of_mass");
             return UniformGravityPotential(core, {m, g, rho});
           }),
           py::arg("mass"), py::arg("gravity"), py::arg("center_of_mass"),
           "__init__(self, mass, gravity, center_of_mass)\n--\n\n")
      .def_property_readonly(
          "mass", [](const UniformGravityPotential& self) { return self.settings().mass; }, "m in kg.")
      .def_property_readonly(
          "gravity", [](const UniformGravityPotential& self) { return self.settings().gravity; }, "g in m/s².")
      .def_property_readonly(
          "center_of_mass",
          [](const UniformGravityPotential& self) { return to_constant_array(self.settings().center_of_mass); },
          "ρ in m, body axes, shape (3,); read-only.")
      .def("__repr__",
           [](const UniformGravityPotential& self) {
             return py::str("UniformGravity(mass={}, gravity={}, center_of_mass={})")
                 .format(self.settings().mass, self.settings().gravity,
                         to_array(self.settings().center_of_mass).attr("tolist")());
           })
      .def("__reduce__", [](const py::object& self) {
        return py::make_tuple(py::type::of(self),
                              py::make_tuple(self.attr("mass"), self.attr("gravity"), self.attr("center_of_mass")));
      });

  py::class_<GravityGradientPotential, Potential>(module, "GravityGradient", py::is_final(),
                                                  R"(GravityGradient(body, orbit_rate, orbit=None)
--

Gravity gradient on a circular orbit: U = (3n²/2) bᵀJb with b = Cᵀr(t). It depends on time.

r(t) is the unit vector from the attracting body, in reference axes. M = 3n² b × Jb.

Parameters
----------
body : RigidBody
    The body whose inertia the torque acts on.
orbit_rate : float
    n in rad/s, not negative.
orbit : array_like, shape (3, 3), or scipy.spatial.transform.Rotation, optional
    A rotation whose columns are, in reference axes, the radial direction at t = 0, the direction of motion and the orbit
    normal: r(t) = cos(nt) column 0 + sin(nt) column 1. The identity unless given.

Raises
------
ValueError
    If the rate is not finite or negative, or the orbit is not a rotation.
)")
      .def(py::init([](const RigidBody<double>& body, const py::object& orbit_rate, const py::object& orbit) {
             const double rate = not_negative(orbit_rate, "orbit_rate");
             const Matrix3<double> plane =
                 orbit.is_none() ? Matrix3<double>(Matrix3<double>::Identity()) : single_attitude(orbit, "orbit");
             GravityGradient<double> core;
             raise_unless_ok(GravityGradient<double>::make(body, rate, plane, core), "body, orbit_rate, orbit");
             return GravityGradientPotential(core, {body, rate, plane});
           }),
           py::arg("body"), py::arg("orbit_rate"), py::arg("orbit") = py::none(),
           "__init__(self, body, orbit_rate, orbit=None)\n--\n\n")
      .def_property_readonly(
          "body", [](const GravityGradientPotential& self) { return self.settings().body; }, "The body, a RigidBody.")
      .def_property_readonly(
          "orbit_rate", [](const GravityGradientPotential& self) { return self.settings().orbit_rate; }, "n in rad/s.")
      .def_property_readonly(
          "orbit", [](const GravityGradientPotential& self) { return to_constant_array(self.settings().orbit); },
          "The orbit's axes in reference axes, shape (3, 3); read-only.")
      .def("__repr__",
           [](const py::object& self) {
             return py::str("GravityGradient({}, orbit_rate={}, orbit={})")
                 .format(py::repr(self.attr("body")), self.attr("orbit_rate"), self.attr("orbit").attr("tolist")());
           })
      .def("__reduce__", [](const py::object& self) {
        return py::make_tuple(py::type::of(self),
                              py::make_tuple(self.attr("body"), self.attr("orbit_rate"), self.attr("orbit")));
      });

  py::class_<SumOfPotentials, Potential>(module, "SumPotential", py::is_final(), collectable<SumOfPotentials>(),
                                         R"(SumPotential(potentials)
--

The sum of potentials. It has a curvature bound if each of them has.

Parameters
----------
potentials : sequence of Potential or PotentialLike
    At least one.

Raises
------
ValueError
    If there are none.
TypeError
    If one of them is not a potential.
)")
      .def(py::init([](const py::iterable& potentials) {
             std::vector<PotentialReference> terms;
             for (const py::handle& term : potentials) {
               terms.emplace_back(py::reinterpret_borrow<py::object>(term),
                                  "potentials[" + std::to_string(terms.size()) + "]");
             }
             if (terms.empty()) {
               value_error("potentials must hold at least one potential");
             }
             return SumOfPotentials(std::move(terms));
           }),
           py::arg("potentials"), "__init__(self, potentials)\n--\n\n")
      .def_property_readonly(
          "potentials",
          [](const SumOfPotentials& self) {
            py::tuple result(self.terms().size());
            for (std::size_t i = 0; i < self.terms().size(); ++i) {
              result[i] = self.terms()[i].object();
            }
            return result;
          },
          "The potentials, a tuple.")
      .def("__repr__",
           [](const py::object& self) {
             return py::str("SumPotential({})").format(py::repr(py::list(self.attr("potentials"))));
           })
      .def("__reduce__", [](const py::object& self) {
        return py::make_tuple(py::type::of(self), py::make_tuple(self.attr("potentials")));
      });

  py::class_<PotentialOfGradient, Potential>(module, "GradientPotential", py::is_final(),
                                             collectable<PotentialOfGradient>(),
                                             R"(GradientPotential(energy, gradient, torque_curvature_bound=None)
--

A potential from two functions of (attitude, time) of yours: U and ∂U/∂C.

The torque is the paper's M = Σ rᵢ × vᵢ with rᵢ and vᵢ the rows of C and of ∂U/∂C (§2.3.1); its Jacobian is taken by
fourth-order central differences, whose error is about 1e-12 of the torque.

Parameters
----------
energy : callable
    ``energy(attitude, time)`` returns U in J; the attitude has shape (3, 3).
gradient : callable
    ``gradient(attitude, time)`` returns ∂U/∂Cᵢⱼ, shape (3, 3), the entries of C taken as independent.
torque_curvature_bound : float, optional
    κ in N m/rad², not negative, if you can promise one: see `Potential.torque_curvature_bound`.

Raises
------
TypeError
    If one of the functions cannot be called.
ValueError
    If the bound is negative or not finite.
)")
      .def(py::init([](const py::object& energy, const py::object& gradient, const py::object& bound) {
             return PotentialOfGradient(callable(energy, "energy"), callable(gradient, "gradient"),
                                        bound.is_none() ? std::nullopt : std::optional<double>(curvature_bound(bound)));
           }),
           py::arg("energy"), py::arg("gradient"), py::arg("torque_curvature_bound") = py::none(),
           "__init__(self, energy, gradient, torque_curvature_bound=None)\n--\n\n")
      .def("__repr__",
           [](const PotentialOfGradient& self) {
             return py::str("GradientPotential(energy={}, gradient={}, torque_curvature_bound={})")
                 .format(py::repr(self.energy_function()), py::repr(self.gradient_function()),
                         self.torque_curvature_bound());
           })
      .def("__reduce__", [](const py::object& self) {
        const auto& potential = self.cast<const PotentialOfGradient&>();
        return py::make_tuple(py::type::of(self),
                              py::make_tuple(potential.energy_function(), potential.gradient_function(),
                                             potential.torque_curvature_bound()));
      });
}

}  // namespace elliptude::python
