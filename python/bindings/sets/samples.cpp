#include <cmath>
#include <limits>

#include "sets/ellipsoids.hpp"

namespace elliptude::python {

namespace {

/// A factor L of the shape P = L Lᵀ with one column for each dimension that the ellipsoid has: fewer than its rows if it is
/// flat. Eigenvalues are of P scaled to a unit diagonal, so that units do not decide what counts as flat.
[[nodiscard]] Eigen::MatrixXd thin_factor(const AnyEllipsoid& ellipsoid) {
  const Index n = ellipsoid.center.size();
  const Eigen::VectorXd widths = half_widths(ellipsoid);
  const Eigen::VectorXd units = (widths.array() > 0).select(widths, 1);
  const Eigen::MatrixXd scaled =
      units.cwiseInverse().asDiagonal() * ellipsoid.shape * units.cwiseInverse().asDiagonal();
  const auto eigen = eigen_of(scaled, "shape");
  const double rounding = static_cast<double>(n) * std::numeric_limits<double>::epsilon();
  const auto rank = (eigen.values.array() > rounding).count();
  return units.asDiagonal() * eigen.vectors.leftCols(rank) * eigen.values.head(rank).cwiseSqrt().asDiagonal();
}

/// Normal numbers from NumPy's generator, each row a direction of equal chance once made a unit vector.
[[nodiscard]] Array normal_numbers(const py::object& generator, Index rows, Index columns) {
  return generator.attr("standard_normal")(py::make_tuple(rows, columns)).cast<Array>();
}
[[nodiscard]] Array uniform_numbers(const py::object& generator, Index count) {
  return generator.attr("random")(count).cast<Array>();
}

/// Center + L u with u uniform in the unit ball of as many dimensions as L has columns: an affine map keeps it uniform.
[[nodiscard]] py::array sample_inside(const AnyEllipsoid& self, Index count, const py::object& generator) {
  const Eigen::MatrixXd factor = thin_factor(self);
  const Index dimension = factor.cols();
  const Array normals = normal_numbers(generator, count, dimension);
  const Array uniforms = uniform_numbers(generator, count);
  Results points({count}, {self.center.size()});
  const double* normal = normals.data();
  const double* uniform = uniforms.data();
  {
    const py::gil_scoped_release release;
    for (Index i = 0; i < count; ++i) {
      Eigen::VectorXd u = Eigen::Map<const Eigen::VectorXd>(normal + i * dimension, dimension);
      if (dimension > 0) {
        u *= std::pow(uniform[i], 1.0 / static_cast<double>(dimension)) / u.norm();
      }
      points.set(i, Eigen::VectorXd(self.center + factor * u));
    }
  }
  return points.array();
}

/// Uniform by area. With u uniform on the unit sphere and axes S, the point center + V S u meets an area that is stretched by
/// det S ‖S⁻¹u‖; accepting it with the chance ‖S⁻¹u‖ s_min evens that out. At least three in ten are accepted, for
/// ‖S⁻¹u‖ s_min is no less than the part of u along the shortest axis.
[[nodiscard]] py::array sample_surface(const AnyEllipsoid& self, Index count, const py::object& generator) {
  const auto axes = axes_of(self);
  const Index dimension = self.center.size();
  const double shortest = axes.lengths(dimension - 1);
  if (!(shortest > 0)) {
    value_error("surface=True needs a shape that is positive definite, but the shortest semi-axis is " +
                text(shortest));
  }
  const Eigen::ArrayXd stretch = shortest / axes.lengths.array();
  const Eigen::MatrixXd factor = axes.directions * axes.lengths.asDiagonal();
  Results points({count}, {dimension});
  Index found = 0;
  while (found < count) {
    const Index trials = count - found;
    const Array normals = normal_numbers(generator, trials, dimension);
    const Array uniforms = uniform_numbers(generator, trials);
    const double* normal = normals.data();
    const double* uniform = uniforms.data();
    const py::gil_scoped_release release;
    for (Index i = 0; i < trials; ++i) {
      const Eigen::VectorXd u = Eigen::Map<const Eigen::VectorXd>(normal + i * dimension, dimension).normalized();
      if (uniform[i] <= (u.array() * stretch).matrix().norm()) {
        points.set(found++, Eigen::VectorXd(self.center + factor * u));
      }
    }
  }
  return points.array();
}

}  // namespace

py::array sample(const AnyEllipsoid& self, const py::object& count, const py::object& rng, bool surface) {
  const Index number = count.cast<Index>();
  if (number < 0) {
    value_error("count must not be negative, but is " + std::to_string(number));
  }
  const py::object generator = py::module_::import("numpy.random").attr("default_rng")(rng);
  return surface ? sample_surface(self, number, generator) : sample_inside(self, number, generator);
}

}  // namespace elliptude::python
