#pragma once

/// \file
/// How the set of errors y = [γ; δω] about a moving center is carried by the motion, with everything that is left out bounded.
/// (theory, section 17)
///
/// Exactly (theory, section 17.1),
///
///     γ'  = −ω̂ × γ + δω + ½ γ × δω + ¼ γ (γ·δω)
///     δω' = J⁻¹ (S(Jω̂ + h_w) − S(ω̂)J) δω + J⁻¹ (𝓜γ + ½ M''(γ, γ) − δω × Jδω + rest of the torque + τ − defect)
///
/// With y = Y(s) u, where Y follows the linear part but for a known error, u moves by the second-order terms alone. They are
/// integrated exactly as a quadratic map of u(0), and what remains, of third order, is bounded in the norm of u.

#include "elliptude/motion_series.hpp"

namespace elliptude {
namespace tube {

/// Six quadratic forms of u, one a column, each packed as the 21 entries on and above the diagonal of its matrix, those off
/// the diagonal times √2, so that a form's value is the inner product with the packed u uᵀ, of length ‖u‖². Three rows of zeros
/// make 24, whole SIMD registers of any width.
template <typename Scalar>
using PackedForms = Matrix<Scalar, 24, 6>;
template <typename Scalar>
using PackedForm = Vector<Scalar, 24>;

/// The form (aᵀu)(bᵀu), times a factor.
template <typename Scalar>
void add_product(const Vector6<Scalar>& a, const Vector6<Scalar>& b, const Scalar& factor,
                 PackedForm<Scalar>& form) noexcept {
  const Scalar off_diagonal = scalar::constant<Scalar>(0.70710678118654752440084436210484903928L) * factor;
  int at = 0;
  for (int j = 0; j < 6; ++j) {
    form(at++) += factor * a(j) * b(j);
    const Scalar aj = off_diagonal * a(j);
    const Scalar bj = off_diagonal * b(j);
    for (int k = j + 1; k < 6; ++k) {
      form(at++) += aj * b(k) + bj * a(k);
    }
  }
}

/// The symmetric matrix of a packed form.
template <typename Scalar>
[[nodiscard]] Matrix6<Scalar> unpacked(const PackedForms<Scalar>& forms, int column) noexcept {
  const Scalar off_diagonal = scalar::constant<Scalar>(0.70710678118654752440084436210484903928L);
  Matrix6<Scalar> matrix;
  int at = 0;
  for (int j = 0; j < 6; ++j) {
    matrix(j, j) = forms(at++, column);
    for (int k = j + 1; k < 6; ++k) {
      matrix(j, k) = off_diagonal * forms(at++, column);
      matrix(k, j) = matrix(j, k);
    }
  }
  return matrix;
}

/// The cubic form uᵀq(u) = uᵀKw as a symmetric tensor, flattened to K, with w the packed u uᵀ. Its norm can be much smaller than
/// that of q: a part of q that only turns u is no growth.
/// \return KKᵀ.
template <typename Scalar>
[[nodiscard]] Matrix6<Scalar> symmetric_part_gram(const PackedForms<Scalar>& forms) noexcept {
  std::array<Matrix6<Scalar>, 6> h;
  for (int i = 0; i < 6; ++i) {
    h[static_cast<std::size_t>(i)] = unpacked(forms, i);
  }
  const Scalar third = scalar::constant<Scalar>(1.0L / 3.0L);
  Matrix6<Scalar> gram = Matrix6<Scalar>::Zero();
  for (int k = 0; k < 6; ++k) {
    Matrix6<Scalar> slice = h[static_cast<std::size_t>(k)];
    for (int i = 0; i < 6; ++i) {
      slice.col(i) += h[static_cast<std::size_t>(i)].col(k);
      slice.row(i) += h[static_cast<std::size_t>(i)].row(k);
    }
    slice *= third;
    gram += slice.lazyProduct(slice);  // slice is symmetric
  }
  return gram;
}

}  // namespace tube

/// What is not known of a rigid body.
template <typename Scalar>
struct BodyUncertainty {
  /// Shape of an ellipsoid about zero, (N m)², body axes, that holds the unknown torque at every time, however it changes.
  Matrix3<Scalar> torque = Matrix3<Scalar>::Zero();
  /// Largest error of the inertia matrix in the spectral norm, kg m². It moves the gravity gradient too.
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
    raised.diagonal() *= Scalar(1) + Scalar(84) * Scalar(scalar::epsilon<Scalar>);
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
  [[nodiscard]] Scalar displacement() const noexcept { return spectral_norm(second_order_) + pushed_norm_ + rest_; }

