// What two sets have in common: states at the edge of both are inside, seen from any center, and in `float` too. (theory, sections 20.3
// and 20.5)
#include <doctest/doctest.h>

#include "support/guaranteed.hpp"

using namespace elliptude;
using namespace elliptude::testing;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

using GyroSet = GibbsEllipsoid<GyroState<double>>;
using BodySet = GibbsEllipsoid<RigidBodyState<double>>;

GibbsEllipsoid<RigidBodyState<double>> random_set(Random& random, double size, double condition) {
  return {{random.rotation(), random.unit_vector<3>()},
          Matrix6<double>(size * size * random.positive_definite<6>(condition))};
}

double form_of(const BodySet& set, const RigidBodyState<double>& state) {
  double form = 2;
  REQUIRE(quadratic_form(set, state, form) == Status::ok);
  return form;
}

/// A set about a center such that a state has a given form in it.
BodySet about(const RigidBodyState<double>& state, const Matrix6<double>& shape, double form, Random& random) {
  const Vector6<double> error = std::sqrt(form) * (Matrix6<double>(shape.llt().matrixL()) * random.unit_vector<6>());
  // Ĉ = C cay(−γ/2): the error of the state about it is γ.
  const RigidBodyState<double> center{renormalized(Matrix3d(state.attitude * cayley(Vector3d(-0.5 * error.head<3>())))),
                                      state.angular_velocity - error.tail<3>()};
  return {center, shape};
}

double log_volume_of(const BodySet& set) {
  double value = 0;
  REQUIRE(log_volume(set.in_coordinates(), value) == Status::ok);
  return value;
}

}  // namespace

TEST_CASE("seen_from: the boundary of a set is in what it is from another center") {
  Random random(11);
  double worst = 0;
  int seen_sets = 0;
  for (int k = 0; k < 400; ++k) {
    const BodySet set = random_set(random, random.log_uniform(1e-3, 1), random.log_uniform(1, 1e4));
    const Vector6<double> way = random.uniform(0, 1.5) * random.unit_vector<6>();
    RigidBodyState<double> center = retract<GibbsChart>(set.center, way);
    center.attitude = renormalized(center.attitude);
    Ellipsoid<double, 6> seen;
    if (seen_from(center, set, seen) != Status::ok) {
      continue;
    }
    ++seen_sets;
    const Matrix6<double> factor = set.shape.llt().matrixL();
    const Vector3d g = 0.5 * way.head<3>();
    // Where the stretch is largest, and anywhere.
    Vector6<double> extreme = Vector6<double>::Zero();
    extreme.head<3>() = g;
    extreme = Vector6<double>(factor.transpose() * extreme).normalized();
    for (int j = 0; j < 20; ++j) {
      const Vector6<double> u = j < 2 ? Vector6<double>((j == 0 ? 1 : -1) * extreme) : random.unit_vector<6>();
      const RigidBodyState<double> state = retract<GibbsChart>(set.center, Vector6<double>(factor * u));
      double form = 2;
      REQUIRE(quadratic_form(seen, state_error<GibbsChart>(center, state), form) == Status::ok);
      worst = std::fmax(worst, form);
    }
  }
  CHECK(seen_sets > 200);
  CHECK(worst <= 1);
  CHECK(worst > 0.99);
}

