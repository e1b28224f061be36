#include "sets/ellipsoids.hpp"

namespace elliptude::python {

void require_dimension(Index n, const std::string& name) {
  if (n < 1 || n > largest_dimension) {
    value_error(name + " has dimension " + std::to_string(n) + "; supported are 1 to " +
                std::to_string(largest_dimension));
  }
}

Eigen::MatrixXd symmetric(const Eigen::MatrixXd& matrix, const std::string& name) {
  const bool good = with_dimension(matrix.rows(), [&](auto dimension) {
    constexpr int n = decltype(dimension)::value;
    return is_symmetric(Matrix<double, n>(matrix));
  });
  if (!good) {
    Eigen::Index row = 0;
    Eigen::Index column = 0;
    (matrix - matrix.transpose()).cwiseAbs().maxCoeff(&row, &column);
    const auto entry = [&](Eigen::Index i, Eigen::Index j) {
      return name + place({matrix.rows(), matrix.cols()}, i * matrix.cols() + j) + " is " + text(matrix(i, j));
    };
    value_error(name + " must be symmetric, but " + entry(row, column) + " and " + entry(column, row));
  }
  return 0.5 * (matrix + matrix.transpose());
}

SymmetricEigen<double, Eigen::Dynamic> eigen_of(const Eigen::MatrixXd& matrix, const std::string& name) {
  return with_dimension(matrix.rows(), [&](auto dimension) {
    constexpr int n = decltype(dimension)::value;
    SymmetricEigen<double, n> eigen;
    raise_unless_ok(symmetric_eigen(Matrix<double, n>(matrix), eigen), name);
    return SymmetricEigen<double, Eigen::Dynamic>{eigen.values, eigen.vectors};
  });
}

void require_positive_definite(const Eigen::MatrixXd& matrix, const std::string& name) {
  const bool good = with_dimension(matrix.rows(), [&](auto dimension) {
    constexpr int n = decltype(dimension)::value;
    Matrix<double, n> factor;
    return cholesky(Matrix<double, n>(matrix), factor) == Status::ok;
  });
  if (!good) {
    value_error(name + " must be positive definite, but its smallest eigenvalue is " +
                text(eigen_of(matrix, name).values(matrix.rows() - 1)));
  }
}

Criterion criterion_argument(const std::string& criterion, const py::object& weight, Index dimension) {
  if (criterion != "trace" && criterion != "volume") {
    value_error("criterion must be 'trace' or 'volume', not '" + criterion + "'");
  }
  if (weight.is_none()) {
    return {criterion == "volume", Eigen::MatrixXd::Identity(dimension, dimension)};
  }
  if (criterion == "volume") {
    value_error("weight belongs to criterion 'trace': the volume does not depend on one");
  }
  const Eigen::MatrixXd matrix = symmetric(single(weight, "weight", {dimension, dimension}).dynamic_matrix(), "weight");
  require_positive_definite(matrix, "weight");
  return {false, matrix};
}

double margin_if_any(const AnyEllipsoid& first, const AnyEllipsoid& second) {
  return with_dimension(first.center.size(), [&](auto dimension) {
    constexpr int n = decltype(dimension)::value;
    double margin = 0;
    const Status status = overlap_margin(fixed<n>(first), fixed<n>(second), margin);
    return status == Status::ok ? margin : std::numeric_limits<double>::quiet_NaN();
  });
}

PrincipalAxes<double, Eigen::Dynamic> axes_of(const AnyEllipsoid& ellipsoid) {
  return with_dimension(ellipsoid.center.size(), [&](auto dimension) {
    constexpr int n = decltype(dimension)::value;
    PrincipalAxes<double, n> axes;
    raise_unless_ok(principal_axes(fixed<n>(ellipsoid), axes), "shape");
    return PrincipalAxes<double, Eigen::Dynamic>{axes.lengths, axes.directions};
  });
}

}  // namespace elliptude::python
