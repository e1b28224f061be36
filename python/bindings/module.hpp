#pragma once

/// \file
/// The parts that the module is made of, in the order in which they need each other.
///
/// A docstring begins with the signature and a line of two hyphens, which Python takes for `inspect.signature` and
/// `help`; the stubs in python/elliptude/_core.pyi are checked against it.

#include <pybind11/pybind11.h>

namespace elliptude::python {

void define_rotations(pybind11::module_& module);
void define_ellipsoids(pybind11::module_& module);
void define_quadrics(pybind11::module_& module);
void define_rigid_body(pybind11::module_& module);
void define_potentials(pybind11::module_& module);
void define_gravity_potentials(pybind11::module_& module);
void define_combined_potentials(pybind11::module_& module);
void define_own_potentials(pybind11::module_& module);
void define_integrator(pybind11::module_& module);
void define_wahba(pybind11::module_& module);
void define_state_ellipsoids(pybind11::module_& module);
void define_flows(pybind11::module_& module);
void define_filter(pybind11::module_& module);
void define_filters(pybind11::module_& module);
void define_guaranteed_flows(pybind11::module_& module);
void define_guaranteed_filter(pybind11::module_& module);
void define_direction_filter(pybind11::module_& module);
/// Last: messages of wrong calls that name the argument, and a line for objects without a `__repr__` of their own.
void define_what_is_said(pybind11::module_& module);

}  // namespace elliptude::python
