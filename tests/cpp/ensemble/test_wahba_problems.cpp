// Eigen adds up three products of one problem in another order where it uses SIMD registers of its own.
#define EIGEN_DONT_VECTORIZE
#include <doctest/doctest.h>

#include <cmath>
#include <cstring>
#include <elliptude/ensemble/wahba.hpp>
#include <limits>
#include <random>
#include <vector>

using namespace elliptude;

namespace {

template <typename Number>
using Directions = Matrix<Number, 3, Eigen::Dynamic>;

/// What a call is given, and where it is kept.
template <typename Number>
struct Problems {
  std::vector<Number> reference;
  std::vector<Number> body;
  std::vector<Number> weights;
  Eigen::Index directions;

  [[nodiscard]] WahbaProblems<Number> view() const {
    return {reference.data(), body.data(), weights.data(), 3 * directions, 3 * directions, directions, directions};
  }
  [[nodiscard]] Status alone(std::size_t i, WahbaSolution<Number>& solution) const {
    const auto m = static_cast<std::size_t>(directions);
    return solve_wahba(Eigen::Map<const Directions<Number>>(reference.data() + 3 * m * i, 3, directions),
                       Eigen::Map<const Directions<Number>>(body.data() + 3 * m * i, 3, directions),
                       Eigen::Map<const Vector<Number, Eigen::Dynamic>>(weights.data() + m * i, directions),
                       WahbaMethod::foam, solution);
  }
};

/// Every third with little noise, every third with much (its root settles later, or never), every seventh with nearly collinear
/// directions, every fifth with lengths or weights that only the careful way can take.
template <typename Number>
[[nodiscard]] Problems<Number> problems(std::size_t count, std::size_t directions) {
  std::mt19937 generator(11);
  std::normal_distribution<double> normal;
  const auto vector = [&](double scale) {
    return Vector3<double>(scale * normal(generator), scale * normal(generator), scale * normal(generator));
  };
  Problems<Number> result{{}, {}, {}, static_cast<Eigen::Index>(directions)};
  for (std::size_t i = 0; i < count; ++i) {
    const Matrix3<double> attitude = exp(vector(1));
    const Vector3<double> axis = vector(1).normalized();
    const double noise = i % 3 == 0 ? 1e-6 : (i % 3 == 1 ? 0.02 : 0.4);
    const double close = i % 7 == 0 ? (sizeof(Number) == sizeof(float) ? 0.1 : 0.02) : 1.0;
    const double size = i % 5 == 0 ? std::ldexp(1.0, std::numeric_limits<Number>::max_exponent / 3) : 1.0;
    for (std::size_t k = 0; k < directions; ++k) {
      const Vector3<double> e = axis + vector(close);
      const Vector3<double> b = attitude.transpose() * e + e.norm() * close * noise * vector(1);
      for (int j = 0; j < 3; ++j) {
        result.reference.push_back(static_cast<Number>(size * e(j)));
        result.body.push_back(static_cast<Number>(b(j) / size));
      }
      result.weights.push_back(static_cast<Number>(i % 10 == 0 ? size : std::exp(normal(generator))));
    }
  }
  return result;
}

template <typename Number>
[[nodiscard]] bool same_bits(const WahbaSolution<Number>& a, const WahbaSolution<Number>& b) {
  return std::memcmp(a.attitude.data(), b.attitude.data(), 9 * sizeof(Number)) == 0 && a.cost == b.cost &&
         a.condition == b.condition;
}

template <typename Number, int Width>
void solves_as_each_alone() {
  constexpr std::size_t width = Width;
  for (const std::size_t directions : {std::size_t{2}, std::size_t{3}, std::size_t{11}}) {
    const Problems<Number> given = problems<Number>(200, directions);
    for (const std::size_t count : {std::size_t{1}, width - 1, width, std::size_t{200}}) {
      std::vector<WahbaSolution<Number>> together(count);
      const EnsembleStatus done = solve_wahba_problems<Width>(given.view(), count, together.data());
      REQUIRE(done.status == Status::ok);
      CHECK(done.member == count);
      for (std::size_t i = 0; i < count; ++i) {
        WahbaSolution<Number> alone;
        REQUIRE(given.alone(i, alone) == Status::ok);
        CAPTURE(i);
        REQUIRE(same_bits(together[i], alone));
      }
    }
  }
}

}  // namespace

TEST_CASE("problems solved together have the solutions that each has alone to the last bit") {
  SUBCASE("two doubles") { solves_as_each_alone<double, 2>(); }
  SUBCASE("eight doubles") { solves_as_each_alone<double, 8>(); }
  SUBCASE("four floats") { solves_as_each_alone<float, 4>(); }
}

TEST_CASE("problems may share references and weights") {
  Problems<double> given = problems<double>(30, 3);
  for (std::size_t i = 0; i < given.reference.size(); ++i) {
    given.reference[i] = given.reference[9 + i % 9];
    given.body[i] = given.body[9 + i % 9];
  }
  std::fill(given.weights.begin(), given.weights.end(), 2.0);
  WahbaProblems<double> shared = given.view();
  shared.reference_stride = 0;
  shared.weights_stride = 0;
  std::vector<WahbaSolution<double>> own(30);
  std::vector<WahbaSolution<double>> one(30);
  REQUIRE(solve_wahba_problems<4>(given.view(), 30, own.data()).status == Status::ok);
  REQUIRE(solve_wahba_problems<4>(shared, 30, one.data()).status == Status::ok);
  for (std::size_t i = 0; i < 30; ++i) {
    CHECK(same_bits(own[i], one[i]));
  }
}

TEST_CASE("the first problem without a solution is named and those before it are solved") {
  Problems<double> given = problems<double>(11, 3);
  std::vector<WahbaSolution<double>> solutions(11);
  WahbaSolution<double> alone;
  REQUIRE(given.alone(5, alone) == Status::ok);
  Status expected = Status::ok;
  SUBCASE("a direction that is not finite") {
    given.body[9 * 6 + 4] = std::nan("");
    expected = Status::not_finite;
  }
  SUBCASE("a direction of no length") {
    std::fill_n(given.reference.begin() + 9 * 6, 3, 0.0);
    expected = Status::zero_direction;
  }
  SUBCASE("a negative weight") {
    given.weights[3 * 6 + 1] = -1;
    expected = Status::out_of_range;
  }
  SUBCASE("collinear directions") {
    for (std::size_t k = 3; k < 9; ++k) {
      given.body[9 * 6 + k] = given.body[9 * 6 + k % 3];
      given.reference[9 * 6 + k] = given.reference[9 * 6 + k % 3];
    }
    expected = Status::attitude_undetermined;
  }
  const EnsembleStatus done = solve_wahba_problems<4>(given.view(), 11, solutions.data());
  CHECK(done.status == expected);
  CHECK(done.member == 6);
  CHECK(same_bits(solutions[5], alone));
}
