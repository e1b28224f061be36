#include "dynamics/potential.hpp"

#include <pybind11/stl.h>

#include <utility>

#include "dynamics/built_in_potential.hpp"
#include "dynamics/python_function.hpp"
#include "module.hpp"

namespace elliptude::python {

namespace {

/// A potential written in Python. It does not own the object: a PotentialReference does.
class PythonPotential final : public Potential {
 public:
  explicit PythonPotential(const py::handle& object) noexcept : object_(object) {}

  [[nodiscard]] double energy(const Matrix3<double>& attitude, double time, Failure& failure) const noexcept override {
    return guarded(failure, failed_number,
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
}

}  // namespace elliptude::python
