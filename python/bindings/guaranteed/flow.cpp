#include "guaranteed/flow.hpp"

#include "measurement/arguments.hpp"
#include "module.hpp"

namespace elliptude::python {

namespace {

[[nodiscard]] double positive_or_zero(const py::object& value, const std::string& name, const std::string& unit) {
  const double number = single(value, name, {}).number(0);
  if (!(number >= 0)) {
    value_error(name + " must not be negative, but is " + text(number) + " " + unit);
  }
  return number;
}

[[nodiscard]] GuaranteedBodyFlowSettings make_body_flow(const RigidBody<double>& body, const py::object& potential,
                                                        const py::object& step, const py::object& unknown_torque,
                                                        const py::object& inertia_error, long most_steps) {
  const double longest_step = single(step, "step", {}).number(0);
  if (!(longest_step > 0)) {
    value_error("step must be positive, but is " + text(longest_step) + " s");
  }
  const py::object given = potential.is_none() ? py::module_::import("elliptude").attr("FreeBody")() : potential;
  PotentialReference reference(given, "potential");
  BoundedPotential bounded;
  switch ((*reference).add_to(bounded)) {
    case Potential::Added::yes:
      break;
    case Potential::Added::no_bounds:
      value_error("potential offers no bounds of its torque, which a guaranteed flow needs: use " +
                  py::module_::import("elliptude._potentials").attr("names")().cast<std::string>() +
                  ", or state what bounds a torque of your own by StatedTorque(potential, curvature=..., rate=..., "
                  "error=...); a SumPotential adds them up");
    case Potential::Added::too_many:
      value_error("potential must be a sum of at most " + std::to_string(BoundedPotential::most_terms) +
                  " potentials other than FreeBody");
  }
  BodyUncertainty<double> uncertainty;
  if (!unknown_torque.is_none()) {
    uncertainty.torque = one_bound(unknown_torque, "unknown_torque", true);
  }
  uncertainty.inertia = positive_or_zero(inertia_error, "inertia_error", "kg m²");
  if (!(uncertainty.inertia < body.least_moment())) {
    value_error("inertia_error must be below the least principal moment, " + text(body.principal_moments()(2)) +
                " kg m² but for rounding, but is " + text(uncertainty.inertia) + " kg m²");
  }
  check_most_steps(most_steps);
  GuaranteedBodyFlow flow;
  raise_unless_ok(GuaranteedBodyFlow::make(body, bounded, longest_step, uncertainty, flow), "flow");
  raise_unless_ok(flow.set_most_steps(most_steps), "most_steps");
  return {flow, std::move(reference), longest_step, uncertainty};
}

/// None where it is not stated.
[[nodiscard]] py::object if_stated(double value) { return value < 0 ? py::object(py::none()) : py::float_(value); }

[[nodiscard]] GuaranteedGyroFlowSettings make_gyro_flow(const py::object& noise, const py::object& drift,
                                                        const py::object& scale, const py::object& angular_acceleration,
                                                        const std::string& interval_rate,
                                                        const py::object& longest_interval,
                                                        const py::object& largest_rate) {
  using Flow = GuaranteedGyroFlow<double>;
  using IntervalRate = Flow::IntervalRate;
  GyroUncertainty<double> uncertainty;
  uncertainty.noise = one_bound(noise, "noise", true);
  uncertainty.drift = one_bound(drift, "drift", true);
  uncertainty.scale = positive_or_zero(scale, "scale", "of the rate");
  uncertainty.angular_acceleration = positive_or_zero(angular_acceleration, "angular_acceleration", "rad/s²");
  if (!longest_interval.is_none()) {
    uncertainty.longest_interval = positive_or_zero(longest_interval, "longest_interval", "s");
  }
  if (!largest_rate.is_none()) {
    uncertainty.largest_rate = positive_or_zero(largest_rate, "largest_rate", "rad/s");
  }
  IntervalRate rate{};
  if (interval_rate == "mean_of_ends") {
    rate = IntervalRate::mean_of_ends;
  } else if (interval_rate == "first_sample") {
    rate = IntervalRate::first_sample;
  } else if (interval_rate == "last_sample") {
    rate = IntervalRate::last_sample;
  } else if (interval_rate == "mean") {
    rate = IntervalRate::mean;
  } else {
    value_error("interval_rate must be 'mean_of_ends', 'first_sample', 'last_sample' or 'mean', not '" + interval_rate +
                "'");
  }
  Flow flow;
  raise_unless_ok(Flow::make(uncertainty, rate, flow), "flow");
  return {flow, uncertainty, interval_rate};
}

}  // namespace

void define_guaranteed_flows(py::module_& module) {
  using namespace py::literals;

  py::class_<GuaranteedBodyFlowSettings>(
      module, "GuaranteedRigidBodyFlow", collectable<GuaranteedBodyFlowSettings>(),
      R"(GuaranteedRigidBodyFlow(body, potential=None, *, step, unknown_torque=None, inertia_error=0.0, most_steps=1000000)
--

How a rigid body in a potential moves, in continuous time, with a set that holds every possible motion.

Parameters
----------
body : RigidBody
potential : Potential, optional
    One of elliptude's own but `GradientPotential`, or a sum of at most 8 of them; a free body if omitted. A potential written in
    Python has no bounds of its torque until they are stated: `StatedTorque`. A `StatedTorque` adds to the set some curvature ‖θ‖² of unknown torque, where θ is the set's largest
    angle and half of a step's turn: take short steps.
step : float
    The longest step, s; an interval is divided into the fewest equal steps that are no longer but for a thousandth. The
    set holds the motion whatever the step; a shorter one makes it smaller, and takes longer.
unknown_torque : float or (3, 3) array_like, optional
    An additional unknown torque, at every time in a ball of this radius (N m) or an ellipsoid of this shape ((N m)²), body
    axes; it may change in any way.
inertia_error : float
    Largest error of the inertia matrix in the spectral norm, kg m²: below the least principal moment.
most_steps : int
    A prediction over more steps is refused: such a time is more likely an error than intended.

Raises
------
ValueError
    If the potential offers no bounds, or an argument is not finite or out of its range.
)")
      .def(py::init(&make_body_flow), "body"_a, "potential"_a = py::none(), py::kw_only(), "step"_a,
           "unknown_torque"_a = py::none(), "inertia_error"_a = 0.0, "most_steps"_a = default_most_steps,
           "__init__(self, body, potential=None, *, step, unknown_torque=None, inertia_error=0.0, "
           "most_steps=1000000)\n--\n\n")
      .def_property_readonly(
          "body", [](const GuaranteedBodyFlowSettings& self) { return self.flow.body(); }, "The body, a RigidBody.")
      .def_property_readonly(
          "potential", [](const GuaranteedBodyFlowSettings& self) { return self.potential.object(); },
          "The potential, as it was given.")
      .def_readonly("step", &GuaranteedBodyFlowSettings::step, "The longest step, s.")
      .def_property_readonly(
          "unknown_torque",
          [](const GuaranteedBodyFlowSettings& self) { return to_constant_array(self.uncertainty.torque); },
          "Shape of the unknown torque's ellipsoid, (N m)², shape (3, 3); read-only.")
      .def_property_readonly(
          "inertia_error", [](const GuaranteedBodyFlowSettings& self) { return self.uncertainty.inertia; },
          "Largest error of the inertia matrix, kg m².")
      .def_property_readonly(
          "most_steps", [](const GuaranteedBodyFlowSettings& self) { return self.flow.most_steps(); },
          "The most steps of one prediction.")
      .def(py::pickle(
          [](const GuaranteedBodyFlowSettings& self) {
            return py::make_tuple(self.flow.body(), self.potential.object(), self.step,
                                  to_array(self.uncertainty.torque), self.uncertainty.inertia, self.flow.most_steps());
          },
          [](const py::tuple& state) {
            return make_body_flow(state[0].cast<RigidBody<double>>(), state[1], state[2], state[3], state[4],
                                  state.size() > 5 ? state[5].cast<long>() : default_most_steps);
          }));

  py::class_<GuaranteedGyroFlowSettings>(
      module, "GuaranteedGyroFlow",
      R"(GuaranteedGyroFlow(noise, drift=0.0, *, scale=0.0, angular_acceleration=0.0, interval_rate='mean_of_ends', longest_interval=None, largest_rate=None)
--

How a body moves about which only its gyro says something: sample = ω + bias + v, with the bias in the state.

Parameters
----------
noise : float or (3, 3) array_like
    v lies in a ball of this radius (rad/s) or an ellipsoid of this shape ((rad/s)²).
drift : float or (3, 3) array_like
    The same for the rate of change of the bias at every time, rad/s².
scale : float
    Largest relative error of a sample: v may be longer by this times the length of the sample.
angular_acceleration : float
    Largest length of dω/dt at every time, rad/s²: how ω may move between samples.
interval_rate : {'mean_of_ends', 'first_sample', 'last_sample', 'mean'}
    What the rate given for an interval is: the mean of the samples at its ends, the sample at its beginning or at its end, or
    the mean over the interval, from a gyro that integrates.
longest_interval : float, optional
    The longest interval that a rate and the bounds above cover, s; any, if omitted. About a longer one, or one whose rate is
    NaN, nothing is known but `largest_rate`.
largest_rate : float, optional
    Largest length of ω at every time, rad/s: over an interval that no bound covers the set grows by this times the duration.
    If omitted, or if that reaches half turns, the attitude is forgotten.

Raises
------
ValueError
    If an argument is not finite or out of its range.
)")
      .def(py::init(&make_gyro_flow), "noise"_a, "drift"_a = 0.0, py::kw_only(), "scale"_a = 0.0,
           "angular_acceleration"_a = 0.0, "interval_rate"_a = "mean_of_ends", "longest_interval"_a = py::none(),
           "largest_rate"_a = py::none(),
           "__init__(self, noise, drift=0.0, *, scale=0.0, angular_acceleration=0.0, interval_rate='mean_of_ends', "
           "longest_interval=None, largest_rate=None)\n--\n\n")
      .def_property_readonly(
          "noise", [](const GuaranteedGyroFlowSettings& self) { return to_constant_array(self.uncertainty.noise); },
          "Shape of the noise's ellipsoid, (rad/s)², shape (3, 3); read-only.")
      .def_property_readonly(
          "drift", [](const GuaranteedGyroFlowSettings& self) { return to_constant_array(self.uncertainty.drift); },
          "Shape of the ellipsoid of the bias's rate of change, (rad/s²)², shape (3, 3); read-only.")
      .def_property_readonly(
          "scale", [](const GuaranteedGyroFlowSettings& self) { return self.uncertainty.scale; },
          "Largest relative error of a sample.")
      .def_property_readonly(
          "angular_acceleration",
          [](const GuaranteedGyroFlowSettings& self) { return self.uncertainty.angular_acceleration; },
          "Largest length of dω/dt, rad/s².")
      .def_readonly("interval_rate", &GuaranteedGyroFlowSettings::interval_rate,
                    "What the rate given for an interval is.")
      .def_property_readonly(
          "longest_interval",
          [](const GuaranteedGyroFlowSettings& self) { return if_stated(self.uncertainty.longest_interval); },
          "The longest interval that a rate and its bounds speak of, s; None for any.")
      .def_property_readonly(
          "largest_rate",
          [](const GuaranteedGyroFlowSettings& self) { return if_stated(self.uncertainty.largest_rate); },
          "Largest length of ω, rad/s; None where it is not known.")
      .def(py::pickle(
          [](const GuaranteedGyroFlowSettings& self) {
            return py::make_tuple(to_array(self.uncertainty.noise), to_array(self.uncertainty.drift),
                                  self.uncertainty.scale, self.uncertainty.angular_acceleration, self.interval_rate,
                                  if_stated(self.uncertainty.longest_interval),
                                  if_stated(self.uncertainty.largest_rate));
          },
          [](const py::tuple& state) {
            return make_gyro_flow(state[0], state[1], state[2], state[3], state[4].cast<std::string>(), state[5],
                                  state[6]);
          }));
}

}  // namespace elliptude::python
