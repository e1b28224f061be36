#pragma once

/// \file
/// Carries the set of errors y = [γ; δω] about a moving center along the motion, with bounds of everything that is left out.
/// (theory, section 17)
///
/// Exactly (theory, section 17.1),
///
///     γ'  = −ω̂ × γ + δω + ½ γ × δω + ¼ γ (γ·δω)
///     δω' = J⁻¹ (S(Jω̂ + h_w) − S(ω̂)J) δω + J⁻¹ (𝓜γ + ½ M''(γ, γ) − δω × Jδω + rest of the torque + τ − defect)
///
/// With y = Y(s) u, where Y follows the linear part but for a known error, u moves by terms of second order and higher. Those of
/// second order are integrated exactly as a quadratic map of u(0); the unknown torque and what is of third and fourth order push u
/// within an ellipsoid, and what is left is bounded in the norm of u.

#include "elliptude/base/rounding.hpp"
#include "elliptude/guaranteed/detail/packed_forms.hpp"
#include "elliptude/guaranteed/detail/prediction_sums.hpp"
#include "elliptude/guaranteed/detail/step_means.hpp"
#include "elliptude/guaranteed/motion_series.hpp"

namespace elliptude {

/// The uncertainty of a rigid body: unknown torque and inertia error.
template <typename Scalar>
struct BodyUncertainty {
  /// Shape of an ellipsoid about zero, (N m)², body axes, that holds the unknown torque at every time, however it changes.
  Matrix3<Scalar> torque = Matrix3<Scalar>::Zero();
  /// Largest error of the inertia matrix in the spectral norm, kg m². It affects the gravity gradient too.
  Scalar inertia = Scalar(0);
};

/// The set of errors over one stretch of the motion, from an ellipsoid to an ellipsoid.
template <typename Scalar, typename Potential>
class ErrorTube {
 public:
  /// \param shape of the ellipsoid of y = [γ; δω] at the start.
  /// \param h the longest step to come, s.
  /// \param stiffness a bound of ‖J⁻¹ ∂M/∂ζ‖, 1/s². Both only choose the norm in which the rest is bounded.
  /// \return `not_positive_definite` also of a flat one.
  [[nodiscard]] Status start(const Matrix6<Scalar>& shape, const Scalar& h, const Scalar& stiffness) noexcept {
    // A Cholesky factor is that of a matrix which differs by less than this from the one given (Higham, Accuracy and
    // Stability, theorem 10.3): none is then smaller.
    Matrix6<Scalar> raised = shape;
    raised.diagonal() *= Scalar(1) + rounding::share<Scalar>(rounding::cholesky(6));
    // Norms are taken about a set that is not too thin in any direction: what nonlinear terms do to a thin set is judged by
    // the width of the whole, and over a step Y must not change by more than a part of itself.
    const Scalar share = scalar::constant<Scalar>(0.01L);
    const Scalar attitude = shape.diagonal().template head<3>().sum();
    const Scalar rate = shape.diagonal().template tail<3>().sum();
    const Scalar by_rate = Scalar(4) * h;
    const Scalar by_torque = by_rate * stiffness;
    Matrix6<Scalar> wide = raised;
    wide.diagonal().template head<3>().array() += share * attitude + by_rate * by_rate * rate;
    wide.diagonal().template tail<3>().array() += share * rate + by_torque * by_torque * attitude;
    Matrix6<Scalar> set;
    if (const Status status = cholesky(raised, set); status != Status::ok) {
      return status;
    }
    if (const Status status = cholesky(wide, frame_); status != Status::ok) {
      return status;
    }
    set_ = solve_lower(frame_, set);
    second_order_.setZero();
    second_order_norm_ = Scalar(0);
    pushed_.setZero();
    pushed_norm_ = Scalar(0);
    rest_ = Scalar(0);
    return Status::ok;
  }

  /// How far u may have moved from where it began, in the norm in which the set has radius one.
  [[nodiscard]] Scalar displacement() const noexcept { return second_order_norm_ + pushed_norm_ + rest_; }

  /// Over the step of the motion that `series` is of; the center is `series.end` afterwards.
  /// \return `unbounded` if the bounds do not close: the set is too large, or the step too long, for it to be bounded;
  /// `invalid_inertia` if the inertia error reaches the least principal moment. Nothing has then changed.
  [[nodiscard]] Status step(const RigidBody<Scalar>& body, const MotionSeries<Scalar, Potential>& series,
                            const BodyUncertainty<Scalar>& uncertainty) noexcept;

