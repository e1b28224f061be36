#include "first_order/flow.hpp"

#include "measurement/arguments.hpp"
#include "module.hpp"

namespace elliptude::python {

namespace {

[[nodiscard]] BodyFlowSettings make_body_flow(const RigidBody<double>& body, const py::object& potential,
                                              const py::object& step, int order, const py::object& unknown_torque,
                                              long most_steps) {
  Composition<double> composition{};
  if (composition_of_order(order, composition) != Status::ok) {
    value_error("order must be 2, 4, 6 or 8, but is " + std::to_string(order));
  }
  const double longest_step = single(step, "step", {}).number(0);
  if (!(longest_step > 0)) {
    value_error("step must be positive, but is " + text(longest_step) + " s");
  }
  check_most_steps(most_steps);
  const py::object given = potential.is_none() ? py::module_::import("elliptude").attr("FreeBody")() : potential;
  return {body,
          PotentialReference(given, "potential"),
          longest_step,
          order,
          unknown_torque.is_none() ? Matrix3<double>(Matrix3<double>::Zero())
                                   : one_bound(unknown_torque, "unknown_torque", true),
          most_steps};
}

}  // namespace

void define_flows(py::module_& module) {
  using namespace py::literals;

  py::class_<BodyFlowSettings>(
      module, "RigidBodyFlow", collectable<BodyFlowSettings>(),
      R"(RigidBodyFlow(body, potential=None, *, step, order=2, unknown_torque=None, most_steps=1000000)
--

How a rigid body in a potential moves between measurements: the variational integrator and its linearization.

Parameters
----------
body : RigidBody
potential : a potential, optional
    A free body if omitted.
step : float
    The longest step, s; an interval is divided into the fewest equal steps that are no longer but for a thousandth.
order : {2, 4, 6, 8}
    Order of the integrator.
unknown_torque : float or (3, 3) array_like, optional
    An additional unknown torque, constant over each step, which may be anything in a ball of this radius (N m) or an ellipsoid
    of this shape ((N m)²) from step to step.
most_steps : int
    A prediction over more steps is refused: such a time is more likely an error than intended.
)")
      .def(py::init(&make_body_flow), "body"_a, "potential"_a = py::none(), py::kw_only(), "step"_a, "order"_a = 2,
           "unknown_torque"_a = py::none(), "most_steps"_a = default_most_steps,
           "__init__(self, body, potential=None, *, step, order=2, unknown_torque=None, most_steps=1000000)\n--\n\n")
      .def_property_readonly("body", [](const BodyFlowSettings& self) { return self.body; })
      .def_property_readonly("potential", [](const BodyFlowSettings& self) { return self.potential.object(); })
      .def_readonly("step", &BodyFlowSettings::step)
      .def_readonly("order", &BodyFlowSettings::order)
      .def_property_readonly("unknown_torque",
                             [](const BodyFlowSettings& self) { return to_constant_array(self.unknown_torque); })
      .def_readonly("most_steps", &BodyFlowSettings::most_steps)
      .def(py::pickle(
          [](const BodyFlowSettings& self) {
            return py::make_tuple(self.body, self.potential.object(), self.step, self.order,
                                  to_array(self.unknown_torque), self.most_steps);
          },
          [](const py::tuple& state) {
            return make_body_flow(state[0].cast<RigidBody<double>>(), state[1], state[2], state[3].cast<int>(),
                                  state[4], state.size() > 5 ? state[5].cast<long>() : default_most_steps);
          }));

  py::class_<GyroFlowSettings>(module, "GyroFlow",
                               R"(GyroFlow(noise, drift=0.0)
--

How a body moves about which only its gyro says something: gyro = ω + bias + v, with the bias in the state.

Parameters
----------
noise : float or (3, 3) array_like
    v lies in a ball of this radius (rad/s) or an ellipsoid of this shape ((rad/s)²).
drift : float or (3, 3) array_like
    The same for the rate of change of the bias, rad/s².
)")
      .def(py::init([](const py::object& noise, const py::object& drift) {
             return GyroFlowSettings{one_bound(noise, "noise", true), one_bound(drift, "drift", true)};
           }),
           "noise"_a, "drift"_a = 0.0, "__init__(self, noise, drift=0.0)\n--\n\n")
      .def_property_readonly("noise", [](const GyroFlowSettings& self) { return to_constant_array(self.noise); })
      .def_property_readonly("drift", [](const GyroFlowSettings& self) { return to_constant_array(self.drift); })
      .def(py::pickle(
          [](const GyroFlowSettings& self) { return py::make_tuple(to_array(self.noise), to_array(self.drift)); },
          [](const py::tuple& state) {
            return GyroFlowSettings{one_bound(state[0], "noise", true), one_bound(state[1], "drift", true)};
          }));
}

}  // namespace elliptude::python
