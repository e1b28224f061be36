// The search for the multipliers of a linear question, against what is known in closed form.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <elliptude/sets/detail/affine_search.hpp>
#include <vector>

#include "support/random.hpp"

using namespace elliptude;
using elliptude::testing::Random;

namespace {

constexpr std::size_t most = 6;

template <int N>
using Form = Matrix<double, N + 1>;

/// [−c, gᵀ; g, A] of the unit ball.
template <int N>
Form<N> ball() {
  Form<N> form = Form<N>::Identity();
  form(0, 0) = -1;
  return form;
}

/// (aᵀu − m)² ≤ h² as a form with rows of sum one at most.
template <int N>
Form<N> slab(const Vector<double, N>& a, double middle, double half) {
  Form<N> form;
  form(0, 0) = middle * middle - half * half;
  form.template block<N, 1>(1, 0) = -middle * a;
  form.template block<1, N>(0, 1) = -middle * a.transpose();
  form.template bottomRightCorner<N, N>() = a * a.transpose();
  return form / form.cwiseAbs().rowwise().sum().maxCoeff();
}

/// The largest dᵀu in the unit ball and in m − h ≤ aᵀu ≤ m + h, of unit vectors.
template <int N>
double support(const Vector<double, N>& d, const Vector<double, N>& a, double middle, double half) {
  const double along = a.dot(d);
  const double at = std::min(std::max(along, middle - half), middle + half);
  const double across = std::sqrt(std::max(0.0, 1 - along * along));
  return at == along ? 1.0 : at * along + std::sqrt(1 - at * at) * across;
}

template <int N>
void compare_with_closed_form(unsigned seed) {
  Random random(seed);
  int found = 0;
  const int trials = 2000;
  for (int trial = 0; trial < trials; ++trial) {
    const Vector<double, N> d = random.unit_vector<N>();
    const Vector<double, N> a = random.unit_vector<N>();
    const double half = random.log_uniform(0.0025, 1);
    const double middle = random.uniform(-0.9, 0.9) * (1 - half);
    const std::vector<Form<N>> forms{ball<N>(), slab<N>(a, middle, half)};
    detail::AffineSearch<double, N, most> search(forms.data(), forms.size(), Vector<double, N>(0.5 * d));
    if (!search.run()) {
      continue;
    }
    ++found;
    const double exact = support<N>(d, a, middle, half);
    CHECK(search.least() >= exact - 1e-9);
    CHECK(search.least() <= exact + 0.012);
  }
  CHECK(found >= 0.97 * trials);
}

}  // namespace

TEST_CASE("a ball alone reaches its radius") {
  const Form<3> form = ball<3>();
  detail::AffineSearch<double, 3, most> search(&form, 1, Vector3<double>(0.5, 1, -1));
  REQUIRE(search.run());
  CHECK(search.least() == doctest::Approx(3).epsilon(1e-12));
  CHECK(search.multipliers()[0] == doctest::Approx(1.5).epsilon(1e-12));
}

TEST_CASE("a ball and a slab reach as far as a closed form says in three and in six coordinates") {
  compare_with_closed_form<3>(1);
  compare_with_closed_form<6>(2);
}
