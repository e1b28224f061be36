#pragma once

/// \file
/// Calls every public function of the library once with input on which it succeeds. It is compiled without exceptions and
/// RTTI and its object searched for heap symbols (freestanding/), and run while allocations are counted
/// (test_no_allocation.cpp). So it must itself neither allocate nor throw.

#include "elliptude/elliptude.hpp"

namespace elliptude::testing {

/// What has been called: how often, how often in vain, and a number that depends on every result, so that no call is
/// optimised away.
template <typename Scalar>
struct Tally {
  int calls = 0;
  int failures = 0;
  Scalar checksum = Scalar(0);

  void add(Status status) noexcept {
    ++calls;
    failures += status == Status::ok ? 0 : 1;
  }
  void add(bool as_expected) noexcept { add(as_expected ? Status::ok : Status::out_of_range); }
  void add(const Scalar& value) noexcept {
    ++calls;
    checksum += value;
  }
  template <typename Derived>
  void add(const Eigen::MatrixBase<Derived>& value) noexcept {
    add(Scalar(value.sum()));
  }
};

/// Input with nothing special about it; given from outside, so that the compiler cannot calculate ahead.
template <typename Scalar>
struct Seeds {
  Vector3<Scalar> zeta{Scalar(0.3), Scalar(-0.5), Scalar(0.7)};
  Vector3<Scalar> rate{Scalar(0.1), Scalar(0.2), Scalar(-0.3)};
  Matrix3<Scalar> inertia = Vector3<Scalar>(Scalar(1), Scalar(2), Scalar(2.5)).asDiagonal();
  Scalar step = Scalar(0.01);
};

/// At angles in each regime of the angle functions: zero, the series, the closed form.
template <typename Scalar>
void use_so3(const Seeds<Scalar>& seeds, Tally<Scalar>& tally) noexcept {
  for (const double factor : {0.0, 1e-6, 1.0, 3.0}) {
    const Vector3<Scalar> z = Scalar(factor) * seeds.zeta;
    const Matrix3<Scalar> c = exp(z);
    tally.add(c);
    tally.add(log(c));
    tally.add(vee(hat(z)));
    tally.add(right_jacobian(z));
    tally.add(right_jacobian_inverse(z));
    tally.add(left_jacobian(z));
    tally.add(left_jacobian_inverse(z));
    tally.add(cayley(z));
    tally.add(cayley_inverse(c));
    tally.add(to_rotation(to_quaternion(c)));
    tally.add(is_rotation(c, rotation_tolerance<Scalar>()));
    tally.add(renormalized(c));
    Matrix3<Scalar> projected;
    tally.add(project_to_rotation(c, projected));
    tally.add(projected);
    tally.add(ExponentialChart::retract(c, ExponentialChart::error(c, Matrix3<Scalar>(c * c))));
    tally.add(GibbsChart::retract(c, GibbsChart::error(c, Matrix3<Scalar>(c * c))));
    tally.add(ExponentialChart::seen_from(z));
    tally.add(ExponentialChart::moved_to(z));
  }
}

template <typename Scalar, int N>
void use_factorization(const Matrix<Scalar, N>& shape, Tally<Scalar>& tally) noexcept {
  Matrix<Scalar, N> l;
  tally.add(is_symmetric(shape));
  tally.add(cholesky_semidefinite(shape, l));
  tally.add(l);
  tally.add(cholesky(shape, l));
  tally.add(lower_inverse(l));
  tally.add(congruence_of_lower(l, shape));
  const Vector<Scalar, N> ones = Vector<Scalar, N>::Ones();
  tally.add(solve_lower_transposed(l, solve_lower(l, ones)));
  Matrix<Scalar, N> inverse;
  tally.add(inverse_positive_definite(shape, inverse));
  tally.add(inverse);
  SymmetricEigen<Scalar, N> eigen;
  tally.add(symmetric_eigen(shape, eigen));
  tally.add(eigen.vectors);
  tally.add(eigen_errors(shape, eigen).values);
  tally.add(eigen_errors(shape, eigen).vectors);
}

template <typename Scalar, int N>
void use_ellipsoid(const Matrix<Scalar, N>& shape, Tally<Scalar>& tally) noexcept {
  use_factorization(shape, tally);
  const Vector<Scalar, N> one_axis = Vector<Scalar, N>::Unit(0);
  const Ellipsoid<Scalar, N> first{Vector<Scalar, N>::Zero(), shape};
  const Ellipsoid<Scalar, N> second{scalar::constant<Scalar>(0.5L) * one_axis, Matrix<Scalar, N>::Identity()};
  Ellipsoid<Scalar, N> flat = second;
  flat.shape(N - 1, N - 1) = Scalar(0);
  const std::array<Ellipsoid<Scalar, N>, 3> terms{first, second, flat};
  tally.add(validate(first));
  tally.add(contains(first, first.center));
  tally.add(support(first, one_axis));
  tally.add(half_widths(first));
  tally.add(affine_image(first, Matrix<Scalar, N>(shape), one_axis).shape);
  tally.add(projection<0, 1>(first).shape);
  Scalar value;
  tally.add(quadratic_form(first, one_axis, value));
  tally.add(value);
  tally.add(log_volume(first, value));
  tally.add(value);
  tally.add(overlap_margin(first, second, value));
  tally.add(value);
  PrincipalAxes<Scalar, N> axes;
  tally.add(principal_axes(first, axes));
  tally.add(axes.lengths);

  Quadric<Scalar, N> quadric;
  Ellipsoid<Scalar, N> back;
  tally.add(slab(one_axis, Scalar(0), scalar::constant<Scalar>(0.25L), quadric));
  tally.add(validate(quadric));
  tally.add(slack(quadric, one_axis));
  tally.add(!contains(quadric, one_axis));
  const Quadric<Scalar, N> thin = pullback(quadric, Matrix<Scalar, N>(shape), one_axis);
  tally.add(thin.a);
  for (const auto& criterion : {SizeCriterion<Scalar, N>::trace(), SizeCriterion<Scalar, N>::weighted_trace(shape),
                                SizeCriterion<Scalar, N>::volume()}) {
    Ellipsoid<Scalar, N> sum;
    Intersection<Scalar, N> common;
    tally.add(validate(criterion));
    tally.add(minimal_sum(terms.data(), terms.size(), criterion, sum));
    tally.add(sum.shape);
    tally.add(minimal_intersection(first, second, criterion, common));
    tally.add(common.set.shape);
    tally.add(minimal_intersection(flat, second, criterion, common));
    tally.add(common.set.shape);
    tally.add(minimal_intersection(quadric, second, criterion, common));
    tally.add(common.set.shape);
  }
  tally.add(to_quadric(first, quadric));
  tally.add(to_ellipsoid(quadric, back));
  tally.add(back.shape);
}

template <typename Scalar, typename Body, typename Potential>
void use_potential(const Seeds<Scalar>& seeds, const Body& body, const Potential& potential,
                   Tally<Scalar>& tally) noexcept {
  const RigidBodyState<Scalar> state{exp(seeds.zeta), seeds.rate};
  tally.add(potential.energy(state.attitude, seeds.step));
  tally.add(potential.torque(state.attitude, seeds.step));
  tally.add(potential.torque_jacobian(state.attitude, seeds.step));
  for (const int order : {2, 4, 6, 8}) {
    Composition<Scalar> composition;
    RigidBodyState<Scalar> next;
    FlowLinearization<Scalar> linearization;
    tally.add(composition_of_order(order, composition));
    tally.add(validate_step(Scalar(0), seeds.step, seeds.rate, state));
    tally.add(integrate_step(body, potential, composition, Scalar(0), seeds.step, seeds.rate, state, next));
    tally.add(next.attitude);
    tally.add(
        integrate(body, potential, composition, Scalar(0), seeds.step, 3L, seeds.rate, state, next,
                  [&tally](long, const RigidBodyState<Scalar>& visited) { tally.add(visited.angular_velocity); }));
    tally.add(integrate_linearized(body, potential, composition, Scalar(0), seeds.step, 3L, seeds.rate, state, next,
                                   linearization));
    tally.add(linearization.state);
    tally.add(linearization.control);
    if constexpr (Body::is_exact) {
      Splitting<Scalar> splitting;
      const std::array<Scalar, 2> times{seeds.step, Scalar(2) * seeds.step};
      tally.add(splitting_of_order(order, splitting));
      tally.add(integrate_to_times(
          body, potential, splitting, Scalar(0), Scalar(3) * seeds.step, 1L, seeds.rate, state, times, next,
          [&tally](std::size_t, const RigidBodyState<Scalar>& visited) { tally.add(visited.attitude); }));
    }
  }
}

template <typename Scalar>
void use_dynamics(const Seeds<Scalar>& seeds, Tally<Scalar>& tally) noexcept {
  RigidBody<Scalar> body;
  tally.add(RigidBody<Scalar>::make(seeds.inertia, body));
  const RigidBodyState<Scalar> state{exp(seeds.zeta), seeds.rate};
  tally.add(body.kinetic_energy(state.angular_velocity));
  tally.add(body.angular_momentum(state));
  tally.add(body.inertia() + body.inertia_inverse() + body.nonstandard_inertia());
  tally.add(body.principal_moments());
  tally.add(body.least_moment());
  tally.add(body.greatest_moment());
  tally.add(Scalar(body.template cast<double>().inertia().sum()));
  Matrix3<Scalar> f;
  tally.add(relative_attitude(body, seeds.step, seeds.rate, f));
  tally.add(f);
  tally.add(relative_attitude_exponential(body, seeds.step, seeds.rate, f));
  tally.add(f);
  ExactRotor<Scalar> rotor;
  tally.add(ExactRotor<Scalar>::make(body, rotor));
  tally.add(rotor.principal_axes());
  tally.add(rotor.inverse_moments());
  tally.add(Scalar(rotor.kappa() + rotor.spread()));
  tally.add(Scalar(rotor.template cast<double>().kappa()));

  const FreeBody<Scalar> free{};
  UniformGravity<Scalar> gravity;
  GravityGradient<Scalar> gradient;
  tally.add(UniformGravity<Scalar>::make(Scalar(1), Scalar(9.81), seeds.rate, gravity));
  tally.add(GravityGradient<Scalar>::make(body, Scalar(0.1), state.attitude, gradient));
  const SumPotential<UniformGravity<Scalar>, GravityGradient<Scalar>> both(gravity, gradient);
  tally.add(free.torque_curvature_bound());
  tally.add(Scalar(both.torque_curvature_bound()));
  // −m g e₃ᵀCρ again, as a potential of one's own.
  const auto energy = [&seeds](const Matrix3<Scalar>& c, const Scalar&) { return Scalar(-(c * seeds.rate).z()); };
  const auto slope = [&seeds](const Matrix3<Scalar>&, const Scalar&) {
    Matrix3<Scalar> result = Matrix3<Scalar>::Zero();
    result.row(2) = -seeds.rate.transpose();
    return result;
  };
  const GradientPotential<Scalar, decltype(energy), decltype(slope)> own(energy, slope);
  tally.add(torque_of_gradient(state.attitude, seeds.inertia));
  use_potential(seeds, body, free, tally);
  use_potential(seeds, body, both, tally);
  use_potential(seeds, rotor, both, tally);
  use_potential(seeds, body, own, tally);
}

template <typename Scalar>
void use_wahba(const Seeds<Scalar>& seeds, Tally<Scalar>& tally) noexcept {
  const Matrix3<Scalar> attitude = exp(seeds.zeta);
  Matrix<Scalar, 3, 2> reference;
  reference << Scalar(1), Scalar(0), Scalar(0), Scalar(1), Scalar(0), Scalar(1);
  const Matrix<Scalar, 3, 2> body = attitude.transpose() * reference;
  ThreeDirections<Scalar> three;
  tally.add(add_cross_product(reference, body, three));
  const Vector3<Scalar> weights = Vector3<Scalar>::Ones();
  Matrix3<Scalar> profile;
  tally.add(attitude_profile(three.reference, three.body, weights, profile));
  RotationSvd<Scalar> svd;
  tally.add(rotation_svd(profile, svd));
  tally.add(svd.u);
  for (const WahbaMethod method : {WahbaMethod::svd, WahbaMethod::foam, WahbaMethod::davenport, WahbaMethod::qr}) {
    WahbaSolution<Scalar> solution;
    tally.add(solve_wahba(three.reference, three.body, weights, method, solution));
    tally.add(solution.attitude);
    Matrix3<Scalar> found;
    Scalar condition;
    tally.add(attitude_of_profile(profile, method, found, condition));
    tally.add(condition);
  }
  WahbaSolution<Scalar> solution;  // a number of directions that is known only when it runs
  tally.add(solve_wahba(three.reference.leftCols(2 + tally.calls % 2), three.body.leftCols(2 + tally.calls % 2),
                        weights.head(2 + tally.calls % 2), WahbaMethod::svd, solution));
}

template <typename Chart, typename Scalar>
void use_wahba_set(const Seeds<Scalar>& seeds, Tally<Scalar>& tally) noexcept {
  const Matrix3<Scalar> reference = Matrix3<Scalar>::Identity();
  Matrix3<Scalar> body = exp(seeds.zeta).transpose();
  body.col(0) += scalar::constant<Scalar>(0.1L) * seeds.rate;
  const Vector3<Scalar> bounds = Vector3<Scalar>::Constant(scalar::constant<Scalar>(0.1L));
  Vector3<Scalar> weights = Vector3<Scalar>::Ones();
  ConeSum<Scalar> sum;
  tally.add(cone_sum(reference, body, bounds, weights, sum));
  tally.add(sum.curvature);
  Ellipsoid<Scalar, 3> error;
  tally.add(bounding_ellipsoid<Chart>(sum, error));
  tally.add(error.shape);
  WahbaSet<Scalar> set;
  tally.add(wahba_set<Chart>(reference, body, bounds, weights, set));
  tally.add(set.attitude);
  for (const WahbaCriterion criterion : {WahbaCriterion::trace, WahbaCriterion::volume}) {
    tally.add(minimal_wahba_set<Chart>(reference, body, bounds, criterion, weights, set));
    tally.add(set.error.shape);
    tally.add(weights);
  }
}

template <typename Scalar, typename Estimator>
void use_filters(const Seeds<Scalar>& seeds, Tally<Scalar>& tally) noexcept {
  using BodyState = RigidBodyState<Scalar>;
  const BodyState truth{exp(seeds.zeta), seeds.rate};
  const Matrix3<Scalar> small = scalar::constant<Scalar>(0.01L) * Matrix3<Scalar>::Identity();
  const Matrix6<Scalar> wide = scalar::constant<Scalar>(0.04L) * Matrix6<Scalar>::Identity();
  const auto criterion = SizeCriterion<Scalar, 6>::trace();
  const auto direction = [&](const Vector3<Scalar>& e, const Matrix3<Scalar>& attitude) {
    return Direction<Scalar>::within(e, attitude.transpose() * e, Scalar(0.1));
  };

  RigidBody<Scalar> body;
  tally.add(RigidBody<Scalar>::make(seeds.inertia, body));
  using BodyFlow = RigidBodyFlow<Scalar, FreeBody<Scalar>>;
  for (const Matrix3<Scalar>& torque : {Matrix3<Scalar>(Matrix3<Scalar>::Zero()), Matrix3<Scalar>(small * small)}) {
    BodyFlow flow;
    tally.add(BodyFlow::make(body, FreeBody<Scalar>{}, seeds.step, 4, torque, flow));
    AttitudeFilter<BodyFlow, Estimator> filter;
    tally.add(AttitudeFilter<BodyFlow, Estimator>::make(flow, criterion, Scalar(0), {truth, wide}, filter));
    tally.add(filter.predict(seeds.step, {}));
    const BodyState now = filter.ellipsoid().center;
    const std::array<Direction<Scalar>, 2> two{direction(Vector3<Scalar>::UnitX(), now.attitude),
                                               direction(Vector3<Scalar>::UnitY(), now.attitude)};
    const AngularVelocity<Scalar> rate{now.angular_velocity, small};
    const MeasuredAttitude<Scalar> star{now.attitude, small};
    Update<Scalar> update;
    Convergence<Scalar> diagnostics{};
    const AttitudeFilter<BodyFlow, Estimator> predicted = filter;
    tally.add(filter.update(two.data(), two.size(), rate, update));
    tally.add(convergence(predicted, two.data(), two.size(), rate, filter, update.share, diagnostics));
    tally.add(diagnostics.contraction);
    tally.add(filter.update(two.data(), 1, rate, update));
    tally.add(filter.update(two.data(), two.size(), update));
    tally.add(filter.update(two.data(), 1, update));
    tally.add(filter.update(rate, update));
    tally.add(filter.update(star, update));
    tally.add(update.margin);
    tally.add(filter.resume(filter.transition(), filter.prior_shape()));
    tally.add(filter.ellipsoid().shape);
    tally.add(filter.time());
    Scalar value;
    Extent<Scalar> size;
    tally.add(validate(filter.ellipsoid()));
    tally.add(quadratic_form(filter.ellipsoid(), now, value));
    tally.add(value);
    tally.add(extent(filter.ellipsoid(), size));
    tally.add(size.half_widths_body);
    tally.add(retract(now, state_error(now, truth)).attitude);
  }

  using Gyro = GyroFlow<Scalar>;
  Gyro flow;
  tally.add(Gyro::make(small, small, flow));
  AttitudeFilter<Gyro, Estimator> filter;
  const GyroState<Scalar> start{truth.attitude, Vector3<Scalar>::Zero()};
  tally.add(AttitudeFilter<Gyro, Estimator>::make(flow, criterion, Scalar(0), {start, wide}, filter));
  StampedFilter<AttitudeFilter<Gyro, Estimator>> stamped(filter, 0, 0);
  tally.add(stamped.predict(10000000, {seeds.rate}));
  tally.add(filter.predict(seeds.step, {seeds.rate}));
  Update<Scalar> update;
  tally.add(filter.update(MeasuredAttitude<Scalar>{filter.ellipsoid().center.attitude, small}, update));
  Ellipsoid<Scalar, 3> velocity;
  tally.add(flow.angular_velocity(filter.ellipsoid(), {seeds.rate}, velocity));
  tally.add(velocity.shape);
}

/// Fusion without linearization.
template <typename Scalar>
void use_guaranteed_fusion(const Seeds<Scalar>& seeds, Tally<Scalar>& tally) noexcept {
  using State = RigidBodyState<Scalar>;
  using Gibbs = StateEllipsoid<State, GibbsChart>;
  const State center{exp(seeds.zeta), seeds.rate};
  const Scalar small = scalar::constant<Scalar>(0.01L);
  const StateEllipsoid<State> exponential{center, small * Matrix6<Scalar>::Identity()};
  Gibbs predicted;
  tally.add(converted(exponential, predicted));
  tally.add(gibbs_stretch(small));
  tally.add(ExponentialChart::angle(small) + GibbsChart::angle(small));
  const Matrix3<Scalar> bound = small * small * Matrix3<Scalar>::Identity();
  std::array<HalfQuadric<Scalar>, 3> halves;
  std::array<Quadric<Scalar, 6>, 4> quadrics;
  Quadric<Scalar, 3> three;
  const Vector3<Scalar> e = Vector3<Scalar>::UnitX();
  const auto direction = Direction<Scalar>::within(e, center.attitude.transpose() * e, small);
  Scalar angle;
  tally.add(angle_bound(direction, angle));
  tally.add(angle);
  tally.add(cone(center.attitude, direction.reference, direction.body, angle, three));
  tally.add(cone(center.attitude, direction, three));
  halves[0] = of_attitude(three);
  quadrics[0] = extended(halves[0]);
  tally.add(to_quadric(center.attitude, MeasuredAttitude<Scalar>{center.attitude, bound}, three));
  halves[1] = of_attitude(three);
  quadrics[1] = extended(halves[1]);
  const AngularVelocity<Scalar> rate{center.angular_velocity, bound};
  tally.add(to_quadric(center.angular_velocity, rate, three));
  halves[2] = of_vector(three);
  quadrics[2] = extended(halves[2]);
  tally.add(to_quadric(linear_angular_velocity(center.angular_velocity, rate), predicted, quadrics[3]));
  const Ellipsoid<Scalar, 6> set = predicted.in_coordinates();
  QuadricFusion<Scalar, 6> fusion;
  for (const auto& criterion : {SizeCriterion<Scalar, 6>::trace(), SizeCriterion<Scalar, 6>::volume()}) {
    tally.add(minimal_intersection(&set, halves.data(), halves.size(), criterion, fusion));
    tally.add(minimal_intersection(&set, quadrics.data(), quadrics.size(), criterion, fusion));
    tally.add(fusion.set.shape);
    tally.add(minimal_intersection<Scalar, 6>(nullptr, quadrics.data(), quadrics.size(), criterion, fusion));
    tally.add(fusion.set.shape);
  }
  Gibbs result;
  tally.add(recentred(center, fusion.set, result));
  tally.add(validate(result));
  Scalar value;
  tally.add(quadratic_form(result, center, value));
  tally.add(largest_attitude_error(result, value));
  Extent<Scalar> size;
  tally.add(extent(result, size));
  tally.add(size.half_widths_body);
  StateEllipsoid<State> back;
  tally.add(converted(result, back));
  tally.add(back.shape);
  tally.add(retract<GibbsChart>(center, state_error<GibbsChart>(center, center)).attitude);
}

/// The guaranteed flows with each kind of potential, and their filter with each policy.
template <typename Scalar, typename Potential>
void use_guaranteed_body(const Seeds<Scalar>& seeds, const RigidBody<Scalar>& body, const Potential& potential,
                         Tally<Scalar>& tally) noexcept {
  using Flow = GuaranteedRigidBodyFlow<Scalar, Potential>;
  using Filter = GuaranteedFilter<Flow>;
  static_assert(has_expansion<Potential, Scalar>);
  const Matrix3<Scalar> unit = Matrix3<Scalar>::Identity();
  const RigidBodyState<Scalar> truth{exp(seeds.zeta), seeds.rate};
  BodyUncertainty<Scalar> uncertainty;
  uncertainty.torque = scalar::constant<Scalar>(1e-6L) * unit;
  uncertainty.inertia = scalar::constant<Scalar>(1e-3L);
  Flow flow;
  tally.add(Flow::make(body, potential, seeds.step, uncertainty, flow));
  tally.add(flow.set_most_steps(2 * flow.most_steps()));
  flow.set_interruption({[](void*) noexcept { return false; }, nullptr});
  tally.add(flow.body().inertia());
  tally.add(flow.potential().torque(truth.attitude, Scalar(0)));
  BodyInput<Scalar> input;
  input.wheel_momentum = scalar::constant<Scalar>(0.1L) * seeds.zeta;
  const GibbsEllipsoid<RigidBodyState<Scalar>> set{truth,
                                                   scalar::constant<Scalar>(1e-4L) * Matrix6<Scalar>::Identity()};
  GibbsEllipsoid<RigidBodyState<Scalar>> later;
  tally.add(flow.predict(Scalar(0), Scalar(4) * seeds.step, input, set, later));
  tally.add(later.shape);
  Ellipsoid<Scalar, 3> vector;
  tally.add(flow.predict_vector(Scalar(0), seeds.step, input, {seeds.rate, unit}, vector));
  tally.add(vector.shape);

  const auto direction = [&](const Vector3<Scalar>& e, const Matrix3<Scalar>& attitude) {
    return Direction<Scalar>::within(e, attitude.transpose() * e, scalar::constant<Scalar>(0.05L));
  };
  for (const Policy policy : {Policy::raise, Policy::drop_measurement, Policy::restart, Policy::relaxed}) {
    typename Filter::Settings settings;
    settings.policy = policy;
    settings.most_wrong = policy == Policy::relaxed ? 1 : 0;
    Filter filter;
    tally.add(Filter::make(flow, settings, Scalar(0), filter));
    tally.add(filter.bound_vector({Vector3<Scalar>::Zero(), unit}));
    // A star tracker beside directions of which one, where a policy can mend that, is wrong.
    const bool mends = policy != Policy::raise;
    const Matrix3<Scalar> other = exp(Vector3<Scalar>(scalar::constant<Scalar>(0.5L) * Vector3<Scalar>::Ones()));
    const std::array<Direction<Scalar>, 3> three{
        direction(Vector3<Scalar>::UnitX(), truth.attitude), direction(Vector3<Scalar>::UnitY(), truth.attitude),
        direction(Vector3<Scalar>::UnitZ(), mends ? Matrix3<Scalar>(truth.attitude * other) : truth.attitude)};
    const AngularVelocity<Scalar> rate{truth.angular_velocity, scalar::constant<Scalar>(1e-4L) * unit};
    const MeasuredAttitude<Scalar> star{truth.attitude, scalar::constant<Scalar>(1e-4L) * unit};
    GuaranteedUpdate<Scalar> update;
    tally.add(filter.start(set));
    tally.add(filter.predict(seeds.step, input));
    tally.add(filter.update({three.data(), three.size(), &rate, &star}, update));
    tally.add(update.margin);
    LinearMeasurement<Scalar, 3> linear;
    tally.add(linear_attitude(filter.ellipsoid().center.attitude, star, linear));
    tally.add(filter.update(linear, update));
    tally.add(filter.knows_attitude());
    tally.add(filter.claim() != Claim::none);
    tally.add(filter.time());
    tally.add(filter.settings().criterion.kind == settings.criterion.kind);
    tally.add(filter.flow().body().inertia());
    tally.add(filter.flow().longest_step());
    tally.add(filter.ellipsoid().shape);
    FixedLag<Filter, 2> lag;
    tally.add(FixedLag<Filter, 2>::make(filter, lag));
    tally.add(lag.predict(Scalar(2) * seeds.step, input));
    tally.add(lag.update(linear, update));
    SmoothedSet<RigidBodyState<Scalar>> smoothed;
    tally.add(lag.smoothed(1, smoothed));
    tally.add(smoothed.set.shape);
  }
}

/// Smoothing, of a gyro; that of a body is beside its filter.
template <typename Scalar>
void use_smoothing(const Seeds<Scalar>& seeds, Tally<Scalar>& tally) noexcept {
  using State = GyroState<Scalar>;
  using Flow = GuaranteedGyroFlow<Scalar>;
  using Filter = GuaranteedFilter<Flow>;
  const Matrix3<Scalar> small = scalar::constant<Scalar>(1e-4L) * Matrix3<Scalar>::Identity();
  GyroUncertainty<Scalar> uncertainty;
  uncertainty.noise = small;
  uncertainty.drift = small;
  Flow made;
  Filter filter;
  tally.add(Flow::make(uncertainty, Flow::IntervalRate::first_sample, made));
  tally.add(Filter::make(made, {}, Scalar(0), filter));
  tally.add(filter.bound_vector({Vector3<Scalar>::Zero(), small}));
  tally.add(filter.start(GibbsEllipsoid<State>{{exp(seeds.zeta), Vector3<Scalar>::Zero()},
                                               scalar::constant<Scalar>(1e-4L) * Matrix6<Scalar>::Identity()}));
  FixedLag<Filter, 3> lag;
  tally.add(FixedLag<Filter, 3>::make(filter, lag));
  tally.add(filter.has_vector_bound());
  tally.add(!filter.leaves_vector());
  tally.add(filter.vector_bound().shape);
  const Scalar start = lag.time();
  tally.add(lag.predict(start + seeds.step, {seeds.rate, seeds.step}));
  tally.add(lag.predict_turn(start + Scalar(2) * seeds.step, seeds.zeta, seeds.step));
  const MeasuredAttitude<Scalar> star{
      filter.ellipsoid().center.attitude * exp(Vector3<Scalar>(seeds.step * seeds.rate)) * exp(seeds.zeta),
      scalar::constant<Scalar>(1e-3L) * Matrix3<Scalar>::Identity()};
  GuaranteedUpdate<Scalar> update;
  UpdateConstraints<State> constraints;
  tally.add(lag.update(Measurements<Scalar>{nullptr, 0, nullptr, &star}, update));
  tally.add(lag.update(Measurements<Scalar>{nullptr, 0, nullptr, &star}, update, constraints));
  SmoothedSet<State> smoothed;
  tally.add(lag.smoothed(lag.moments() - 1, smoothed));
  tally.add(smoothed.set.shape);
  tally.add(smoothed.vector.shape);
  tally.add(smoothed.claim == Claim::unconditional);
  tally.add(!lag.has_contradicted());
  tally.add(lag.filter().time());
  const GibbsEllipsoid<State> back = mirrored(mirrored(smoothed.set));
  Ellipsoid<Scalar, 6> seen;
  tally.add(seen_from(lag.filter().ellipsoid().center, back, seen));
  tally.add(seen.center);
  GibbsEllipsoid<State> common;
  tally.add(common_set(back, smoothed.set, {}, common));
  CommonSetSettings<Scalar> settings;
  settings.is_product = true;
  BothDirections<State> both;
  tally.add(both_directions<State>({back, Claim::conditional}, {common, Claim::conditional}, settings, both));
  tally.add(both.smoothed.set.shape);
  const FilterMoment<Filter> last = FilterMoment<Filter>::of(lag.filter(), {});
  BackwardPass<Filter> pass(lag.filter(), last);
  tally.add(pass.to(last));
  tally.add(pass.smoothed().time);
  tally.add(!pass.has_contradicted());
  tally.add(mirrored(filter.vector_bound()).center);
  Flow flow;
  tally.add(Mirror<Flow>::flow(filter.flow(), flow));
  tally.add(flow.uncertainty().noise);
  tally.add(flow.interval_rate() == Flow::IntervalRate::last_sample);
  tally.add(Mirror<Flow>::input({seeds.rate, seeds.step}).increment);
  lag.forget();
  tally.add(lag.predict_interval(lag.time() + seeds.step, seeds.step, {seeds.rate, seeds.step}));
  tally.add(lag.predict_turn_interval(lag.time() + seeds.step, seeds.step, seeds.zeta, seeds.step));
}

/// Caps, and the filter of one direction.
template <typename Scalar>
void use_directions(const Seeds<Scalar>& seeds, Tally<Scalar>& tally) noexcept {
  const DirectionCap<Scalar> first{Vector3<Scalar>::UnitZ(), scalar::constant<Scalar>(0.2L)};
  const DirectionCap<Scalar> second = turned(first, exp(seeds.zeta), seeds.step);
  DirectionCap<Scalar> both;
  tally.add(intersection(first, {first.center, scalar::constant<Scalar>(0.3L)}, both));
  tally.add(validate(second));
  DirectionFilter<Scalar> filter;
  tally.add(DirectionFilter<Scalar>::make({}, filter));
  DirectionUpdate update;
  tally.add(filter.update(both, update));
  tally.add(filter.predict_turn(seeds.zeta, seeds.step));
  tally.add(filter.cap().center);
}

/// Not inlined: GCC would see that a filter that knows nothing yet is copied with what it does not know.
template <typename Scalar, typename Filter>
[[gnu::noinline]] void use_stamps(const Seeds<Scalar>& seeds, const Filter& filter, Tally<Scalar>& tally) noexcept {
  StampedFilter<Filter> stamped(filter, 0, 0);
  tally.add(stamped.predict(10000000, {seeds.rate, Scalar(-1)}));
  tally.add(stamped.predict_turn(20000000, seeds.zeta, seeds.step));
  tally.add(stamped.stamp() == 20000000 && stamped.epoch() == 0);
  tally.add(stamped.filter().time());
}

template <typename Scalar>
void use_guaranteed(const Seeds<Scalar>& seeds, Tally<Scalar>& tally) noexcept {
  RigidBody<Scalar> body;
  tally.add(RigidBody<Scalar>::make(seeds.inertia, body));
  UniformGravity<Scalar> gravity;
  tally.add(UniformGravity<Scalar>::make(Scalar(1), Scalar(1), seeds.zeta, gravity));
  GravityGradient<Scalar> gradient;
  tally.add(GravityGradient<Scalar>::make(body, Scalar(1), Matrix3<Scalar>::Identity(), gradient));
  // One flow with every kind of potential: each flow is long to compile.
  TurningDirection<Scalar> direction;
  tally.add(TurningDirection<Scalar>::make(Vector3<Scalar>::UnitX(), Vector3<Scalar>::UnitZ(), direction));
  LinearPotential<Scalar> linear;
  tally.add(LinearPotential<Scalar>::make(seeds.zeta, direction, linear));
  QuadraticPotential<Scalar> quadratic;
  tally.add(QuadraticPotential<Scalar>::make(body.inertia(), direction, quadratic));
  const BackwardTorque<Scalar, QuadraticPotential<Scalar>> backward(quadratic);
  tally.add(backward.energy(body.inertia(), seeds.step));
  tally.add(backward.torque(body.inertia(), seeds.step));
  tally.add(backward.torque_jacobian(body.inertia(), seeds.step));
  tally.add(backward.backward().matrix());
  using Stated = StatedTorque<Scalar, QuadraticPotential<Scalar>>;
  Stated stated;
  tally.add(Stated::make(quadratic, {quadratic.torque_curvature_bound(), Scalar(1), Scalar(0)}, stated));
  tally.add(stated.energy(Matrix3<Scalar>::Identity(), Scalar(1)));
  using Sum = SumPotential<FreeBody<Scalar>, UniformGravity<Scalar>, GravityGradient<Scalar>, LinearPotential<Scalar>,
                           QuadraticPotential<Scalar>, Stated>;
  use_guaranteed_body(seeds, body, Sum(FreeBody<Scalar>{}, gravity, gradient, linear, quadratic, stated), tally);

  using Flow = GuaranteedGyroFlow<Scalar>;
  const Matrix3<Scalar> small = scalar::constant<Scalar>(1e-4L) * Matrix3<Scalar>::Identity();
  GyroUncertainty<Scalar> uncertainty;
  uncertainty.noise = small;
  uncertainty.drift = small;
  for (const typename Flow::IntervalRate mode :
       {Flow::IntervalRate::first_sample, Flow::IntervalRate::mean_of_ends, Flow::IntervalRate::mean}) {
    Flow flow;
    tally.add(Flow::make(uncertainty, mode, flow));
    GuaranteedFilter<Flow> filter;
    typename GuaranteedFilter<Flow>::Settings settings;
    settings.keeps_constraints = true;
    tally.add(GuaranteedFilter<Flow>::make(flow, settings, Scalar(0), filter));
    tally.add(filter.bound_vector({Vector3<Scalar>::Zero(), small}));
    use_stamps(seeds, filter, tally);
    tally.add(filter.predict(seeds.step, {seeds.rate, Scalar(-1)}));
    const MeasuredAttitude<Scalar> star{exp(seeds.zeta), small};
    GuaranteedUpdate<Scalar> update;
    tally.add(filter.update({nullptr, 0, nullptr, &star}, update));
    AttitudeBounds<Scalar> bounds;
    tally.add(filter.bounds(seeds.rate, bounds));
    tally.add(bounds.angle + bounds.heading());
    UpdateConstraints<GyroState<Scalar>> constraints;
    tally.add(filter.update({nullptr, 0, nullptr, &star}, update, constraints));
    Interval<Scalar> interval{Scalar(0), Scalar(0)};
    tally.add(constraints.turn_about(seeds.rate, interval));
    tally.add(interval.most);
    tally.add(constraints.vector_along(seeds.rate, interval));
    tally.add(interval.least);
    AttitudeSet<Scalar> alone{Matrix3<Scalar>::Identity(), Matrix3<Scalar>::Identity()};
    tally.add(constraints.attitude_set(SizeCriterion<Scalar, 3>::volume(), alone));
    tally.add(alone.shape);
    tally.add(filter.predict(Scalar(2) * seeds.step, {seeds.rate, Scalar(-1)}));
    tally.add(filter.predict_turn(Scalar(3) * seeds.step, seeds.zeta, seeds.step));
    tally.add(filter.ellipsoid().shape);
    GibbsEllipsoid<GyroState<Scalar>> turned;
    tally.add(flow.predict_attitude_turn(seeds.step, seeds.zeta, seeds.step, {seeds.rate, small}, filter.ellipsoid(),
                                         turned));
    Ellipsoid<Scalar, 3> bias;
    tally.add(flow.predict_vector(Scalar(0), seeds.step, {seeds.rate, Scalar(-1)}, {seeds.rate, small}, bias));
    tally.add(bias.shape);
  }
}

template <typename Scalar>
[[nodiscard]] Tally<Scalar> use_every_function(const Seeds<Scalar>& seeds) noexcept {
  Tally<Scalar> tally;
  use_so3(seeds, tally);
  use_ellipsoid<Scalar, 3>(seeds.inertia, tally);
  Matrix6<Scalar> shape = Matrix6<Scalar>::Identity();
  shape.template topLeftCorner<3, 3>() = seeds.inertia;
  use_ellipsoid<Scalar, 6>(shape, tally);
  use_dynamics(seeds, tally);
  use_wahba(seeds, tally);
  use_wahba_set<ExponentialChart>(seeds, tally);
  use_wahba_set<GibbsChart>(seeds, tally);
  use_filters<Scalar, PaperEstimator>(seeds, tally);
  use_filters<Scalar, FirstOrderEstimator>(seeds, tally);
  use_guaranteed_fusion(seeds, tally);
  use_directions(seeds, tally);
  use_guaranteed(seeds, tally);
  use_smoothing(seeds, tally);
  Sealed<Matrix6<Scalar>> sealed(shape);
  tally.add(sealed.verify());
  tally.add(sealed.call([](Matrix6<Scalar>& inside) noexcept {
    inside *= Scalar(2);
    return Status::ok;
  }));
  sealed.replace(shape);
  tally.add(sealed.object());
  tally.add(message(tally.failures == 0 ? Status::ok : Status::out_of_range)[0] == 'o');
  return tally;
}

}  // namespace elliptude::testing
