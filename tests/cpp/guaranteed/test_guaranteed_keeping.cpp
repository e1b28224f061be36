// What a guaranteed filter keeps of what it knew, and that nothing beyond its domain is kept on any way (theory, section 16.9).
#include <doctest/doctest.h>

#include "support/filter_scene.hpp"

using namespace elliptude;
using namespace elliptude::testing;

namespace {

using GyroFlow = GuaranteedGyroFlow<double>;
using GyroFilter = GuaranteedFilter<GyroFlow>;

const double largest = FilterDomain<double>::largest();

GyroFilter gyro_filter(double noise, double drift, const GyroFilter::Settings& settings = {}) {
  GyroUncertainty<double> uncertainty;
  uncertainty.noise = noise * noise * Matrix3d::Identity();
  uncertainty.drift = drift * drift * Matrix3d::Identity();
  GyroFlow flow;
  REQUIRE(GyroFlow::make(uncertainty, GyroFlow::IntervalRate::mean, flow) == Status::ok);
  GyroFilter filter;
  REQUIRE(GyroFilter::make(flow, settings, 0, filter) == Status::ok);
  return filter;
}

GibbsEllipsoid<GyroState<double>> gyro_set(double attitude, double bias) {
  GibbsEllipsoid<GyroState<double>> set;
  set.center = {Matrix3d::Identity(), Vector3d::Zero()};
  set.shape.setZero();
  set.shape.diagonal() << Vector3d::Constant(attitude * attitude), Vector3d::Constant(bias * bias);
  return set;
}

}  // namespace

TEST_CASE("a start about what is nearly a rotation is about a rotation") {
  const Scene scene(3);
  GibbsEllipsoid<State> set{scene.truth, 1e-4 * Matrix6<double>::Identity()};
  set.center.attitude(0, 1) += 1e-11;
  BodyFilter filter = filter_with({});
  REQUIRE(filter.start(set) == Status::ok);
  const Matrix3d& attitude = filter.ellipsoid().center.attitude;
  CHECK((attitude.transpose() * attitude - Matrix3d::Identity()).norm() < 1e-14);
  CHECK(form_of(filter, scene.truth) < 1e-12);
}

TEST_CASE("where the attitude is lost the rate is kept of the set that is known now") {
  const Scene scene(4);
  BodyFilter filter = filter_with({});
  // Before the attitude a rate that has nothing to do with it is known, so that an old one would be seen.
  const AngularVelocity<double> other{Vector3d(5, 5, 5), 1e-4 * Matrix3d::Identity()};
  Report report;
  REQUIRE(filter.update({nullptr, 0, &other, nullptr}, report) == Status::ok);
  REQUIRE(filter.knows_vector());
  REQUIRE(filter.start(GibbsEllipsoid<State>{scene.truth, 0.25 * Matrix6<double>::Identity()}) == Status::ok);
  REQUIRE(filter.predict(20, {}) == Status::ok);
  REQUIRE(!filter.knows_attitude());
  REQUIRE(filter.knows_vector());
  CHECK(contains(filter.vector(), after(scene.truth, 20).angular_velocity));
  CHECK(filter.vector().shape.trace() < 100);
}

TEST_CASE("the margin of measurements of which one may be wrong is that of the choice that agrees best") {
  for (int wrong = 0; wrong < 4; ++wrong) {
    Scene scene(5);
    scene.directions[static_cast<std::size_t>(wrong)] =
        measured(scene.truth, scene.references[static_cast<std::size_t>(wrong)], 1.2 * bound * Vector3d(0.6, 0, 0.8));
    double best = -1;
    for (std::size_t left_out = 0; left_out < 5; ++left_out) {
      std::vector<Direction<double>> kept = scene.directions;
      if (left_out < 4) {
        kept.erase(kept.begin() + static_cast<std::ptrdiff_t>(left_out));
      }
      BodyFilter filter = filter_with({});
      Report report;
      const Status status =
          filter.update({kept.data(), kept.size(), left_out < 4 ? &scene.rate : nullptr, nullptr}, report);
      if (status == Status::ok && filter.knows_attitude()) {
        best = std::fmax(best, report.margin);
      }
    }
    BodyFilter::Settings settings;
    settings.policy = Policy::relaxed;
    settings.most_wrong = 1;
    BodyFilter filter = filter_with(settings);
    REQUIRE(filter.bound_vector({scene.truth.angular_velocity, Matrix3d::Identity()}) == Status::ok);
    Report report;
    REQUIRE(filter.update(scene.all(), report) == Status::ok);
    MESSAGE("wrong " << wrong << ": margin " << report.margin << ", of the best choice alone " << best);
    CHECK(report.margin > best - 0.05 * std::fabs(best));
  }
}

