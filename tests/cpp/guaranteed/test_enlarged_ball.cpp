// The unit ball made larger for a quadratic map, against the points themselves (theory, eq. 17.19): each term alone where it is
// nearly reached, any map under a search, and rounding.
#include "elliptude/guaranteed/detail/enlarged_ball.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cmath>

#include "support/random.hpp"

using namespace elliptude;
using elliptude::testing::Random;

namespace {

using Slices = detail::packed::Slices<double>;
using RealVector6 = Vector6<long double>;
using RealMatrix6 = Matrix6<long double>;

constexpr double any_trace = 1e6;

/// q(v)ᵢ = vᵀHᵢv
using Quadratic = std::array<Matrix6<double>, 6>;

Quadratic none() {
  Quadratic q;
  q.fill(Matrix6<double>::Zero());
  return q;
}

Slices slices_of(const Quadratic& q) {
  Slices slices = Slices::Zero();
  for (int i = 0; i < 6; ++i) {
    detail::packed::slice(slices, i).topRows<6>() = q[static_cast<std::size_t>(i)];
  }
  return slices;
}

RealVector6 moved(const Quadratic& q, const RealVector6& v) {
  RealVector6 x = v;
  for (int i = 0; i < 6; ++i) {
    x(i) += v.dot(q[static_cast<std::size_t>(i)].cast<long double>() * v);
  }
  return x;
}

/// xᵀ ball⁻¹ x
long double form(const Matrix6<double>& ball, const RealVector6& x) {
  return x.dot(RealMatrix6(ball.cast<long double>()).llt().solve(x));
}

/// The farthest that a search finds on the sphere: by steps along the gradient of the form, taken at differences.
long double farthest(const Quadratic& q, const Matrix6<double>& ball, Random& random) {
  long double most = 0;
  for (int start = 0; start < 6; ++start) {
    RealVector6 v = random.unit_vector<6>().cast<long double>();
    long double reached = form(ball, moved(q, v));
    long double step = 0.5L;
    for (int i = 0; i < 60 && step > 1e-4L; ++i) {
      RealVector6 gradient;
      for (int k = 0; k < 6; ++k) {
        const RealVector6 little = 1e-6L * RealVector6::Unit(k);
        gradient(k) = form(ball, moved(q, RealVector6(v + little))) - form(ball, moved(q, RealVector6(v - little)));
      }
      const RealVector6 next = (v + step * gradient.normalized()).normalized();
      const long double there = form(ball, moved(q, next));
      if (there > reached) {
        v = next;
        reached = there;
      } else {
        step /= 2;
      }
    }
    most = std::fmax(most, reached);
  }
  return most;
}

/// A map whose cubic form vᵀq(v) is zero: q(v) = S(v) v with entries of the skew S linear in v.
Quadratic random_turning(Random& random) {
  Quadratic q = none();
  for (int k = 0; k < 6; ++k) {
    const Matrix6<double> a = random.normal_matrix<6, 6>();
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j < 6; ++j) {
        const double entry = 0.5 * (a(i, j) - a(j, i));  // q(v)ᵢ += entry vₖ vⱼ
        q[static_cast<std::size_t>(i)](k, j) += 0.5 * entry;
        q[static_cast<std::size_t>(i)](j, k) += 0.5 * entry;
      }
    }
  }
  return q;
}

Quadratic random_map(Random& random) {
  Quadratic q = none();
  for (Matrix6<double>& form : q) {
    const Matrix6<double> a = random.normal_matrix<6, 6>();
    form = a + a.transpose();
  }
  return q;
}

Quadratic scaled(Quadratic q, double factor) {
  for (Matrix6<double>& form : q) {
    form *= factor;
  }
  return q;
}

}  // namespace

TEST_CASE("a map that makes each axis longer comes to the edge of its ball") {
  // (1 + a)² against (√(1 + a²) + a)²: with λ or KKᵀ/λ left out or halved, the point is outside.
  for (const double a : {0.01, 0.05, 0.1, 0.2}) {
    Quadratic q = none();
    for (int i = 0; i < 6; ++i) {
      q[static_cast<std::size_t>(i)](i, i) = a;
    }
    Matrix6<double> ball;
    REQUIRE(detail::enlarged_ball(slices_of(q), any_trace, ball));
    const long double reached = form(ball, moved(q, RealVector6::Unit(2)));
    CHECK(reached <= 1);
    const double edge = (1 + a) / (std::sqrt(1 + a * a) + a);
    CHECK(reached == doctest::Approx(edge * edge).epsilon(1e-12));
  }
}