  /// An ellipsoid about zero that contains Y u for all that u can be by now.
  [[nodiscard]] Matrix6<Scalar> shape() const noexcept;

  // What is known of every motion that began at y = Y(0) u₀ with ‖u₀‖ ≤ 1: by now y = Y (u₀ + q(u₀) + p + r),

  [[nodiscard]] const Matrix6<Scalar>& frame() const noexcept { return frame_; }                              ///< Y
  [[nodiscard]] const detail::packed::Forms<Scalar>& second_order() const noexcept { return second_order_; }  ///< q
  [[nodiscard]] const Matrix6<Scalar>& pushed() const noexcept { return pushed_; }  ///< shape of p's ellipsoid
  [[nodiscard]] const Scalar& rest() const noexcept { return rest_; }               ///< bound of ‖r‖

 private:
  static constexpr int order = 4;      // of Y within a step
  static constexpr int jacobians = 4;  // terms of the torque's Jacobian
  // Three rows of Y, transposed: columns fill SIMD registers with two rows of zeros.
  using Block = Matrix<Scalar, 8, 3>;
  using Columns = Matrix<Scalar, 6, 3>;

  /// Y(s) = Σ Y_k sᵏ over a step, which is Y(h/2) (I + W(s)).
  struct LinearPart {
    Matrix6<Scalar> middle;
    Matrix6<Scalar> end;
    Columns from_attitude;      // Y(h/2)⁻¹, its first three columns
    Columns from_rate;          // and its last
    Scalar from_attitude_norm;  // what an error of γ' is, at most, in u'
    Scalar from_rate_norm;      // and one of δω'
    Scalar largest_attitude;    // of γ in the middle for ‖u‖ ≤ 1
    Scalar largest_difference;  // of δω
    Scalar change_odd;          // of W, its part that is linear in s − h/2
    Scalar change;              // of W, all
    Scalar error;               // of the integral of Y(h/2)⁻¹ (Y' − A Y)
  };

  /// Bounds of what moves u beyond second order, given how far it moves.
  struct Displacement {
    Scalar rest;    // of u from where the quadratic map and the pushes take it
    Scalar all;     // of u from where it began
    Scalar cube;    // what the pushes of third order in the middle, for ‖u‖ = 1, are multiplied by
    Scalar fourth;  // and those of fourth
  };

  [[nodiscard]] Status expand_linear(const RigidBody<Scalar>& body, const MotionSeries<Scalar, Potential>& series,
                                     LinearPart& linear) const noexcept;
  [[nodiscard]] static detail::packed::Forms<Scalar> second_order_forms(const RigidBody<Scalar>& body,
                                                                        const MotionSeries<Scalar, Potential>& series,
                                                                        const Scalar& middle,
                                                                        const LinearPart& linear) noexcept;
  [[nodiscard]] static Status unknown_torque(const RigidBody<Scalar>& body,
                                             const MotionSeries<Scalar, Potential>& series,
                                             const BodyUncertainty<Scalar>& uncertainty,
                                             const Scalar& largest_difference, Matrix3<Scalar>& shape) noexcept;
  [[nodiscard]] static Matrix6<Scalar> cubic_push(const RigidBody<Scalar>& body,
                                                  const MotionSeries<Scalar, Potential>& series, const Scalar& middle,
                                                  const LinearPart& linear) noexcept;

  [[nodiscard]] static Scalar block_norm(const Block& block) noexcept {
    return norm_of_gram(Matrix3<Scalar>(block.transpose().lazyProduct(block)));
  }
  [[nodiscard]] static Scalar column_norm(const Columns& columns) noexcept {
    return norm_of_gram(Matrix3<Scalar>(columns.transpose().lazyProduct(columns)));
  }

