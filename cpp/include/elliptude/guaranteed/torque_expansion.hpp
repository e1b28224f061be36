#pragma once

/// \file
/// Power series in time of the torque of a potential along a motion, and bounds of the torque: what a potential must
/// provide for guaranteed bounds. (theory, section 17)
///
/// A torque here is a polynomial in vectors that are fixed in the reference frame, or turn in it at a known rate, as
/// they are seen from the body: s = Cᵀr(t), which obeys s' = −ω × s + Cᵀr'(t). `TorqueExpansion<Potential, Scalar,
/// Terms>` is specialised for each potential that can be used in a guaranteed flow:
///
///     explicit TorqueExpansion(const Potential&);
///     Vector3<Scalar> start(attitude, time);               // coefficient 0 of M(s)
///     Vector3<Scalar> extend(k, rate);                      // coefficient k, from coefficients 0 … k − 1 of ω
///     Matrix3<Scalar> jacobian(k);                          // coefficient k of ∂M/∂ζ, for k extended before
///     void add_curvature(s, transform, forms);              // forms[i] += row i of transform times ½ ∂²M/∂γ² at time s
///     void add_cubic(s, transform, axes, forms);            // column i += the same of the terms of third order in γ = axes v
///     TorqueBounds<Scalar> bounds(transform) const;          // of transform times the torque
///
/// An expansion that holds near one attitude only says so by `static constexpr bool is_local = true`, and has besides
///
///     Status begin_step(attitude, rate, time, h);            // before `start`: expands about the middle of a step
///     Scalar remainder(angle, duration) const;               // what it lacks of the torque, N m, at an attitude within the angle
///                                                            // of that in the middle, and a time within the duration
///
/// Its bounds then change with each step.

#include <utility>

#include "elliptude/dynamics/potential.hpp"
#include "elliptude/guaranteed/torque_forms.hpp"
#include "elliptude/linear/norms.hpp"
#include "elliptude/sets/sum.hpp"

namespace elliptude {

/// Along a turn by an angle θ about any fixed axis the torque is a trigonometric polynomial in θ of the given degree,
/// of at most the given length. By Bernstein's inequality its k-th derivative is then at most degreeᵏ as long. Along a
/// motion that is continued to complex times z, its length is at most `largest` exp(degree (Σ‖ω_k‖|z|ᵏ + turn_rate)
/// |z|), and that of its Jacobian at most `degree` times as much. In γ the terms of second order are at most ½ degree²
/// ‖γ‖² times `largest`, those of third order ⅜ degree² ‖γ‖³, and all the rest ⅛ degree³ ‖γ‖⁴ (1 + ⅝‖γ‖)
/// (theory, section 17.3).
template <typename Scalar>
struct TorqueBounds {
  Scalar largest = Scalar(0);    ///< of the transformed torque; N m for the torque itself
  Scalar degree = Scalar(0);     ///< 0 for no torque
  Scalar turn_rate = Scalar(0);  ///< rad/s, at which the potential turns in the reference frame
  /// 1/s²: an error ΔJ of the inertia, in the spectral norm, changes the torque itself by at most this times ‖ΔJ‖.
  Scalar by_inertia = Scalar(0);
  /// Shape of an ellipsoid about zero that holds the transformed torque at every attitude and time. The statements
  /// about lengths above hold in each direction, with the ellipsoid's width there instead of `largest`.
  Matrix3<Scalar> shape = Matrix3<Scalar>::Zero();
  /// Length of a part that is the same at every attitude, seen from the body. `largest` and the shape leave it out.
  Scalar fixed = Scalar(0);
  /// Length of the products that the torque is made of, where they may cancel: their rounding does not.
  Scalar products = Scalar(0);

  /// Adds the torque of a second potential: bounds grow with the degree and the rate, so the larger ones hold for the
  /// sum.
  void add(const TorqueBounds& other) noexcept {
    largest += other.largest;
    degree = other.degree > degree ? other.degree : degree;
    turn_rate = other.turn_rate > turn_rate ? other.turn_rate : turn_rate;
    by_inertia += other.by_inertia;
    shape = sum_of_shapes(shape, other.shape);
    fixed += other.fixed;
    products += other.products;
  }
};

/// Specialised for each potential that can be used in a guaranteed flow.
template <typename Potential, typename Scalar, int Terms>
class TorqueExpansion;

namespace detail {

template <typename Expansion, typename = void>
struct IsLocal : std::false_type {};

template <typename Expansion>
struct IsLocal<Expansion, std::enable_if_t<Expansion::is_local>> : std::true_type {};

}  // namespace detail

/// Whether an expansion holds near one attitude only.
template <typename Expansion>
constexpr bool is_local = detail::IsLocal<Expansion>::value;

template <typename Scalar, int Terms>
class TorqueExpansion<FreeBody<Scalar>, Scalar, Terms> {
 public:
  explicit TorqueExpansion(const FreeBody<Scalar>& /*potential*/) noexcept {}