TEST_CASE("seen_from: the stretch at its largest") {
  // A wide ball: along ĝ the error is stretched by 1/(1 − e).
  const double size = 1.2;
  const BodySet set{{Matrix3d::Identity(), Vector3d::Zero()}, size * size * Matrix6<double>::Identity()};
  const Vector3d axis = Vector3d(2, -1, 2) / 3;
  for (const double length : {0.1, 0.4, 1.0}) {
    const RigidBodyState<double> center{cayley(Vector3d(length * axis)), Vector3d::Zero()};
    Ellipsoid<double, 6> seen;
    REQUIRE(seen_from(center, set, seen) == Status::ok);
    CHECK((seen.center.head<3>() + 2 * length * axis).norm() < 1e-14);
    double worst = 0;
    for (const double sign : {-1.0, 1.0}) {
      const Vector6<double> error = (Vector6<double>() << sign * size * axis, Vector3d::Zero()).finished();
      double form = 2;
      REQUIRE(quadratic_form(seen, state_error<GibbsChart>(center, retract<GibbsChart>(set.center, error)), form) ==
              Status::ok);
      worst = std::fmax(worst, form);
    }
    CHECK(worst <= 1);
    CHECK(worst > 0.8);
  }
  // Beyond that nothing is said, and nothing is changed.
  const RigidBodyState<double> far{cayley(Vector3d(1.6 * axis)), Vector3d::Zero()};
  Ellipsoid<double, 6> seen{Vector6<double>::Ones(), Matrix6<double>::Identity()};
  CHECK(seen_from(far, set, seen) == Status::unbounded);
  CHECK(seen.center == Vector6<double>::Ones());
  BodySet broken = set;
  broken.shape(0, 0) = std::nan("");
  CHECK(seen_from(far, broken, seen) == Status::not_finite);
  broken = set;
  broken.center.attitude(1, 1) = std::nan("");
  CHECK(seen_from(far, broken, seen) == Status::not_finite);
  CHECK(seen.shape == Matrix6<double>::Identity());
}

TEST_CASE("seen_from: rounding in float, of sets as small as rounding") {
  Random random(12);
  double worst_attitude = 0;
  double worst_vector = 0;
  for (int k = 0; k < 300; ++k) {
    // One is small and the other wide, so that neither grows by what the other needs.
    const bool of_attitude = k % 2 == 0;
    const double width = of_attitude ? 1e-6 : 0.1;
    const double vector_width = of_attitude ? 1 : 3e-6;
    GibbsEllipsoid<RigidBodyState<float>> set;
    set.center.attitude = renormalized(Eigen::Matrix3f(random.rotation().cast<float>()));
    set.center.angular_velocity = (100 * random.unit_vector<3>()).cast<float>();
    set.shape.setZero();
    set.shape.diagonal().head<3>().setConstant(static_cast<float>(width * width));
    set.shape.diagonal().tail<3>().setConstant(static_cast<float>(vector_width * vector_width));
    RigidBodyState<float> center;
    center.attitude = renormalized(
        Eigen::Matrix3f(set.center.attitude * cayley(Eigen::Vector3f((0.5 * random.unit_vector<3>()).cast<float>()))));
    center.angular_velocity = (100 * random.unit_vector<3>()).cast<float>();
    Ellipsoid<float, 6> seen;
    REQUIRE(seen_from(center, set, seen) == Status::ok);
    // The same in double, about the nearest rotations.
    const Matrix3d from = renormalized(Matrix3d(set.center.attitude.cast<double>()));
    const Matrix3d to = renormalized(Matrix3d(center.attitude.cast<double>()));
    for (int j = 0; j < 5; ++j) {
      const Vector3d error = width * random.unit_vector<3>();
      const Matrix3d attitude = from * cayley(Vector3d(0.5 * error));
      Vector6<double> y;
      y << 2 * cayley_inverse(Matrix3d(to.transpose() * attitude)), Vector3d::Zero();
      const Vector3d vector = set.center.angular_velocity.cast<double>() - center.angular_velocity.cast<double>();
      y.tail<3>() = vector;
      const Ellipsoid<double, 6> exact{seen.center.cast<double>(), seen.shape.cast<double>()};
      double form = 2;
      REQUIRE(quadratic_form(exact, y, form) == Status::ok);
      worst_attitude = std::fmax(worst_attitude, of_attitude ? form : 0);
      y.head<3>() = exact.center.head<3>();
      y.tail<3>() = vector + vector_width * random.unit_vector<3>();
      REQUIRE(quadratic_form(exact, y, form) == Status::ok);
      worst_vector = std::fmax(worst_vector, of_attitude ? 0 : form);
    }
  }
  CHECK(worst_attitude <= 1);
  CHECK(worst_attitude > 1e-4);  // without its ball it would be some tens
  CHECK(worst_vector <= 1);
  CHECK(worst_vector > 1e-4);
}

