#pragma once

/// \file
/// A step of the free rotor in closed form, and its derivative with respect to the momentum
/// (theory, sections 4.1 and 6.1).

#include "elliptude/base/rounding.hpp"
#include "elliptude/base/so3.hpp"
#include "elliptude/dynamics/detail/elliptic_step.hpp"

namespace elliptude::detail {

/// The triad (m, p, m × p) of the unit vector m of the momentum, with p towards the third axis, which m keeps away
/// from.
template <typename Scalar>
struct MomentumTriad {
  Scalar radius;            ///< of m about the third axis: √(x² + y²), at least √½
  Matrix3<Scalar> columns;  ///< in body axes

  void find(const Vector3<Scalar>& unit, const Matrix3<Scalar>& axes) noexcept {
    radius = scalar::sqrt(Scalar(unit.x() * unit.x() + unit.y() * unit.y()));
    const Scalar inverse = Scalar(1) / radius;
    const Scalar x = unit.x() * inverse;
    const Scalar y = unit.y() * inverse;
    Matrix3<Scalar> local;
    local << unit.x(), -x * unit.z(), y,  //
        unit.y(), -y * unit.z(), -x,      //
        unit.z(), radius, Scalar(0);
    columns = axes.lazyProduct(local);
  }
};

/// A step of the free rotor. Its axes are the principal ones, the first and the third exchanged where that keeps the
/// momentum farther from the third. x, y, z are those of the unit vector m of the momentum.
template <typename Scalar>
class RotorStep {
 public:
  /// \param rotor an `ExactRotor`.
  /// \return `step_too_long`.
  template <bool slopes, typename Rotor>
  [[nodiscard]] Status find(const Rotor& rotor, const Scalar& h, const Vector3<Scalar>& a) noexcept {
    if (const Status status = choose_axes(rotor, h, a); status != Status::ok) {
      return status;
    }
    if (const Status status = elliptic_step<slopes>(of_, length_, step_); status != Status::ok) {
      return status;
    }
    move();
    turn();
    return Status::ok;
  }

  /// F, which takes body axes at the end to those at the start: the product of the triads, a rotation but for rounding,
  /// made one so that many steps together are one, too.
  [[nodiscard]] Matrix3<Scalar> rotation() const noexcept {
    Matrix3<Scalar> turned;
    turned.col(0) = start_.columns.col(0);
    turned.col(1) = cosine_ * start_.columns.col(1) + sine_ * start_.columns.col(2);
    turned.col(2) = cosine_ * start_.columns.col(2) - sine_ * start_.columns.col(1);
    const Matrix3<Scalar> product = turned.lazyProduct(end_.columns.transpose());
    if (scalar::all(product.trace() > Scalar(0))) {
      return cayley(Vector3<Scalar>((Scalar(2) / (Scalar(1) + product.trace())) * vee(product)));
    }
    return to_rotation(to_quaternion(product));
  }

  /// K = ∂ξ/∂a in body axes, after `find<true>`.
  [[nodiscard]] Matrix3<Scalar> by_momentum() const noexcept {
    const Scalar& x = from_.x();
    const Scalar& y = from_.y();
    const Scalar& z = from_.z();
    const Scalar inverse = Scalar(1) / start_.radius;
    const Scalar other = Scalar(1) - of_.kappa;
    // m moves towards the third axis, or about it.
    const Direction towards{Vector3<Scalar>(-x * z * inverse, -y * z * inverse, start_.radius),
                            Scalar(2) * z * of_.rest * inverse, Scalar(0)};
    const Direction about{Vector3<Scalar>(y * inverse, -x * inverse, Scalar(0)), Scalar(-2) * other * x * y * inverse,
                          -inverse};
    const Vector3<Scalar> by_towards = inverse_momentum_ * turn_along(towards);
    const Vector3<Scalar> by_about = inverse_momentum_ * turn_along(about);
    // A longer momentum is a longer step: ξ = h ω(h).
    const Vector3<Scalar> by_length = axes_.lazyProduct(Vector3<Scalar>(moments_by_step_.cwiseProduct(to_)));
    const Matrix3<Scalar>& start = start_.columns;
    const Vector3<Scalar> first = end_.columns.lazyProduct(by_towards);
    const Vector3<Scalar> second = end_.columns.lazyProduct(by_about);
    return by_length * start.col(0).transpose() + first * start.col(1).transpose() + second * start.col(2).transpose();
  }

