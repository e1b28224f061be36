#include <algorithm>
#include <elliptude/dynamics/linearization.hpp>
#include <utility>

#include "dynamics/potential.hpp"
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

/// The integrator's settings. The potential is kept as the Python object that was given.
struct Integrator {
  RigidBody<double> body;
  PotentialReference potential;
  double step;
  int order;
  Composition<double> composition;

  [[nodiscard]] int traverse(visitproc visit, void* argument) const noexcept {
    return potential.traverse(visit, argument);
  }
};

[[nodiscard]] double step_argument(const py::object& value) {
  const double step = single(value, "step", {}).number(0);
  if (!(step > 0)) {
    value_error("step must be positive, but is " + text(step) + " s");
  }
  return step;
}

[[nodiscard]] Integrator make_integrator(const RigidBody<double>& body, const py::object& potential,
                                         const py::object& step, int order) {
  Composition<double> composition{};
  if (composition_of_order(order, composition) != Status::ok) {
    value_error("order must be 2, 4, 6 or 8, but is " + std::to_string(order));
  }
  const py::object given = potential.is_none() ? py::module_::import("elliptude").attr("FreeBody")() : potential;
  return {body, PotentialReference(given, "potential"), step_argument(step), order, composition};
}

/// \throws ValueError for a status of the core's integrator that is not `ok`; Python's own exception where a potential has
/// raised one.
[[noreturn]] void raise_integration(Status status, const Failure& failure, const Integrator& integrator,
                                    const RigidBodyState<double>& state, const std::string& where) {
  failure.rethrow();
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

[[nodiscard]] py::object control_torque_or_zero(const py::object& given) {
  return given.is_none() ? py::object(to_array(Vector3<double>(Vector3<double>::Zero()))) : given;
}

/// The initial states, times and control torques of a call, broadcast.
class InitialStates {
 public:
  InitialStates(const py::object& attitude, const py::object& angular_velocity, const py::object& time,
                const py::object& control_torque)
      : attitude_(attitudes(attitude, "attitude")),
        angular_velocity_(angular_velocity, "angular_velocity", {3}),
        time_(time, "time", {}),
        control_torque_(control_torque_or_zero(control_torque), "control_torque", {3}),
        leading_(broadcast({&attitude_, &angular_velocity_, &time_, &control_torque_})) {}

  [[nodiscard]] const Shape& leading() const noexcept { return leading_; }
  [[nodiscard]] Index count() const noexcept { return count_of(leading_); }
  [[nodiscard]] RigidBodyState<double> state(Index i) const noexcept {
    return {attitude_.matrix3(i), angular_velocity_.vector<3>(i)};
  }
  [[nodiscard]] double time(Index i) const noexcept { return time_.number(i); }
  [[nodiscard]] Vector3<double> control_torque(Index i) const noexcept { return control_torque_.vector<3>(i); }
  /// " for item [3]", where there is more than one.
  [[nodiscard]] std::string where(Index i) const { return leading_.empty() ? "" : " for item " + place(leading_, i); }

 private:
  Items attitude_;
  Items angular_velocity_;
  Items time_;
  Items control_torque_;
  Shape leading_;
};

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
      const Status status = integrate_step(self.body, PotentialInCall{*self.potential, failure}, self.composition,
                                           start.time(i), self.step, start.control_torque(i), state, next);
      if (status != Status::ok) {
        raise_integration(status, failure, self, state, start.where(i));
      }
      attitudes_after.set(i, next.attitude);
      rates_after.set(i, next.angular_velocity);
    }
  }
  return py::make_tuple(attitudes_after.array(), rates_after.array());
}