TEST_CASE("an updated set beyond the domain is not kept") {
  // The rate's bound alone is in the domain. Together with directions it is made wider.
  const Scene scene(6);
  BodyFilter filter = filter_with({});
  const double width = 0.99 * largest / std::sqrt(3);
  const AngularVelocity<double> rate{Vector3d::Zero(), width * width * Matrix3d::Identity()};
  Report report;
  REQUIRE(filter.update({scene.directions.data(), 4, &rate, nullptr}, report) == Status::ok);
  CHECK((!filter.knows_attitude() || filter.ellipsoid().shape.trace() <= largest * largest));
  CHECK(filter.knows_attitude() == (filter.claim() != Claim::none));
}

TEST_CASE("a predicted set beyond the domain is not kept") {
  GyroFilter filter = gyro_filter(1e8, 0);
  REQUIRE(filter.start(gyro_set(1e-3, 0.9999999 * largest / std::sqrt(3))) == Status::ok);
  REQUIRE(filter.predict(1e-11, {Vector3d::Zero()}) == Status::ok);
  CHECK((!filter.knows_attitude() || filter.ellipsoid().shape.trace() <= largest * largest));
  CHECK(filter.knows_attitude() == (filter.claim() != Claim::none));
}

TEST_CASE("a bias beyond the domain is not kept without the attitude") {
  GyroFilter filter = gyro_filter(1e-3, 0.5 * largest);
  REQUIRE(filter.start(gyro_set(1e-3, 1)) == Status::ok);
  REQUIRE(filter.predict(1, {Vector3d::Zero()}) == Status::ok);
  CHECK(!filter.knows_attitude());
  REQUIRE(filter.knows_vector());
  REQUIRE(filter.predict(3, {Vector3d::Zero()}) == Status::ok);
  CHECK(!filter.knows_vector());
}

TEST_CASE("a linear measurement speaks of a bias that is to be left to its bound, as long as there is none") {
  GyroFilter::Settings settings;
  settings.estimates_vector = false;
  // A bound that is to come later, or belonged to another filter, is none.
  GyroFilter filter = gyro_filter(0, 0, settings);
  REQUIRE(filter.bound_vector({Vector3d(5, 5, 5), 1e-6 * Matrix3d::Identity()}) == Status::ok);
  REQUIRE(GyroFilter::make(filter.flow(), settings, 0, filter) == Status::ok);
  REQUIRE(filter.start(gyro_set(0.1, 1)) == Status::ok);
  const Vector6<double> error = (Vector6<double>() << 0.01, 0, 0, 0.5, 0, 0).finished();
  LinearMeasurement<double, 1> linear{Vector<double, 1>::Zero(), Matrix<double, 1, 6>::Zero(),
                                      Matrix<double, 1>::Constant(1e-6)};
  for (const double of_bias : {0.1, 1.0}) {
    linear.h << 1, 0, 0, of_bias, 0, 0;
    linear.y = linear.h * error;
    GyroFilter measured = filter;
    Report report;
    REQUIRE(measured.update(linear, report) == Status::ok);
    const GyroState<double> truth{exp(Vector3d(error.head<3>())), error.tail<3>()};
    double form = 2;
    REQUIRE(quadratic_form(measured.ellipsoid(), truth, form) == Status::ok);
    CHECK(form <= 1);
    CHECK(measured.ellipsoid().shape.trace() < filter.ellipsoid().shape.trace());
  }
}

TEST_CASE("a bound of the vector is refused only where it surely has nothing in common with what is known") {
  const auto refuses = [](const Ellipsoid<double, 3>& vector, const Matrix3d& bound) {
    GyroFilter filter = gyro_filter(1e-3, 0);
    GibbsEllipsoid<GyroState<double>> set = gyro_set(0.1, 1);
    set.center.gyro_bias = vector.center;
    set.shape.bottomRightCorner<3, 3>() = vector.shape;
    REQUIRE(filter.start(set) == Status::ok);
    const Status late = filter.bound_vector({Vector3d::Zero(), bound});
    GyroFilter bounded = gyro_filter(1e-3, 0);
    REQUIRE(bounded.bound_vector({Vector3d::Zero(), bound}) == Status::ok);
    const Status early = bounded.start(set);
    CHECK((late == Status::ok || late == Status::empty_intersection));
    CHECK(early == late);
    return late == Status::empty_intersection;
  };
  // Balls that touch: 4/9 (1, 4, 8) is in both.
  CHECK_FALSE(refuses({Vector3d(1, 4, 8), 25 * Matrix3d::Identity()}, 16 * Matrix3d::Identity()));
  CHECK(refuses({1.00001 * Vector3d(1, 4, 8), 25 * Matrix3d::Identity()}, 16 * Matrix3d::Identity()));
  // Two that are thin, and have a point in common at which both forms are 0.99999998.
  Matrix3d bound;
  bound << 0.2607299290635246, 0.20352142510500054, 0.38901010612452364,  //
      0.20352142510500054, 0.15886542314094854, 0.3036547874287309,       //
      0.38901010612452364, 0.3036547874287309, 0.5804046478763195;
  Matrix3d shape;
  shape << 0.38376450562465486, -0.012062309137538207, 0.4861520446789294,  //
      -0.012062309137538207, 0.0003791369437775861, -0.015280507094459847,  //
      0.4861520446789294, -0.015280507094459847, 0.6158563574318666;
  const Vector3d center(-0.6480381190096977, -0.002814724062010618, -0.8273625690365146);
  CHECK_FALSE(refuses({center, shape}, bound));
  CHECK(refuses({1.001 * center, shape}, bound));
}