TEST_CASE("common_set: a state at the edge of both sets is in what they have in common") {
  Random random(13);
  double worst = 0;
  int smaller = 0;
  constexpr int pairs = 2000;
  for (int k = 0; k < pairs; ++k) {
    const RigidBodyState<double> state{random.rotation(), random.unit_vector<3>()};
    const double size = random.log_uniform(1e-5, 0.7);
    const double form = k % 2 == 0 ? 0.999999 : random.uniform(0.3, 1);
    const auto shape = [&] {
      return Matrix6<double>(size * size * random.positive_definite<6>(random.log_uniform(1, 1e3)));
    };
    const BodySet first = about(state, shape(), form, random);
    const BodySet second = about(state, shape(), form, random);
    CommonSetSettings<double> settings;
    settings.criterion = k % 3 == 0   ? SizeCriterion<double, 6>::volume()
                         : k % 3 == 1 ? SizeCriterion<double, 6>::trace()
                                      : SizeCriterion<double, 6>::weighted_trace(random.positive_definite<6>(10));
    BodySet common;
    REQUIRE(common_set(first, second, settings, common) == Status::ok);
    worst = std::fmax(worst, form_of(common, state));
    if (common.shape != first.shape) {
      ++smaller;
      REQUIRE(detail::is_smaller_set(common.in_coordinates(), first.in_coordinates(), settings.criterion));
    }
  }
  CHECK(worst <= 1);
  CHECK(worst > 0.98);
  CHECK(smaller > pairs / 2);
}

TEST_CASE("common_set: all that both have in common, by points in both") {
  Random random(14);
  for (int k = 0; k < 50; ++k) {
    const RigidBodyState<double> state{random.rotation(), random.unit_vector<3>()};
    const double size = random.log_uniform(1e-3, 0.5);
    const BodySet first = about(state, size * size * random.positive_definite<6>(10), 0.5, random);
    const BodySet second = about(state, size * size * random.positive_definite<6>(10), 0.5, random);
    BodySet common;
    REQUIRE(common_set(first, second, {}, common) == Status::ok);
    const Matrix6<double> factor = first.shape.llt().matrixL();
    int both = 0;
    for (int j = 0; j < 500; ++j) {
      const RigidBodyState<double> point =
          retract<GibbsChart>(first.center, Vector6<double>(factor * random.in_ball<6>()));
      if (form_of(second, point) <= 1) {
        ++both;
        REQUIRE(form_of(common, point) <= 1);
      }
    }
    CHECK(both > 0);
    CHECK(log_volume_of(common) < log_volume_of(first));
  }
}

TEST_CASE("common_set: one concentric pair by formula") {
  // Wide and narrow in turn: the least trace of the family of one share by a search.
  const Vector6<double> one = (Vector6<double>() << 4, 1, 4, 1, 4, 1).finished() * 1e-6;
  const Vector6<double> other = (Vector6<double>() << 1, 4, 1, 4, 1, 4).finished() * 1e-6;
  const BodySet first{{Matrix3d::Identity(), Vector3d::Zero()}, Matrix6<double>(one.asDiagonal())};
  const BodySet second{{Matrix3d::Identity(), Vector3d::Zero()}, Matrix6<double>(other.asDiagonal())};
  BodySet common;
  REQUIRE(common_set(first, second, {SizeCriterion<double, 6>::trace(), false}, common) == Status::ok);
  // By symmetry the share is one half: 1/(½/4 + ½/1) = 1.6 along each axis.
  CHECK((common.shape.diagonal() - Vector6<double>::Constant(1.6e-6)).cwiseAbs().maxCoeff() < 1e-8);
}