  Matrix6<Scalar> frame_;
  Matrix6<Scalar> set_;  // {set_ v : ‖v‖ ≤ 1} is the set of u at the start, within the unit ball
  detail::packed::Forms<Scalar> second_order_;
  Scalar second_order_norm_;  // of q(u) for ‖u‖ ≤ 1
  Matrix6<Scalar> pushed_;
  Scalar pushed_norm_;  // of p
  Scalar rest_;
};

template <typename Scalar, typename Potential>
Status ErrorTube<Scalar, Potential>::expand_linear(const RigidBody<Scalar>& body,
                                                   const MotionSeries<Scalar, Potential>& series,
                                                   LinearPart& linear) const noexcept {
  const Scalar& h = series.step_powers[1];
  const Scalar half = scalar::constant<Scalar>(0.5L);
  const Scalar one(1);
  const Matrix3<Scalar>& inertia = body.inertia();
  const Matrix3<Scalar>& inverse_inertia = body.inertia_inverse();
  const auto& powers = series.step_powers;
  const TorqueBounds<Scalar>& torque = series.acceleration;  // of J⁻¹M
  const auto number = [](std::size_t k) { return Scalar(static_cast<scalar::Value<Scalar>>(k)); };

  // --- Y_k from Y' = A(s) Y; everything transposed -----------------------------------------------------------------------
  std::array<Matrix3<Scalar>, jacobians> stiffness;  // J⁻¹ 𝓜_j
  for (int j = 0; j < jacobians; ++j) {
    stiffness[static_cast<std::size_t>(j)] = inverse_inertia.lazyProduct(series.torque.jacobian(j)).transpose();
  }
  std::array<Matrix3<Scalar>, order + 1> turning;     // −S(ω_j), transposed: S(ω_j)
  std::array<Matrix3<Scalar>, order + 1> gyroscopic;  // J⁻¹ (S(Jω_j + h_w) − S(ω_j) J)
  for (std::size_t j = 0; j <= order; ++j) {
    turning[j] = hat(series.rate[j]);
    gyroscopic[j] =
        inverse_inertia.lazyProduct(Matrix3<Scalar>(hat(series.momentum[j]) - turning[j].lazyProduct(inertia)))
            .transpose();
  }
  std::array<Block, order + 1> top;     // of γ
  std::array<Block, order + 1> bottom;  // of δω
  top[0].setZero();
  bottom[0].setZero();
  top[0].template topRows<6>() = frame_.template topRows<3>().transpose();
  bottom[0].template topRows<6>() = frame_.template bottomRows<3>().transpose();
  Block next_top;
  Block next_bottom;
  for (std::size_t k = 0; k <= order; ++k) {  // coefficient k of A Y, which is (k + 1) Y_{k+1}
    next_top = bottom[k];
    next_bottom.setZero();
    for (std::size_t j = 0; j <= k; ++j) {
      next_top += top[k - j].lazyProduct(turning[j]);
      next_bottom += bottom[k - j].lazyProduct(gyroscopic[j]);
      if (j < jacobians) {
        next_bottom += top[k - j].lazyProduct(stiffness[j]);
      }
    }
    if (k < order) {
      top[k + 1] = (one / number(k + 1)) * next_top;
      bottom[k + 1] = (one / number(k + 1)) * next_bottom;
    }
  }

  // --- the middle and the end of the step --------------------------------------------------------------------------------
  const Scalar middle = half * h;
  const auto value_at = [](const std::array<Block, order + 1>& blocks, const Scalar& s) {
    Block value = blocks[order];
    for (std::size_t k = order; k-- > 0;) {
      value = blocks[k] + s * value;
    }
    return value;
  };
  const auto slope_at = [&number](const std::array<Block, order + 1>& blocks, const Scalar& s) {
    Block slope = number(order) * blocks[order];
    for (std::size_t k = order - 1; k > 0; --k) {
      slope = number(k) * blocks[k] + s * slope;
    }
    return slope;
  };
  const auto rows = [](const Block& first, const Block& second) {
    Matrix6<Scalar> matrix;
    matrix.template topRows<3>() = first.template topRows<6>().transpose();
    matrix.template bottomRows<3>() = second.template topRows<6>().transpose();
    return matrix;
  };
  const Block middle_top = value_at(top, middle);
  const Block middle_bottom = value_at(bottom, middle);
  linear.middle = rows(middle_top, middle_bottom);
  linear.end = rows(value_at(top, h), value_at(bottom, h));
  Matrix6<Scalar> inverse;
  if (inverse_of(linear.middle, inverse) != Status::ok) {
    return Status::unbounded;
  }
  linear.from_attitude = inverse.template leftCols<3>();
  linear.from_rate = inverse.template rightCols<3>();
  linear.from_attitude_norm = column_norm(linear.from_attitude);
  linear.from_rate_norm = column_norm(linear.from_rate);
  linear.largest_attitude = block_norm(middle_top);
  linear.largest_difference = block_norm(middle_bottom);

  std::array<Scalar, order + 1> top_norms;
  std::array<Scalar, order + 1> bottom_norms;
  for (std::size_t k = 0; k <= order; ++k) {
    top_norms[k] = scalar::sqrt(Scalar(top[k].squaredNorm()));
    bottom_norms[k] = scalar::sqrt(Scalar(bottom[k].squaredNorm()));
  }
  const Matrix6<Scalar> slope = rows(slope_at(top, middle), slope_at(bottom, middle));
  linear.change_odd = spectral_norm(Matrix6<Scalar>(inverse.lazyProduct(slope))) * middle;
  Scalar curvature(0);
  for (std::size_t k = 2; k <= order; ++k) {
    curvature += number(k * (k - 1)) * powers[k - 2] *
                 (linear.from_attitude_norm * top_norms[k] + linear.from_rate_norm * bottom_norms[k]);
  }
  linear.change = linear.change_odd + half * curvature * middle * middle;
  if (!(linear.change < half)) {
    return Status::unbounded;
  }
  const Scalar largest_attitude = linear.largest_attitude * (one + linear.change);
  const Scalar largest_difference = linear.largest_difference * (one + linear.change);

  // --- Y' − A Y: its first coefficient exactly, the others by the norms of their blocks ----------------------------------
  const Matrix6<Scalar> first_error = inverse.lazyProduct(rows(next_top, next_bottom));
  linear.error = scalar::sqrt(Scalar(first_error.squaredNorm())) * powers[order + 1] / number(order + 1);
  // In these, the integral of sⁱ⁺ʲ with i + j > order is at most hⁱ⁺ʲ⁺¹/(order + 2); sums over i come first.
  std::array<Scalar, order + 1> top_sums;
  std::array<Scalar, order + 1> bottom_sums;
  top_sums[order] = powers[order] * top_norms[order];
  bottom_sums[order] = powers[order] * bottom_norms[order];
  for (std::size_t i = order; i-- > 0;) {
    top_sums[i] = top_sums[i + 1] + powers[i] * top_norms[i];
    bottom_sums[i] = bottom_sums[i + 1] + powers[i] * bottom_norms[i];
  }
  Scalar top_sum(0);
  Scalar bottom_sum(0);
  for (std::size_t j = 1; j < series.rate_norms.size(); ++j) {
    const Scalar momentum = scalar::sqrt(Scalar(series.momentum[j].squaredNorm()));
    const Scalar gyroscopic_norm =
        (momentum + series.rate_norms[j] * body.principal_moments()(0)) / body.principal_moments()(2);
    const Scalar stiffness_norm = j < jacobians ? scalar::sqrt(Scalar(stiffness[j].squaredNorm())) : Scalar(0);
    const std::size_t first = j > order ? 0 : order + 1 - j;
    top_sum += powers[j] * series.rate_norms[j] * top_sums[first];
    bottom_sum += powers[j] * (gyroscopic_norm * bottom_sums[first] + stiffness_norm * top_sums[first]);
  }
  top_sum *= h / number(order + 2);
  bottom_sum *= h / number(order + 2);
  if (torque.largest > Scalar(0)) {
    bottom_sum += torque.degree * torque.largest * series.tail(jacobians, torque.degree, torque.turn_rate, h) * h /
                  number(jacobians + 1) * largest_attitude;
  }
  linear.error += linear.from_attitude_norm * top_sum + linear.from_rate_norm * bottom_sum;
  // Rounding of Y and of what is calculated from it.
  linear.error += rounding::share<Scalar>(rounding::linear_part) *
                  (linear.from_attitude_norm * largest_attitude + linear.from_rate_norm * largest_difference);
  // And of A, and of the terms of second order, whose products may cancel before J⁻¹ makes the rest of them large. ‖u‖ ≤ 2.
  const Scalar ratio = body.principal_moments()(0) / body.principal_moments()(2);
  linear.error += rounding::share<Scalar>(rounding::linear_rate) * h * linear.from_rate_norm *
                  ((series.gyroscopic_size + ratio * largest_difference) * largest_difference +
                   series.stiffness_size * largest_attitude * (one + largest_attitude));
  return Status::ok;
}

/// The terms of second order of u' in the middle of the step, as forms of u.
template <typename Scalar, typename Potential>
detail::packed::Forms<Scalar> ErrorTube<Scalar, Potential>::second_order_forms(
    const RigidBody<Scalar>& body, const MotionSeries<Scalar, Potential>& series, const Scalar& middle,
    const LinearPart& linear) noexcept {
  using Factor = detail::packed::Factor<Scalar>;
  const Matrix6<Scalar>& y = linear.middle;
  const std::array<Factor, 3> attitude{Factor(y.row(0)), Factor(y.row(1)), Factor(y.row(2))};
  const std::array<Factor, 3> difference{Factor(y.row(3)), Factor(y.row(4)), Factor(y.row(5))};
  // The six products of three linear forms, as `expansion::RowForms` counts them.
  const auto squares_of = [](const std::array<Factor, 3>& factors) {
    const Scalar root = scalar::constant<Scalar>(1.41421356237309504880168872420969807857L);
    detail::packed::Forms<Scalar> squares;
    for (int a = 0; a < 3; ++a) {
      const auto at = static_cast<std::size_t>(a);
      squares.col(a) = detail::packed::product(factors[at], factors[at]);
      squares.col(3 + a) = root * detail::packed::product(factors[(at + 1) % 3], factors[(at + 2) % 3]);
    }
    return squares;
  };

  Matrix<Scalar, detail::packed::size, 3> by_attitude;
  for (int a = 0; a < 3; ++a) {  // ½ γ × δω
    const auto next = static_cast<std::size_t>((a + 1) % 3);
    const auto last = static_cast<std::size_t>((a + 2) % 3);
    by_attitude.col(a) = scalar::constant<Scalar>(0.5L) * (detail::packed::product(attitude[next], difference[last]) -
                                                           detail::packed::product(attitude[last], difference[next]));
  }
  // −J⁻¹ (δω × Jδω)
  const expansion::RowForms<Scalar> gyroscopic =
      -body.inertia_inverse().lazyProduct(expansion::gyroscopic_forms(body.inertia()));
  Matrix<Scalar, detail::packed::size, 3> by_rate = squares_of(difference).lazyProduct(gyroscopic.transpose());
  if (series.acceleration.largest > Scalar(0)) {
    expansion::Forms<Scalar> torque_forms{Matrix3<Scalar>::Zero(), Matrix3<Scalar>::Zero(), Matrix3<Scalar>::Zero()};
    series.torque.add_curvature(middle, body.inertia_inverse(), torque_forms);
    const expansion::RowForms<Scalar> curvature = expansion::rows_of(torque_forms);
    by_rate += squares_of(attitude).lazyProduct(curvature.transpose());
  }
  detail::packed::Forms<Scalar> forms = by_attitude.lazyProduct(linear.from_attitude.transpose());
  forms += by_rate.lazyProduct(linear.from_rate.transpose());
  return forms;
}

/// The unknown torque, and the inertia error as a torque (theory, section 17.5).
template <typename Scalar, typename Potential>
Status ErrorTube<Scalar, Potential>::unknown_torque(const RigidBody<Scalar>& body,
                                                    const MotionSeries<Scalar, Potential>& series,
                                                    const BodyUncertainty<Scalar>& uncertainty,
                                                    const Scalar& largest_difference, Matrix3<Scalar>& shape) noexcept {
  shape = uncertainty.torque;
  if (!(uncertainty.inertia > Scalar(0))) {
    return Status::ok;
  }
  const Scalar error = uncertainty.inertia;
  const Scalar least_moment = body.principal_moments()(2) - error;
  if (!(least_moment > Scalar(0))) {
    return Status::invalid_inertia;
  }
  const Scalar speed = series.largest_rate + Scalar(2) * largest_difference;
  const Scalar wheel = scalar::sqrt(Scalar(series.input.wheel_momentum.squaredNorm()));
  const Scalar spread = body.principal_moments()(0) - body.principal_moments()(2);
  const Scalar gradient = series.acceleration.by_inertia * error;
  const Scalar control = scalar::sqrt(Scalar(series.input.control_torque.squaredNorm()));
  const Scalar acceleration =
      (scalar::constant<Scalar>(0.5L) * spread * speed * speed + error * speed * speed + wheel * speed +
       series.torque_bounds.largest + gradient + control + scalar::sqrt(Scalar(shape.trace()))) /
      least_moment;
  const Scalar ball = error * speed * speed + gradient + error * acceleration;
  shape = sum_of_shapes(shape, Matrix3<Scalar>((ball * ball) * Matrix3<Scalar>::Identity()));
  return Status::ok;
}

/// Shape of an ellipsoid that holds the terms of third order of u' in the middle of the step, for ‖u‖ ≤ 1.
template <typename Scalar, typename Potential>
Matrix6<Scalar> ErrorTube<Scalar, Potential>::cubic_push(const RigidBody<Scalar>& body,
                                                         const MotionSeries<Scalar, Potential>& series,
                                                         const Scalar& middle, const LinearPart& linear) noexcept {
  const Matrix<Scalar, 3, 6> top = linear.middle.template topRows<3>();
  const Matrix<Scalar, 3, 6> bottom = linear.middle.template bottomRows<3>();
  const Matrix3<Scalar> attitudes = top.lazyProduct(top.transpose());  // shape of the ellipsoid of γ
  // ¼ γ (γ·δω): a number, which is a form of u, times γ
  const Matrix6<Scalar> inner = top.transpose().lazyProduct(bottom);
  const Matrix6<Scalar> symmetric = inner + inner.transpose();
  const Scalar eighth = scalar::constant<Scalar>(0.125L) * spectral_norm(symmetric);
  Matrix6<Scalar> shape = congruence(linear.from_attitude, Matrix3<Scalar>((eighth * eighth) * attitudes));
  if (series.acceleration.largest > Scalar(0)) {
    Matrix3<Scalar> axes;  // γ is in {axes v : ‖v‖ ≤ 1}
    if (cholesky(attitudes, axes) != Status::ok) {
      axes = linear.largest_attitude * Matrix3<Scalar>::Identity();
    }
    expansion::CubicForms<Scalar> forms = expansion::CubicForms<Scalar>::Zero();
    series.torque.add_cubic(middle, body.inertia_inverse(), axes, forms);
    shape = sum_of_shapes(shape, congruence(linear.from_rate, Matrix3<Scalar>(forms.transpose().lazyProduct(forms))));
  }
  return shape;
}

template <typename Scalar, typename Potential>
Status ErrorTube<Scalar, Potential>::step(const RigidBody<Scalar>& body, const MotionSeries<Scalar, Potential>& series,
                                          const BodyUncertainty<Scalar>& uncertainty) noexcept {
  const Scalar& h = series.step_powers[1];
  const Scalar half = scalar::constant<Scalar>(0.5L);
  const Scalar zero(0);
  const Scalar one(1);
  const Scalar middle = half * h;
  const TorqueBounds<Scalar>& torque = series.acceleration;  // of J⁻¹M

  LinearPart linear;
  if (const Status status = expand_linear(body, series, linear); status != Status::ok) {
    return status;
  }
  const detail::step_means::LinearChange<Scalar> change{linear.change_odd, linear.change};
  const Scalar stretch = change.stretch();
  const Scalar shrink = change.shrink();
  const Scalar attitude = linear.largest_attitude;
  const Scalar strength = linear.from_rate_norm * torque.largest;  // of the torque in u'

  // --- how the torque's forms change within half a step, in parts of their bounds (theory, eq. 17.5) ---------------------
  const Scalar degree = torque.degree;
  Scalar turn_acceleration(0);
  for (std::size_t k = 1; k < series.rate_norms.size(); ++k) {
    turn_acceleration +=
        Scalar(static_cast<scalar::Value<Scalar>>(k)) * series.step_powers[k - 1] * series.rate_norms[k];
  }
  // The forms in the middle are those of the first eight terms of the directions they are made of.
  static_assert(MotionSeries<Scalar, Potential>::order == 8);
  const Scalar truncated =
      torque.largest > zero ? Scalar(series.tail(8, one, torque.turn_rate, h) * scalar::constant<Scalar>(1.0L / 256.0L))
                            : zero;
  const detail::step_means::FormChange<Scalar> of_forms = detail::step_means::FormChange<Scalar>::within(
      degree, Scalar(series.largest_rate + torque.turn_rate), turn_acceleration, middle, truncated);

  // --- second order (theory, eq. 17.7) -----------------------------------------------------------------------------------
  const detail::packed::Forms<Scalar> forms = second_order_forms(body, series, middle, linear);
  const Scalar largest_form = spectral_norm(forms);  // ‖Y⁻¹ N₂(Yu, Yu)‖ ≤ this times ‖u‖² in the middle
  const Scalar form_bound = strength * attitude * attitude * half * degree * degree;
  const detail::step_means::SecondOrder<Scalar> second_order =
      detail::step_means::SecondOrder<Scalar>::of(largest_form, form_bound, change, of_forms, h);

  // --- pushes: the unknown torque, and what is of third and of fourth order ----------------------------------------------
  Matrix3<Scalar> unknown;
  if (const Status status =
          unknown_torque(body, series, uncertainty, Scalar(linear.largest_difference * stretch), unknown);
      status != Status::ok) {
    return status;
  }
  Matrix6<Scalar> unknown_push = Matrix6<Scalar>::Zero();
  if (unknown.trace() != zero) {  // of NaN, too, which shows in the norm
    const Columns by_torque = linear.from_rate.lazyProduct(body.inertia_inverse());
    unknown_push = congruence(by_torque, unknown);
  }
  const Scalar unknown_norm = scalar::sqrt(Scalar(unknown_push.trace()));
  const Matrix6<Scalar> cubic = cubic_push(body, series, middle, linear);
  const Scalar cubic_norm = scalar::sqrt(Scalar(cubic.trace()));
  const Scalar cubic_bound =
      strength * attitude * attitude * attitude * scalar::constant<Scalar>(0.375L) * degree * degree;
  const Scalar fourth_bound =
      attitude * attitude * attitude * attitude * scalar::constant<Scalar>(0.125L) * degree * degree * degree;
  const Matrix6<Scalar> fourth =
      congruence(linear.from_rate, Matrix3<Scalar>((fourth_bound * fourth_bound) * torque.shape));
  const Scalar fourth_norm = scalar::sqrt(Scalar(fourth.trace()));

  // --- how far u moves (theory, section 17.4) ----------------------------------------------------------------------------
  const Scalar before = displacement();
  const Scalar infinite(std::numeric_limits<scalar::Value<Scalar>>::infinity());
  const Scalar stretch3 = detail::step_means::cube_of(stretch);
  const Scalar stretch4 = detail::step_means::fourth_of(stretch);
  // If u stays within eta of where it began.
  const auto displacement_within = [&](const Scalar& eta) {
    const Scalar most = one + eta;
    const Scalar gibbs = half * attitude * stretch * most;
    // A center that is another by the angle a moves γ by at most 2 tan(a/2) (1 + ‖γ/2‖²) / (1 − tan(a/2) ‖γ/2‖).
    const Scalar tangent = scalar::constant<Scalar>(0.501L) * series.attitude_error;
    const Scalar left = one - tangent * gibbs;
    if (!(left > half)) {
      return Displacement{infinite, infinite, infinite, infinite};
    }
    const Scalar jumps = shrink * (most * linear.error + linear.from_rate_norm * series.rate_defect +
                                   linear.from_attitude_norm * Scalar(2) * tangent * (one + gibbs * gibbs) / left);
    const Scalar fifth = one + scalar::constant<Scalar>(1.25L) * gibbs;
    const Scalar moved =
        h * (second_order.largest * most * most +
             shrink * (unknown_norm +
                       stretch3 * detail::step_means::cube_of(most) *
                           (cubic_norm + cubic_bound * (of_forms.drift + of_forms.rest + of_forms.missing)) +
                       stretch4 * detail::step_means::fourth_of(most) * fifth * fourth_norm));
    // ‖u‖ is at most this where the step begins and ends, and at most on a line between.
    const Scalar first = one + before + jumps;
    const detail::step_means::Line<Scalar> line{first, Scalar(first + moved)};
    const Scalar cube_at_ends = line.cube_at_ends(stretch);
    const Scalar fourth_at_ends = line.fourth_at_ends(stretch);
    Scalar rest = second_order.quadrature + jumps;
    rest += second_order.displaced(line.mean(), moved, h);
    rest += h * cubic_bound * detail::step_means::changing_cubes(of_forms, change, cube_at_ends);
    rest += h * half * linear.change * shrink *
            (unknown_norm + cubic_norm * cube_at_ends + fourth_norm * fifth * fourth_at_ends);
    return Displacement{Scalar(rest_ + rest), Scalar(line.last - one), line.mean_cube(stretch),
                        Scalar(fifth * line.mean_fourth(stretch))};
  };
  Scalar eta = before + second_order.integral;
  Displacement moved{zero, zero, zero, zero};
  bool closed = false;
  for (int attempt = 0; attempt < 6 && !closed; ++attempt) {
    moved = displacement_within(eta);
    closed = moved.all <= eta && eta < one;
    eta = closed ? eta : Scalar(scalar::constant<Scalar>(1.02L) * moved.all);
  }
  if (!closed) {
    return Status::unbounded;
  }

  const bool first_step = before == zero;
  second_order_ += h * forms;
  second_order_norm_ = first_step ? Scalar(h * largest_form) : spectral_norm(second_order_);
  const Matrix6<Scalar> higher = sum_of_shapes(Matrix6<Scalar>((moved.cube * moved.cube) * cubic),
                                               Matrix6<Scalar>((moved.fourth * moved.fourth) * fourth));
  pushed_ = sum_of_shapes(pushed_, Matrix6<Scalar>((h * h) * sum_of_shapes(unknown_push, higher)));
  pushed_norm_ += h * (unknown_norm + cubic_norm * moved.cube + fourth_norm * moved.fourth);
  rest_ = moved.rest;
  frame_ = linear.end;
  return Status::ok;
}

template <typename Scalar, typename Potential>
Matrix6<Scalar> ErrorTube<Scalar, Potential>::shape() const noexcept {
  const Scalar one(1);
  const Matrix6<Scalar> set_inverse = lower_inverse(set_);
  // What is second order in the coordinates v of the set itself, u = set_ v, where the set is the unit ball.
  const detail::packed::Slices<Scalar> forms = detail::packed::seen_from(second_order_, set_, set_inverse);
  const Matrix6<Scalar> moved = gram_of(forms);  // {q(v) : ‖v‖ ≤ 1} lies in this ellipsoid
  // A sum holds with any positive share; if rounding leaves none, use one.
  const auto share_of = [](const Scalar& trace) {
    return trace > Scalar(0) ? scalar::sqrt(Scalar(trace / Scalar(6))) : Scalar(1);
  };
  const Vector6<Scalar> widths = set_.colwise().squaredNorm();
  const Scalar width = widths.sum();

  // The sum of both; or, as v alone says where both are, the ball itself a little larger, if that is less: in v, and in u,
  // where the widest axes count.
  const Scalar moved_trace = moved.trace();
  const Scalar moved_width = widths.dot(moved.diagonal());
  const Scalar share = detail::tube::moderate_growth(share_of(moved_trace), moved_width, width);
  const Scalar by_moved = one + one / share;
  Matrix6<Scalar> ball;
  bool is_enlarged = false;
  if (share > scalar::constant<Scalar>(0.002L) && moved_trace > Scalar(0)) {
    // ‖v + q(v)‖² in the metric I − E is at most vᵀ(I − E)v + 2vᵀKw + 2‖E‖‖q‖ + ‖q‖², and 2vᵀKw ≤ vᵀ(KKᵀ/λ)v + λ.
    const Scalar norm = norm_of_gram(moved);
    const Matrix6<Scalar> cubic = gram_of(detail::packed::symmetric_part(forms));  // KKᵀ
    const Scalar lambda = scalar::sqrt(Scalar(cubic.trace() / Scalar(6)));
    const Scalar square = norm * norm;
    const Scalar spread = norm_of_gram(cubic);
    const Scalar largest = lambda > Scalar(0) ? Scalar(spread * spread / lambda + lambda) : lambda;
    const Scalar e = (largest + square) / (one - Scalar(2) * norm);  // ‖E‖
    Matrix6<Scalar> metric = Matrix6<Scalar>::Zero();
    if (lambda > Scalar(0)) {
      metric = (-one / lambda) * cubic;
    }
    metric.diagonal().array() += one - lambda - Scalar(2) * e * norm - square;
    is_enlarged = norm < scalar::constant<Scalar>(0.4L) && e < one &&
                  inverse_positive_definite(metric, ball) == Status::ok &&
                  ball.trace() < Scalar(6) * (one + share) + by_moved * moved_trace &&
                  widths.dot(ball.diagonal()) < (one + share) * width + by_moved * moved_width;
  }
  if (!is_enlarged) {
    ball = by_moved * moved;
    ball.diagonal().array() += moved_trace > Scalar(0) ? Scalar(one + share) : one;
  }
  Matrix6<Scalar> shape = congruence(set_, ball);
  // What is left is a ball in u, and the disturbance an ellipsoid: sums with shares by their size beside the set.
  const Scalar rest_share =
      detail::tube::moderate_growth(Scalar(rest_ * scalar::sqrt(Scalar(set_inverse.squaredNorm() / Scalar(6)))),
                                    Scalar(Scalar(6) * rest_ * rest_), width);
  if (rest_share > Scalar(0)) {
    shape *= one + rest_share;
    shape.diagonal().array() += (one + one / rest_share) * rest_ * rest_;
  }
  const Matrix6<Scalar> beside = set_inverse.lazyProduct(pushed_);
  const Scalar pushed_share = detail::tube::moderate_growth(share_of(Scalar(beside.cwiseProduct(set_inverse).sum())),
                                                            Scalar(pushed_.trace()), width);
  if (pushed_.trace() > Scalar(0)) {
    shape = ((one + pushed_share) * shape + (one + one / pushed_share) * pushed_).eval();
  }
  Matrix6<Scalar> whole = symmetrized(congruence(frame_, shape));
  // Entry (i, j) errs by at most 16 ε √(mᵢmⱼ), which this diagonal outweighs.
  const Vector6<Scalar> magnitude =
      frame_.cwiseAbs().lazyProduct(Vector6<Scalar>(shape.diagonal().cwiseSqrt())).cwiseAbs2();
  whole.diagonal() += rounding::share<Scalar>(rounding::image) * magnitude;
  return whole;
}

}  // namespace elliptude