  /// Over one step of the motion; the center is `series.end` afterwards.
  /// \return `unbounded` if the bounds do not close: the set is too large, or the step too long, for it to be bounded;
  /// `invalid_inertia` if the inertia error reaches the least principal moment. Nothing has then changed.
  [[nodiscard]] Status step(const RigidBody<Scalar>& body, const MotionSeries<Scalar, Potential>& series,
                            const Scalar& h, const BodyUncertainty<Scalar>& uncertainty) noexcept;

  /// An ellipsoid about zero that contains Y u for all that u can be by now.
  [[nodiscard]] Matrix6<Scalar> shape() const noexcept;

 private:
  static constexpr int order = 4;  // of Y within a step
  using Rows = Matrix<Scalar, 3, 6>;

  /// The sum with an ellipsoid, by the smallest trace (paper, eq. Pmkl).
  static void add_push(const Matrix6<Scalar>& added, Matrix6<Scalar>& pushed) noexcept {
    const Scalar before = scalar::sqrt(Scalar(pushed.trace()));
    const Scalar after = scalar::sqrt(Scalar(added.trace()));
    if (after > Scalar(0)) {
      pushed = before > Scalar(0)
                   ? Matrix6<Scalar>((Scalar(1) + after / before) * pushed + (Scalar(1) + before / after) * added)
                   : added;
    }
  }

  /// What a torque anywhere in an ellipsoid does to u over a step. \return the largest ‖u'‖.
  [[nodiscard]] static Scalar push(const Matrix<Scalar, 6, 3>& by_torque, const Matrix3<Scalar>& torque,
                                   const Scalar& h, Matrix6<Scalar>& pushed) noexcept {
    if (torque.isZero(Scalar(0))) {
      return Scalar(0);
    }
    const Matrix<Scalar, 6, 3> scaled = by_torque.lazyProduct(torque);
    const Matrix6<Scalar> speed = scaled.lazyProduct(by_torque.transpose());
    add_push(Matrix6<Scalar>((h * h) * speed), pushed);
    return scalar::sqrt(Scalar(speed.trace()));
  }

