// A small symmetric system against the exact solution, and against the length of a right side in the metric of the inverse.
#include <doctest/doctest.h>

#include <cmath>
#include <elliptude/sets/detail/bordered_system.hpp>

#include "support/random.hpp"

using namespace elliptude;
using elliptude::testing::Random;

namespace {

constexpr std::size_t most = 10;
using System = detail::BorderedSystem<double, most>;

void fill(const Eigen::MatrixXd& h, const Eigen::VectorXd& b, System& system) {
  const auto count = static_cast<std::size_t>(h.rows());
  system.begin(count);
  for (std::size_t i = 0; i < count; ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    for (std::size_t j = i; j < count; ++j) {
      system.entry(i, j) = h(row, static_cast<Eigen::Index>(j));
    }
    system.right_side(i) = b(row);
  }
}

}  // namespace

TEST_CASE("a bordered system of any count is solved, and measures its right side") {
  Random random(7);
  for (int trial = 0; trial < 200; ++trial) {
    const int count = 1 + trial % static_cast<int>(most);
    Eigen::MatrixXd root(count, count);
    Eigen::VectorXd x(count);
    for (int j = 0; j < count; ++j) {
      x(j) = random.normal();
      for (int i = 0; i < count; ++i) {
        root(i, j) = random.normal();
      }
    }
    const Eigen::MatrixXd h = root * root.transpose() + Eigen::MatrixXd::Identity(count, count);
    const Eigen::VectorXd b = h * x;
    System system;
    fill(h, b, system);
    REQUIRE(system.eliminate());
    double square = 0;
    for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
      square += system.inverse_pivot(i) * system.right_side(i) * system.right_side(i);
    }
    CAPTURE(count);
    CHECK(square == doctest::Approx(b.dot(x)).epsilon(1e-12));  // bᵀH⁻¹b
    std::array<double, most> solution{};
    system.solve(solution);
    for (int i = 0; i < count; ++i) {
      CHECK(std::abs(solution[static_cast<std::size_t>(i)] - x(i)) < 1e-11 * (1 + x.norm()));
    }
  }
}

TEST_CASE("a system that is not positive definite, or not a number, is refused") {
  System system;
  const Eigen::VectorXd b = Eigen::VectorXd::Ones(3);
  Eigen::MatrixXd h = Eigen::MatrixXd::Identity(3, 3);
  h(2, 2) = 0.5;
  h(0, 2) = h(2, 0) = 0.75;  // det < 0
  fill(h, b, system);
  CHECK_FALSE(system.eliminate());
  h(0, 2) = h(2, 0) = std::nan("");
  fill(h, b, system);
  CHECK_FALSE(system.eliminate());
}
