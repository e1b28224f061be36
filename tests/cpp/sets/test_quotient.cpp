// Questions of a set that are no numbers, and one that has an answer in closed form.
#include <doctest/doctest.h>

#include <elliptude/sets/quotient.hpp>
#include <limits>

using namespace elliptude;

TEST_CASE("a question with an entry that is no number is refused, wherever the entry is") {
  const Vector3<double> squares(4, 1, 0.25);  // of the semi-axes
  const Ellipsoid<double, 3> ellipsoid{Vector3<double>::Zero(), squares.asDiagonal()};
  QuestionedSet<double, 3> set;
  REQUIRE(set.see(ellipsoid, nullptr, 0) == Status::ok);
  using Form = Matrix<double, 4>;
  const Form one = Vector<double, 4>(1, 0, 0, 0).asDiagonal();
  const Form weights = Vector<double, 4>(0, 1, 9, 4).asDiagonal();
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    for (int i = 0; i < 4; ++i) {
      for (int j = 0; j <= i; ++j) {
        double largest = -7;
        Form spoiled = weights;
        spoiled(i, j) = spoiled(j, i) = bad;
        CHECK(set.largest_quotient(spoiled, one, largest) == Status::not_finite);
        spoiled = one;
        spoiled(i, j) = spoiled(j, i) = bad;
        CHECK(set.largest_quotient(weights, spoiled, largest) == Status::not_finite);
        CHECK(largest == -7);
      }
    }
  }
  // The largest of y₁² + 9y₂² + 4y₃² is 9, at the end of the second axis.
  double largest = 0;
  REQUIRE(set.largest_quotient(weights, one, largest) == Status::ok);
  CHECK(largest >= 9);
  CHECK(largest <= 9 * 1.01);
}
