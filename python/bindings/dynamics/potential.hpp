#pragma once

/// \file
/// Potentials behind one interface, the built-in ones and those written in Python.

#include <elliptude/dynamics/potential.hpp>
#include <exception>
#include <memory>
#include <optional>

#include "arrays.hpp"
#include "dynamics/bounded_potential.hpp"
#include "dynamics/ensemble_kernel.hpp"

namespace elliptude::python {

/// The exception of a function written in Python. It belongs to one call from Python and is raised again at its end. The core
/// does not throw, so it sees a torque that is not finite instead.
class Failure {
 public:
  [[nodiscard]] bool happened() const noexcept { return exception_ != nullptr; }
  void keep_current_exception() noexcept { exception_ = std::current_exception(); }
  /// \throws what was kept, if anything.
  void rethrow() const {
    if (exception_) {
      std::rethrow_exception(exception_);
    }
  }

 private:
  std::exception_ptr exception_;
};

/// What a potential in a guaranteed flow of this thread has raised: such a flow outlives a call, its failure does not.
[[nodiscard]] Failure& failure_of_this_thread() noexcept;
/// \throws what it holds, if anything, which it then holds no more.
void rethrow_failure_of_this_thread();

/// elliptude::Potential in Python; for the meaning of its functions see the core's dynamics/potential.hpp.
class Potential {
 public:
  Potential() = default;
  Potential(const Potential&) = default;
  Potential(Potential&&) = default;
  Potential& operator=(const Potential&) = default;
  Potential& operator=(Potential&&) = default;
  virtual ~Potential() = default;

  [[nodiscard]] virtual double energy(const Matrix3<double>& attitude, double time,
                                      Failure& failure) const noexcept = 0;
  [[nodiscard]] virtual Vector3<double> torque(const Matrix3<double>& attitude, double time,
                                               Failure& failure) const noexcept = 0;
  [[nodiscard]] virtual Matrix3<double> torque_jacobian(const Matrix3<double>& attitude, double time,
                                                        Failure& failure) const noexcept = 0;
  /// Empty if the potential promises no bound.
  [[nodiscard]] virtual std::optional<double> torque_curvature_bound() const = 0;
  enum class Added : std::uint8_t { yes, no_bounds, too_many };
  /// Adds this potential to a sum of those that offer the bounds of a guaranteed flow.
  [[nodiscard]] virtual Added add_to(BoundedPotential& /*sum*/) const noexcept { return Added::no_bounds; }
  /// Says what it is to those that move many bodies at a time.
  /// \return whether they have it.
  [[nodiscard]] virtual bool describe(elliptude_kernels::Settings& /*settings*/) const noexcept { return false; }
  /// Shows the garbage collector the Python objects that this one holds.
  [[nodiscard]] virtual int traverse(visitproc /*visit*/, void* /*argument*/) const noexcept { return 0; }
};

/// The potential that the core sees, for the length of one call.
struct PotentialInCall {
  const Potential& potential;
  Failure& failure;

  [[nodiscard]] double energy(const Matrix3<double>& attitude, const double& time) const noexcept {
    return potential.energy(attitude, time, failure);
  }
  [[nodiscard]] Vector3<double> torque(const Matrix3<double>& attitude, const double& time) const noexcept {
    return potential.torque(attitude, time, failure);
  }
  [[nodiscard]] Matrix3<double> torque_jacobian(const Matrix3<double>& attitude, const double& time) const noexcept {
    return potential.torque_jacobian(attitude, time, failure);
  }
};

/// An object of Python's that is a potential: one of this module's, or any with the methods of one.
class PotentialReference {
 public:
  /// \throws TypeError unless it has the methods.
  /// \param has_energy whether it must have an energy too.
  PotentialReference(py::object object, const std::string& name, bool has_energy = true);

  [[nodiscard]] const Potential& operator*() const noexcept { return *target_; }
  [[nodiscard]] const py::object& object() const noexcept { return object_; }
  [[nodiscard]] int traverse(visitproc visit, void* argument) const noexcept;

 private:
  py::object object_;
  std::shared_ptr<const Potential> adapter_;  // of an object that is not this module's
  const Potential* target_;
};

/// Lets the garbage collector see what objects of the type Owner hold (see Owner::traverse), so that an object and a
/// potential that refer to each other are freed. There is nothing to clear: an owner is immutable, like a tuple, and cannot
/// close a cycle without another kind of object in it.
template <typename Owner>
[[nodiscard]] py::custom_type_setup collectable() {
  return py::custom_type_setup([](PyHeapTypeObject* heap_type) {
    PyTypeObject& type = heap_type->ht_type;
    type.tp_flags |= Py_TPFLAGS_HAVE_GC;
    type.tp_traverse = [](PyObject* self, visitproc visit, void* arg) {
      Py_VISIT(Py_TYPE(self));
      if (py::detail::is_holder_constructed(self)) {
        return py::cast<const Owner&>(py::handle(self)).traverse(visit, arg);
      }
      return 0;
    };
  });
}

}  // namespace elliptude::python