[[nodiscard]] Index positive_count(const py::object& value, const std::string& name) {
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

[[nodiscard]] py::object trajectory(const Integrator& self, const py::object& attitude,
                                    const py::object& angular_velocity, const py::object& steps, const py::object& time,
                                    const py::object& control_torque, const py::object& every) {
  RigidBodyState<double> state{single_attitude(attitude, "attitude"),
                               single(angular_velocity, "angular_velocity", {3}).vector<3>(0)};
  const Index step_count = positive_count(steps, "steps");
  const Index stride = positive_count(every, "every");
  if (step_count % stride != 0) {
    value_error("every must divide steps, so that the last state is there, but is " + std::to_string(stride) + " for " +
                std::to_string(step_count) + " steps");
  }
  const double start = single(time, "time", {}).number(0);
  const Items controls(control_torque_or_zero(control_torque), "control_torque", {3});
  const bool constant_control = controls.leading().empty();
  if (!constant_control && controls.leading() != Shape{step_count}) {
    Shape shape = controls.leading();
    shape.push_back(3);
    value_error("control_torque must have the shape (3,) or (steps, 3) = " + text({step_count, 3}) + ", not " +
                text(shape));
  }

  const Index rows = step_count / stride + 1;
  Results times({rows}, {});
  Results attitudes_at({rows}, {3, 3});
  Results rates_at({rows}, {3});
  const auto record = [&](Index row, const RigidBodyState<double>& at) {
    times.set(row, start + static_cast<double>(row * stride) * self.step);
    attitudes_at.set(row, at.attitude);
    rates_at.set(row, at.angular_velocity);
  };
  record(0, state);
  Failure failure;
  {
    const py::gil_scoped_release release;
    // Ctrl-C is looked for after this many steps, some milliseconds.
    constexpr Index longest_run = 1 << 15;
    Index run = 0;
    for (Index done = 0; done < step_count; done += run) {
      run = constant_control ? std::min(longest_run, step_count - done) : 1;
      RigidBodyState<double> latest = state;
      Index completed = done;
      const Status status = integrate(self.body, PotentialInCall{*self.potential, failure}, self.composition,
                                      start + static_cast<double>(done) * self.step, self.step, static_cast<long>(run),
                                      controls.vector<3>(constant_control ? 0 : done), state, state,
                                      [&](long k, const RigidBodyState<double>& at) {
                                        latest = at;
                                        completed = done + k;
                                        if (completed % stride == 0) {
                                          record(completed / stride, at);
                                        }
                                      });
      if (status != Status::ok) {
        raise_integration(status, failure, self, latest, " after " + std::to_string(completed) + " steps");
      }
      if ((done + run) / longest_run > done / longest_run) {
        const py::gil_scoped_acquire acquire;
        if (PyErr_CheckSignals() != 0) {
          throw py::error_already_set();
        }
      }
    }
  }
  return py::module_::import("elliptude.results")
      .attr("Trajectory")(times.array(), attitudes_at.array(), rates_at.array());
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
      const Status status = integrate_linearized(self.body, PotentialInCall{*self.potential, failure}, self.composition,
                                                 start.time(i), self.step, static_cast<long>(step_count),
                                                 start.control_torque(i), state, next, linearization);
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

void define_integrator(py::module_& module) {
  py::class_<Integrator>(module, "Integrator", py::is_final(), collectable<Integrator>(),
                         R"(Integrator(body, potential=None, *, step, order=2)
--

The Lie group variational integrator (paper, eqs. findf0, updateR0, updatew0) and symmetric compositions of it.

It keeps the attitude a rotation and the momentum map of a symmetric potential to rounding, and its energy error does not
grow. Immutable.

Parameters
----------
body : RigidBody
potential : Potential or PotentialLike, optional
    The potential that the body moves in; a `FreeBody` unless given. One written in Python is called with the interpreter's lock,
    at least twice a step, and an exception that it raises comes out of the method that was called.
step : float
    h in s, positive.
order : {2, 4, 6, 8}, optional
    2 is the step itself; 4 composes it of 5 stages, 6 of 9, 8 of 17.

Raises
------
ValueError
    If the step is not positive or the order is another one.
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
)")
      .def(py::init(&make_integrator), py::arg("body"), py::arg("potential") = py::none(), py::kw_only(),
           py::arg("step"), py::arg("order") = 2, "__init__(self, body, potential=None, *, step, order=2)\n--\n\n")
      .def_property_readonly(
          "body", [](const Integrator& self) { return self.body; }, "The body, a RigidBody.")
      .def_property_readonly(
          "potential", [](const Integrator& self) { return self.potential.object(); },
          "The potential, the object that was given.")
      .def_property_readonly(
          "step_length", [](const Integrator& self) { return self.step; }, "h in s.")
      .def_property_readonly(
          "order", [](const Integrator& self) { return self.order; }, "2, 4, 6 or 8.")
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
             return py::str("Integrator({}, {}, step={}, order={})")
                 .format(py::repr(self.attr("body")), py::repr(self.attr("potential")), self.attr("step_length"),
                         self.attr("order"));
           })
      .def("__reduce__", [](const py::object& self) {
        // The step can be given by name only.
        return py::make_tuple(py::module_::import("functools")
                                  .attr("partial")(py::type::of(self), py::arg("step") = self.attr("step_length"),
                                                   py::arg("order") = self.attr("order")),
                              py::make_tuple(self.attr("body"), self.attr("potential")));
      });

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