  [[nodiscard]] Vector3<Scalar> start(const Matrix3<Scalar>& /*attitude*/, const Scalar& /*time*/) noexcept {
    return Vector3<Scalar>::Zero();
  }
  [[nodiscard]] Vector3<Scalar> extend(int /*k*/, const std::array<Vector3<Scalar>, Terms>& /*rate*/) noexcept {
    return Vector3<Scalar>::Zero();
  }
  [[nodiscard]] Matrix3<Scalar> jacobian(int /*k*/) const noexcept { return Matrix3<Scalar>::Zero(); }
  void add_curvature(const Scalar& /*s*/, const Matrix3<Scalar>& /*transform*/,
                     expansion::Forms<Scalar>& /*forms*/) const noexcept {}
  void add_cubic(const Scalar& /*s*/, const Matrix3<Scalar>& /*transform*/, const Matrix3<Scalar>& /*axes*/,
                 expansion::CubicForms<Scalar>& /*forms*/) const noexcept {}
  [[nodiscard]] TorqueBounds<Scalar> bounds(const Matrix3<Scalar>& /*transform*/) const noexcept { return {}; }
};

/// M = m g ρ × s with s = Cᵀe₃.
template <typename Scalar, int Terms>
class TorqueExpansion<UniformGravity<Scalar>, Scalar, Terms> {
 public:
  explicit TorqueExpansion(const UniformGravity<Scalar>& potential) noexcept : moment_(potential.moment()) {}

  [[nodiscard]] Vector3<Scalar> start(const Matrix3<Scalar>& attitude, const Scalar& /*time*/) noexcept {
    down_[0] = attitude.row(2).transpose();
    count_ = 1;
    return moment_.cross(down_[0]);
  }
  [[nodiscard]] Vector3<Scalar> extend(int k, const std::array<Vector3<Scalar>, Terms>& rate) noexcept {
    const auto index = static_cast<std::size_t>(k);
    down_[index] = expansion::cross_coefficient(k - 1, rate, down_) / Scalar(-k);
    count_ = k + 1;
    return moment_.cross(down_[index]);
  }
  [[nodiscard]] Matrix3<Scalar> jacobian(int k) const noexcept {
    return hat_product(moment_, down_[static_cast<std::size_t>(k)]);
  }
  void add_curvature(const Scalar& s, const Matrix3<Scalar>& transform,
                     expansion::Forms<Scalar>& forms) const noexcept {
    const Vector3<Scalar> down = expansion::value(down_, count_, s);
    const Matrix3<Scalar> n = transform.lazyProduct(hat(moment_));
    for (int i = 0; i < 3; ++i) {
      forms[static_cast<std::size_t>(i)] += expansion::second_order_form(Vector3<Scalar>(n.row(i).transpose()), down);
    }
  }
  /// −¼‖γ‖² m × (s × γ).
  void add_cubic(const Scalar& s, const Matrix3<Scalar>& transform, const Matrix3<Scalar>& axes,
                 expansion::CubicForms<Scalar>& forms) const noexcept {
    const Vector3<Scalar> down = expansion::value(down_, count_, s);
    expansion::add_cubic_of_first_degree(hat_product(moment_, down), transform, axes, forms);
  }
  [[nodiscard]] TorqueBounds<Scalar> bounds(const Matrix3<Scalar>& transform) const noexcept {
    const Matrix3<Scalar> map = transform.lazyProduct(hat(moment_));
    const Matrix3<Scalar> shape = map.lazyProduct(map.transpose());
    return {norm_of_gram(shape), Scalar(1), Scalar(0), Scalar(0), shape};
  }

 private:
  Vector3<Scalar> moment_;
  std::array<Vector3<Scalar>, Terms> down_;
  int count_ = 0;
};

namespace expansion {

/// M = f b × Jb with a symmetric J and b = Cᵀr, r a unit vector that turns by n in a plane, where v is a quarter turn
/// ahead of it: r' = n v, v' = −n r. For the gravity gradient f = 3n², and J is the body's inertia.
template <typename Scalar, int Terms>
class QuadraticTorque {
 public:
  /// \param radial r at time 0.
  /// \param along v at time 0; zero if r stands still.
  /// \param rate n in rad/s.
  QuadraticTorque(const Matrix3<Scalar>& inertia, const Scalar& strength, const Vector3<Scalar>& radial,
                  const Vector3<Scalar>& along, const Scalar& rate) noexcept
      : inertia_(inertia), strength_(strength), start_radial_(radial), start_along_(along), rate_(rate) {}