  Matrix6<Scalar> frame_;                   // Y
  Matrix6<Scalar> set_;                     // {set_ v : ‖v‖ ≤ 1} is the set of u at the start, within the unit ball
  tube::PackedForms<Scalar> second_order_;  // q: u has moved by q(u(0)), …
  Scalar second_order_norm_;                // on the unit ball
  Matrix6<Scalar> pushed_;                  // … by a point of this ellipsoid, …
  Scalar rest_;                             // … and by at most this
  Scalar pushed_norm_;                      // no further than this, …
};

template <typename Scalar, typename Potential>
Status ErrorTube<Scalar, Potential>::step(const RigidBody<Scalar>& body, const MotionSeries<Scalar, Potential>& series,
                                          const Scalar& h, const BodyUncertainty<Scalar>& uncertainty) noexcept {
  const Scalar half = scalar::constant<Scalar>(0.5L);
  const Scalar zero(0);
  const Scalar one(1);
  const Matrix3<Scalar>& inertia = body.inertia();
  const Matrix3<Scalar>& inverse_inertia = body.inertia_inverse();
  const Scalar inverse_norm = one / body.principal_moments()(2);
  const auto& powers = series.step_powers;
  const TorqueBounds<Scalar>& torque = series.acceleration;  // of J⁻¹M

  // --- Y(s) = Σ Y_k sᵏ from Y' = A(s) Y ----------------------------------------------------------------------------------
  constexpr int jacobians = 4;
  std::array<Matrix3<Scalar>, jacobians> stiffness;  // J⁻¹ 𝓜_j
  for (int j = 0; j < jacobians; ++j) {
    stiffness[static_cast<std::size_t>(j)] = inverse_inertia.lazyProduct(series.torque.jacobian(j));
  }
  std::array<Matrix3<Scalar>, order + 1> gyroscopic;  // J⁻¹ (S(Jω_j + h_w) − S(ω_j) J)
  for (std::size_t j = 0; j <= order; ++j) {
    gyroscopic[j] = inverse_inertia.lazyProduct(
        Matrix3<Scalar>(hat(series.momentum[j]) - hat(series.rate[j]).lazyProduct(inertia)));
  }
  std::array<Rows, order + 1> top;     // of γ
  std::array<Rows, order + 1> bottom;  // of δω
  top[0] = frame_.template topRows<3>();
  bottom[0] = frame_.template bottomRows<3>();
  Rows next_top;
  Rows next_bottom;
  for (std::size_t k = 0; k <= order; ++k) {  // coefficient k of A Y, which is (k + 1) Y_{k+1}
    next_top = bottom[k];
    next_bottom.setZero();
    for (std::size_t j = 0; j <= k; ++j) {
      next_top -= hat(series.rate[j]).lazyProduct(top[k - j]);
      next_bottom += gyroscopic[j].lazyProduct(bottom[k - j]);
      if (j < jacobians) {
        next_bottom += stiffness[j].lazyProduct(top[k - j]);
      }
    }
    if (k < order) {
      const Scalar factor = one / Scalar(static_cast<scalar::Value<Scalar>>(k + 1));
      top[k + 1] = factor * next_top;
      bottom[k + 1] = factor * next_bottom;
    }
  }

  // --- the middle of the step, where the norms are taken -----------------------------------------------------------------
  const Scalar middle = half * h;
  Matrix6<Scalar> y_middle;
  Matrix6<Scalar> slope_middle;
  Matrix6<Scalar> y_end;
  {
    Rows value_top = top[order];
    Rows value_bottom = bottom[order];
    Rows slope_top = Scalar(order) * top[order];
    Rows slope_bottom = Scalar(order) * bottom[order];
    Rows end_top = top[order];
    Rows end_bottom = bottom[order];
    for (int k = order - 1; k >= 0; --k) {
      const auto index = static_cast<std::size_t>(k);
      value_top = top[index] + middle * value_top;
      value_bottom = bottom[index] + middle * value_bottom;
      end_top = top[index] + h * end_top;
      end_bottom = bottom[index] + h * end_bottom;
      if (k > 0) {
        slope_top = Scalar(k) * top[index] + middle * slope_top;
        slope_bottom = Scalar(k) * bottom[index] + middle * slope_bottom;
      }
    }
    y_middle.template topRows<3>() = value_top;
    y_middle.template bottomRows<3>() = value_bottom;
    slope_middle.template topRows<3>() = slope_top;
    slope_middle.template bottomRows<3>() = slope_bottom;
    y_end.template topRows<3>() = end_top;
    y_end.template bottomRows<3>() = end_bottom;
  }
  Matrix6<Scalar> inverse;
  if (inverse_of(y_middle, inverse) != Status::ok) {
    return Status::unbounded;
  }
  const Matrix<Scalar, 6, 3> from_attitude = inverse.template leftCols<3>();
  const Matrix<Scalar, 6, 3> from_rate = inverse.template rightCols<3>();
  const Scalar attitude_norm = spectral_norm(from_attitude);  // of what an attitude error does to u
  const Scalar rate_norm = spectral_norm(from_rate);

  // Y(s) = Y(h/2) (I + W(s)) with W = W₁ (s − h/2) + second order.
  std::array<Scalar, order + 1> top_norms;
  std::array<Scalar, order + 1> bottom_norms;
  for (std::size_t k = 0; k <= order; ++k) {
    top_norms[k] = scalar::sqrt(Scalar(top[k].squaredNorm()));
    bottom_norms[k] = scalar::sqrt(Scalar(bottom[k].squaredNorm()));
  }
  const Scalar w1 = spectral_norm(Matrix6<Scalar>(inverse.lazyProduct(slope_middle))) * middle;
  Scalar curvature(0);
  for (std::size_t k = 2; k <= order; ++k) {
    curvature += Scalar(static_cast<scalar::Value<Scalar>>(k * (k - 1))) * powers[k - 2] *
                 (attitude_norm * top_norms[k] + rate_norm * bottom_norms[k]);
  }
  const Scalar w = w1 + half * curvature * middle * middle;
  if (!(w < half)) {
    return Status::unbounded;
  }
  const Scalar shrink = one / (one - w);  // ‖Y(s)⁻¹ v‖ ≤ shrink ‖Y(h/2)⁻¹ v‖
  const Scalar growth = (one + w) * (one + w) * shrink;

  // --- the second-order terms as forms of u, in the middle ---------------------------------------------------------------
  tube::PackedForms<Scalar> forms;
  {
    Matrix<Scalar, 24, 6> raw = Matrix<Scalar, 24, 6>::Zero();
    std::array<Vector6<Scalar>, 3> g;
    std::array<Vector6<Scalar>, 3> d;
    std::array<Vector6<Scalar>, 3> jd;
    for (int i = 0; i < 3; ++i) {
      const auto index = static_cast<std::size_t>(i);
      g[index] = y_middle.row(i).transpose();
      d[index] = y_middle.row(3 + i).transpose();
      jd[index] = (inertia.row(i).lazyProduct(y_middle.template bottomRows<3>())).transpose();
    }
    std::array<tube::PackedForm<Scalar>, 3> spin;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::size_t next = (i + 1) % 3;
      const std::size_t last = (i + 2) % 3;
      tube::PackedForm<Scalar> form = tube::PackedForm<Scalar>::Zero();
      tube::add_product(g[next], d[last], half, form);  // ½ γ × δω
      tube::add_product(g[last], d[next], Scalar(-half), form);
      raw.col(static_cast<Eigen::Index>(i)) = form;
      spin[i].setZero();
      tube::add_product(d[next], jd[last], Scalar(-one), spin[i]);  // −δω × Jδω
      tube::add_product(d[last], jd[next], one, spin[i]);
    }
    expansion::Forms<Scalar> torque_forms{Matrix3<Scalar>::Zero(), Matrix3<Scalar>::Zero(), Matrix3<Scalar>::Zero()};
    if (torque.largest > zero) {
      series.torque.add_curvature(middle, inverse_inertia, torque_forms);
    }
    for (int i = 0; i < 3; ++i) {
      tube::PackedForm<Scalar> form =
          inverse_inertia(i, 0) * spin[0] + inverse_inertia(i, 1) * spin[1] + inverse_inertia(i, 2) * spin[2];
      if (torque.largest > zero) {
        const Matrix3<Scalar>& t = torque_forms[static_cast<std::size_t>(i)];
        for (int a = 0; a < 3; ++a) {
          const Vector6<Scalar> row = t(a, 0) * g[0] + t(a, 1) * g[1] + t(a, 2) * g[2];
          tube::add_product(g[static_cast<std::size_t>(a)], row, one, form);
        }
      }
      raw.col(3 + i) = form;
    }
    forms.noalias() = raw.lazyProduct(inverse.transpose());
  }
  const Scalar largest_form = spectral_norm(forms);  // b: ‖Y⁻¹ N₂(Yu, Yu)‖ ≤ b ‖u‖² in the middle