TEST_CASE("a map that only turns comes to the edge of its ball") {
  // q = a (v₁v₂, −v₁²): at e₁ the point is at 1 + a², and σ² is within a tenth of a².
  for (const double a : {0.1, 0.3, 0.6}) {
    Quadratic q = none();
    q[0](0, 1) = q[0](1, 0) = 0.5 * a;
    q[1](0, 0) = -a;
    Matrix6<double> ball;
    REQUIRE(detail::enlarged_ball(slices_of(q), any_trace, ball));
    const long double reached = form(ball, moved(q, RealVector6::Unit(0)));
    CHECK(reached <= 1);
    CHECK(reached > 1 - 0.11 * a * a);
  }
}

TEST_CASE("a small map is added to the ball, and comes to the edge of the sum") {
  // The ball and a ball of a: where q and v have one direction, (1 + a)² of (1 + a)².
  for (const double a : {1e-5, 1e-4, 1e-3}) {
    Quadratic q = none();
    for (int i = 0; i < 6; ++i) {
      q[static_cast<std::size_t>(i)](i, i) = a;
    }
    const Matrix6<double> ball = detail::ball_and_image(slices_of(q), Vector6<double>(Vector6<double>::Ones()));
    CHECK(form(ball, moved(q, RealVector6::Unit(4))) == doctest::Approx(1).epsilon(1e-12));
  }
}

TEST_CASE("no point of any map is found outside") {
  Random random(4);
  long double most = 0;
  int refused = 0;
  for (int trial = 0; trial < 100; ++trial) {
    const Quadratic turning = scaled(random_turning(random), random.log_uniform(1e-3, 0.3));
    const Quadratic any = scaled(random_map(random), random.log_uniform(1e-4, 0.05));
    Quadratic q;
    for (std::size_t i = 0; i < 6; ++i) {
      q[i] = turning[i] + any[i];
    }
    Matrix6<double> ball;
    if (!detail::enlarged_ball(slices_of(q), any_trace, ball)) {
      ++refused;
      continue;
    }
    const long double reached = farthest(q, ball, random);
    CHECK(reached <= 1);
    const Vector6<double> widths = random.normal_matrix<6>().cwiseAbs2();
    CHECK(farthest(q, detail::ball_and_image(slices_of(q), widths), random) <= 1);
    most = std::fmax(most, reached);
    for (int i = 0; i < 20; ++i) {  // what is inside is no farther
      const RealVector6 v = random.uniform(0, 1) * random.unit_vector<6>().cast<long double>();
      CHECK(form(ball, moved(q, v)) <= 1);
    }
  }
  MESSAGE("farthest " << static_cast<double>(most) << ", refused " << refused);
  CHECK(most > 0.9);
  CHECK(refused == 0);
}

TEST_CASE("a map that is too large, or no map, has no ball") {
  Random random(5);
  const Matrix6<double> before = random.positive_definite<6>(10);
  Matrix6<double> ball = before;
  Quadratic along_one = none();
  along_one[0](0, 0) = 10;
  CHECK_FALSE(detail::enlarged_ball(slices_of(along_one), any_trace, ball));
  for (const double bad : {std::nan(""), HUGE_VAL, -HUGE_VAL}) {
    Slices forms = Slices::Zero();
    forms(0, 3) = bad;
    CHECK_FALSE(detail::enlarged_ball(forms, any_trace, ball));
  }
  CHECK(ball == before);
  REQUIRE(detail::enlarged_ball(Slices(Slices::Zero()), any_trace, ball));
  CHECK((ball - Matrix6<double>::Identity()).norm() < 1e-12);
}