  [[nodiscard]] Vector3<Scalar> start(const Matrix3<Scalar>& attitude, const Scalar& time) noexcept {
    const Scalar angle = rate_ * time;
    const Scalar cosine = scalar::cos(angle);
    const Scalar sine = scalar::sin(angle);
    const Vector3<Scalar> radial = attitude.transpose() * (cosine * start_radial_ + sine * start_along_);
    const Vector3<Scalar> along = attitude.transpose() * (cosine * start_along_ - sine * start_radial_);
    add(0, radial, along);
    return torque(0);
  }
  [[nodiscard]] Vector3<Scalar> extend(int k, const std::array<Vector3<Scalar>, Terms>& rate) noexcept {
    const auto last = static_cast<std::size_t>(k - 1);
    const Scalar factor = Scalar(1) / Scalar(k);
    add(k, factor * (rate_ * along_[last] - cross_coefficient(k - 1, rate, radial_)),
        factor * (-rate_ * radial_[last].template head<3>() - cross_coefficient(k - 1, rate, along_)));
    return torque(k);
  }
  /// f (−S(Jb) + S(b)J) S(b), which is linear in B = bbᵀ: as S(x)S(y) = yxᵀ − (x·y)I and S(x)J + JS(x) = S((tr J I −
  /// J)x) it is f (tr J B + tr B J − 2BJ − JB + (2 tr BJ − tr J tr B) I).
  [[nodiscard]] Matrix3<Scalar> jacobian(int k) const noexcept {
    const Matrix3<Scalar> square = squares_[static_cast<std::size_t>(k)].template topRows<3>();
    const Matrix3<Scalar> product = square.lazyProduct(inertia_);
    const Scalar trace = inertia_.trace();
    Matrix3<Scalar> sum = trace * square + square.trace() * inertia_ - Scalar(2) * product - product.transpose();
    sum.diagonal().array() += Scalar(2) * product.trace() - trace * square.trace();
    return strength_ * sum;
  }
  void add_curvature(const Scalar& s, const Matrix3<Scalar>& transform, Forms<Scalar>& forms) const noexcept {
    const Vector3<Scalar> b = value(radial_, count_, s).template head<3>();
    const Matrix3<Scalar> n = strength_ * transform.lazyProduct(linear_part(b, Vector3<Scalar>(inertia_ * b)));
    // (S(b)γ) × (J S(b)γ): component a of it is the antisymmetric combination of rows of S(b) and J S(b).
    const Matrix3<Scalar> p = hat(b);
    const Matrix3<Scalar> q = inertia_.lazyProduct(p);
    std::array<Matrix3<Scalar>, 3> cross;
    for (int a = 0; a < 3; ++a) {
      const int next = (a + 1) % 3;
      const int last = (a + 2) % 3;
      const Matrix3<Scalar> form = p.row(next).transpose() * q.row(last) - p.row(last).transpose() * q.row(next);
      cross[static_cast<std::size_t>(a)] = (scalar::constant<Scalar>(0.5L) * strength_) * (form + form.transpose());
    }
    for (int i = 0; i < 3; ++i) {
      Matrix3<Scalar>& form = forms[static_cast<std::size_t>(i)];
      form += second_order_form(Vector3<Scalar>(n.row(i).transpose()), b);
      form += transform(i, 0) * cross[0] + transform(i, 1) * cross[1] + transform(i, 2) * cross[2];
    }
  }
  /// With b₁ = S(b)γ and b₂ = ½ (γ(γ·b) − b‖γ‖²) it is f (−¼‖γ‖² N b₁ + b₁ × Jb₂ + b₂ × Jb₁), in which −½ b‖γ‖² gives
  /// −½‖γ‖² N b₁ more: f (−¾‖γ‖² N b₁ + ½ (γ·b) (b₁ × Jγ + γ × Jb₁)).
  void add_cubic(const Scalar& s, const Matrix3<Scalar>& transform, const Matrix3<Scalar>& axes,
                 CubicForms<Scalar>& forms) const noexcept {
    const Vector3<Scalar> b = value(radial_, count_, s).template head<3>();
    const Matrix3<Scalar> b1 = hat(b).lazyProduct(axes);
    const Matrix3<Scalar> jb1 = inertia_.lazyProduct(b1);
    const Matrix3<Scalar> jaxes = inertia_.lazyProduct(axes);
    const Matrix3<Scalar> linear =
        scalar::constant<Scalar>(-0.75L) * linear_part(b, Vector3<Scalar>(inertia_ * b)).lazyProduct(b1);
    const Matrix3<Scalar> square = axes.transpose().lazyProduct(axes);
    const Vector3<Scalar> along = scalar::constant<Scalar>(0.25L) * (axes.transpose() * b);  // half of ½ γ·b
    CubicForms<Scalar> torque;
    for (int a = 0; a < 3; ++a) {
      const int next = (a + 1) % 3;
      const int last = (a + 2) % 3;
      const Matrix3<Scalar> form =
          b1.row(next).transpose() * jaxes.row(last) - b1.row(last).transpose() * jaxes.row(next) +
          axes.row(next).transpose() * jb1.row(last) - axes.row(last).transpose() * jb1.row(next);
      torque.col(a) = cubic_product(Vector3<Scalar>(linear.row(a).transpose()), square) +
                      cubic_product(along, Matrix3<Scalar>(form + form.transpose()));
    }
    forms += torque.lazyProduct(Matrix3<Scalar>(strength_ * transform.transpose()));
  }
  /// The components of b × Jb are forms without a trace, so they act on bbᵀ − I/3 alone, of length √(2/3), which a
  /// turn, of complex rates too, changes as it does the spherical harmonics of degree two.
  [[nodiscard]] TorqueBounds<Scalar> bounds(const Matrix3<Scalar>& transform) const noexcept {
    const Matrix<Scalar, 3, 6> map = transform.lazyProduct(gyroscopic_forms(inertia_));
    const Matrix3<Scalar> shape =
        (strength_ * strength_ * scalar::constant<Scalar>(2.0L / 3.0L)) * map.lazyProduct(map.transpose());
    return {norm_of_gram(shape), Scalar(2), rate_, Scalar(0), shape};
  }

