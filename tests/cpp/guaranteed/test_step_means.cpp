// What terms that change within a step add up to, against systems of numbers that change as fast as they may (theory, section 17.4):
// each bound holds and is nearly reached.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <elliptude/guaranteed/detail/step_means.hpp>
#include <functional>

using namespace elliptude;

namespace {

using Linear = detail::step_means::LinearChange<double>;
using Forms = detail::step_means::FormChange<double>;
using Second = detail::step_means::SecondOrder<double>;
using Line = detail::step_means::Line<double>;

/// Over −1 ≤ x ≤ 1, times half of the step.
double integral(const std::function<double(double)>& f, double h) {
  constexpr int parts = 2000;
  double sum = 0;
  for (int k = 0; k <= parts; ++k) {
    sum += f(-1 + 2.0 * k / parts) * (k == 0 || k == parts ? 1 : k % 2 == 1 ? 4 : 2);
  }
  return sum / (3 * parts) * h;
}

/// Y is diagonal: of the part that is acted upon it grows, and the part that a term goes to gets smaller, both as fast as they may.
double grown(const Linear& w, double x) { return 1 + w.odd * x + (w.all - w.odd) * x * x; }
double shrunk(const Linear& w, double x) { return 1 / (1 - w.odd * x - (w.all - w.odd) * x * x); }

void check(double truth, double bound, double least) {
  CHECK(truth <= bound * (1 + 1e-12));  // what the sums of the test are rounded by: some bounds are reached
  CHECK(truth > least * bound);
}

}  // namespace

TEST_CASE("forms of a direction that turns change no more than they may") {
  // cos pθ and sin pθ, where the direction turns by θ: at a constant rate, or from rest with a constant acceleration.
  for (const double degree : {1.0, 2.0}) {
    const double rate = 0.3;
    const double acceleration = 0.4;
    const double middle = 0.1;
    const Forms turning = Forms::within(degree, rate, 0, middle, 0);
    check(std::sin(degree * rate * middle), turning.drift, 0.99);
    check(1 - std::cos(degree * rate * middle), turning.rest, 0.99);
    CHECK(turning.missing == 0);
    const Forms started = Forms::within(degree, 0, acceleration, middle, 0);
    CHECK(started.drift == 0);
    check(std::sin(degree * acceleration * middle * middle / 2), started.rest, 0.99);
    // A unit vector that lacks e is one of length 1 + e, in a form of its degree.
    const double lacks = 0.01;
    check(std::pow(1 + lacks, degree) - 1, Forms::within(degree, 0, 0, middle, lacks).missing, 0.98);
  }
}

TEST_CASE("terms of second order that change within a step") {
  const double h = 0.7;
  const double b = 0.8;
  struct Case {
    Linear linear;
    double drift;
    double rest;
    double least;
  };
  // By each alone, by two odd ones together, and by all.
  for (const Case& c : {Case{{0.02, 0.02}, 0, 0, 0.9}, Case{{0, 0.02}, 0, 0, 0.9}, Case{{0, 0}, 0, 0.03, 0.999},
                        Case{{0.02, 0.02}, 0.4, 0, 0.9}, Case{{0.01, 0.03}, 0.05, 0.02, 0.9}}) {
    const double bound = 1.3;
    const Second second = Second::of(b, bound, c.linear, Forms{c.drift, c.rest, 0}, h);
    const auto g = [&](double x) {
      return grown(c.linear, x) * grown(c.linear, x) * shrunk(c.linear, x) *
             (b + bound * (c.drift * x + c.rest * x * x));
    };
    check(integral(g, h) - h * b, second.quadrature, c.least);
    check(g(1), second.largest, 0.999);
    // That of the norm, where it is larger at both ends.
    check(integral([&](double x) { return g(std::fabs(x)); }, h), second.integral, 0.99);
  }
  // What is missing at all times, while the linear part changes.
  const Second missing = Second::of(0, 1.3, {0.0, 0.02}, Forms{0, 0, 0.1}, h);
  const auto g = [&](double x) {
    const Linear w{0.0, 0.02};
    return grown(w, 1) * grown(w, 1) * shrunk(w, 1) * 1.3 * 0.1 + 0 * x;
  };
  check(integral(g, h), missing.quadrature, 0.999);
  check(integral(g, h), missing.integral, 0.999);
  check(g(0), missing.largest, 0.999);
}

TEST_CASE("terms of second order where u has moved") {
  // Along u itself, e on its line: G (2 e + e²) with a G that is largest at both ends.
  const double h = 0.7;
  for (const double before : {0.0, 0.2}) {
    for (const double moved : {0.05, 0.5}) {
      for (const double drift : {0.0, 0.2}) {
        const double b = 0.8;
        const Second second = Second::of(b, b, {0, 0}, Forms{drift, 0, 0}, h);
        const Line line{1 + before, 1 + before + moved};
        const auto g = [&](double x) {
          const double e = before + moved * (1 + x) / 2;
          return b * (1 + drift * std::fabs(x)) * (2 * e + e * e);
        };
        check(integral(g, h), second.displaced(line.mean(), moved, h), 0.99);
      }
    }
  }
  // The square of what is moved within the step alone.
  const Second second = Second::of(1, 0, {0, 0}, Forms{0, 0, 0}, 1);
  check(1.0 / 12, second.displaced(1, 1, 1), 0.999999);
}

TEST_CASE("means of the third and the fourth power over a step") {
  const double h = 1;
  for (const double w : {0.0, 0.02}) {
    for (const double moved : {0.0, 0.1, 0.6}) {
      const Linear linear{0, w};
      const Line line{1.1, 1.1 + moved};
      const auto size = [&](double x) { return (1 + w * std::fabs(x)) * (line.mean() + moved * x / 2); };
      const double stretch = linear.stretch();
      check(integral([&](double x) { return std::pow(size(x), 3); }, h), line.mean_cube(stretch), 0.95);
      check(integral([&](double x) { return std::pow(size(x), 4); }, h), line.mean_fourth(stretch), 0.9);
      // At the ends both bounds are values.
      CHECK(line.cube_at_ends(stretch) == doctest::Approx((std::pow(size(-1), 3) + std::pow(size(1), 3)) / 2));
      CHECK(line.fourth_at_ends(stretch) == doctest::Approx((std::pow(size(-1), 4) + std::pow(size(1), 4)) / 2));
    }
  }
}

TEST_CASE("forms of third order that change within a step") {
  const double h = 1;
  struct Case {
    Forms forms;
    double w;      // of the linear part, odd
    double moved;  // of u
    double least;
  };
  // What is linear in time counts where W or u's way adds to it; what is of second order, and what is missing, always.
  for (const Case& c :
       {Case{{0.3, 0, 0}, 0.01, 0, 0.6}, Case{{0, 0.3, 0}, 0, 0, 0.6}, Case{{0, 0.3, 0}, 0.001, 0.01, 0.6},
        Case{{0, 0, 0.1}, 0, 0, 0.999}, Case{{0, 0, 0.1}, 0.01, 0.01, 0.9}, Case{{0.3, 0.1, 0.05}, 0.01, 0.01, 0.6}}) {
    const Linear linear{c.w, c.w};
    const Line line{1, 1 + c.moved};
    const auto beyond = [&](double x) {
      const double rho = line.mean() + c.moved * x / 2;
      return (c.forms.drift * x + c.forms.rest * x * x + c.forms.missing) * std::pow(grown(linear, x) * rho, 3) *
             shrunk(linear, x);
    };
    check(integral(beyond, h), detail::step_means::changing_cubes(c.forms, linear, line.cube_at_ends(linear.stretch())),
          c.least);
  }
}