TEST_CASE("of a shape that is not quite symmetric a filter takes the symmetric part") {
  // Lower triangle, upper triangle and symmetric part are positive definite, and thin to other widths.
  Matrix3d bound;
  bound << 1, 1 - 1e-9, 0, 1 - 1e-9, 1, 0, 0, 0, 1;
  bound *= 1e-4;
  bound(0, 1) -= 1e-4 * 1e-9;
  const Matrix3d symmetric = symmetrized(bound);
  const Vector3d thin = 0.999 * Vector3d(1, -1, 0).normalized() *
                        std::sqrt(Eigen::SelfAdjointEigenSolver<Matrix3d>(symmetric).eigenvalues()(0));
  for (const Matrix3d& given : {bound, Matrix3d(bound.transpose())}) {
    GyroFilter filter = gyro_filter(1e-3, 0);
    REQUIRE(filter.start(gyro_set(0.1, 1)) == Status::ok);
    const MeasuredAttitude<double> measured{Matrix3d::Identity(), given};
    Report report;
    REQUIRE(filter.update({nullptr, 0, nullptr, &measured}, report) == Status::ok);
    double form = 2;
    REQUIRE(quadratic_form(filter.ellipsoid(), GyroState<double>{exp(thin), Vector3d::Zero()}, form) == Status::ok);
    CHECK(form <= 1);
    Quadric<double, 3> quadric;
    REQUIRE(to_quadric(Matrix3d(Matrix3d::Identity()), measured, quadric) == Status::ok);
    CHECK(quadric.c - thin.dot(quadric.a * thin) - 2 * quadric.g.dot(thin) >= 0);
    REQUIRE(to_quadric(Ellipsoid<double, 3>{Vector3d::Zero(), given}, quadric) == Status::ok);
    CHECK(quadric.c - thin.dot(quadric.a * thin) >= 0);
    CHECK(quadric.a == quadric.a.transpose());
    filter.forget();
    REQUIRE(filter.bound_vector({Vector3d::Zero(), given}) == Status::ok);
    CHECK(filter.vector_bound().shape.isApprox(symmetric, 1e-14));
    GibbsEllipsoid<GyroState<double>> set = gyro_set(0.1, 1);
    set.shape.topLeftCorner<3, 3>() = given;
    REQUIRE(filter.start(set) == Status::ok);
    CHECK(Matrix3d(filter.ellipsoid().shape.topLeftCorner<3, 3>()).isApprox(symmetric, 1e-14));
    LinearMeasurement<double, 3> linear{Vector3d::Zero(), Matrix<double, 3, 6>::Zero(), given};
    linear.h.leftCols<3>().setIdentity();
    Quadric<double, 6> of_linear;
    REQUIRE(covered_quadric(linear, Vector6<double>(Vector6<double>::Constant(1e-2)), of_linear) == Status::ok);
    CHECK(of_linear.c - thin.dot(of_linear.a.topLeftCorner<3, 3>() * thin) >= 0);
  }
}

TEST_CASE("a center with an entry that is no number is in no domain, wherever the entry is") {
  for (int i = 0; i < 3; ++i) {
    Vector3d vector(1, 2, 3);
    vector(i) = std::numeric_limits<double>::quiet_NaN();
    CHECK_FALSE(in_domain(Ellipsoid<double, 3>{vector, Matrix3d::Identity()}));
    GibbsEllipsoid<GyroState<double>> set = gyro_set(0.1, 1);
    set.center.gyro_bias = vector;
    CHECK_FALSE(in_domain(set));
  }
}