 private:
  [[nodiscard]] static Padded<Scalar> padded(const Vector3<Scalar>& v) noexcept {
    Padded<Scalar> result = Padded<Scalar>::Zero();
    result.template head<3>() = v;
    return result;
  }
  /// Coefficient k of both directions, and of bbᵀ.
  void add(int k, const Vector3<Scalar>& radial, const Vector3<Scalar>& along) noexcept {
    const auto index = static_cast<std::size_t>(k);
    radial_[index] = padded(radial);
    along_[index] = along;
    squares_[index] = radial_[0].lazyProduct(radial.transpose());
    for (std::size_t i = 1; i <= index; ++i) {
      squares_[index] += radial_[i].lazyProduct(radial_[index - i].template head<3>().transpose());
    }
    count_ = k + 1;
  }
  /// Coefficient k of f b × Jb, the axis of bbᵀJ.
  [[nodiscard]] Vector3<Scalar> torque(int k) const noexcept {
    const Matrix3<Scalar> product = squares_[static_cast<std::size_t>(k)].template topRows<3>().lazyProduct(inertia_);
    return strength_ *
           Vector3<Scalar>(product(1, 2) - product(2, 1), product(2, 0) - product(0, 2), product(0, 1) - product(1, 0));
  }
  /// −S(Jb) + S(b)J, which gives d(b × Jb) from db.
  [[nodiscard]] Matrix3<Scalar> linear_part(const Vector3<Scalar>& b, const Vector3<Scalar>& jb) const noexcept {
    return hat(b).lazyProduct(inertia_) - hat(jb);
  }

  Matrix3<Scalar> inertia_;
  Scalar strength_;
  Vector3<Scalar> start_radial_;
  Vector3<Scalar> start_along_;
  Scalar rate_;
  std::array<Padded<Scalar>, Terms> radial_;
  std::array<Vector3<Scalar>, Terms> along_;
  std::array<Columns<Scalar>, Terms> squares_;  // of bbᵀ
  int count_ = 0;
};

}  // namespace expansion

template <typename Scalar, int Terms>
class TorqueExpansion<GravityGradient<Scalar>, Scalar, Terms> : public expansion::QuadraticTorque<Scalar, Terms> {
 public:
  explicit TorqueExpansion(const GravityGradient<Scalar>& potential) noexcept
      : expansion::QuadraticTorque<Scalar, Terms>(
            potential.inertia(), Scalar(3) * potential.orbit_rate() * potential.orbit_rate(), potential.orbit().col(0),
            potential.orbit().col(1), potential.orbit_rate()),
        strength_(Scalar(3) * potential.orbit_rate() * potential.orbit_rate()) {}