 private:
  /// A change of m, with what goes with it: that of q, and the angle by which m turns about the third axis.
  struct Direction {
    Vector3<Scalar> m;
    Scalar q;
    Scalar azimuth;
  };

  /// \return `step_too_long`.
  template <typename Rotor>
  [[nodiscard]] Status choose_axes(const Rotor& rotor, const Scalar& h, const Vector3<Scalar>& a) noexcept {
    const Vector3<Scalar>& b = rotor.inverse_moments();
    // The momentum in units of angle, so that none that matters is too small to be squared.
    const Scalar forward = scalar::select(h < Scalar(0), Scalar(-1), Scalar(1));
    const Scalar unit_of_angle = forward * h * b.z();
    const Vector3<Scalar> angles = unit_of_angle * a;
    const Scalar least = Scalar(std::numeric_limits<scalar::Value<Scalar>>::min()) / rounding::one_rounding<Scalar>();
    const Scalar square = angles.squaredNorm();
    const auto rests = square <= least;
    const Scalar angle = scalar::sqrt(scalar::select(rests, least, square));
    if (!scalar::all(angle * rounding::one_rounding<Scalar>() <= Scalar(1))) {
      return Status::step_too_long;
    }
    const Scalar inverse_angle = Scalar(1) / angle;
    inverse_momentum_ = unit_of_angle * inverse_angle;
    // At rest any momentum that is small enough has the same F and K.
    const Vector3<Scalar> principal = rotor.principal_axes().transpose().lazyProduct(angles) * inverse_angle;
    const Scalar x = scalar::select(rests, Scalar(1), principal.x());
    const Scalar y = scalar::select(rests, Scalar(0), principal.y());
    const Scalar z = scalar::select(rests, Scalar(0), principal.z());
    const Scalar& kappa = rotor.kappa();
    const Scalar y2 = y * y;
    const Scalar q = (Scalar(1) - kappa) * y2 + z * z;
    const Scalar rest = x * x + kappa * y2;
    const auto exchanged = q > rest;
    const auto choose = [&exchanged](const Scalar& yes, const Scalar& no) {
      return scalar::select(exchanged, yes, no);
    };
    from_ = Vector3<Scalar>(choose(z, x), choose(-y, y), choose(x, z));
    of_ = {choose(Scalar(1) - kappa, kappa), choose(rest, q), choose(q, rest)};
    const Scalar signed_angle = forward * angle;
    length_ = choose(-signed_angle, signed_angle) * rotor.spread();
    const Scalar b_first = choose(b.z(), b.x());
    const Scalar b_third = choose(b.x(), b.z());
    precession_ = signed_angle * b_third / b.z();
    moments_by_step_ = h * Vector3<Scalar>(b_first, b.y(), b_third);
    const Matrix3<Scalar>& axes = rotor.principal_axes();
    for (int i = 0; i < 3; ++i) {
      axes_(i, 0) = choose(axes(i, 2), axes(i, 0));
      axes_(i, 1) = choose(Scalar(-axes(i, 1)), axes(i, 1));
      axes_(i, 2) = choose(axes(i, 0), axes(i, 2));
    }
    return Status::ok;
  }