TEST_CASE("common_set: sets that are apart are proved apart, others never") {
  Random random(15);
  int proved = 0;
  for (int k = 0; k < 300; ++k) {
    const BodySet first = random_set(random, 0.01, 10);
    const Vector6<double> error = Matrix6<double>(first.shape.llt().matrixL()) * random.unit_vector<6>();
    const double away = random.uniform(1.2, 6);
    BodySet second{retract<GibbsChart>(first.center, Vector6<double>(away * error)), first.shape};
    second.center.attitude = renormalized(second.center.attitude);
    BodySet common = first;
    const Status status = common_set(first, second, {}, common);
    if (away > 2.1) {
      CHECK(status == Status::empty_intersection);
      CHECK(common.shape == first.shape);
      ++proved;
    } else if (away < 1.9) {
      CHECK(status == Status::ok);
    }
  }
  CHECK(proved > 100);
}

TEST_CASE("common_set: of a product the attitudes alone meet, and the vector's bound stays") {
  Random random(16);
  double worst = 0;
  for (int k = 0; k < 300; ++k) {
    const Matrix3d attitude = random.rotation();
    const double size = random.log_uniform(1e-4, 0.5);
    const Matrix3d bias = 1e-6 * random.positive_definite<3>(10);
    const auto set = [&] {
      const Matrix3d shape = size * size * random.positive_definite<3>(100);
      const Vector3d error = 0.9999999 * (Matrix3d(shape.llt().matrixL()) * random.unit_vector<3>());
      const Matrix3d center = renormalized(Matrix3d(attitude * cayley(Vector3d(-0.5 * error))));
      return GyroSet{{center, Vector3d(0.1, 0.2, 0.3)}, detail::product_shape(shape, bias)};
    };
    const GyroSet first = set();
    const GyroSet second = set();
    GyroSet common;
    REQUIRE(common_set(first, second, {SizeCriterion<double, 6>::volume(), true}, common) == Status::ok);
    const Ellipsoid<double, 3> alone{Vector3d::Zero(), common.shape.topLeftCorner<3, 3>()};
    double form = 2;
    REQUIRE(quadratic_form(alone, GibbsChart::error(common.center.attitude, attitude), form) == Status::ok);
    worst = std::fmax(worst, form);
    CHECK(Matrix3d(common.shape.bottomRightCorner<3, 3>()) == bias);
    CHECK(Matrix3d(common.shape.topRightCorner<3, 3>()).isZero(0));
    CHECK(common.center.gyro_bias == first.center.gyro_bias);
  }
  CHECK(worst <= 1);
  CHECK(worst > 0.98);
}

TEST_CASE("common_set: what cannot be combined leaves the first set as it is") {
  const BodySet first{{Matrix3d::Identity(), Vector3d::Zero()}, 0.01 * Matrix6<double>::Identity()};
  BodySet half_a_turn = first;
  half_a_turn.center.attitude = Vector3d(1, -1, -1).asDiagonal();
  BodySet common;
  REQUIRE(common_set(first, half_a_turn, {}, common) == Status::ok);
  CHECK(common.shape == first.shape);
  BodySet larger = first;
  larger.shape *= 4;
  REQUIRE(common_set(first, larger, {}, common) == Status::ok);
  CHECK(common.shape == first.shape);
  CHECK(common.center.attitude == first.center.attitude);
  BodySet flat = first;
  flat.shape.row(2).setZero();
  flat.shape.col(2).setZero();
  REQUIRE(common_set(flat, first, {}, common) == Status::ok);
  CHECK(common.shape == flat.shape);
}

TEST_CASE("common_set: bad input changes nothing") {
  const BodySet first{{Matrix3d::Identity(), Vector3d::Zero()}, 0.01 * Matrix6<double>::Identity()};
  BodySet common = first;
  BodySet bad = first;
  bad.shape(3, 3) = std::nan("");
  CHECK(common_set(bad, first, {}, common) == Status::not_finite);
  CHECK(common_set(first, bad, {}, common) == Status::not_finite);
  CHECK(common_set(first, first, {SizeCriterion<double, 6>::weighted_trace(-Matrix6<double>::Identity()), false},
                   common) == Status::not_positive_definite);
  CHECK(common.shape == first.shape);
}
