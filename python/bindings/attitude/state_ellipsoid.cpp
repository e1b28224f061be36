#include "attitude/state_ellipsoid.hpp"

#include "module.hpp"

namespace elliptude::python {

namespace {

[[nodiscard]] bool is_gibbs_chart(const std::string& chart) {
  if (chart != "exponential" && chart != "gibbs") {
    value_error("chart must be 'exponential' or 'gibbs', not '" + chart + "'");
  }
  return chart == "gibbs";
}

}  // namespace

Matrix6<double> single_matrix6(const py::object& value, const std::string& name) {
  return Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(single(value, name, {6, 6})[0]);
}

AnyStateEllipsoid make_state_ellipsoid(const py::object& attitude, const py::object& vector, const py::object& shape,
                                       const std::string& chart) {
  AnyStateEllipsoid result;
  result.is_gibbs = is_gibbs_chart(chart);
  result.attitude = single_attitude(attitude, "attitude");
  result.vector = single(vector, "vector", {3}).vector<3>(0);
  result.shape = single_matrix6(shape, "shape");
  raise_unless_ok(validate(result.as<BodyState>()), "shape");
  return result;
}

namespace {

[[nodiscard]] py::object quadratic_forms(const AnyStateEllipsoid& self, const py::object& attitude,
                                         const py::object& vector) {
  Items points = attitudes(attitude, "attitude");
  Items vectors(vector, "vector", {3});
  const Shape leading = broadcast({&points, &vectors});
  return self.in_chart([&](const auto& ellipsoid) {
    return map_items(leading, {}, [&](Index i) {
      double value = 0;
      const Status status = quadratic_form(ellipsoid, BodyState{points.matrix3(i), vectors.vector<3>(i)}, value);
      return status == Status::ok ? value : std::numeric_limits<double>::quiet_NaN();
    });
  });
}

[[nodiscard]] AnyStateEllipsoid converted_to(const AnyStateEllipsoid& self, const std::string& chart) {
  const bool to_gibbs = is_gibbs_chart(chart);
  if (to_gibbs == self.is_gibbs) {
    return self;
  }
  if (!to_gibbs) {
    StateEllipsoid<BodyState> result;
    raise_unless_ok(converted(self.as<BodyState, GibbsChart>(), result), "shape");
    return AnyStateEllipsoid::from(result);
  }
  StateEllipsoid<BodyState, GibbsChart> result;
  const Status status = converted(self.as<BodyState>(), result);
  if (status == Status::unbounded) {
    value_error("the set holds half turns, which the Gibbs chart has not: its largest angle must be below pi");
  }
  raise_unless_ok(status, "shape");
  return AnyStateEllipsoid::from(result);
}

/// Gibbs chart, for the rows of a log; NaN where a row is.
[[nodiscard]] py::object gibbs_forms(const py::object& attitudes, const py::object& vectors, const py::object& shapes,
                                     const py::object& true_attitudes, const py::object& true_vectors) {
  const auto anything = Items::Require::anything;
  Items centers(attitudes, "attitudes", {3, 3}, anything);
  Items shape(shapes, "shapes", {6, 6}, anything);
  Items truth(true_attitudes, "true_attitudes", {3, 3}, anything);
  Items vector(vectors, "vectors", {3}, anything);
  if (true_vectors.is_none()) {
    const Shape leading = broadcast({&centers, &shape, &truth});
    return map_items(leading, {}, [&](Index i) {
      const Matrix6<double> p = Eigen::Map<const Matrix6<double>>(shape[i]);
      const Vector3<double> x = GibbsChart::error(centers.matrix3(i), truth.matrix3(i));
      double value = 0;
      const Ellipsoid<double, 3> set{Vector3<double>::Zero(), p.topLeftCorner<3, 3>()};
      return quadratic_form(set, x, value) == Status::ok ? value : std::numeric_limits<double>::quiet_NaN();
    });
  }
  Items true_vector(true_vectors, "true_vectors", {3}, anything);
  const Shape leading = broadcast({&centers, &vector, &shape, &truth, &true_vector});
  return map_items(leading, {}, [&](Index i) {
    const StateEllipsoid<BodyState, GibbsChart> set{BodyState{centers.matrix3(i), vector.vector<3>(i)},
                                                    Eigen::Map<const Matrix6<double>>(shape[i])};
    double value = 0;
    const Status status = quadratic_form(set, BodyState{truth.matrix3(i), true_vector.vector<3>(i)}, value);
    return status == Status::ok ? value : std::numeric_limits<double>::quiet_NaN();
  });
}

/// Extents of sets in the Gibbs chart: 6 half-widths in body axes, 3 in reference axes, the largest angle.
[[nodiscard]] py::object gibbs_extents(const py::object& attitudes, const py::object& shapes) {
  Items centers(attitudes, "attitudes", {3, 3}, Items::Require::anything);
  Items shape(shapes, "shapes", {6, 6}, Items::Require::anything);
  const Shape leading = broadcast({&centers, &shape});
  return map_items(leading, {10}, [&](Index i) {
    const StateEllipsoid<BodyState, GibbsChart> set{BodyState{centers.matrix3(i), Vector3<double>::Zero()},
                                                    Eigen::Map<const Matrix6<double>>(shape[i])};
    Vector<double, 10> row = Vector<double, 10>::Constant(std::numeric_limits<double>::quiet_NaN());
    Extent<double> found;
    if (scalar::all_finite(set.shape) && extent(set, found) == Status::ok) {
      row << found.half_widths_body, found.half_widths_reference, found.largest_angle;
    }
    return row;
  });
}

/// Shapes of sets that contain those of the Gibbs chart, in the exponential chart.
[[nodiscard]] py::object gibbs_to_exponential(const py::object& shapes) {
  Items shape(shapes, "shapes", {6, 6}, Items::Require::anything);
  return map_items(shape.leading(), {6, 6}, [&](Index i) {
    const BodyState center{Matrix3<double>::Identity(), Vector3<double>::Zero()};
    StateEllipsoid<BodyState> result;
    const Status status =
        converted(StateEllipsoid<BodyState, GibbsChart>{center, Eigen::Map<const Matrix6<double>>(shape[i])}, result);
    return status == Status::ok ? result.shape
                                : Matrix6<double>(Matrix6<double>::Constant(std::numeric_limits<double>::quiet_NaN()));
  });
}

}  // namespace

py::object extent_of(const AnyStateEllipsoid& self) {
  Extent<double> result;
  raise_unless_ok(self.in_chart([&](const auto& ellipsoid) { return extent(ellipsoid, result); }), "shape");
  return py::module_::import("elliptude.results")
      .attr("Extent")(to_array(result.half_widths_body), to_array(result.half_widths_reference), result.largest_angle,
                      to_array(result.largest_angle_axis), to_array(result.greatest_uncertainty));
}

void define_state_ellipsoids(py::module_& module) {
  using namespace py::literals;

  py::class_<AnyStateEllipsoid>(module, "StateEllipsoid",
                                R"(StateEllipsoid(attitude, vector, shape, chart='exponential')
--

The set of states about a center: C = Ĉ exp(S(ζ)) and vector + δ with [ζ; δ]ᵀ P⁻¹ [ζ; δ] ≤ 1 (paper, eq. ueso).

P is the shape of a set, not a covariance; the error ζ is on the body side. In the Gibbs chart γ = 2 tan(θ/2) n, twice the
Gibbs vector of the same turn ζ = θ n, replaces ζ; both are equal to second order.

Parameters
----------
attitude : (3, 3) array_like or scipy Rotation
    Ĉ, body to reference.
vector : (3,) array_like
    The angular velocity (rad/s, body axes) for a rigid body, the gyro bias (rad/s) for a gyro flow.
shape : (6, 6) array_like
    P, rad², rad²/s and rad²/s², symmetric positive semidefinite.
chart : {'exponential', 'gibbs'}
    The coordinates of the attitude error.

Raises
------
ValueError
    If an argument is not finite, the attitude is not a rotation, or the shape is not positive semidefinite.
)")
      .def(py::init(&make_state_ellipsoid), "attitude"_a, "vector"_a, "shape"_a, "chart"_a = "exponential",
           "__init__(self, attitude, vector, shape, chart='exponential')\n--\n\n")
      .def_property_readonly("chart", &AnyStateEllipsoid::chart)
      .def_property_readonly("attitude", [](const AnyStateEllipsoid& self) { return to_constant_array(self.attitude); })
      .def_property_readonly("vector", [](const AnyStateEllipsoid& self) { return to_constant_array(self.vector); })
      .def_property_readonly("shape", [](const AnyStateEllipsoid& self) { return to_constant_array(self.shape); })
      .def("quadratic_form", &quadratic_forms, "attitude"_a, "vector"_a,
           R"(quadratic_form(self, attitude, vector)
--

[ζ; δ]ᵀ P⁻¹ [ζ; δ] of states (..., 3, 3) and (..., 3), in the Gibbs chart [γ; δ]ᵀ P⁻¹ [γ; δ]: at most 1 inside.

A GuaranteedFilter with `estimate_vector=False` reports two sets in one shape, the attitude's and the vector's, with zeros
between. The form of a state that is in both is the sum of the two sets' forms, up to 2.
)")
      .def(
          "contains",
          [](const AnyStateEllipsoid& self, const py::object& attitude, const py::object& vector) {
            return py::object(quadratic_forms(self, attitude, vector).attr("__le__")(1.0));
          },
          "attitude"_a, "vector"_a,
          R"(contains(self, attitude, vector)
--

Whether states (..., 3, 3) and (..., 3) are in the set: whether `quadratic_form` is at most 1.

A GuaranteedFilter with `estimate_vector=False` reports two sets in one shape. A state that is in both may have a form up to 2, and
this is then False: use the shapes `ellipsoid.shape[:3, :3]` and `ellipsoid.shape[3:, 3:]` one by one.
)")
      .def("converted", &converted_to, "chart"_a,
           R"(converted(self, chart)
--

A set in another chart that contains this one.

Parameters
----------
chart : {'exponential', 'gibbs'}

Returns
-------
StateEllipsoid

Raises
------
ValueError
    If it holds half turns, which the Gibbs chart does not have.
)")
      .def("extent", &extent_of,
           R"(extent(self)
--

Half-widths along body and reference axes, the largest angle and the directions of greatest uncertainty.

They are angles in any chart; for a set in the Gibbs chart the half-widths of ζ are bounds.

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
                            "shape"_a = to_array(self.shape).attr("tolist")(), "chart"_a = self.chart());
          },
          R"(to_dict(self)
--

Lists of numbers under 'attitude', 'vector' and 'shape', and the 'chart', for JSON.
)")
      .def_static(
          "from_dict",
          [](const py::dict& fields) {
            return make_state_ellipsoid(fields["attitude"], fields["vector"], fields["shape"],
                                        fields.contains("chart") ? fields["chart"].cast<std::string>() : "exponential");
          },
          "fields"_a,
          R"(from_dict(fields)
--

The inverse of `to_dict`.
)")
      .def(
          "__eq__",
          [](const AnyStateEllipsoid& self, const AnyStateEllipsoid& other) {
            return self.is_gibbs == other.is_gibbs && self.attitude == other.attitude && self.vector == other.vector &&
                   self.shape == other.shape;
          },
          py::is_operator(), "other"_a)
      .def("__repr__",
           [](const AnyStateEllipsoid& self) {
             Extent<double> e;
             const Status status = self.in_chart([&](const auto& ellipsoid) { return extent(ellipsoid, e); });
             return "StateEllipsoid(largest_angle=" + (status == Status::ok ? text(e.largest_angle) : "?") +
                    " rad, chart='" + self.chart() + "')";
           })
      .def(py::pickle(
          [](const AnyStateEllipsoid& self) {
            return py::make_tuple(to_array(self.attitude), to_array(self.vector), to_array(self.shape), self.chart());
          },
          [](const py::tuple& state) {
            return make_state_ellipsoid(state[0], state[1], state[2],
                                        state.size() > 3 ? state[3].cast<std::string>() : "exponential");
          }));

  module.def("_gibbs_forms", &gibbs_forms, "attitudes"_a, "vectors"_a, "shapes"_a, "true_attitudes"_a, "true_vectors"_a,
             R"(_gibbs_forms(attitudes, vectors, shapes, true_attitudes, true_vectors)
--

Implements `GuaranteedLog.forms`.
)");
  module.def("_gibbs_extents", &gibbs_extents, "attitudes"_a, "shapes"_a,
             R"(_gibbs_extents(attitudes, shapes)
--

Implements `GuaranteedLog.extents`.
)");
  module.def("_gibbs_to_exponential", &gibbs_to_exponential, "shapes"_a,
             R"(_gibbs_to_exponential(shapes)
--

Implements `GuaranteedLog.shapes_exponential`.
)");
}

}  // namespace elliptude::python