  /// m at the end, eq. (4.9).
  void move() noexcept {
    const Scalar& x = from_.x();
    const Scalar& y = from_.y();
    const Scalar& z = from_.z();
    const Scalar& s = step_.s;
    const Scalar& c = step_.c;
    const Scalar& d = step_.d;
    const Scalar& kappa = of_.kappa;
    const Scalar other = Scalar(1) - kappa;
    denominator_ = d * d + kappa * z * z * s * s;
    const Vector3<Scalar> to(x * d + kappa * y * z * s * c, y * c * d - x * z * s, z * c + other * x * y * s * d);
    to_ = to / scalar::sqrt(Scalar(to.squaredNorm()));  // Δ but for rounding
    start_.find(from_, axes_);
    end_.find(to_, axes_);
  }

  /// ψ, the angle between the triads about the momentum, eq. (4.11).
  void turn() noexcept {
    const Scalar product = from_.x() * from_.y() * from_.z();
    const Scalar& s = step_.s;
    const Scalar radius2 = start_.radius * start_.radius;
    across_ = step_.c * step_.d * radius2 -
              (Scalar(1) - of_.kappa) * product * s * (of_.kappa * s * s * radius2 + denominator_);
    along_ = -of_.rest * s * denominator_;
    const Scalar angle = precession_ + step_.angle;
    const Scalar cosine = scalar::cos(angle);
    const Scalar sine = scalar::sin(angle);
    const Scalar scale = Scalar(1) / scalar::sqrt(Scalar(across_ * across_ + along_ * along_));
    const Scalar turned_cosine = scale * (step_.cosine * across_ - step_.sine * along_);
    const Scalar turned_sine = scale * (step_.cosine * along_ + step_.sine * across_);
    cosine_ = cosine * turned_cosine - sine * turned_sine;
    sine_ = sine * turned_cosine + cosine * turned_sine;
  }

  /// ξ along the triad at the end when m changes, eq. (6.5). Every term has the factor s or sin ψ: nothing cancels in a
  /// short step.
  [[nodiscard]] Vector3<Scalar> turn_along(const Direction& change) const noexcept;

  /// Eq. (6.5) of z' − z and of the changes of it, of γ and of ψ.
  [[nodiscard]] Vector3<Scalar> triads_turn(const Direction& change, const Scalar& rise, const Scalar& by_rise,
                                            const Scalar& azimuth, const Scalar& psi) const noexcept;

