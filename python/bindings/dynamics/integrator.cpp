#include "dynamics/integrator.hpp"

#include <elliptude/dynamics/linearization.hpp>
#include <utility>

#include "module.hpp"

namespace elliptude::python {

void raise_integration(Status status, const Failure& failure, const Integrator& integrator,
                       const RigidBodyState<double>& state, const std::string& where) {
  failure.rethrow();
  if (status == Status::step_too_long && integrator.is_exact) {
    value_error("step " + text(integrator.step) + " s is too long" + where +
                ": rounding leaves nothing of the turn within it, and the angular velocity is " +
                text(state.angular_velocity.norm()) + " rad/s");
  }
  if (status == Status::step_too_long) {
    value_error("step " + text(integrator.step) + " s is too long" + where +
                ": the turn within a stage must stay below a right angle, and the angular velocity is " +
                text(state.angular_velocity.norm()) + " rad/s");
  }
  if (status == Status::callback_failed) {
    value_error("potential: its torque or torque_jacobian is not finite" + where);
  }
  raise(status, "integrator" + where);
}

py::object control_torque_or_zero(const py::object& given) {
  return given.is_none() ? py::object(to_array(Vector3<double>(Vector3<double>::Zero()))) : given;
}

Index positive_count(const py::object& value, const std::string& name) {
  const Index number = PyNumber_AsSsize_t(value.ptr(), PyExc_OverflowError);
  if (number == -1 && PyErr_Occurred() != nullptr) {
    py::raise_from(PyExc_TypeError, (name + " must be an integer").c_str());
    throw py::error_already_set();
  }
  if (number < 1) {
    value_error(name + " must be at least 1, but is " + std::to_string(number));
  }
  return number;
}

namespace {

[[nodiscard]] double step_argument(const py::object& value) {
  const double step = single(value, "step", {}).number(0);
  if (!(step > 0)) {
    value_error("step must be positive, but is " + text(step) + " s");
  }
  return step;
}

[[nodiscard]] Integrator make_integrator(const RigidBody<double>& body, const py::object& potential,
                                         const py::object& step, int order, const std::string& free_rotor) {
  if (free_rotor != "variational" && free_rotor != "exact") {
    value_error("free_rotor must be 'variational' or 'exact', not '" + free_rotor + "'");
  }
  Composition<double> composition{};
  Splitting<double> splitting{};
  if (composition_of_order(order, composition) != Status::ok || splitting_of_order(order, splitting) != Status::ok) {
    value_error("order must be 2, 4, 6 or 8, but is " + std::to_string(order));
  }
  const py::object given = potential.is_none() ? py::module_::import("elliptude").attr("FreeBody")() : potential;
  ExactRotor<double> rotor;
  if (const Status status = ExactRotor<double>::make(body, rotor); status != Status::ok) {
    raise(status, "body");
  }
  return {body,
          PotentialReference(given, "potential"),
          step_argument(step),
          order,
          free_rotor == "exact",
          composition,
          rotor,
          splitting};
}

[[nodiscard]] py::tuple step_once(const Integrator& self, const py::object& attitude,
                                  const py::object& angular_velocity, const py::object& time,
                                  const py::object& control_torque) {
  const InitialStates start(attitude, angular_velocity, time, control_torque);
  Results attitudes_after(start.leading(), {3, 3});
  Results rates_after(start.leading(), {3});
  Failure failure;
  {
    const py::gil_scoped_release release;
    const Index count = start.count();
    for (Index i = 0; i < count; ++i) {
      const RigidBodyState<double> state = start.state(i);
      RigidBodyState<double> next;
      const Status status = self.with_method([&](const auto& body, const auto& method) {
        return integrate_step(body, PotentialInCall{*self.potential, failure}, method, start.time(i), self.step,
                              start.control_torque(i), state, next);
      });
      if (status != Status::ok) {
        raise_integration(status, failure, self, state, start.where(i));
      }
      attitudes_after.set(i, next.attitude);
      rates_after.set(i, next.angular_velocity);
    }
  }
  return py::make_tuple(attitudes_after.array(), rates_after.array());
}

[[nodiscard]] py::object linearize(const Integrator& self, const py::object& attitude,
                                   const py::object& angular_velocity, const py::object& steps, const py::object& time,
                                   const py::object& control_torque) {
  const InitialStates start(attitude, angular_velocity, time, control_torque);
  const Index step_count = positive_count(steps, "steps");
  Results attitudes_after(start.leading(), {3, 3});
  Results rates_after(start.leading(), {3});
  Results by_state(start.leading(), {6, 6});
  Results by_control(start.leading(), {6, 3});
  Failure failure;
  {
    const py::gil_scoped_release release;
    const Index count = start.count();
    for (Index i = 0; i < count; ++i) {
      const RigidBodyState<double> state = start.state(i);
      RigidBodyState<double> next;
      FlowLinearization<double> linearization = FlowLinearization<double>::identity();
      const Status status = self.with_method([&](const auto& body, const auto& method) {
        return integrate_linearized(body, PotentialInCall{*self.potential, failure}, method, start.time(i), self.step,
                                    static_cast<long>(step_count), start.control_torque(i), state, next, linearization);
      });
      if (status != Status::ok) {
        raise_integration(status, failure, self, state, start.where(i));
      }
      // An error in the Jacobian alone leaves the core nothing to notice at the first stage.
      failure.rethrow();
      attitudes_after.set(i, next.attitude);
      rates_after.set(i, next.angular_velocity);
      by_state.set(i, linearization.state);
      by_control.set(i, linearization.control);
    }
  }
  return py::module_::import("elliptude.results")
      .attr("FlowLinearization")(attitudes_after.array(), rates_after.array(), by_state.array(), by_control.array());
}

[[nodiscard]] py::object relative_attitudes(const RigidBody<double>& body, const py::object& step,
                                            const py::object& momentum, const std::string& form) {
  if (form != "cayley" && form != "exponential") {
    value_error("form must be 'cayley' or 'exponential', not '" + form + "'");
  }
  const double h = single(step, "step", {}).number(0);
  const Items momenta(momentum, "momentum", {3});
  return map_items(momenta.leading(), {3, 3}, [&](Index i) {
    const Vector3<double> a = momenta.vector<3>(i);
    Matrix3<double> f;
    const Status status =
        form == "cayley" ? relative_attitude(body, h, a, f) : relative_attitude_exponential(body, h, a, f);
    if (status == Status::step_too_long) {
      value_error("step " + text(h) + " s is too long for " + momenta.label(i) + ", whose length is " + text(a.norm()) +
                  " N m s: the turn within the step must stay below a right angle");
    }
    if (status != Status::ok) {
      raise(status, momenta.label(i));
    }
    return f;
  });
}

}  // namespace

void define_integrator(py::module_& module) {
  py::class_<Integrator> integrator(module, "Integrator", py::is_final(), collectable<Integrator>(),
                                    R"(Integrator(body, potential=None, *, step, order=2, free_rotor='variational')
--

The Lie group variational integrator (paper, eqs. findf0, updateR0, updatew0) and symmetric compositions of it.

It keeps the attitude a rotation and the momentum map of a symmetric potential to rounding, and its energy error does not
grow. Immutable.

With ``free_rotor='exact'`` it is the splitting with the exact free rigid body instead, of the same orders: kicks of the torque
and, between them, the motion of the free body by Jacobi's elliptic functions.

Parameters
----------
body : RigidBody
potential : Potential or PotentialLike, optional
    The potential that the body moves in; a `FreeBody` unless given. One written in Python is called with the interpreter's lock,
    at least twice a step, and an exception that it raises comes out of the method that was called.
step : float
    h in s, positive.
order : {2, 4, 6, 8}, optional
    2 is the step itself; 4 composes it of 5 stages, 6 of 9, 8 of 17. With the exact free rotor 4 takes 6 stages, 6 takes 11, with
    errors some fifty times smaller for the same number of stages in all.
free_rotor : {'variational', 'exact'}, optional
    How the body moves between the kicks of the torque: by the paper's discrete free rotor, or exactly. An exact one costs more
    per stage and pays in orders from 4 on, and where the torque is small beside the turn; a free body then moves without error in
    steps of any length.

Raises
------
ValueError
    If the step is not positive, or the order or the free rotor is another one.
TypeError
    If the potential is not one.

Examples
--------
>>> import numpy as np
>>> from elliptude import Integrator, RigidBody, UniformGravity
>>> body = RigidBody([0.13, 0.28, 0.17])
>>> pendulum = Integrator(body, UniformGravity(1.0, 9.81, [0.0, 0.0, 0.3]), step=0.002)
>>> trajectory = pendulum.trajectory(np.eye(3), [0.5, -0.5, 0.4], steps=1000)
>>> trajectory.attitudes.shape
(1001, 3, 3)
)");
  integrator
      .def(py::init(&make_integrator), py::arg("body"), py::arg("potential") = py::none(), py::kw_only(),
           py::arg("step"), py::arg("order") = 2, py::arg("free_rotor") = "variational",
           "__init__(self, body, potential=None, *, step, order=2, free_rotor='variational')\n--\n\n")
      .def_property_readonly(
          "body", [](const Integrator& self) { return self.body; }, "The body, a RigidBody.")
      .def_property_readonly(
          "potential", [](const Integrator& self) { return self.potential.object(); },
          "The potential, the object that was given.")
      .def_property_readonly(
          "step_length", [](const Integrator& self) { return self.step; }, "h in s.")
      .def_property_readonly(
          "order", [](const Integrator& self) { return self.order; }, "2, 4, 6 or 8.")
      .def_property_readonly(
          "free_rotor", [](const Integrator& self) { return self.is_exact ? "exact" : "variational"; },
          "'variational' or 'exact'.")
      .def("step", &step_once, py::arg("attitude"), py::arg("angular_velocity"), py::arg("time") = 0.0,
           py::arg("control_torque") = py::none(),
           R"(step(self, attitude, angular_velocity, time=0.0, control_torque=None)
--

One step of one or many states. The leading shapes of all arguments broadcast.

Parameters
----------
attitude : array_like, shape (..., 3, 3), or scipy.spatial.transform.Rotation
    C, from body to reference axes.
angular_velocity : array_like, shape (..., 3)
    ω in rad/s, body axes.
time : array_like, shape (...), optional
    t in s at the start.
control_torque : array_like, shape (..., 3), optional
    In N m, body axes, constant over the step; zero unless given.

Returns
-------
attitude : ndarray, shape (..., 3, 3)
angular_velocity : ndarray, shape (..., 3)

Raises
------
ValueError
    If an attitude is not a rotation, an entry is not finite, a shape does not fit, or the step is too long for an angular
    velocity.
)")
      .def("trajectory", &trajectory, py::arg("attitude"), py::arg("angular_velocity"), py::arg("steps"),
           py::arg("time") = 0.0, py::arg("control_torque") = py::none(), py::arg("every") = 1,
           R"(trajectory(self, attitude, angular_velocity, steps, time=0.0, control_torque=None, every=1)
--

Many steps from one state.

Parameters
----------
attitude : array_like, shape (3, 3), or scipy.spatial.transform.Rotation
    C, from body to reference axes.
angular_velocity : array_like, shape (3,)
    ω in rad/s, body axes.
steps : int
    At least 1.
time : float, optional
    t in s at the start.
control_torque : array_like, shape (3,) or (steps, 3), optional
    In N m, body axes: constant, or constant over each step; zero unless given.
every : int, optional
    How many steps lie between states that are kept; it divides the number of steps.

Returns
-------
Trajectory
    With ``times``, shape (n + 1,), ``attitudes``, shape (n + 1, 3, 3), and ``angular_velocities``, shape (n + 1, 3), where
    n = steps/every; the first is the start.

Raises
------
ValueError
    If the attitude is not a rotation, an entry is not finite, a shape or count does not fit, or the step is too long for the
    angular velocity.
)")
      .def("trajectory_at", &trajectory_at, py::arg("attitude"), py::arg("angular_velocity"), py::arg("times"),
           py::arg("time") = 0.0, py::arg("control_torque") = py::none(),
           R"(trajectory_at(self, attitude, angular_velocity, times, time=0.0, control_torque=None)
--

The states at any times, from one state on, by steps as long as the integrator's.

Between two steps the motion is the polynomial of degree five that has the attitude, the angular velocity and its derivative of
both (theory, section 4.3). A step must turn the body by less than a right angle, and may otherwise be as long as its error
allows, however close the times are.

Parameters
----------
attitude : array_like, shape (3, 3), or scipy.spatial.transform.Rotation
    C, from body to reference axes.
angular_velocity : array_like, shape (3,)
    ω in rad/s, body axes.
times : array_like, shape (n,)
    In s, ascending; the first is not before ``time``.
time : float, optional
    t in s at the start.
control_torque : array_like, shape (3,), optional
    In N m, body axes, constant; zero unless given.

Returns
-------
Trajectory
    With ``times``, shape (n,), ``attitudes``, shape (n, 3, 3), and ``angular_velocities``, shape (n, 3).

Raises
------
ValueError
    If the attitude is not a rotation, an entry is not finite, a shape does not fit, the times do not ascend, or the step is too
    long for the angular velocity.

Examples
--------
>>> import numpy as np
>>> from elliptude import Integrator, RigidBody, UniformGravity
>>> body = RigidBody([0.13, 0.28, 0.17])
>>> pendulum = Integrator(body, UniformGravity(1.0, 9.81, [0, 0, 0.3]), step=0.03, order=6, free_rotor="exact")
>>> pendulum.trajectory_at(np.eye(3), [0.5, -0.5, 0.4], np.linspace(0, 12, 1001)).attitudes.shape
(1001, 3, 3)
)")
      .def("linearize", &linearize, py::arg("attitude"), py::arg("angular_velocity"), py::arg("steps") = 1,
           py::arg("time") = 0.0, py::arg("control_torque") = py::none(),
           R"(linearize(self, attitude, angular_velocity, steps=1, time=0.0, control_torque=None)
--

Steps of one or many states, and their linearization x⁺ = A x + B δu (paper, §3.1 and eq. flow).

x = [ζ; δω], with ζ the error rotation vector on the body side, C = Ĉ exp(S(ζ)); δu is a change of the control torque. The
leading shapes of all arguments broadcast.

Parameters
----------
attitude : array_like, shape (..., 3, 3), or scipy.spatial.transform.Rotation
    Ĉ, from body to reference axes.
angular_velocity : array_like, shape (..., 3)
    ω̂ in rad/s, body axes.
steps : int, optional
    At least 1.
time : array_like, shape (...), optional
    t in s at the start.
control_torque : array_like, shape (..., 3), optional
    u in N m, body axes, constant over all the steps; zero unless given.

Returns
-------
FlowLinearization
    With ``attitude``, shape (..., 3, 3), and ``angular_velocity``, shape (..., 3), at the end, ``state``, A, shape
    (..., 6, 6), of determinant 1, and ``control``, B, shape (..., 6, 3).

Raises
------
ValueError
    As for `step`, or if ``steps`` is not positive.
)")
      .def("__repr__",
           [](const py::object& self) {
             const py::str rotor = py::cast<const Integrator&>(self).is_exact ? ", free_rotor='exact'" : "";
             return py::str("Integrator({}, {}, step={}, order={}{})")
                 .format(py::repr(self.attr("body")), py::repr(self.attr("potential")), self.attr("step_length"),
                         self.attr("order"), rotor);
           })
      .def("__reduce__", [](const py::object& self) {
        // The step can be given by name only.
        return py::make_tuple(py::module_::import("functools")
                                  .attr("partial")(py::type::of(self), py::arg("step") = self.attr("step_length"),
                                                   py::arg("order") = self.attr("order"),
                                                   py::arg("free_rotor") = self.attr("free_rotor")),
                              py::make_tuple(self.attr("body"), self.attr("potential")));
      });

  define_ensembles(integrator);

  module.def("relative_attitude", &relative_attitudes, py::arg("body"), py::arg("step"), py::arg("momentum"),
             py::arg("form") = "cayley", R"(relative_attitude(body, step, momentum, form='cayley')
--

F, the rotation within one step, from h S(a) = F J_d − J_d Fᵀ (paper, eq. findf0).

Parameters
----------
body : RigidBody
step : float
    h in s; negative within compositions.
momentum : array_like, shape (..., 3)
    a = Jω + (h/2) M in N m s, body axes.
form : {'cayley', 'exponential'}, optional
    How F is written while the equation is solved: by the Cayley map, which needs no trigonometric function, or as the
    paper's exp(S(f)). The result is the same to rounding.

Returns
-------
ndarray, shape (..., 3, 3)

Raises
------
ValueError
    If an entry is not finite, a shape does not fit, the form is unknown or the step is too long.
)");
}

}  // namespace elliptude::python
