#include "state_ellipsoid.hpp"

#include "module.hpp"

namespace elliptude::python {

AnyStateEllipsoid make_state_ellipsoid(const py::object& attitude, const py::object& vector, const py::object& shape) {
  AnyStateEllipsoid result;
  result.attitude = single_attitude(attitude, "attitude");
  result.vector = single(vector, "vector", {3}).vector<3>(0);
  result.shape = Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(single(shape, "shape", {6, 6})[0]);
  raise_unless_ok(validate(result.as<BodyState>()), "shape");
  return result;
}

namespace {

[[nodiscard]] py::object quadratic_forms(const AnyStateEllipsoid& self, const py::object& attitude,
                                         const py::object& vector) {
  Items points = attitudes(attitude, "attitude");
  Items vectors(vector, "vector", {3});
  const Shape leading = broadcast({&points, &vectors});
  const StateEllipsoid<BodyState> ellipsoid = self.as<BodyState>();
  return map_items(leading, {}, [&](Index i) {
    double value = 0;
    const Status status = quadratic_form(ellipsoid, BodyState{points.matrix3(i), vectors.vector<3>(i)}, value);
    return status == Status::ok ? value : std::numeric_limits<double>::quiet_NaN();
  });
}

}  // namespace

py::object extent_of(const AnyStateEllipsoid& self) {
  Extent<double> result;
  raise_unless_ok(extent(self.as<BodyState>(), result), "shape");
  return py::module_::import("elliptude.results")
      .attr("Extent")(to_array(result.half_widths_body), to_array(result.half_widths_reference), result.largest_angle,
                      to_array(result.largest_angle_axis), to_array(result.greatest_uncertainty));
}

void define_state_ellipsoids(py::module_& module) {
  using namespace py::literals;

  py::class_<AnyStateEllipsoid>(module, "StateEllipsoid",
                                R"(StateEllipsoid(attitude, vector, shape)
--

The set of states about a center: C = Ĉ exp(S(ζ)) and vector + δ with [ζ; δ]ᵀ P⁻¹ [ζ; δ] ≤ 1 (paper, eq. ueso).

P is the shape of a set, not a covariance; the error ζ is on the body side.

Parameters
----------
attitude : (3, 3) array_like or scipy Rotation
    Ĉ, body to reference.
vector : (3,) array_like
    The angular velocity (rad/s, body axes) for a rigid body, the gyro bias (rad/s) for a gyro flow.
shape : (6, 6) array_like
    P, rad², rad²/s and rad²/s², symmetric positive semidefinite.

Raises
------
ValueError
    If an argument is not finite, the attitude is no rotation, or the shape is not positive semidefinite.
)")
      .def(py::init(&make_state_ellipsoid), "attitude"_a, "vector"_a, "shape"_a)
      .def_property_readonly("attitude", [](const AnyStateEllipsoid& self) { return to_constant_array(self.attitude); })
      .def_property_readonly("vector", [](const AnyStateEllipsoid& self) { return to_constant_array(self.vector); })
      .def_property_readonly("shape", [](const AnyStateEllipsoid& self) { return to_constant_array(self.shape); })
      .def("quadratic_form", &quadratic_forms, "attitude"_a, "vector"_a,
           R"(quadratic_form(self, attitude, vector)
--

[ζ; δ]ᵀ P⁻¹ [ζ; δ] of states (..., 3, 3) and (..., 3): at most 1 inside.
)")
      .def(
          "contains",
          [](const AnyStateEllipsoid& self, const py::object& attitude, const py::object& vector) {
            return py::object(quadratic_forms(self, attitude, vector).attr("__le__")(1.0));
          },
          "attitude"_a, "vector"_a,
          R"(contains(self, attitude, vector)
--

Whether states (..., 3, 3) and (..., 3) are in the set.
)")
      .def("extent", &extent_of,
           R"(extent(self)
--

Half-widths along body and reference axes, the largest angle and the directions of greatest uncertainty.

Returns
-------
Extent
)")
      .def(
          "to_dict",
          [](const AnyStateEllipsoid& self) {
            using namespace py::literals;
            return py::dict("attitude"_a = to_array(self.attitude).attr("tolist")(),
                            "vector"_a = to_array(self.vector).attr("tolist")(),
                            "shape"_a = to_array(self.shape).attr("tolist")());
          },
          R"(to_dict(self)
--

Lists of numbers under 'attitude', 'vector' and 'shape', for JSON.
)")
      .def_static(
          "from_dict",
          [](const py::dict& fields) {
            return make_state_ellipsoid(fields["attitude"], fields["vector"], fields["shape"]);
          },
          "fields"_a,
          R"(from_dict(fields)
--

The inverse of `to_dict`.
)")
      .def("__repr__",
           [](const AnyStateEllipsoid& self) {
             Extent<double> e;
             const Status status = extent(self.as<BodyState>(), e);
             return "StateEllipsoid(largest_angle=" + (status == Status::ok ? text(e.largest_angle) : "?") + " rad)";
           })
      .def(py::pickle(
          [](const AnyStateEllipsoid& self) {
            return py::make_tuple(to_array(self.attitude), to_array(self.vector), to_array(self.shape));
          },
          [](const py::tuple& state) { return make_state_ellipsoid(state[0], state[1], state[2]); }));
}

}  // namespace elliptude::python
