// How a step is put together: the lengths of kicks and turns, and the conditions that make its order.

#include <doctest/doctest.h>

#include <cmath>
#include <elliptude/dynamics/composition.hpp>
#include <vector>

using namespace elliptude;

namespace {

template <typename Scalar>
Composition<Scalar> composition(int order) {
  Composition<Scalar> result;
  REQUIRE(composition_of_order(order, result) == Status::ok);
  return result;
}

template <typename Scalar>
Splitting<Scalar> splitting(int order) {
  Splitting<Scalar> result;
  REQUIRE(splitting_of_order(order, result) == Status::ok);
  return result;
}

}  // namespace

TEST_CASE("every composition is symmetric and its weights satisfy the power sums of its order") {
  for (const int order : {2, 4, 6, 8}) {
    CAPTURE(order);
    const Composition<long double> exact = composition<long double>(order);
    const Composition<double> rounded = composition<double>(order);
    REQUIRE(rounded.stages == exact.stages);
    for (int power = 1; power < order; power += 2) {
      long double sum = 0;
      for (int i = 0; i < exact.stages; ++i) {
        sum += std::pow(exact.weights[static_cast<std::size_t>(i)], static_cast<long double>(power));
      }
      CAPTURE(power);
      CHECK(std::abs(sum - (power == 1 ? 1.0L : 0.0L)) <= 2e-18L);
    }
    for (int i = 0; i < exact.stages; ++i) {
      const auto here = static_cast<std::size_t>(i);
      const auto mirrored = static_cast<std::size_t>(exact.stages - 1 - i);
      CHECK(exact.weights[here] == exact.weights[mirrored]);
      CHECK(rounded.weights[here] == static_cast<double>(exact.weights[here]));
    }
  }
  CHECK(composition<double>(2).stages == 1);
  CHECK(composition<double>(4).stages == 5);
  CHECK(composition<double>(6).stages == 9);
  CHECK(composition<double>(8).stages == 17);
}

TEST_CASE("an order that is not two or four or six or eight is refused") {
  Composition<double> result = composition<double>(4);
  for (const int order : {-2, 0, 1, 3, 5, 7, 9, 10, 1000}) {
    CHECK(composition_of_order(order, result) == Status::out_of_range);
  }
  CHECK(result.stages == 5);
  Splitting<double> second = splitting<double>(4);
  for (const int order : {-2, 0, 1, 3, 5, 7, 9, 10, 1000}) {
    CHECK(splitting_of_order(order, second) == Status::out_of_range);
  }
  CHECK(second.stages == 6);
}

namespace {

using Row = std::vector<long double>;

/// The sums over kicks that the order conditions of Nyström's methods are about.
class NystromSums {
 public:
  explicit NystromSums(const Splitting<long double>& splitting) {
    long double time = 0;
    for (int i = 0; i <= splitting.stages; ++i) {
      times.push_back(time);
      kicks_.push_back(splitting.kicks[static_cast<std::size_t>(i)]);
      time += i < splitting.stages ? splitting.turns[static_cast<std::size_t>(i)] : 0;
    }
  }

  Row times;  ///< cᵢ, of the kicks

  /// Σ bᵢ xᵢ
  [[nodiscard]] long double sum(const Row& x) const {
    long double result = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      result += kicks_[i] * x[i];
    }
    return result;
  }
  /// Σⱼ aᵢⱼ xⱼ with aᵢⱼ = bⱼ (cᵢ − cⱼ) for j < i: how far kicks of strength x have moved the body when kick i comes.
  [[nodiscard]] Row moved(const Row& x) const {
    Row result;
    for (std::size_t i = 0; i < x.size(); ++i) {
      long double distance = 0;
      for (std::size_t j = 0; j < i; ++j) {
        distance += kicks_[j] * (times[i] - times[j]) * x[j];
      }
      result.push_back(distance);
    }
    return result;
  }
  [[nodiscard]] Row power(int exponent) const {
    Row result;
    for (const long double time : times) {
      result.push_back(std::pow(time, static_cast<long double>(exponent)));
    }
    return result;
  }

 private:
  Row kicks_;
};

Row product(const Row& a, const Row& b) {
  Row result;
  for (std::size_t i = 0; i < a.size(); ++i) {
    result.push_back(a[i] * b[i]);
  }
  return result;
}

}  // namespace

TEST_CASE("every splitting is symmetric and satisfies Nyström's conditions up to its order") {
  for (const int order : {2, 4, 6, 8}) {
    CAPTURE(order);
    const Splitting<long double> exact = splitting<long double>(order);
    const auto last = static_cast<std::size_t>(exact.stages);
    for (std::size_t i = 0; i <= last; ++i) {
      CHECK(exact.kicks[i] == exact.kicks[last - i]);
      if (i < last) {
        CHECK(exact.turns[i] == exact.turns[last - 1 - i]);
      }
    }
    const NystromSums s(exact);
    const auto is = [](long double found, long double wanted) { CHECK(std::abs(found - wanted) <= 4e-18L); };
    const Row moved = s.moved(s.power(0));
    is(s.times.back(), 1);
    is(s.sum(s.power(0)), 1);
    is(s.sum(s.times), 1.0L / 2);
    if (order >= 4) {
      is(s.sum(s.power(2)), 1.0L / 3);
      is(s.sum(moved), 1.0L / 6);
      is(s.sum(s.power(3)), 1.0L / 4);
      is(s.sum(product(s.times, moved)), 1.0L / 8);
      is(s.sum(s.moved(s.times)), 1.0L / 24);
    }
    if (order >= 6) {
      is(s.sum(s.power(4)), 1.0L / 5);
      is(s.sum(product(s.power(2), moved)), 1.0L / 10);
      is(s.sum(product(moved, moved)), 1.0L / 20);
      is(s.sum(product(s.times, s.moved(s.times))), 1.0L / 30);
      is(s.sum(s.moved(s.power(2))), 1.0L / 60);
      is(s.sum(s.moved(moved)), 1.0L / 120);
      is(s.sum(s.power(5)), 1.0L / 6);
    }
    if (order == 8) {
      is(s.sum(s.power(6)), 1.0L / 7);
      is(s.sum(s.power(7)), 1.0L / 8);
    }
  }
  CHECK(splitting<double>(2).stages == 1);
  CHECK(splitting<double>(4).stages == 6);
  CHECK(splitting<double>(6).stages == 11);
  CHECK(splitting<double>(8).stages == 17);
}
