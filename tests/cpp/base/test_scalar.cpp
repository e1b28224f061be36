#include <doctest/doctest.h>

#include "elliptude/base/scalar.hpp"
#include "support/random.hpp"

using namespace elliptude;
using elliptude::testing::Random;

namespace {

TEST_CASE_TEMPLATE("the length of a vector and its direction, however small or large it is", Scalar, float, double) {
  using Limits = std::numeric_limits<Scalar>;
  Random random(101);
  for (const Scalar size : {Limits::denorm_min(), Limits::min(), std::sqrt(Limits::min()), Limits::epsilon(), Scalar(1),
                            std::sqrt(Limits::max()), Limits::max() / 4}) {
    CAPTURE(size);
    for (int trial = 0; trial < 200; ++trial) {
      const Vector3<Scalar> v = (Scalar(2) * size) * random.unit_vector<3>().cast<Scalar>();
      // long double has exponents to spare
      const Vector3<long double> wide = v.template cast<long double>();
      const long double length = wide.norm();
      if (length == 0) {
        continue;
      }
      // Half of the smallest number is what writing a subnormal length costs.
      const auto epsilon = static_cast<long double>(Limits::epsilon());
      const long double error = 4 * epsilon * length + 0.5L * static_cast<long double>(Limits::denorm_min());
      CHECK(std::abs(static_cast<long double>(scalar::length(v)) - length) <= error);
      CHECK((scalar::unit(v).template cast<long double>() - wide / length).norm() <= 4 * epsilon);
    }
  }
}

TEST_CASE("a zero vector has no length, and NaN is not a length") {
  const Vector3<double> zero = Vector3<double>::Zero();
  CHECK(scalar::length(zero) == 0);
  CHECK(scalar::unit(zero) == zero);
  for (int i = 0; i < 3; ++i) {
    for (const double rest : {0.0, 1.0, 1e-300, 1e300}) {
      Vector3<double> v = Vector3<double>::Constant(rest);
      v(i) = std::numeric_limits<double>::quiet_NaN();
      CHECK(std::isnan(scalar::length(v)));
      CHECK(!scalar::all_finite(scalar::unit(v)));
    }
  }
}

}  // namespace
