#include <pybind11/stl.h>

#include "first_order/python_filter.hpp"
#include "measurement/arguments.hpp"
#include "module.hpp"

namespace elliptude::python {

namespace {

[[nodiscard]] MeasuredDirections<double> measured_directions(const py::object& directions, const py::object& reference,
                                                             const py::object& bounds, const py::object& weights) {
  const Items body(directions, "directions", {3});
  if (body.leading().size() != 1) {
    value_error("directions must have the shape (m, 3), one row for each direction");
  }
  const Index m = body.leading()[0];
  const Items references = single(reference, "reference", {m, 3});
  const DirectionArguments arguments(bounds, weights, m);
  std::vector<Direction<double>> given;
  for (Index i = 0; i < m; ++i) {
    given.push_back(arguments.direction(i, references[0] + 3 * i, body[i]));
    require_direction(given.back().body, "directions[" + std::to_string(i) + "]");
    require_direction(given.back().reference, "reference[" + std::to_string(i) + "]");
  }
  MeasuredDirections<double> measured;
  raise_unless_ok(MeasuredDirections<double>::make(given.data(), given.size(), WahbaMethod::svd, measured),
                  "directions");
  return measured;
}

[[nodiscard]] py::tuple measured_attitude_of(const py::object& directions, const py::object& reference,
                                             const py::object& bounds, const py::object& weights) {
  MeasuredAttitude<double> attitude;
  raise_unless_ok(measured_directions(directions, reference, bounds, weights)
                      .measured_attitude(SizeCriterion<double, 3>::trace(), attitude),
                  "bounds");
  return py::make_tuple(to_array(attitude.attitude), to_array(attitude.bound));
}

[[nodiscard]] AnyStateEllipsoid measured_state_of(const py::object& directions, const py::object& reference,
                                                  const py::object& bounds, const py::object& angular_velocity,
                                                  const py::object& rate_bound, const py::object& weights) {
  const AngularVelocity<double> rate{single(angular_velocity, "angular_velocity", {3}).vector<3>(0),
                                     one_bound(rate_bound, "rate_bound", false)};
  StateEllipsoid<BodyState> result;
  raise_unless_ok(measured_state(measured_directions(directions, reference, bounds, weights), rate,
                                 SizeCriterion<double, 6>::trace(), result),
                  "bounds");
  return AnyStateEllipsoid::from(result);
}

}  // namespace

void define_filter(py::module_& module) {
  using namespace py::literals;

  py::class_<PythonFilter>(
      module, "AttitudeFilter", collectable<PythonFilter>(),
      R"(AttitudeFilter(flow, ellipsoid, *, time=0.0, mode='first_order', criterion='trace', weight=None)
--

Attitude and angular velocity (or gyro bias) with the ellipsoid that bounds them, from measurements with bounded errors.

A call that raises leaves the filter as it was; after a prediction, a refused measurement changes nothing. Both modes
are of first order: their sets are bounds only up to terms of second order in the error.

Parameters
----------
flow : RigidBodyFlow or GyroFlow
ellipsoid : StateEllipsoid
    Holds the state at `time`.
time : float
    s.
mode : {'first_order', 'paper'}
    How ellipsoids move to another center: 'paper' shifts them, as printed; 'first_order' uses the Jacobian of the exponential.
criterion : {'trace', 'weighted_trace', 'volume'}
    The size to minimise; the trace adds rad² to rad²/s² unless it is weighted.
weight : (6, 6) array_like, optional
    The weight of the trace, symmetric positive definite.
)")
      .def(py::init<py::object, const AnyStateEllipsoid&, const py::object&, std::string, std::string,
                    const py::object&>(),
           "flow"_a, "ellipsoid"_a, py::kw_only(), "time"_a = 0.0, "mode"_a = "first_order", "criterion"_a = "trace",
           "weight"_a = py::none(),
           "__init__(self, flow, ellipsoid, *, time=0.0, mode='first_order', criterion='trace', weight=None)\n--\n\n")
      .def_property_readonly("flow", &PythonFilter::flow)
      .def_property_readonly("mode", &PythonFilter::mode)
      .def_property_readonly("criterion", &PythonFilter::criterion)
      .def_property_readonly("weight", &PythonFilter::weight)
      .def_property_readonly("time", &PythonFilter::time)
      .def_property_readonly("ellipsoid", &PythonFilter::ellipsoid)
      .def_property_readonly("attitude",
                             [](const PythonFilter& self) { return to_constant_array(self.ellipsoid().attitude); })
      .def_property_readonly("vector",
                             [](const PythonFilter& self) { return to_constant_array(self.ellipsoid().vector); })
      .def_property_readonly("shape",
                             [](const PythonFilter& self) { return to_constant_array(self.ellipsoid().shape); })
      .def_property_readonly(
          "transition", [](const PythonFilter& self) { return to_constant_array(self.transition()); },
          "A^f since the last update, (6, 6).")
      .def_property_readonly(
          "prior_shape", [](const PythonFilter& self) { return to_constant_array(self.prior_shape()); },
          "P₀, the shape after the last update, (6, 6).")
      .def("_resume", &PythonFilter::resume, "transition"_a, "prior_shape"_a)
      .def(
          "extent", [](const PythonFilter& self) { return extent_of(self.ellipsoid()); },
          R"(extent(self)
--

The same as `ellipsoid.extent()`.
)")
      .def("predict", &PythonFilter::predict, "time"_a, py::kw_only(), "control_torque"_a = py::none(),
           "gyro"_a = py::none(),
           R"(predict(self, time, *, control_torque=None, gyro=None)
--

Moves the ellipsoid to a later time (paper, §3.1).

Parameters
----------
time : float
    s, not before `self.time`.
control_torque : (3,) array_like, optional
    N m, body axes, constant over the interval; for a RigidBodyFlow.
gyro : (3,) array_like
    The measured rate over the interval, rad/s; for a GyroFlow.
)")
      .def(
          "update", &PythonFilter::update, py::kw_only(), "directions"_a = py::none(), "reference"_a = py::none(),
          "bounds"_a = py::none(), "weights"_a = py::none(), "angular_velocity"_a = py::none(),
          "rate_bound"_a = py::none(), "sensor"_a = "", "diagnostics"_a = false,
          R"(update(self, *, directions=None, reference=None, bounds=None, weights=None, angular_velocity=None, rate_bound=None, sensor='', diagnostics=False)
--

Fuses directions, an angular velocity or both with the prediction (paper, §3.2, §3.3). Any number of directions will do.

Parameters
----------
directions : (m, 3) array_like
    Measured in body axes.
reference : (m, 3) array_like
    The same directions in reference axes.
bounds : float, (m,) or (m, 3, 3) array_like
    Bounds of the direction errors: angles in rad, or shapes in rad².
weights : (m,) array_like, optional
    Weights in Wahba's problem.
angular_velocity : (3,) array_like, optional
    rad/s, body axes; for a RigidBodyFlow.
rate_bound : float or (3, 3) array_like
    rad/s, or a shape in (rad/s)².
sensor : str
    Name of the sensor for the message if the sets do not meet.
diagnostics : bool
    Whether to return diagnostics of the convergence theorem, for directions that determine an attitude, with an angular velocity.

Returns
-------
Update

Raises
------
InconsistentMeasurement
    If the sets have no common point.
)")
      .def("update_attitude", &PythonFilter::update_attitude, "attitude"_a, "bound"_a, "sensor"_a = "",
           R"(update_attitude(self, attitude, bound, sensor='')
--

Fuses a whole measured attitude, C = C̃ exp(S(ν)) with ν in a ball of radius `bound` (rad) or an ellipsoid of that shape.
)")
      .def("update_linear", &PythonFilter::update_linear, "y"_a, "h"_a, "bound"_a, "sensor"_a = "",
           R"(update_linear(self, y, h, bound, sensor='')
--

Fuses y = H x + v of the error x = [ζ; δ] about the present center, v in the ellipsoid of the shape `bound`.

Parameters
----------
y : (r,) array_like
h : (r, 6) array_like
bound : (r, r) array_like
)")
      .def("angular_velocity_estimate", &PythonFilter::angular_velocity_estimate, "gyro"_a,
           R"(angular_velocity_estimate(self, gyro)
--

The body's rate ω = gyro − bias − v at a sample with its bound, for a GyroFlow.

Returns
-------
Ellipsoid
)")
      .def(
          "run", &PythonFilter::run, "times"_a, py::kw_only(), "directions"_a = py::none(), "reference"_a = py::none(),
          "bounds"_a = py::none(), "weights"_a = py::none(), "angular_velocity"_a = py::none(),
          "rate_bound"_a = py::none(), "gyro"_a = py::none(), "control_torque"_a = py::none(),
          "on_inconsistent"_a = "raise",
          R"(run(self, times, *, directions=None, reference=None, bounds=None, weights=None, angular_velocity=None, rate_bound=None, gyro=None, control_torque=None, on_inconsistent='raise')
--

Predicts to each time of a log and updates with the measurements there, in one call and without the interpreter's lock.

Parameters
----------
times : (n,) array_like
    s, not decreasing, from `self.time` on.
directions : (n, m, 3) array_like, optional
    Rows that are all NaN are absent.
reference : (m, 3) or (n, m, 3) array_like
bounds, weights, rate_bound
    As in `update`, the same for all rows.
angular_velocity : (n, 3) array_like, optional
    For a RigidBodyFlow; rows that are all NaN are absent.
gyro : (n, 3) array_like
    For a GyroFlow: gyro[k] is the rate from times[k] to times[k + 1]; times[0] must be `self.time`.
control_torque : (3,) or (n, 3) array_like, optional
    For a RigidBodyFlow: row k acts until times[k].
on_inconsistent : {'raise', 'skip'}
    What to do with a row that contradicts the prediction. 'raise' leaves the filter as it was before the call.

Returns
-------
FilterLog

Raises
------
InconsistentMeasurement
    If sets do not meet; with the row.
RowError
    If a row has a number that is not finite or out of its range, or its time cannot be predicted to; with the row.
)");

  module.def("measured_attitude", &measured_attitude_of, "directions"_a, "reference"_a, "bounds"_a,
             "weights"_a = py::none(),
             R"(measured_attitude(directions, reference, bounds, weights=None)
--

The attitude that two or more directions measure, and the shape of its ellipsoid to first order (paper, eq. zetakpm).

Returns
-------
attitude : (3, 3) ndarray
shape : (3, 3) ndarray
    rad².
)");
  module.def("measured_state", &measured_state_of, "directions"_a, "reference"_a, "bounds"_a, "angular_velocity"_a,
             "rate_bound"_a, "weights"_a = py::none(),
             R"(measured_state(directions, reference, bounds, angular_velocity, rate_bound, weights=None)
--

The ellipsoid E^m of two or more directions and an angular velocity (paper, eqs. Pmkl, mea): a filter may start from it.

Returns
-------
StateEllipsoid
)");
}

}  // namespace elliptude::python