TEST_CASE("a ball is there if its trace is as little as wanted") {
  Random random(7);
  const Matrix6<double> before = random.positive_definite<6>(10);
  for (int trial = 0; trial < 100; ++trial) {
    const Slices forms = slices_of(scaled(random_map(random), random.log_uniform(1e-4, 0.05)));
    Matrix6<double> ball;
    REQUIRE(detail::enlarged_ball(forms, any_trace, ball));
    Matrix6<double> other = before;
    CHECK(detail::enlarged_ball(forms, ball.trace() * (1 + 1e-12), other));
    CHECK(other == ball);
    other = before;
    CHECK_FALSE(detail::enlarged_ball(forms, ball.trace() * (1 - 1e-12), other));
    CHECK(other == before);
  }
}

TEST_CASE("the ellipsoid is no smaller than the exact one, whatever rounding does") {
  Random random(6);
  double most = 0;
  double largest_trace = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    Quadratic q = scaled(random_map(random), random.log_uniform(1e-4, 1));
    if (trial % 3 == 1) {  // all terms round alike, near to where there is no ellipsoid any more
      q.fill(Matrix6<double>::Constant(0.0339 * random.uniform(0.9, 1)));
    } else if (trial % 3 == 2) {
      const Vector6<double> axis = random.unit_vector<6>();
      for (int i = 0; i < 6; ++i) {
        q[static_cast<std::size_t>(i)] = 0.4999 * random.uniform(0.9, 1) * axis(i) * axis * axis.transpose();
      }
    }
    Matrix6<double> ball;
    if (!detail::enlarged_ball(slices_of(q), 2000.0, ball)) {
      continue;
    }
    // The same in long double, without the cover.
    const detail::packed::Slices<long double> forms = slices_of(q).cast<long double>();
    const detail::packed::Slices<long double> symmetric = detail::packed::symmetric_part(forms);
    const RealMatrix6 growth = gram_of(symmetric);
    const long double mean = growth.trace() / 6;
    const long double sigma = norm_of_gram(gram_of(detail::packed::Slices<long double>(forms - symmetric)));
    const long double whole = 1 + sigma * sigma;
    const long double lambda = mean + std::sqrt(mean * (mean + whole));
    const RealMatrix6 inverse = RealMatrix6(RealMatrix6::Identity() - growth / lambda).inverse();
    const RealMatrix6 root = RealMatrix6((whole + lambda) * inverse).llt().matrixL();
    const RealMatrix6 ratio = root.inverse() * ball.cast<long double>() * root.inverse().transpose();
    const long double least = Eigen::SelfAdjointEigenSolver<RealMatrix6>(ratio).eigenvalues()(0);
    const auto share = static_cast<long double>(rounding::share<double>(rounding::enlarged_ball));
    const long double cover = share * inverse.trace();
    CHECK(least >= 1);
    most = std::fmax(most, static_cast<double>(1 - (least - 1) / cover));
    largest_trace = std::fmax(largest_trace, static_cast<double>(inverse.trace()));
  }
  MESSAGE("rounding took " << most << " of its constant; the largest trace was " << largest_trace);
  CHECK(most > 0.01);
  CHECK(largest_trace > 100);
  // Where nothing is left of the ellipsoid but the ball, the cover is what it should be.
  Matrix6<double> ball;
  REQUIRE(detail::enlarged_ball(Slices(Slices::Zero()), any_trace, ball));
  CHECK((ball.diagonal().array() >= 1 + 570 * std::numeric_limits<double>::epsilon()).all());
}

TEST_CASE_TEMPLATE("an ellipsoid that rounding may have taken is not there", Scalar, double, float) {
  // Near the edge of KKᵀ < λI, in one direction: the inverse has no right digit.
  Random random(8);
  for (int trial = 0; trial < 4000; ++trial) {
    const Vector6<Scalar> axis = random.unit_vector<6>().cast<Scalar>();
    const Scalar size =
        Scalar(0.5) + static_cast<Scalar>(random.uniform(-8, 8)) * std::numeric_limits<Scalar>::epsilon();
    detail::packed::Slices<Scalar> forms = detail::packed::Slices<Scalar>::Zero();
    for (int i = 0; i < 6; ++i) {
      detail::packed::slice(forms, i).template topRows<6>() = size * axis(i) * axis * axis.transpose();
    }
    Matrix6<Scalar> ball;
    if (detail::enlarged_ball(forms, std::numeric_limits<Scalar>::max(), ball)) {
      CHECK(Eigen::SelfAdjointEigenSolver<Matrix6<Scalar>>(ball).eigenvalues()(0) > 0);
    }
  }
}