  // --- bounds over the step, all in the norm of u ------------------------------------------------------------------------
  const Scalar largest_attitude = spectral_norm(Rows(y_middle.template topRows<3>())) * (one + w);
  const Scalar largest_difference = spectral_norm(Rows(y_middle.template bottomRows<3>())) * (one + w);
  const Scalar degree = torque.degree;
  const Scalar torque_curvature = half * degree * degree * torque.largest;
  const Scalar turning = degree * (series.largest_rate + torque.turn_rate);

  // The torque's forms in the middle are those of the first eight terms of the directions they are made of.
  static_assert(MotionSeries<Scalar, Potential>::order == 8);
  const Scalar truncated =
      torque.largest > zero ? Scalar(series.tail(8, one, torque.turn_rate, h) * scalar::constant<Scalar>(1.0L / 256.0L))
                            : zero;
  const Scalar missing = degree * truncated * (one + truncated);  // of a form, for each of its bounds

  // The second-order terms at other times than the middle: all that is odd in s − h/2 to first order integrates to zero.
  const Scalar form_bound = rate_norm * largest_attitude * largest_attitude * torque_curvature;
  const Scalar drift = form_bound * turning * middle;
  Scalar largest_turn_change(0);  // of ω̂'
  for (std::size_t k = 1; k < series.rate_norms.size(); ++k) {
    largest_turn_change += Scalar(static_cast<scalar::Value<Scalar>>(k)) * powers[k - 1] * series.rate_norms[k];
  }
  const Scalar drift_rest =
      half * (drift * turning * middle + form_bound * degree * largest_turn_change * middle * middle);
  const Scalar odd = Scalar(3) * w1 * largest_form + drift;
  const Scalar even = growth * (largest_form + drift + drift_rest) - largest_form - odd;  // of second order in s − h/2
  const Scalar quadrature = even * h / Scalar(3) + growth * missing * form_bound * h;
  // The integral over the step of a bound of ‖Y⁻¹ N₂(Yu, Yu)‖.
  const Scalar second_order = (largest_form + half * odd) * h + quadrature;