  [[nodiscard]] TorqueBounds<Scalar> bounds(const Matrix3<Scalar>& transform) const noexcept {
    TorqueBounds<Scalar> bounds = expansion::QuadraticTorque<Scalar, Terms>::bounds(transform);
    bounds.by_inertia = strength_;
    return bounds;
  }

 private:
  Scalar strength_;  // 3n², in 1/s²
};

template <typename Scalar, int Terms, typename... Potentials>
class TorqueExpansion<SumPotential<Potentials...>, Scalar, Terms> {
 public:
  static constexpr bool is_local = (elliptude::is_local<TorqueExpansion<Potentials, Scalar, Terms>> || ...);

  explicit TorqueExpansion(const SumPotential<Potentials...>& sum) noexcept
      : terms_(std::apply(
            [](const auto&... p) {
              return std::tuple<TorqueExpansion<Potentials, Scalar, Terms>...>(p...);  // each one made in its place
            },
            sum.potentials())) {}

  [[nodiscard]] Vector3<Scalar> start(const Matrix3<Scalar>& attitude, const Scalar& time) noexcept {
    return std::apply([&](auto&... term) { return Vector3<Scalar>((term.start(attitude, time) + ...)); }, terms_);
  }
  [[nodiscard]] Vector3<Scalar> extend(int k, const std::array<Vector3<Scalar>, Terms>& rate) noexcept {
    return std::apply([&](auto&... term) { return Vector3<Scalar>((term.extend(k, rate) + ...)); }, terms_);
  }
  [[nodiscard]] Matrix3<Scalar> jacobian(int k) const noexcept {
    return std::apply([&](const auto&... term) { return Matrix3<Scalar>((term.jacobian(k) + ...)); }, terms_);
  }
  void add_curvature(const Scalar& s, const Matrix3<Scalar>& transform,
                     expansion::Forms<Scalar>& forms) const noexcept {
    std::apply([&](const auto&... term) { (term.add_curvature(s, transform, forms), ...); }, terms_);
  }
  void add_cubic(const Scalar& s, const Matrix3<Scalar>& transform, const Matrix3<Scalar>& axes,
                 expansion::CubicForms<Scalar>& forms) const noexcept {
    std::apply([&](const auto&... term) { (term.add_cubic(s, transform, axes, forms), ...); }, terms_);
  }
  [[nodiscard]] TorqueBounds<Scalar> bounds(const Matrix3<Scalar>& transform) const noexcept {
    TorqueBounds<Scalar> sum;
    std::apply([&](const auto&... term) { (sum.add(term.bounds(transform)), ...); }, terms_);
    return sum;
  }
  [[nodiscard]] Status begin_step(const Matrix3<Scalar>& attitude, const Vector3<Scalar>& rate, const Scalar& time,
                                  const Scalar& h) noexcept {
    Status status = Status::ok;
    const auto begin = [&](auto& term) {
      if constexpr (elliptude::is_local<std::decay_t<decltype(term)>>) {
        status = status == Status::ok ? term.begin_step(attitude, rate, time, h) : status;
      }
    };
    std::apply([&](auto&... term) { (begin(term), ...); }, terms_);
    return status;
  }
  [[nodiscard]] Scalar remainder(const Scalar& angle, const Scalar& duration) const noexcept {
    Scalar sum(0);
    const auto add = [&](const auto& term) {
      if constexpr (elliptude::is_local<std::decay_t<decltype(term)>>) {
        sum += term.remainder(angle, duration);
      }
    };
    std::apply([&](const auto&... term) { (add(term), ...); }, terms_);
    return sum;
  }

 private:
  std::tuple<TorqueExpansion<Potentials, Scalar, Terms>...> terms_;
};

namespace detail {

template <typename Potential, typename Scalar, typename = void>
struct HasExpansion : std::false_type {};

template <typename Potential, typename Scalar>
struct HasExpansion<Potential, Scalar,
                    std::void_t<decltype(std::declval<const TorqueExpansion<Potential, Scalar, 4>&>().bounds(
                        std::declval<const Matrix3<Scalar>&>()))>> : std::true_type {};

}  // namespace detail

/// Whether a potential can be used in a guaranteed flow.
template <typename Potential, typename Scalar>
constexpr bool has_expansion = detail::HasExpansion<Potential, Scalar>::value;

}  // namespace elliptude
