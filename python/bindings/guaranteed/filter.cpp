#include <pybind11/stl.h>

#include "guaranteed/python_filter.hpp"
#include "module.hpp"

namespace elliptude::python {

void define_guaranteed_filter(py::module_& module) {
  using namespace py::literals;
  using Filter = PythonGuaranteedFilter;

  py::class_<Filter>(
      module, "GuaranteedFilter", collectable<Filter>(),
      R"(GuaranteedFilter(flow, start=None, *, time=0.0, criterion='volume', weight=None, policy='raise', most_wrong=0, regain_after=10, vector_bound=None, estimate_vector=True)
--

A set that holds the attitude and the angular velocity (or gyro bias) if all stated bounds hold; no term is dropped.

It may know nothing about the attitude, at the beginning or after a prediction has become too large to be useful. It then starts
from the next measurements that determine one. A call that raises leaves the filter as it was, except `run`.

Parameters
----------
flow : GuaranteedRigidBodyFlow or GuaranteedGyroFlow
start : StateEllipsoid, optional
    Holds the state at `time`, in either chart; nothing is known if omitted.
time : float
    s.
criterion : {'volume', 'trace', 'weighted_trace'}
    The size to minimise; the trace adds rad² to rad²/s² unless it is weighted.
weight : (6, 6) array_like, optional
    The weight of the trace, symmetric positive definite.
policy : {'raise', 'drop_measurement', 'restart', 'relaxed'}
    What to do with measurements that no predicted state can have caused, which proves that some bound is wrong. 'raise' raises;
    'drop_measurement' leaves out as few as possible, so that the rest agree; 'restart' forgets the prediction; 'relaxed' lets
    `most_wrong` of the measurements of every update be wrong, whether that shows or not.
most_wrong : {0, 1, 2}
    For 'relaxed', of at most eight measurements.
regain_after : int
    A conditional claim ends after this many updates in a row without contradiction: the set is then taken from the measurements
    of that moment alone, if they bound one. If contradictions go on, the past is given up for such a set this many updates after
    the first one; the claim stays conditional until as many have agreed. Disturbances should be shorter than this.
vector_bound : float, (3, 3) array_like or tuple of (3,) array_like and one of these, optional
    The angular velocity, or the gyro's bias, is always in this ellipsoid: a radius (rad/s) or shape ((rad/s)²) about zero, or
    about a center.
estimate_vector : bool
    For a GuaranteedGyroFlow: whether its bias is estimated. If not, `vector_bound` is all that is known of it, and the attitude's
    sets, predicted and fused by themselves, are smaller. The shape then holds two sets, the attitude's and the bound of the
    bias, with zeros between: the state is in both, not in the ellipsoid of all six numbers, whose form may be up to 2 for it
    (`StateEllipsoid.quadratic_form`, `contains`, `GuaranteedLog.forms` with vectors).

Raises
------
ValueError
    If an argument is not finite or out of its range, or the start is flat or holds half turns.
)")
      .def(py::init<py::object, const std::optional<AnyStateEllipsoid>&, const py::object&, std::string,
                    const py::object&, const std::string&, int, int, const py::object&, bool>(),
           "flow"_a, "start"_a = py::none(), py::kw_only(), "time"_a = 0.0, "criterion"_a = "volume",
           "weight"_a = py::none(), "policy"_a = "raise", "most_wrong"_a = 0, "regain_after"_a = 10,
           "vector_bound"_a = py::none(), "estimate_vector"_a = true,
           "__init__(self, flow, start=None, *, time=0.0, criterion='volume', weight=None, policy='raise', "
           "most_wrong=0, regain_after=10, vector_bound=None, estimate_vector=True)\n--\n\n")
      .def_property_readonly("flow", &Filter::flow, "The flow, as it was given.")
      .def_property_readonly("time", &Filter::time, "The time of the set, s.")
      .def_property_readonly("criterion", &Filter::criterion, "What the smallest ellipsoid is.")
      .def_property_readonly("weight", &Filter::weight,
                             "The weight of the weighted trace, shape (6, 6); None for another criterion.")
      .def_property_readonly("policy", &Filter::policy, "What is done with measurements that contradict.")
      .def_property_readonly("most_wrong", &Filter::most_wrong,
                             "How many measurements of an update may be wrong, for 'relaxed'.")
      .def_property_readonly("regain_after", &Filter::regain_after,
                             "After how many updates without contradiction a conditional claim ends.")
      .def_property_readonly("vector_bound", &Filter::vector_bound,
                             "What the vector is always in: (center, shape), rad/s and (rad/s)²; or None.")
      .def_property_readonly("estimate_vector", &Filter::estimate_vector,
                             "Whether the gyro's bias is estimated, and not only bounded; True for a body.")
      .def_property_readonly(
          "claim", &Filter::claim,
          "What the set rests on: 'unconditional', on what the filter was told of errors; 'conditional', also on what "
          "was dropped having been wrong; 'none', there is no set.")
      .def_property_readonly("knows_attitude", &Filter::knows_attitude, "Whether there is a set.")
      .def_property_readonly("ellipsoid", &Filter::ellipsoid,
                             "The set, a StateEllipsoid in the Gibbs chart; None if the attitude is not known. With "
                             "`estimate_vector=False` its shape is of two sets, attitude's and vector's, with zeros "
                             "between, and the form of a state that is in both up to 2.")
      .def_property_readonly("_agreeing_updates", &Filter::agreeing_updates)
      .def_property_readonly("_vector", &Filter::vector)
      .def_property_readonly("_rests_on_drops", &Filter::rests_on_drops)
      .def_property_readonly("_disputed_updates", &Filter::disputed_updates)
      .def_property_readonly("_contradictions", &Filter::contradictions)
      .def("_resume", &Filter::resume, "ellipsoid"_a, "vector"_a, "rests_on_drops"_a, "agreeing_updates"_a,
           "disputed_updates"_a = 0, "contradictions"_a = 0)
      .def("forget", &Filter::forget, R"(forget(self)
--

Forgets everything except `vector_bound`: the next measurements that determine an attitude start the filter again.

Use it to go on under the policy 'raise' if the set has turned out to be wrong, or cannot be predicted.
)")
      .def("predict", &Filter::predict, "time"_a, py::kw_only(), "control_torque"_a = py::none(),
           "wheel_momentum"_a = py::none(), "gyro"_a = py::none(), "increment"_a = py::none(),
           R"(predict(self, time, *, control_torque=None, wheel_momentum=None, gyro=None, increment=None)
--

Moves the set to a later time. If it becomes too large to be bounded, the attitude is forgotten. The same happens, except under
the policy 'raise', if this set cannot be predicted although another could be, such as a set about a wrong rate.

Parameters
----------
time : float
    s, not before `self.time`.
control_torque : (3,) array_like, optional
    N m, body axes, constant over the interval; for a GuaranteedRigidBodyFlow, as the next.
wheel_momentum : (3,) array_like, optional
    Angular momentum of wheels relative to the body, N m s, body axes, constant over the interval.
gyro : (3,) array_like
    The measured rate of the interval as the flow's `interval_rate` says, rad/s, body axes; for a GuaranteedGyroFlow. NaN if
    nothing was measured: then only the flow's `largest_rate` is known about the interval.
increment : float, optional
    Bound of the angle that the errors v of the gyro make together over this interval, rad, if it is better than the duration
    times the noise.

Raises
------
ValueError
    If time runs backwards, a step is too long for the motion, or an argument is not finite.
)")
      .def("predict_turn", &Filter::predict_turn, "time"_a, "turn"_a, "turn_bound"_a,
           R"(predict_turn(self, time, turn, turn_bound)
--

Moves the set of a GuaranteedGyroFlow over a turn that is known up to an angle.

Errors of a gyro that cancel over many samples then do not add up: integrate the rates yourself, and state how far the whole turn
may be off. A bias that is estimated drifts as the flow says.

Parameters
----------
time : float
    s, not before `self.time`.
turn : (3,) array_like
    Rotation vector from the attitude at `self.time` to that at `time`, rad, body axes.
turn_bound : float
    The true turn differs by a turn about any axis of at most this, rad. From π on it says nothing: the attitude is forgotten.

Raises
------
ValueError
    If time runs backwards, or an argument is out of its range.
TypeError
    If the flow is that of a rigid body.
)")
      .def(
          "update", &Filter::update, "directions"_a = py::none(), "reference"_a = py::none(), "bounds"_a = py::none(),
          py::kw_only(), "angular_velocity"_a = py::none(), "rate_bound"_a = py::none(), "attitude"_a = py::none(),
          "attitude_bound"_a = py::none(), "sensors"_a = py::none(),
          R"(update(self, directions=None, reference=None, bounds=None, *, angular_velocity=None, rate_bound=None, attitude=None, attitude_bound=None, sensors=None)
--

Fuses all measurements of one moment with the prediction, at once. Any number of directions will do.

Parameters
----------
directions : (m, 3) array_like
    Measured in body axes, 1 to 32.
reference : (m, 3) array_like
    The same directions in reference axes.
bounds : float, (m,) or (m, 3, 3) array_like
    Bounds of the direction errors: angles in rad, below pi, or shapes in rad².
angular_velocity : (3,) array_like, optional
    rad/s, body axes; for a GuaranteedRigidBodyFlow.
rate_bound : float or (3, 3) array_like
    rad/s, or a shape in (rad/s)².
attitude : (3, 3) array_like or scipy Rotation, optional
    A whole attitude, as a star tracker gives it: C = C̃ exp(S(ν)).
attitude_bound : float or (3, 3) array_like
    Bound of ν: an angle in rad, below pi, or a shape in rad².
sensors : sequence of str, optional
    Names for messages and for what is dropped: of the directions, or of the directions, the angular velocity and the attitude, as
    far as they are given. Without names a direction is its index, and the others are 'angular_velocity' and 'attitude'.

Returns
-------
GuaranteedUpdate

Raises
------
InconsistentMeasurement
    If no state satisfies all bounds and the policy does not resolve it; with the sensor that contradicts most, unless that is
    the prediction.
ValueError
    If an argument is not finite or out of its range.
)")
      .def("bounds", &Filter::bounds, "vertical"_a, R"(bounds(self, vertical)
--

How far the attitude of the set's center may be off: its tilt, its heading, and in all.

Each is a question of its own to all that the last update used, its measurements and its prediction, until the next prediction. The
answers are sharper than the set, which has to answer all questions at once.

Parameters
----------
vertical : (3,) array_like
    Up in reference axes, of any length.

Returns
-------
AttitudeBounds or None
    None if the attitude is not known.

Raises
------
ValueError
    If it is not finite, or zero.
)")
      .def("turn_about", &Filter::turn_about, "axis"_a, R"(turn_about(self, axis)
--

How far the attitude may be turned about an axis from the attitude of the set's center.

It is the turn that is left when what turns the axis itself is taken away by the shortest turn, in the sense of a right-handed screw; about
the vertical it is the heading. A question of its own, as in `bounds`, to all that the last `update` used, until the filter changes; then to
the set.

Parameters
----------
axis : (3,) array_like
    In the body axes at the center, of any length.

Returns
-------
Interval or None
    rad, up to ±pi. None if the attitude is not known.

Raises
------
ValueError
    If it is not finite, or zero.
)")
      .def("vector_along", &Filter::vector_along, "direction"_a, R"(vector_along(self, direction)
--

Between what a component of the angular velocity, or of the gyro's bias, is.

A question of its own, as `turn_about`.

Parameters
----------
direction : (3,) array_like
    In body axes, of any length; the component along it.

Returns
-------
Interval or None
    rad/s. None if the attitude is not known.

Raises
------
ValueError
    If it is not finite, or zero.
)")
      .def("attitude_set", &Filter::attitude_set, "criterion"_a = "volume", R"(attitude_set(self, criterion='volume')
--

A small set of the attitude alone, about a center of its own.

The filter's set has to be small in attitude and vector together. This one is as small as the attitude alone allows, from all that the
last `update` used, until the filter changes, and from bounds of the turns about three axes.

Parameters
----------
criterion : {'volume', 'trace'}
    The size to minimise.

Returns
-------
AttitudeSet or None
    None if the attitude is not known.

Raises
------
ValueError
    If there is no such criterion.
)")
      .def("update_linear", &Filter::update_linear, "y"_a, "h"_a, "bound"_a,
           R"(update_linear(self, y, h, bound)
--

Fuses y = H x + v of the error x = [ζ; δ] about the present center, v in the ellipsoid of the shape `bound`.

Parameters
----------
y : (r,) array_like
h : (r, 6) array_like
bound : (r, r) array_like

Returns
-------
GuaranteedUpdate

Raises
------
InconsistentMeasurement
    If no predicted state can have caused it, under any policy.
ValueError
    If the attitude is not known, or an argument is not finite or out of its range.
)")
      .def(
          "run", &Filter::run, "times"_a, py::kw_only(), "directions"_a = py::none(), "reference"_a = py::none(),
          "bounds"_a = py::none(), "angular_velocity"_a = py::none(), "rate_bound"_a = py::none(),
          "attitude"_a = py::none(), "attitude_bound"_a = py::none(), "gyro"_a = py::none(), "increment"_a = py::none(),
          "control_torque"_a = py::none(), "wheel_momentum"_a = py::none(), "sensors"_a = py::none(),
          "vertical"_a = py::none(),
          R"(run(self, times, *, directions=None, reference=None, bounds=None, angular_velocity=None, rate_bound=None, attitude=None, attitude_bound=None, gyro=None, increment=None, control_torque=None, wheel_momentum=None, sensors=None, vertical=None)
--

Predicts to each time of a log and updates with the measurements there, in one call and without the interpreter's lock.

Parameters
----------
times : (n,) array_like
    s, not decreasing, from `self.time` on.
directions : (n, m, 3) array_like, optional
    Rows that are all NaN were not measured.
reference : (m, 3) or (n, m, 3) array_like
bounds : float, (m,), (n, m) or (m, 3, 3) array_like
    Angles in rad, or shapes in rad²; an angle that is NaN, or pi and more, says that nothing was measured there.
angular_velocity : (n, 3) array_like, optional
    For a GuaranteedRigidBodyFlow; rows that are all NaN were not measured.
rate_bound : float, (n,) or (3, 3) array_like
    rad/s, NaN where nothing was measured, or a shape in (rad/s)².
attitude : (n, 3, 3) array_like or scipy Rotation, optional
    Rows that are all NaN were not measured.
attitude_bound : float, (n,) or (3, 3) array_like
    As for directions.
gyro : (n, 3) array_like
    For a GuaranteedGyroFlow: gyro[k] is the rate of the interval from times[k] to times[k + 1], as the flow's `interval_rate`
    says, NaN where nothing was measured; times[0] must be `self.time`.
increment : float or (n,) array_like, optional
    As in `predict`, for the same intervals as gyro; NaN if unknown.
control_torque, wheel_momentum : (3,) or (n, 3) array_like, optional
    For a GuaranteedRigidBodyFlow: row k acts until times[k].
sensors : sequence of str, optional
    As in `update`.
vertical : (3,) array_like, optional
    Up in reference axes. With it each row also has bounds of tilt, heading and angle, as `bounds` gives them.

Returns
-------
GuaranteedLog

Raises
------
InconsistentMeasurement
    With the row, its time and the sensor; the filter is then predicted to that row. After any other error it is as before
    the call.
RowError
    If a row has a number that is not finite or out of its range, or its time cannot be predicted to; with the row.
)")
      .def(
          "run_turns", &Filter::run_turns, "times"_a, "turns"_a, "turn_bounds"_a, py::kw_only(), "anchors"_a,
          "directions"_a = py::none(), "reference"_a = py::none(), "bounds"_a = py::none(), "attitude"_a = py::none(),
          "attitude_bound"_a = py::none(), "sensors"_a = py::none(), "vertical"_a = py::none(),
          "threads"_a = py::none(),
          R"(run_turns(self, times, turns, turn_bounds, *, anchors, directions=None, reference=None, bounds=None, attitude=None, attitude_bound=None, sensors=None, vertical=None, threads=None)
--

Predicts each row of a log from its anchor, an earlier row, over a known turn, and updates it with its measurements, in one call.

Only the sets of anchors are carried on. Each row between is predicted from its anchor in one step, so that errors of the
gyro can cancel (`predict_turn`) and repeated fusion loses nothing. For a GuaranteedGyroFlow.

Parameters
----------
times : (n,) array_like
    s, not decreasing, from `self.time` on.
turns : (n, 3) array_like
    turns[k] is the rotation vector from the attitude at row anchors[k] to that at row k, rad, body axes.
turn_bounds : (n,) array_like
    How far each may be off, rad, about any axis.
anchors : (n,) array_like of int
    The row that each is predicted from: the row before it, or that row's anchor. −1, as in the first row, is the filter as it is.
directions, reference, bounds, attitude, attitude_bound, sensors, vertical
    As in `run`.
threads : int, optional
    How many threads go through the rows between anchors; as many as there are processors and as the rows are worth, if omitted.
    The numbers do not depend on it.

Returns
-------
GuaranteedLog

Raises
------
InconsistentMeasurement
    With the row, its time and the sensor; the filter is then predicted to that row. After any other error it is as before
    the call.
RowError
    If a row has a number that is not finite or out of its range; with the row.
)");
}

}  // namespace elliptude::python