  EllipticInvariants<Scalar> of_;
  EllipticStep<Scalar> step_;
  Matrix3<Scalar> axes_;
  Vector3<Scalar> from_;
  Vector3<Scalar> to_;
  MomentumTriad<Scalar> start_;
  MomentumTriad<Scalar> end_;
  Vector3<Scalar> moments_by_step_;  ///< h/Jᵢ
  Scalar inverse_momentum_;          ///< 1/‖a‖
  Scalar length_;                    ///< T
  Scalar precession_;                ///< h ‖a‖/J₃
  Scalar denominator_;               ///< Δ
  Scalar across_;                    ///< Re W
  Scalar along_;                     ///< Im W
  Scalar cosine_;
  Scalar sine_;
};

template <typename Scalar>
Vector3<Scalar> RotorStep<Scalar>::turn_along(const Direction& change) const noexcept {
  const Scalar& x = from_.x();
  const Scalar& y = from_.y();
  const Scalar& z = from_.z();
  const Scalar& dx = change.m.x();
  const Scalar& dy = change.m.y();
  const Scalar& dz = change.m.z();
  const Scalar& s = step_.s;
  const Scalar& c = step_.c;
  const Scalar& d = step_.d;
  const Scalar ds = step_.by_q.s * change.q;
  const Scalar dc = step_.by_q.c * change.q;
  const Scalar dd = step_.by_q.d * change.q;
  const Scalar& kappa = of_.kappa;
  const Scalar& rest = of_.rest;
  const Scalar other = Scalar(1) - kappa;
  const Scalar two(2);
  const Scalar xy = x * y;
  const Scalar dxy = dx * y + x * dy;
  const Scalar zs = z * s;
  const Scalar dzs = dz * s + z * ds;
  const Scalar xyzs = xy * zs;
  const Scalar dxyzs = dxy * zs + xy * dzs;
  const Scalar by_denominator = two * (d * dd + kappa * zs * dzs);
  const Scalar over_denominator = Scalar(1) / denominator_;
  // 1 − c without cancellation
  const Scalar versine =
      scalar::select(c > Scalar(0), Scalar(of_.b() * s * s / (Scalar(1) + scalar::abs(c))), Scalar(Scalar(1) - c));
  // z' − z = E/Δ
  const Scalar xs = x * s;
  const Scalar dxs = dx * s + x * ds;
  const Scalar xys = xy * s;
  const Scalar dxys = dxy * s + xy * ds;
  const Scalar fall = c * versine - other * xs * xs;  // c − Δ
  const Scalar by_fall = dc * (versine - c) - two * other * xs * dxs;
  const Scalar rise = (z * fall + other * xys * d) * over_denominator;
  const Scalar by_rise =
      (dz * fall + z * by_fall + other * (dxys * d + xys * dd) - rise * by_denominator) * over_denominator;
  // γ, by which m turns about the third axis: the argument of Y
  const Scalar squares = x * x + c * y * y;
  const Scalar by_squares = two * x * dx + dc * y * y + two * c * y * dy;
  const Scalar weighed = x * x + kappa * c * y * y;
  const Scalar by_weighed = two * x * dx + kappa * (dc * y * y + two * c * y * dy);
  const Scalar real = d * squares - xyzs * (Scalar(1) - kappa * c);
  const Scalar by_real = dd * squares + d * by_squares - dxyzs * (Scalar(1) - kappa * c) + xyzs * kappa * dc;
  const Scalar imaginary = -(xy * d * versine + zs * weighed);
  const Scalar by_imaginary = -(dxy * d * versine + xy * (dd * versine - d * dc) + dzs * weighed + zs * by_weighed);
  const Scalar azimuth = (real * by_imaginary - imaginary * by_real) / (real * real + imaginary * imaginary);
  // ψ: the phase and the argument of W
  const Scalar radius2 = start_.radius * start_.radius;
  const Scalar by_radius2 = -two * z * dz;
  const Scalar sum = kappa * s * s * radius2 + denominator_;
  const Scalar by_sum = kappa * (two * s * ds * radius2 + s * s * by_radius2) + by_denominator;
  const Scalar by_across = (dc * d + c * dd) * radius2 + c * d * by_radius2 - other * (dxyzs * sum + xyzs * by_sum);
  const Scalar by_along = change.q * s * denominator_ - rest * (ds * denominator_ + s * by_denominator);
  const Scalar psi =
      step_.by_q.phase * change.q + (across_ * by_along - along_ * by_across) / (across_ * across_ + along_ * along_);
  return triads_turn(change, rise, by_rise, azimuth, psi);
}

template <typename Scalar>
Vector3<Scalar> RotorStep<Scalar>::triads_turn(const Direction& change, const Scalar& rise, const Scalar& by_rise,
                                               const Scalar& azimuth, const Scalar& psi) const noexcept {
  const Scalar& z = from_.z();
  const Scalar& dz = change.m.z();
  const Scalar& r = start_.radius;
  const Scalar& r_end = end_.radius;
  const Scalar shorter = rise * (to_.z() + z) / (r + r_end);  // r − r'
  const Scalar less = scalar::select(cosine_ > Scalar(0), Scalar(-sine_ * sine_ / (Scalar(1) + scalar::abs(cosine_))),
                                     Scalar(cosine_ - Scalar(1)));  // cos ψ − 1
  return {-rise * change.azimuth - to_.z() * azimuth + psi,
          (less * r + shorter) * change.azimuth - r_end * azimuth + sine_ * dz / r,
          -sine_ * r * change.azimuth + less * dz / r - dz * shorter / (r * r_end) - by_rise / r_end};
}

}  // namespace elliptude::detail
