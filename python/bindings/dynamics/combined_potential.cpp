#include <utility>

#include "dynamics/python_function.hpp"
#include "module.hpp"

namespace elliptude::python {

namespace {

/// Potentials that add up, the core's or those written in Python.
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
    return guarded(failure, failed_number, [&] { return called(energy_, "energy", {}, attitude, time).number(0); });
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

[[nodiscard]] py::object callable(const py::object& function, const std::string& name) {
  if (PyCallable_Check(function.ptr()) == 0) {
    throw py::type_error(name + " must be a function of (attitude, time), not " + Py_TYPE(function.ptr())->tp_name);
  }
  return function;
}

}  // namespace

void define_combined_potentials(py::module_& module) {
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