  // Y' − A Y: its first coefficient exactly, the others by the norms of their blocks.
  Matrix6<Scalar> first_error;
  first_error.template topRows<3>() = next_top;
  first_error.template bottomRows<3>() = next_bottom;
  Scalar linear =
      spectral_norm(Matrix6<Scalar>(inverse.lazyProduct(first_error))) * powers[order + 1] / Scalar(order + 1);
  {
    Scalar top_sum(0);
    Scalar bottom_sum(0);
    for (std::size_t j = 0; j < series.rate_norms.size(); ++j) {
      const Scalar momentum = scalar::sqrt(Scalar(series.momentum[j].squaredNorm()));
      const Scalar gyroscopic_norm = inverse_norm * (momentum + series.rate_norms[j] * body.principal_moments()(0));
      const Scalar stiffness_norm = j < jacobians ? scalar::sqrt(Scalar(stiffness[j].squaredNorm())) : zero;
      for (std::size_t i = 0; i <= order; ++i) {
        if (i + j > order) {
          const Scalar power = powers[i + j + 1] / Scalar(static_cast<scalar::Value<Scalar>>(i + j + 1));
          top_sum += power * series.rate_norms[j] * top_norms[i];
          bottom_sum += power * (gyroscopic_norm * bottom_norms[i] + stiffness_norm * top_norms[i]);
        }
      }
    }
    if (torque.largest > zero) {
      bottom_sum += degree * torque.largest * series.tail(jacobians, degree, torque.turn_rate, h) * h /
                    Scalar(jacobians + 1) * scalar::constant<Scalar>(1.7320508075688772L) * largest_attitude;
    }
    linear += attitude_norm * top_sum + rate_norm * bottom_sum;
  }
  // Rounding of Y and of what is calculated from it.
  linear += Scalar(256) * Scalar(scalar::epsilon<Scalar>) *
            (attitude_norm * largest_attitude + rate_norm * largest_difference);

  // What is not known of the torque, and of the inertia as a torque (theory, section 17.5).
  Matrix3<Scalar> unknown = uncertainty.torque;
  if (uncertainty.inertia > zero) {
    const Scalar error = uncertainty.inertia;
    const Scalar least_moment = body.principal_moments()(2) - error;
    if (!(least_moment > zero)) {
      return Status::invalid_inertia;
    }
    const Scalar speed = series.largest_rate + Scalar(2) * largest_difference;
    const Scalar wheel = scalar::sqrt(Scalar(series.input.wheel_momentum.squaredNorm()));
    const Scalar spread = body.principal_moments()(0) - body.principal_moments()(2);
    const Scalar torque_norm = scalar::sqrt(Scalar(unknown.trace()));
    const Scalar gradient = torque.by_inertia * error;
    const Scalar control = scalar::sqrt(Scalar(series.input.control_torque.squaredNorm()));
    const Scalar acceleration = (half * spread * speed * speed + error * speed * speed + wheel * speed +
                                 series.largest_torque + gradient + control + torque_norm) /
                                least_moment;
    const Scalar ball = error * speed * speed + gradient + error * acceleration;
    const Scalar ratio = torque_norm > zero ? Scalar(ball / torque_norm) : zero;
    unknown = torque_norm > zero ? Matrix3<Scalar>((one + ratio) * unknown) : Matrix3<Scalar>(Matrix3<Scalar>::Zero());
    unknown.diagonal().array() += ball * ball * (torque_norm > zero ? Scalar(one + one / ratio) : one);
  }
  Matrix6<Scalar> pushed = pushed_;
  const Scalar unknown_push = push(from_rate.lazyProduct(inverse_inertia), unknown, h, pushed);

