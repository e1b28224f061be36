#include <elliptude/dynamics/potential.hpp>

#include "dynamics/built_in_potential.hpp"
#include "module.hpp"

namespace elliptude::python {

namespace {

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

}  // namespace

void define_gravity_potentials(py::module_& module) {
  py::class_<FreeBodyPotential, Potential> free_body(module, "FreeBody", py::is_final(), R"(FreeBody()
--

No potential: a free body.
)");
  free_body.def(py::init([] { return FreeBodyPotential({}, {}); }), "__init__(self)\n--\n\n");
  define_parameters(free_body);

  py::class_<UniformGravityPotential, Potential> uniform_gravity(module, "UniformGravity", py::is_final(),
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
)");
  uniform_gravity.def(py::init([](const py::object& mass, const py::object& gravity, const py::object& center_of_mass) {
                        const double m = not_negative(mass, "mass");
                        const double g = not_negative(gravity, "gravity");
                        const Vector3<double> rho = single(center_of_mass, "center_of_mass", {3}).vector<3>(0);
                        UniformGravity<double> core;
                        raise_unless_ok(UniformGravity<double>::make(m, g, rho, core), "mass, gravity, center_of_mass");
                        return UniformGravityPotential(core, {m, g, rho});
                      }),
                      py::arg("mass"), py::arg("gravity"), py::arg("center_of_mass"),
                      "__init__(self, mass, gravity, center_of_mass)\n--\n\n");
  using Uniform = UniformGravitySettings;
  define_parameters(uniform_gravity, Parameter{"mass", &Uniform::mass, "m in kg."},
                    Parameter{"gravity", &Uniform::gravity, "g in m/s²."},
                    Parameter{"center_of_mass", &Uniform::center_of_mass, "ρ in m, body axes, shape (3,); read-only."});

  py::class_<GravityGradientPotential, Potential> gravity_gradient(module, "GravityGradient", py::is_final(),
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
)");
  gravity_gradient.def(
      py::init([](const RigidBody<double>& body, const py::object& orbit_rate, const py::object& orbit) {
        const double rate = not_negative(orbit_rate, "orbit_rate");
        const Matrix3<double> plane =
            orbit.is_none() ? Matrix3<double>(Matrix3<double>::Identity()) : single_attitude(orbit, "orbit");
        GravityGradient<double> core;
        raise_unless_ok(GravityGradient<double>::make(body, rate, plane, core), "body, orbit_rate, orbit");
        return GravityGradientPotential(core, {body, rate, plane});
      }),
      py::arg("body"), py::arg("orbit_rate"), py::arg("orbit") = py::none(),
      "__init__(self, body, orbit_rate, orbit=None)\n--\n\n");
  using Gradient = GravityGradientSettings;
  define_parameters(
      gravity_gradient, Parameter{"body", &Gradient::body, "The body, a RigidBody."},
      Parameter{"orbit_rate", &Gradient::orbit_rate, "n in rad/s."},
      Parameter{"orbit", &Gradient::orbit, "The orbit's axes in reference axes, shape (3, 3); read-only."});
}

}  // namespace elliptude::python
