#include "first_order/python_filters.hpp"
#include "module.hpp"

namespace elliptude::python {

using elliptude_kernels::FilterMemory;

void define_filters(py::module_& module) {
  using namespace py::literals;

  py::class_<PythonFilters>(
      module, "AttitudeFilters", collectable<PythonFilters>(),
      R"(AttitudeFilters(flow, attitude, vector, shape, *, time=0.0, mode='first_order', criterion='trace', weight=None)
--

Many filters with one flow, mode, criterion and time, that differ in their sets, their inputs and their measurements.

Several filters go through one SIMD register, with the widest instructions that the processor has, and groups of them through
threads. The numbers depend on neither, and not on how many filters there are; they are those of `AttitudeFilter` but for rounding,
after one update within 1e-9 of a shape. A call that raises leaves all filters as they were. With a potential other than
`FreeBody`, `UniformGravity` and `GravityGradient` predictions are made one after the other.

Parameters
----------
flow : RigidBodyFlow or GyroFlow
attitude : array_like, shape (n, 3, 3) or (3, 3), or scipy.spatial.transform.Rotation
    The centers of the n sets at `time`, as those of `StateEllipsoid`.
vector : array_like, shape (n, 3) or (3,)
    Angular velocities or gyro biases, rad/s, body axes.
shape : array_like, shape (n, 6, 6) or (6, 6)
    P; rad² and rad²/s².
time : float
    s.
mode : {'first_order', 'paper'}
criterion : {'trace', 'weighted_trace', 'volume'}
weight : (6, 6) array_like, optional
    As in `AttitudeFilter`.
)")
      .def(py::init<py::object, const py::object&, const py::object&, const py::object&, const py::object&, std::string,
                    std::string, const py::object&>(),
           "flow"_a, "attitude"_a, "vector"_a, "shape"_a, py::kw_only(), "time"_a = 0.0, "mode"_a = "first_order",
           "criterion"_a = "trace", "weight"_a = py::none(),
           "__init__(self, flow, attitude, vector, shape, *, time=0.0, mode='first_order', criterion='trace', "
           "weight=None)\n--\n\n")
      .def("__len__", &PythonFilters::count)
      .def_property_readonly("flow", &PythonFilters::flow, "How the bodies move.")
      .def_property_readonly("mode", &PythonFilters::mode, "'first_order' or 'paper'.")
      .def_property_readonly("criterion", &PythonFilters::criterion, "The size that is minimised.")
      .def_property_readonly("weight", &PythonFilters::weight, "The weight of the trace, (6, 6), or None.")
      .def_property_readonly("time", &PythonFilters::time, "Of all filters, s.")
      .def_property_readonly(
          "attitude", [](const PythonFilters& self) { return self.matrices<3, 3>(FilterMemory::attitude); },
          "Centers of the sets, from body to reference axes, (n, 3, 3).")
      .def_property_readonly(
          "vector", [](const PythonFilters& self) { return self.matrices<3, 1>(FilterMemory::vector); },
          "Angular velocities or gyro biases of the centers, rad/s, (n, 3).")
      .def_property_readonly(
          "shape", [](const PythonFilters& self) { return self.matrices<6, 6>(FilterMemory::shape); }, "P, (n, 6, 6).")
      .def_property_readonly(
          "transition", [](const PythonFilters& self) { return self.matrices<6, 6>(FilterMemory::transition); },
          "A^f of each since its last update, (n, 6, 6).")
      .def_property_readonly(
          "prior_shape", [](const PythonFilters& self) { return self.matrices<6, 6>(FilterMemory::prior_shape); },
          "P₀ of each, the shape after its last update, (n, 6, 6).")
      .def("_resume", &PythonFilters::resume, "transition"_a, "prior_shape"_a)
      .def("predict", &PythonFilters::predict, "time"_a, py::kw_only(), "control_torque"_a = py::none(),
           "gyro"_a = py::none(), "threads"_a = py::none(),
           R"(predict(self, time, *, control_torque=None, gyro=None, threads=None)
--

`AttitudeFilter.predict` of all filters to the same time.

Parameters
----------
time : float
    s, not before `self.time`.
control_torque : (3,) or (n, 3) array_like, optional
    N m, body axes, constant over the interval; for a RigidBodyFlow.
gyro : (3,) or (n, 3) array_like
    The measured rates over the interval, rad/s; for a GyroFlow.
threads : int, optional
    As many as there are processors and as the work is worth, unless given.

Raises
------
ValueError
    If a filter cannot be predicted to that time; it names the first of which that is so.
)")
      .def(
          "update", &PythonFilters::update, py::kw_only(), "directions"_a = py::none(), "reference"_a = py::none(),
          "bounds"_a = py::none(), "weights"_a = py::none(), "angular_velocity"_a = py::none(),
          "rate_bound"_a = py::none(), "on_inconsistent"_a = "raise", "threads"_a = py::none(),
          R"(update(self, *, directions=None, reference=None, bounds=None, weights=None, angular_velocity=None, rate_bound=None, on_inconsistent='raise', threads=None)
--

`AttitudeFilter.update` of all filters, with the same kinds of measurements.

Parameters
----------
directions : (m, 3) or (n, m, 3) array_like
    Measured in body axes.
reference : (m, 3) or (n, m, 3) array_like
    The same directions in reference axes.
bounds : float, (m,) or (m, 3, 3) array_like
    Bounds of the direction errors, of all filters: angles in rad, or shapes in rad².
weights : (m,) array_like, optional
    Weights in Wahba's problem.
angular_velocity : (3,) or (n, 3) array_like, optional
    rad/s, body axes; for a RigidBodyFlow.
rate_bound : float or (3, 3) array_like
    rad/s, or a shape in (rad/s)², of all filters.
on_inconsistent : {'raise', 'skip'}
    What to do about filters whose measurement contradicts the prediction. 'raise' leaves all filters as they were, 'skip' those.
threads : int, optional
    As many as there are processors and as the work is worth, unless given.

Returns
-------
Updates

Raises
------
InconsistentMeasurement
    If the sets of a filter have no common point; it names the first.
)");
}

}  // namespace elliptude::python