  // Everything that is left grows with how far u may move, which holds what is left: the bound closes if a guess of it
  // holds (theory, section 17.4).
  const Scalar cube = largest_attitude * largest_attitude * largest_attitude;
  const Scalar strength = rate_norm * torque.largest;
  const Scalar fourth_order =
      strength * cube * largest_attitude * scalar::constant<Scalar>(0.125L) * degree * degree * degree;
  // The torque's terms of third order push u within an ellipsoid; where they are tiny their norm will do.
  Matrix6<Scalar> cubic = Matrix6<Scalar>::Zero();
  const Scalar cubic_bound = strength * cube * scalar::constant<Scalar>(0.375L) * degree * degree;
  const bool cubic_matters = cubic_bound * h > scalar::constant<Scalar>(1e-4L);
  const Scalar third_order =
      scalar::constant<Scalar>(0.25L) * attitude_norm * largest_attitude * largest_attitude * largest_difference +
      cubic_bound * (cubic_matters ? Scalar(half * turning * middle + missing) : one);
  if (cubic_matters) {
    const Rows y_top = y_middle.template topRows<3>();
    Matrix3<Scalar> axes;  // γ is in {axes v : ‖v‖ ≤ 1}
    if (cholesky(Matrix3<Scalar>(y_top.lazyProduct(y_top.transpose())), axes) != Status::ok) {
      return Status::unbounded;
    }
    expansion::CubicForms<Scalar> cubic_forms = expansion::CubicForms<Scalar>::Zero();
    series.torque.add_cubic(middle, inverse_inertia, Matrix3<Scalar>((one + w) * axes), cubic_forms);
    const Matrix<Scalar, 10, 6> on_u = cubic_forms.lazyProduct(from_rate.transpose());
    cubic = on_u.transpose().lazyProduct(on_u);
  }
  const Scalar cubic_push = norm_of_gram(cubic);
  const Scalar moved = second_order_norm_ + pushed_norm_ + second_order + h * shrink * unknown_push;
  // As far as the cubic terms push at this reach.
  const auto cubic_at = [&](const Scalar& reach) { return Scalar(cubic_push * reach * reach * reach); };
  const Scalar infinite = Scalar(std::numeric_limits<scalar::Value<Scalar>>::infinity());
  const auto rest_within = [&](const Scalar& eta) {
    const Scalar reach = one + eta;
    const Scalar gibbs = half * largest_attitude * reach;
    // A center that is another by the angle a moves γ by at most 2 tan(a/2) (1 + ‖γ/2‖²) / (1 − tan(a/2) ‖γ/2‖).
    const Scalar tangent = scalar::constant<Scalar>(0.501L) * series.attitude_error;
    const Scalar left = one - tangent * gibbs;
    if (!(left > half)) {
      return infinite;
    }
    Scalar rest = quadrature + shrink * reach * linear;
    rest += second_order * eta * (Scalar(2) + eta);
    rest += h * shrink *
            (third_order + fourth_order * reach * (one + scalar::constant<Scalar>(0.625L) * largest_attitude * reach)) *
            reach * reach * reach;
    rest += shrink * (rate_norm * inverse_norm * series.impulse_defect +
                      attitude_norm * Scalar(2) * tangent * (one + gibbs * gibbs) / left);
    rest += h * (unknown_push + cubic_at(reach)) * w * shrink;
    return Scalar(rest_ + rest);
  };
  Scalar eta = moved + rest_;
  Scalar rest(0);
  bool closed = false;
  for (int attempt = 0; attempt < 6 && !closed; ++attempt) {
    rest = rest_within(eta);
    const Scalar found = moved + rest + h * shrink * cubic_at(Scalar(one + eta));
    closed = found <= eta && eta < one;
    eta = closed ? eta : Scalar(scalar::constant<Scalar>(1.02L) * found);
  }
  if (!closed) {
    return Status::unbounded;
  }
  const Scalar reach = one + eta;
  add_push(Matrix6<Scalar>((h * h * reach * reach * reach * reach * reach * reach) * cubic), pushed);
  second_order_ += h * forms;
  second_order_norm_ = spectral_norm(second_order_);
  pushed_ = pushed;
  pushed_norm_ += h * shrink * (unknown_push + cubic_at(reach));
  rest_ = rest;
  frame_ = y_end;
  return Status::ok;
}

