#include <cmath>

#include "module.hpp"
#include "sets/ellipsoids.hpp"

namespace elliptude::python {

namespace {

[[nodiscard]] AnyQuadric make_quadric(const py::object& a, const py::object& g, const py::object& c) {
  const Items gradient = single(g, "g", {any_length});
  const Index n = gradient.item()[0];
  require_dimension(n, "g");
  return {symmetric(single(a, "a", {n, n}).dynamic_matrix(), "a"), gradient.dynamic_vector(),
          single(c, "c", {}).number(0)};
}

[[nodiscard]] AnyQuadric slab_of(const py::object& normal, const py::object& middle, const py::object& half_width) {
  const Items direction = single(normal, "normal", {any_length});
  const Index n = direction.item()[0];
  require_dimension(n, "normal");
  const double center = single(middle, "middle", {}).number(0);
  const double width = single(half_width, "half_width", {}).number(0);
  if (!(width >= 0)) {
    value_error("half_width must not be negative, but is " + text(width));
  }
  return with_dimension(n, [&](auto dimension) {
    constexpr int N = decltype(dimension)::value;
    Quadric<double, N> quadric;
    const Status status = slab(direction.vector<N>(0), center, width, quadric);
    if (status == Status::zero_direction) {
      value_error("normal must not be zero, but its length is " + text(direction.vector<N>(0).norm()));
    }
    raise_unless_ok(status, "normal");
    return AnyQuadric{quadric.a, quadric.g, quadric.c};
  });
}

[[nodiscard]] AnyQuadric quadric_of(const AnyEllipsoid& ellipsoid) {
  return with_dimension(ellipsoid.center.size(), [&](auto dimension) {
    constexpr int n = decltype(dimension)::value;
    Quadric<double, n> quadric;
    const Status status = to_quadric(fixed<n>(ellipsoid), quadric);
    if (status == Status::not_positive_definite) {
      value_error("ellipsoid must not be flat: its shape must be positive definite");
    }
    raise_unless_ok(status, "ellipsoid");
    return AnyQuadric{quadric.a, quadric.g, quadric.c};
  });
}

[[nodiscard]] AnyEllipsoid ellipsoid_of(const AnyQuadric& quadric) {
  return with_dimension(quadric.g.size(), [&](auto dimension) {
    constexpr int n = decltype(dimension)::value;
    const Quadric<double, n> q = fixed<n>(quadric);
    Ellipsoid<double, n> ellipsoid;
    const Status status = to_ellipsoid(q, ellipsoid);
    if (status == Status::unbounded) {
      require_positive_definite(quadric.a, "a");
    }
    if (status == Status::empty_intersection) {
      // The largest slack: how far the quadric is from having a point.
      Matrix<double, n> inverse;
      raise_unless_ok(inverse_positive_definite(q.a, inverse), "a");
      const double margin = slack(q, Vector<double, n>(-inverse * q.g));
      throw InconsistentSets("the quadric has no point: its largest slack is " + text(margin), margin);
    }
    raise_unless_ok(status, "quadric");
    return any(ellipsoid);
  });
}

/// With an ellipsoid or a quadric as the second set.
[[nodiscard]] py::object intersection_of(const AnyEllipsoid& first, const py::object& second,
                                         const std::string& criterion, const py::object& weight) {
  const bool is_ellipsoid = py::isinstance<AnyEllipsoid>(second);
  if (!is_ellipsoid && !py::isinstance<AnyQuadric>(second)) {
    throw py::type_error(std::string("second must be an Ellipsoid or a Quadric, not ") +
                         Py_TYPE(second.ptr())->tp_name);
  }
  const Index n = first.center.size();
  const Index other =
      is_ellipsoid ? second.cast<const AnyEllipsoid&>().center.size() : second.cast<const AnyQuadric&>().g.size();
  if (other != n) {
    value_error("second has dimension " + std::to_string(other) + ", first has " + std::to_string(n));
  }
  const Criterion size = criterion_argument(criterion, weight, n);
  double share = 0;
  const AnyEllipsoid set = with_dimension(n, [&](auto dimension) {
    constexpr int N = decltype(dimension)::value;
    const auto wanted = size_criterion<N>(size.by_volume, size.weight);
    Intersection<double, N> intersection;
    if (is_ellipsoid) {
      const auto& ellipsoid = second.cast<const AnyEllipsoid&>();
      const Status status = minimal_intersection(fixed<N>(first), fixed<N>(ellipsoid), wanted, intersection);
      if (status == Status::empty_intersection) {
        const double margin = margin_if_any(first, ellipsoid);
        throw InconsistentSets("first and second have no common point: their overlap margin is " + text(margin) +
                                   " and would have to be at least 0; some bound is wrong",
                               margin);
      }
      if (status == Status::not_positive_definite) {
        value_error("first and second are both flat: the shape of one must be positive definite");
      }
      raise_unless_ok(status, "intersection");
      share = intersection.share;
    } else {
      const Status status =
          minimal_intersection(fixed<N>(second.cast<const AnyQuadric&>()), fixed<N>(first), wanted, intersection);
      if (status == Status::empty_intersection) {
        throw InconsistentSets("first and second have no common point; some bound is wrong");
      }
      raise_unless_ok(status, "intersection");
      share = 1 - intersection.share;  // the core's first set is the quadric
    }
    return any(intersection.set);
  });
  return py::module_::import("elliptude.results").attr("Intersection")(set, share);
}

}  // namespace

void define_quadrics(py::module_& module) {
  py::class_<AnyQuadric>(module, "Quadric", py::is_final(), R"(Quadric(a, g, c)
--

The set {y : yᵀAy + 2gᵀy ≤ c}; immutable.

A need not be positive definite: a half-space, a slab, a cylinder and the inside of a cone are quadrics as an ellipsoid
is, and a measurement says that the state is in one (theory, section 7).

Parameters
----------
a : array_like, shape (n, n)
    Symmetric, with n from 1 to 6.
g : array_like, shape (n,)
c : float

Raises
------
ValueError
    If an entry is not finite, the shapes do not fit, n is not supported, or A is not symmetric.
)")
      .def(py::init(&make_quadric), py::arg("a"), py::arg("g"), py::arg("c"), "__init__(self, a, g, c)\n--\n\n")
      .def_static("slab", &slab_of, py::arg("normal"), py::arg("middle"), py::arg("half_width"),
                  R"(slab(normal, middle, half_width)
--

The slab |nᵀy − middle| ≤ half_width, unbounded along n − 1 directions.

Parameters
----------
normal : array_like, shape (n,)
    Not zero; its length scales the other two.
middle : float
half_width : float
    Not negative.

Returns
-------
Quadric

Raises
------
ValueError
    If an entry is not finite, the normal is zero or the half-width negative.
)")
      .def_static("from_ellipsoid", &quadric_of, py::arg("ellipsoid"), R"(from_ellipsoid(ellipsoid)
--

An ellipsoid as a quadric: A = P⁻¹, g = −Ax̂, c = 1 − x̂ᵀAx̂.

Parameters
----------
ellipsoid : Ellipsoid

Returns
-------
Quadric

Raises
------
ValueError
    If the ellipsoid is flat.
)")
      .def_property_readonly(
          "a", [](const AnyQuadric& self) { return to_constant_array(self.a); }, "A, shape (n, n); read-only.")
      .def_property_readonly(
          "g", [](const AnyQuadric& self) { return to_constant_array(self.g); }, "g, shape (n,); read-only.")
      .def_property_readonly(
          "c", [](const AnyQuadric& self) { return self.c; }, "c.")
      .def_property_readonly(
          "dimension", [](const AnyQuadric& self) { return self.g.size(); }, "n.")
      .def(
          "slack",
          [](const AnyQuadric& self, const py::object& points) {
            const Items items(points, "points", {self.g.size()});
            return with_dimension(self.g.size(), [&](auto dimension) {
              constexpr int n = decltype(dimension)::value;
              const Quadric<double, n> quadric = fixed<n>(self);
              return map_items(items.leading(), {}, [&](Index i) { return slack(quadric, items.vector<n>(i)); });
            });
          },
          py::arg("points"), R"(slack(self, points)
--

c − yᵀAy − 2gᵀy: not negative inside.

Parameters
----------
points : array_like, shape (..., n)

Returns
-------
float or ndarray, shape (...)

Raises
------
ValueError
    If an entry is not finite or the shape is another one.
)")
      .def(
          "contains",
          [](const AnyQuadric& self, const py::object& points) {
            const Items items(points, "points", {self.g.size()});
            return with_dimension(self.g.size(), [&](auto dimension) {
              constexpr int n = decltype(dimension)::value;
              const Quadric<double, n> quadric = fixed<n>(self);
              return map_questions(items.leading(), [&](Index i) { return contains(quadric, items.vector<n>(i)); });
            });
          },
          py::arg("points"), R"(contains(self, points)
--

Whether points are in the set.

Parameters
----------
points : array_like, shape (..., n)

Returns
-------
bool or ndarray of bool, shape (...)

Raises
------
ValueError
    If an entry is not finite or the shape is another one.
)")
      .def(
          "pullback",
          [](const AnyQuadric& self, const py::object& transform, const py::object& shift) {
            const Index n = self.g.size();
            const Items matrix = single(transform, "transform", {n, any_length});
            require_dimension(matrix.item()[1], "transform");
            const Eigen::VectorXd by = shift.is_none() ? Eigen::VectorXd(Eigen::VectorXd::Zero(n))
                                                       : single(shift, "shift", {n}).dynamic_vector();
            return pullback(self, matrix.dynamic_matrix(), by);
          },
          py::arg("transform"), py::arg("shift") = py::none(), R"(pullback(self, transform, shift=None)
--

The set {z : T z + s in the quadric}: the same constraint, seen in coordinates z with y = T z + s.

Parameters
----------
transform : array_like, shape (n, m)
    T.
shift : array_like, shape (n,), optional
    s; zero unless given.

Returns
-------
Quadric
    The quadric seen in these coordinates, of dimension m.

Raises
------
ValueError
    If an entry is not finite, the shapes do not fit, or m is not from 1 to 6.
)")
      .def("to_ellipsoid", &ellipsoid_of, R"(to_ellipsoid(self)
--

The ellipsoid that a quadric with positive definite A is: center −A⁻¹g, shape (c + gᵀA⁻¹g) A⁻¹.

Returns
-------
Ellipsoid

Raises
------
ValueError
    If A is not positive definite: the set is not bounded.
InconsistentMeasurement
    If the set is empty; its ``margin`` is the largest slack, which is negative.
)")
      .def(
          "__eq__",
          [](const AnyQuadric& self, const AnyQuadric& other) {
            return self.g.size() == other.g.size() && self.a == other.a && self.g == other.g && self.c == other.c;
          },
          py::is_operator(), py::arg("other"))
      .def("__repr__",
           [](const py::object& self) {
             return py::str("Quadric(a={}, g={}, c={})")
                 .format(self.attr("a").attr("tolist")(), self.attr("g").attr("tolist")(), self.attr("c"));
           })
      .def("__reduce__", [](const py::object& self) {
        return py::make_tuple(py::type::of(self), py::make_tuple(self.attr("a"), self.attr("g"), self.attr("c")));
      });

  module.def("minimal_intersection", &intersection_of, py::arg("first"), py::arg("second"),
             py::arg("criterion") = "trace", py::arg("weight") = py::none(),
             R"(minimal_intersection(first, second, criterion='trace', weight=None)
--

A small ellipsoid that contains the intersection of an ellipsoid with an ellipsoid or a quadric.

The smallest of the family that two multipliers give (paper, eqs. xhatP to LP, with both end points of q), never larger
than either ellipsoid.

Parameters
----------
first : Ellipsoid
second : Ellipsoid or Quadric
    Of the same dimension n as `first`. One of two ellipsoids may be flat, and a quadric unbounded.
criterion : {'trace', 'volume'}
    The size to minimise: tr(W P), or the volume.
weight : array_like, shape (n, n), optional
    W, symmetric positive definite, in the inverse squares of the coordinates' units; the identity unless given. Only with
    'trace'.

Returns
-------
Intersection
    With ``ellipsoid`` and ``share``: 0 if the first set alone is the answer, 1 if the second alone; q = share/(1 − share) in
    the paper's notation.

Raises
------
InconsistentMeasurement
    If the sets have no common point. Its ``margin`` is that of `overlap_margin`, negative; NaN for a quadric.
ValueError
    If the dimensions differ, both ellipsoids are flat, W is not positive definite or the criterion is unknown.

Examples
--------
>>> import numpy as np
>>> from elliptude import Ellipsoid, minimal_intersection
>>> ellipsoid, share = minimal_intersection(Ellipsoid([0, 0, 0], np.eye(3)), Ellipsoid([1, 0, 0], np.eye(3)))
>>> ellipsoid.center.round(6).tolist(), ellipsoid.shape.diagonal().round(6).tolist()
([0.5, 0.0, 0.0], [0.75, 0.75, 0.75])
)");
}

}  // namespace elliptude::python
