#include <elliptude/dynamics/rigid_body.hpp>

#include "arrays.hpp"
#include "module.hpp"
#include "sets/ellipsoids.hpp"

namespace elliptude::python {

namespace {

[[nodiscard]] RigidBody<double> make_body(const py::object& inertia) {
  const Items given(inertia, "inertia", {});
  const Shape& shape = given.leading();
  Matrix3<double> matrix;
  if (shape == Shape{3}) {
    matrix = given.vector<3>(0).asDiagonal();
  } else if (shape == Shape{3, 3}) {
    matrix = symmetric(given.matrix3(0), "inertia");
  } else {
    value_error("inertia must have the shape (3, 3), or (3,) for principal moments, not " + text(shape));
  }
  RigidBody<double> body;
  const Status status = RigidBody<double>::make(matrix, body);
  if (status == Status::not_positive_definite || status == Status::invalid_inertia) {
    SymmetricEigen<double, 3> eigen;
    raise_unless_ok(symmetric_eigen(matrix, eigen), "inertia");
    const Vector3<double>& j = eigen.values;
    const std::string moments = text(j(0)) + ", " + text(j(1)) + ", " + text(j(2)) + " kg m²";
    value_error(status == Status::invalid_inertia
                    ? "inertia breaks the triangle inequality: of the principal moments " + moments +
                          " the largest must not exceed the sum of the others, " + text(j(1) + j(2))
                    : "inertia must be positive definite, but its principal moments are " + moments);
  }
  raise_unless_ok(status, "inertia");
  return body;
}

}  // namespace

void define_rigid_body(py::module_& module) {
  py::class_<RigidBody<double>>(module, "RigidBody", py::is_final(), R"(RigidBody(inertia)
--

A rigid body: its inertia and what follows from it (paper, §2.3.1); immutable.

Parameters
----------
inertia : array_like, shape (3, 3) or (3,)
    J in kg m², body axes, about the point that the body turns about; or the principal moments, if these are the axes.

Raises
------
ValueError
    If an entry is not finite, the shape is another one, J is not symmetric or not positive definite, or a principal moment
    exceeds the sum of the others: no mass distribution has such moments.
)")
      .def(py::init(&make_body), py::arg("inertia"), "__init__(self, inertia)\n--\n\n")
      .def_property_readonly(
          "inertia", [](const RigidBody<double>& self) { return to_constant_array(self.inertia()); },
          "J in kg m², shape (3, 3); read-only.")
      .def_property_readonly(
          "inertia_inverse", [](const RigidBody<double>& self) { return to_constant_array(self.inertia_inverse()); },
          "J⁻¹ in 1/(kg m²), shape (3, 3); read-only.")
      .def_property_readonly(
          "nonstandard_inertia",
          [](const RigidBody<double>& self) { return to_constant_array(self.nonstandard_inertia()); },
          "J_d = ½ tr(J) I − J in kg m² (paper, after eq. updatew0), shape (3, 3); read-only.")
      .def_property_readonly(
          "principal_moments",
          [](const RigidBody<double>& self) { return to_constant_array(self.principal_moments()); },
          "The eigenvalues of J in kg m², largest first, shape (3,); read-only.")
      .def(
          "kinetic_energy",
          [](const RigidBody<double>& self, const py::object& angular_velocity) {
            const Items rates(angular_velocity, "angular_velocity", {3});
            return map_items(rates.leading(), {}, [&](Index i) { return self.kinetic_energy(rates.vector<3>(i)); });
          },
          py::arg("angular_velocity"), R"(kinetic_energy(self, angular_velocity)
--

½ ωᵀJω.

Parameters
----------
angular_velocity : array_like, shape (..., 3)
    ω in rad/s, body axes.

Returns
-------
float or ndarray, shape (...)
    In J.

Raises
------
ValueError
    If an entry is not finite or the shape is another one.
)")
      .def(
          "angular_momentum",
          [](const RigidBody<double>& self, const py::object& attitude, const py::object& angular_velocity) {
            Items at = attitudes(attitude, "attitude");
            Items rates(angular_velocity, "angular_velocity", {3});
            return map_items(broadcast({&at, &rates}), {3}, [&](Index i) {
              return self.angular_momentum(RigidBodyState<double>{at.matrix3(i), rates.vector<3>(i)});
            });
          },
          py::arg("attitude"), py::arg("angular_velocity"), R"(angular_momentum(self, attitude, angular_velocity)
--

CJω, the angular momentum in reference axes: constant for a free body.

Parameters
----------
attitude : array_like, shape (..., 3, 3), or scipy.spatial.transform.Rotation
    C, from body to reference axes.
angular_velocity : array_like, shape (..., 3)
    ω in rad/s, body axes.

Returns
-------
ndarray, shape (..., 3)
    In N m s.

Raises
------
ValueError
    If an attitude is not a rotation, an entry is not finite or a shape does not fit.
)")
      .def(
          "__eq__",
          [](const RigidBody<double>& self, const RigidBody<double>& other) {
            return self.inertia() == other.inertia();
          },
          py::is_operator(), py::arg("other"))
      .def(
          "__repr__",
          [](const py::object& self) { return py::str("RigidBody({})").format(self.attr("inertia").attr("tolist")()); })
      .def("__reduce__", [](const py::object& self) {
        return py::make_tuple(py::type::of(self), py::make_tuple(self.attr("inertia")));
      });
}

}  // namespace elliptude::python