template <typename Scalar, typename Potential>
Matrix6<Scalar> ErrorTube<Scalar, Potential>::shape() const noexcept {
  const Scalar one(1);
  // The forms as they are on the set itself, u = set_ v.
  tube::PackedForms<Scalar> forms = tube::PackedForms<Scalar>::Zero();
  for (int i = 0; i < 6; ++i) {
    const Matrix6<Scalar> on_set =
        set_.transpose().lazyProduct(Matrix6<Scalar>(tube::unpacked(second_order_, i).lazyProduct(set_)));
    int at = 0;
    for (int j = 0; j < 6; ++j) {
      forms(at++, i) = on_set(j, j);
      for (int k = j + 1; k < 6; ++k) {
        forms(at++, i) = scalar::constant<Scalar>(1.41421356237309504880168872420969807857L) * on_set(j, k);
      }
    }
  }
  const Matrix6<Scalar> set = set_.lazyProduct(set_.transpose());
  const Matrix6<Scalar> moved = forms.transpose().lazyProduct(forms);  // {q(v) : ‖v‖ ≤ 1} lies in this ellipsoid
  const Matrix6<Scalar> set_inverse = lower_inverse(set_);
  // A sum holds with any positive share; where rounding leaves none to be had, with one.
  const auto share_of = [](const Scalar& trace) {
    return trace > Scalar(0) ? scalar::sqrt(Scalar(trace / Scalar(6))) : Scalar(1);
  };

  // The sum of both; or, as v alone says where both are, the set itself a little larger, if that is less.
  Matrix6<Scalar> whitened_moved = set_inverse.lazyProduct(moved);
  whitened_moved = whitened_moved.lazyProduct(set_inverse.transpose()).eval();
  const Scalar share = share_of(Scalar(whitened_moved.trace()));
  Matrix6<Scalar> shape = set;
  if (moved.trace() > Scalar(0)) {
    shape = (one + share) * set + (one + one / share) * moved;
  }
  if (moved.trace() > Scalar(0) && share > scalar::constant<Scalar>(0.002L)) {
    const tube::PackedForms<Scalar> whitened = forms.lazyProduct(set_inverse.transpose());
    // ‖v + q(v)‖² in the metric I − E is at most vᵀ(I − E)v + 2vᵀKw + 2‖E‖‖q‖ + ‖q‖², and 2vᵀKw ≤ vᵀ(KKᵀ/λ)v + λ.
    const Scalar norm = spectral_norm(whitened);
    const Matrix6<Scalar> cubic = tube::symmetric_part_gram(whitened);
    const Scalar lambda = scalar::sqrt(Scalar(cubic.trace() / Scalar(6)));
    const Scalar square = norm * norm;
    const Scalar spread = norm_of_gram(cubic);
    const Scalar largest = lambda > Scalar(0) ? Scalar(spread * spread / lambda + lambda) : lambda;
    const Scalar e = (largest + square) / (one - Scalar(2) * norm);  // ‖E‖
    Matrix6<Scalar> metric = Matrix6<Scalar>::Identity() * (one - lambda - Scalar(2) * e * norm - square);
    if (lambda > Scalar(0)) {
      metric -= cubic / lambda;
    }
    Matrix6<Scalar> larger;
    if (norm < scalar::constant<Scalar>(0.4L) && e < one && inverse_positive_definite(metric, larger) == Status::ok &&
        larger.trace() < Scalar(6) * (one + share) * (one + share)) {
      const Matrix6<Scalar> half = set_.lazyProduct(larger);
      shape = half.lazyProduct(set_.transpose());
    }
  }
  // What is left is a ball in u, and the disturbance an ellipsoid: sums with shares by their size beside the set.
  const Scalar rest_share = rest_ * scalar::sqrt(Scalar(set_inverse.squaredNorm() / Scalar(6)));
  if (rest_share > Scalar(0)) {
    shape *= one + rest_share;
    shape.diagonal().array() += (one + one / rest_share) * rest_ * rest_;
  }
  const Matrix6<Scalar> beside = set_inverse.lazyProduct(pushed_);
  const Scalar pushed_share = share_of(Scalar(beside.cwiseProduct(set_inverse).sum()));
  if (pushed_.trace() > Scalar(0)) {
    shape = ((one + pushed_share) * shape + (one + one / pushed_share) * pushed_).eval();
  }
  const Matrix6<Scalar> half = frame_.lazyProduct(shape);
  Matrix6<Scalar> whole = half.lazyProduct(frame_.transpose());
  whole = (scalar::constant<Scalar>(0.5L) * (whole + whole.transpose())).eval();
  // Entry (i, j) errs by at most 16 ε √(mᵢmⱼ), which this diagonal outweighs.
  const Vector6<Scalar> magnitude =
      frame_.cwiseAbs().lazyProduct(Vector6<Scalar>(shape.diagonal().cwiseSqrt())).cwiseAbs2();
  whole.diagonal() += Scalar(128) * Scalar(scalar::epsilon<Scalar>) * magnitude;
  return whole;
}

}  // namespace elliptude
