#include <pybind11/stl.h>

#include <cmath>
#include <elliptude/sets/sum.hpp>
#include <random>

#include "module.hpp"
#include "sets/ellipsoids.hpp"

namespace elliptude::python {

namespace {

[[nodiscard]] AnyEllipsoid make_ellipsoid(const py::object& center, const py::object& shape) {
  const Items centers = single(center, "center", {any_length});
  const Index n = centers.item()[0];
  require_dimension(n, "center");
  AnyEllipsoid ellipsoid{centers.dynamic_vector(), symmetric(single(shape, "shape", {n, n}).dynamic_matrix(), "shape")};
  const Status status =
      with_dimension(n, [&](auto dimension) { return validate(fixed<decltype(dimension)::value>(ellipsoid)); });
  if (status == Status::not_positive_definite) {
    value_error("shape must be positive semidefinite, but its smallest eigenvalue is " +
                text(eigen_of(ellipsoid.shape, "shape").values(n - 1)));
  }
  raise_unless_ok(status, "shape");
  return ellipsoid;
}

/// Points or directions (..., n).
[[nodiscard]] Items vectors_of(const AnyEllipsoid& self, const py::object& value, const std::string& name) {
  return {value, name, {self.center.size()}};
}

[[nodiscard]] py::object results_type(const char* name) { return py::module_::import("elliptude.results").attr(name); }

[[nodiscard]] AnyEllipsoid projection_on(const AnyEllipsoid& self, const std::vector<Index>& indices) {
  const Index n = self.center.size();
  const auto size = static_cast<Index>(indices.size());
  require_dimension(size, "indices");
  std::vector<bool> seen(static_cast<std::size_t>(n), false);
  for (const Index index : indices) {
    if (index < 0 || index >= n) {
      value_error("indices must be from 0 to " + std::to_string(n - 1) + ", but hold " + std::to_string(index));
    }
    if (seen[static_cast<std::size_t>(index)]) {
      value_error("indices must differ, but " + std::to_string(index) + " is there twice");
    }
    seen[static_cast<std::size_t>(index)] = true;
  }
  AnyEllipsoid result{Eigen::VectorXd(size), Eigen::MatrixXd(size, size)};
  for (Index i = 0; i < size; ++i) {
    const Index from = indices[static_cast<std::size_t>(i)];
    result.center(i) = self.center(from);
    for (Index j = 0; j < size; ++j) {
      result.shape(i, j) = self.shape(from, indices[static_cast<std::size_t>(j)]);
    }
  }
  return result;
}

[[nodiscard]] AnyEllipsoid sum_of(const std::vector<AnyEllipsoid>& terms, const std::string& criterion,
                                  const py::object& weight) {
  constexpr std::size_t most_terms = 64;  // of elliptude::minimal_sum
  if (terms.empty() || terms.size() > most_terms) {
    value_error("ellipsoids must be 1 to " + std::to_string(most_terms) + " in number, not " +
                std::to_string(terms.size()));
  }
  const Index n = terms.front().center.size();
  for (std::size_t i = 1; i < terms.size(); ++i) {
    if (terms[i].center.size() != n) {
      value_error("ellipsoids[" + std::to_string(i) + "] has dimension " + std::to_string(terms[i].center.size()) +
                  ", ellipsoids[0] has " + std::to_string(n));
    }
  }
  const Criterion size = criterion_argument(criterion, weight, n);
  return with_dimension(n, [&](auto dimension) {
    constexpr int N = decltype(dimension)::value;
    std::vector<Ellipsoid<double, N>> fixed_terms;
    fixed_terms.reserve(terms.size());
    for (const AnyEllipsoid& term : terms) {
      fixed_terms.push_back(fixed<N>(term));
    }
    Ellipsoid<double, N> sum;
    const Status status =
        minimal_sum(fixed_terms.data(), fixed_terms.size(), size_criterion<N>(size.by_volume, size.weight), sum);
    if (status == Status::not_positive_definite) {
      value_error("ellipsoids have a flat sum, which has no volume to minimise: use criterion 'trace'");
    }
    raise_unless_ok(status, "ellipsoids");
    return any(sum);
  });
}

[[nodiscard]] double margin_of(const AnyEllipsoid& first, const AnyEllipsoid& second) {
  if (first.center.size() != second.center.size()) {
    value_error("second has dimension " + std::to_string(second.center.size()) + ", first has " +
                std::to_string(first.center.size()));
  }
  const double margin = margin_if_any(first, second);
  if (std::isnan(margin)) {
    value_error("first and second are both flat: a mixture of their shapes must be positive definite");
  }
  return margin;
}

}  // namespace

void define_ellipsoids(py::module_& module) {
  py::class_<AnyEllipsoid>(module, "Ellipsoid", py::is_final(), R"(Ellipsoid(center, shape)
--

The set E(x̂, P) = {x : (x − x̂)ᵀ P⁻¹ (x − x̂) ≤ 1} (paper, §2.3.2); immutable.

P is the shape of a set, not a covariance: it has no probability, and its eigenvalues are the squares of the
semi-axes. It may be singular; the ellipsoid is then flat.

Parameters
----------
center : array_like, shape (n,)
    x̂, with n from 1 to 6.
shape : array_like, shape (n, n)
    P, symmetric and positive semidefinite, in squares of the center's units.

Raises
------
ValueError
    If an entry is not finite, the shapes do not fit, n is not supported, or P is not symmetric or has a negative eigenvalue.

Examples
--------
>>> from elliptude import Ellipsoid
>>> ball = Ellipsoid([1.0, 0.0], [[4.0, 0.0], [0.0, 4.0]])
>>> bool(ball.contains([2.9, 0.0]))
True
>>> float(ball.support([1.0, 0.0]))
3.0
)")
      .def(py::init(&make_ellipsoid), py::arg("center"), py::arg("shape"), "__init__(self, center, shape)\n--\n\n")
      .def_property_readonly(
          "center", [](const AnyEllipsoid& self) { return to_constant_array(self.center); },
          "x̂, shape (n,); read-only.")
      .def_property_readonly(
          "shape", [](const AnyEllipsoid& self) { return to_constant_array(self.shape); },
          "P, shape (n, n); read-only.")
      .def_property_readonly(
          "dimension", [](const AnyEllipsoid& self) { return self.center.size(); }, "n.")
      .def(
          "contains",
          [](const AnyEllipsoid& self, const py::object& points) {
            const Items items = vectors_of(self, points, "points");
            return with_dimension(self.center.size(), [&](auto dimension) {
              constexpr int n = decltype(dimension)::value;
              const Ellipsoid<double, n> ellipsoid = fixed<n>(self);
              return map_questions(items.leading(), [&](Index i) { return contains(ellipsoid, items.vector<n>(i)); });
            });
          },
          py::arg("points"), R"(contains(self, points)
--

Whether points are in the set, its surface included.

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
          "quadratic_form",
          [](const AnyEllipsoid& self, const py::object& points) {
            const Items items = vectors_of(self, points, "points");
            return with_dimension(self.center.size(), [&](auto dimension) {
              constexpr int n = decltype(dimension)::value;
              const Ellipsoid<double, n> ellipsoid = fixed<n>(self);
              return map_items(items.leading(), {}, [&](Index i) {
                double value = 0;
                if (const Status status = quadratic_form(ellipsoid, items.vector<n>(i), value); status != Status::ok) {
                  raise(status, items.label(i));
                }
                return value;
              });
            });
          },
          py::arg("points"), R"(quadratic_form(self, points)
--

(x − x̂)ᵀ P⁻¹ (x − x̂): at most 1 inside, 1 on the surface.

Parameters
----------
points : array_like, shape (..., n)

Returns
-------
float or ndarray, shape (...)
    Infinite off the plane of an ellipsoid with a coordinate of zero width.

Raises
------
ValueError
    If an entry is not finite or the shape is another one.
)")
      .def(
          "support",
          [](const AnyEllipsoid& self, const py::object& direction) {
            const Items items = vectors_of(self, direction, "direction");
            return with_dimension(self.center.size(), [&](auto dimension) {
              constexpr int n = decltype(dimension)::value;
              const Ellipsoid<double, n> ellipsoid = fixed<n>(self);
              return map_items(items.leading(), {}, [&](Index i) { return support(ellipsoid, items.vector<n>(i)); });
            });
          },
          py::arg("direction"), R"(support(self, direction)
--

The support function max {dᵀx : x in E} = dᵀx̂ + √(dᵀPd).

Parameters
----------
direction : array_like, shape (..., n)
    d, of any length.

Returns
-------
float or ndarray, shape (...)

Raises
------
ValueError
    If an entry is not finite or the shape is another one.
)")
      .def(
          "half_widths", [](const AnyEllipsoid& self) { return to_array(half_widths(self)); }, R"(half_widths(self)
--

Half the widths of the smallest box about the ellipsoid, √Pᵢᵢ, in the units of the coordinates.

Returns
-------
ndarray, shape (n,)
)")
      .def(
          "principal_axes",
          [](const AnyEllipsoid& self) {
            const auto axes = axes_of(self);
            return results_type("PrincipalAxes")(to_array(axes.lengths), to_array(axes.directions));
          },
          R"(principal_axes(self)
--

The semi-axes, longest first, and their directions.

Returns
-------
PrincipalAxes
    With ``lengths``, shape (n,), and ``directions``, shape (n, n), unit vectors as columns in the same order.
)")
      .def(
          "log_volume",
          [](const AnyEllipsoid& self) {
            return with_dimension(self.center.size(), [&](auto dimension) {
              constexpr int n = decltype(dimension)::value;
              double value = 0;
              if (log_volume(fixed<n>(self), value) != Status::ok) {
                value_error("shape must be positive definite: a flat ellipsoid has no volume");
              }
              return value;
            });
          },
          R"(log_volume(self)
--

The natural logarithm of the volume, which is in the product of the coordinates' units.

Returns
-------
float

Raises
------
ValueError
    If the ellipsoid is flat.
)")
      .def(
          "affine_image",
          [](const AnyEllipsoid& self, const py::object& transform, const py::object& shift) {
            const Items matrix = single(transform, "transform", {any_length, self.center.size()});
            const Index m = matrix.item()[0];
            require_dimension(m, "transform");
            const Eigen::VectorXd by = shift.is_none() ? Eigen::VectorXd(Eigen::VectorXd::Zero(m))
                                                       : single(shift, "shift", {m}).dynamic_vector();
            return affine_image(self, matrix.dynamic_matrix(), by);
          },
          py::arg("transform"), py::arg("shift") = py::none(), R"(affine_image(self, transform, shift=None)
--

The image {T x + s : x in E}, E(T x̂ + s, T P Tᵀ) (paper, eq. Pkpf).

Parameters
----------
transform : array_like, shape (m, n)
    T.
shift : array_like, shape (m,), optional
    s; zero unless given.

Returns
-------
Ellipsoid
    The image, of dimension m; flat if T does not have full row rank.

Raises
------
ValueError
    If an entry is not finite, the shapes do not fit, or m is not from 1 to 6.
)")
      .def("projection", &projection_on, py::arg("indices"), R"(projection(self, indices)
--

The projection on some of the coordinates.

Parameters
----------
indices : sequence of int
    The coordinates to keep, in the order wanted.

Returns
-------
Ellipsoid

Raises
------
ValueError
    If an index is out of range or there twice.
)")
      .def("sample", &sample, py::arg("count"), py::arg("rng") = py::none(), py::arg("surface") = false,
           R"(sample(self, count, rng=None, surface=False)
--

Random points.

Parameters
----------
count : int
rng : int or numpy.random.Generator, optional
    A seed, or the generator to draw from; without one, fresh entropy.
surface : bool, optional
    False: uniform by volume in the set; in a flat ellipsoid, in its plane. True: uniform by area on the surface. (Points
    that are uniform on the sphere and stretched with it would be too frequent where the ellipsoid is flat; some of them are
    rejected to correct this.)

Returns
-------
ndarray, shape (count, n)

Raises
------
ValueError
    If the count is negative, or a flat ellipsoid's surface is asked for.
)")
      .def(
          "__eq__",
          [](const AnyEllipsoid& self, const AnyEllipsoid& other) {
            return self.center.size() == other.center.size() && self.center == other.center &&
                   self.shape == other.shape;
          },
          py::is_operator(), py::arg("other"))
      .def("__repr__",
           [](const py::object& self) {
             return py::str("Ellipsoid(center={}, shape={})")
                 .format(self.attr("center").attr("tolist")(), self.attr("shape").attr("tolist")());
           })
      .def("__reduce__", [](const py::object& self) {
        return py::make_tuple(py::type::of(self), py::make_tuple(self.attr("center"), self.attr("shape")));
      });

  module.def("minimal_sum", &sum_of, py::arg("ellipsoids"), py::arg("criterion") = "trace",
             py::arg("weight") = py::none(), R"(minimal_sum(ellipsoids, criterion='trace', weight=None)
--

A small ellipsoid that contains the sum {Σ xᵢ : xᵢ in Eᵢ} of ellipsoids.

It is the smallest of the outer ellipsoids P = Σ Pᵢ/αᵢ, Σ αᵢ = 1, about the sum of the centers: for the trace
αᵢ ∝ √tr(W Pᵢ) (paper, eq. Pmkl).

Parameters
----------
ellipsoids : sequence of Ellipsoid
    1 to 64, all of dimension n.
criterion : {'trace', 'volume'}
    The size to minimise: tr(W P), or the volume.
weight : array_like, shape (n, n), optional
    W, symmetric positive definite, in the inverse squares of the coordinates' units; the identity unless given. Only with
    'trace'.

Returns
-------
Ellipsoid

Raises
------
ValueError
    If there are no ellipsoids, too many or of different dimensions, W is not positive definite, the criterion is unknown, or
    the volume of a flat sum is to be minimised.

Examples
--------
>>> from elliptude import Ellipsoid, minimal_sum
>>> total = minimal_sum([Ellipsoid([0, 0], [[4, 0], [0, 1]]), Ellipsoid([0, 0], [[1, 0], [0, 9]])])
>>> float(total.shape.trace() - (5**0.5 + 10**0.5) ** 2) < 1e-12
True
)");

  module.def("overlap_margin", &margin_of, py::arg("first"), py::arg("second"), R"(overlap_margin(first, second)
--

How much two ellipsoids overlap.

1 − max over 0 ≤ λ ≤ 1 of λ(1−λ) dᵀ(λP₁ + (1−λ)P₂)⁻¹d, with d the difference of the centers (theory, section 7).

Parameters
----------
first, second : Ellipsoid
    Ellipsoids of the same dimension. One of them may be flat.

Returns
-------
float
    1 for a common center, 0 if they touch, negative if and only if they have no common point.

Raises
------
ValueError
    If the dimensions differ or both are flat.
)");
}

}  // namespace elliptude::python
