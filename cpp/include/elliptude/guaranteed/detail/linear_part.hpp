#pragma once

/// \file
/// The linear part of the errors of an error tube over a step, as a polynomial in time with a bound of its error.
/// (theory, section 17.4)

#include "elliptude/base/out_of_line.hpp"
#include "elliptude/base/rounding.hpp"
#include "elliptude/guaranteed/motion_series.hpp"
#include "elliptude/linear/inverse.hpp"
#include "elliptude/linear/norms.hpp"

namespace elliptude::detail {

/// Y(s) = Σ Y_k sᵏ over a step, which is Y(h/2) (I + W(s)).
template <typename Scalar>
struct LinearPart {
  Matrix6<Scalar> middle;
  Matrix6<Scalar> end;
  Matrix6<Scalar> inverse;    // Y(h/2)⁻¹
  Scalar from_attitude_norm;  // what an error of γ' is, at most, in u'
  Scalar from_rate_norm;      // and one of δω'
  Scalar largest_attitude;    // of γ in the middle for ‖u‖ ≤ 1
  Scalar largest_difference;  // of δω
  Scalar change_odd;          // of W, its part that is linear in s − h/2
  Scalar change;              // of W, all
  Scalar error;               // of the integral of Y(h/2)⁻¹ (Y' − A Y)

  /// What makes u' of γ', and of δω'.
  [[nodiscard]] auto from_attitude() const noexcept { return inverse.template leftCols<3>(); }
  [[nodiscard]] auto from_rate() const noexcept { return inverse.template rightCols<3>(); }
};

/// Y_k from Y' = A(s) Y, and what follows from them.
template <typename Scalar, typename Potential>
class LinearExpansion {
 public:
  LinearExpansion(const RigidBody<Scalar>& body, const MotionSeries<Scalar, Potential>& series) noexcept
      : body_(body), series_(series) {}

  /// \param frame Y at the start of the step.
  /// \return `unbounded` if Y changes too much over the step.
  [[nodiscard]] Status expand(const Matrix6<Scalar>& frame, LinearPart<Scalar>& linear) noexcept {
    find_coefficients(frame);
    evaluate(linear);
    if (inverse_of(linear.middle, linear.inverse) != Status::ok || !bound_change(linear)) {
      return Status::unbounded;
    }
    bound_error(linear);
    return Status::ok;
  }

 private:
  static constexpr int order = 4;      // of Y within a step
  static constexpr int jacobians = 4;  // terms of the torque's Jacobian
  // Rows of Y, transposed: one, and three.
  using Row = Vector<Scalar, padded(6)>;
  using Block = Matrix<Scalar, padded(6), 3>;
  using Blocks = std::array<Block, order + 1>;

  [[nodiscard]] static Scalar number(std::size_t k) noexcept { return Scalar(static_cast<scalar::Value<Scalar>>(k)); }

  [[nodiscard]] static Scalar block_norm(const Block& block) noexcept {
    return norm_of_gram(Matrix3<Scalar>(block.transpose().lazyProduct(block)));
  }
  template <typename Columns>
  [[nodiscard]] static Scalar column_norm(const Columns& columns) noexcept {
    return norm_of_gram(Matrix3<Scalar>(columns.transpose().lazyProduct(columns)));
  }

  [[nodiscard]] static Block value_at(const Blocks& blocks, const Scalar& s) noexcept {
    Block value = blocks[order];
    for (std::size_t k = order; k-- > 0;) {
      value = blocks[k] + s * value;
    }
    return value;
  }
  [[nodiscard]] static Block slope_at(const Blocks& blocks, const Scalar& s) noexcept {
    Block slope = number(order) * blocks[order];
    for (std::size_t k = order - 1; k > 0; --k) {
      slope = number(k) * blocks[k] + s * slope;
    }
    return slope;
  }
  [[nodiscard]] static Matrix6<Scalar> rows(const Block& first, const Block& second) noexcept {
    Matrix6<Scalar> matrix;
    matrix.template topRows<3>() = first.template topRows<6>().transpose();
    matrix.template bottomRows<3>() = second.template topRows<6>().transpose();
    return matrix;
  }

  /// Everything is transposed.
  ELLIPTUDE_OUT_OF_LINE void find_coefficients(const Matrix6<Scalar>& frame) noexcept {
    const Matrix3<Scalar>& inertia = body_.inertia();
    const Matrix3<Scalar>& inverse_inertia = body_.inertia_inverse();
    for (int j = 0; j < jacobians; ++j) {
      stiffness_[static_cast<std::size_t>(j)] =
          product_by_columns(inverse_inertia, series_.torque.jacobian(j)).transpose();
    }
    std::array<Matrix3<Scalar>, order + 1> gyroscopic;  // J⁻¹ (S(Jω_j + h_w) − S(ω_j) J)
    for (std::size_t j = 0; j <= order; ++j) {
      const Matrix3<Scalar> torque = hat(series_.momentum[j]) - product_by_columns(hat(series_.rate[j]), inertia);
      gyroscopic[j] = product_by_columns(inverse_inertia, torque).transpose();
    }
    top_[0].setZero();
    bottom_[0].setZero();
    top_[0].template topRows<6>() = frame.template topRows<3>().transpose();
    bottom_[0].template topRows<6>() = frame.template bottomRows<3>().transpose();
    for (std::size_t k = 0; k <= order; ++k) {  // coefficient k of A Y, which is (k + 1) Y_{k+1}
      for (int column = 0; column < 3; ++column) {
        Row top = bottom_[k].col(column);
        for (std::size_t j = 0; j <= k; ++j) {  // −S(ω_j), transposed
          const int next = column < 2 ? column + 1 : 0;
          const int last = 3 - column - next;
          top += top_[k - j].col(next) * series_.rate[j](last);
          top -= top_[k - j].col(last) * series_.rate[j](next);
        }
        next_top_.col(column) = top;
        Row bottom = Row::Zero();
        for (std::size_t j = 0; j <= k; ++j) {
          for (int row = 0; row < 3; ++row) {
            bottom += bottom_[k - j].col(row) * gyroscopic[j](row, column);
          }
        }
        for (std::size_t j = 0; j <= k && j < jacobians; ++j) {
          for (int row = 0; row < 3; ++row) {
            bottom += top_[k - j].col(row) * stiffness_[j](row, column);
          }
        }
        next_bottom_.col(column) = bottom;
      }
      if (k < order) {
        top_[k + 1] = (Scalar(1) / number(k + 1)) * next_top_;
        bottom_[k + 1] = (Scalar(1) / number(k + 1)) * next_bottom_;
      }
    }
    for (std::size_t k = 0; k <= order; ++k) {
      top_norms_[k] = scalar::sqrt(Scalar(top_[k].squaredNorm()));
      bottom_norms_[k] = scalar::sqrt(Scalar(bottom_[k].squaredNorm()));
    }
  }

  /// Y in the middle and at the end of the step.
  ELLIPTUDE_OUT_OF_LINE void evaluate(LinearPart<Scalar>& linear) const noexcept {
    const Scalar& h = series_.step_powers[1];
    const Scalar middle = scalar::constant<Scalar>(0.5L) * h;
    const Block middle_top = value_at(top_, middle);
    const Block middle_bottom = value_at(bottom_, middle);
    linear.middle = rows(middle_top, middle_bottom);
    linear.end = rows(value_at(top_, h), value_at(bottom_, h));
    linear.largest_attitude = block_norm(middle_top);
    linear.largest_difference = block_norm(middle_bottom);
  }

  /// Bounds of W. \return whether they are below a half.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE bool bound_change(LinearPart<Scalar>& linear) const noexcept {
    linear.from_attitude_norm = column_norm(linear.from_attitude());
    linear.from_rate_norm = column_norm(linear.from_rate());
    const auto& powers = series_.step_powers;
    const Scalar half = scalar::constant<Scalar>(0.5L);
    const Scalar middle = half * powers[1];
    const Matrix6<Scalar> slope = rows(slope_at(top_, middle), slope_at(bottom_, middle));
    linear.change_odd = spectral_norm(product_by_columns(linear.inverse, slope)) * middle;
    Scalar curvature(0);
    for (std::size_t k = 2; k <= order; ++k) {
      curvature += number(k * (k - 1)) * powers[k - 2] *
                   (linear.from_attitude_norm * top_norms_[k] + linear.from_rate_norm * bottom_norms_[k]);
    }
    linear.change = linear.change_odd + half * curvature * middle * middle;
    return linear.change < half;
  }

  /// Bound of the integral of Y' − A Y: its first coefficient exactly, the others by the norms of their blocks; with
  /// rounding.
  ELLIPTUDE_OUT_OF_LINE void bound_error(LinearPart<Scalar>& linear) const noexcept {
    const auto& powers = series_.step_powers;
    const Scalar& h = powers[1];
    const Scalar one(1);
    const Scalar largest_attitude = linear.largest_attitude * (one + linear.change);
    const Scalar largest_difference = linear.largest_difference * (one + linear.change);
    const Matrix6<Scalar> first_error = product_by_columns(linear.inverse, rows(next_top_, next_bottom_));
    linear.error = scalar::sqrt(Scalar(first_error.squaredNorm())) * powers[order + 1] / number(order + 1);
    Scalar top_sum(0);
    Scalar bottom_sum(0);
    add_up_rest(top_sum, bottom_sum);
    const TorqueBounds<Scalar>& torque = series_.acceleration;  // of J⁻¹M
    if (torque.largest > Scalar(0)) {
      bottom_sum += torque.degree * torque.largest * series_.tail(jacobians, torque.degree, torque.turn_rate, h) * h /
                    number(jacobians + 1) * largest_attitude;
    }
    linear.error += linear.from_attitude_norm * top_sum + linear.from_rate_norm * bottom_sum;
    // Rounding of Y and of what is calculated from it.
    linear.error += rounding::share<Scalar>(rounding::linear_part) *
                    (linear.from_attitude_norm * largest_attitude + linear.from_rate_norm * largest_difference);
    // And of A, and of the terms of second order, whose products may cancel before J⁻¹ makes the rest of them large.
    // ‖u‖ ≤ 2.
    const Scalar ratio = body_.greatest_moment() / body_.least_moment();
    linear.error += rounding::share<Scalar>(rounding::linear_rate) * h * linear.from_rate_norm *
                    ((series_.gyroscopic_size + ratio * largest_difference) * largest_difference +
                     series_.stiffness_size * largest_attitude * (one + largest_attitude));
  }

  /// The integral of sⁱ⁺ʲ with i + j > order is at most hⁱ⁺ʲ⁺¹/(order + 2); sums over i come first.
  void add_up_rest(Scalar& top_sum, Scalar& bottom_sum) const noexcept {
    const auto& powers = series_.step_powers;
    std::array<Scalar, order + 1> top_sums;
    std::array<Scalar, order + 1> bottom_sums;
    top_sums[order] = powers[order] * top_norms_[order];
    bottom_sums[order] = powers[order] * bottom_norms_[order];
    for (std::size_t i = order; i-- > 0;) {
      top_sums[i] = top_sums[i + 1] + powers[i] * top_norms_[i];
      bottom_sums[i] = bottom_sums[i + 1] + powers[i] * bottom_norms_[i];
    }
    for (std::size_t j = 1; j < series_.rate_norms.size(); ++j) {
      const Scalar momentum = scalar::sqrt(Scalar(series_.momentum[j].squaredNorm()));
      const Scalar gyroscopic_norm =
          (momentum + series_.rate_norms[j] * body_.greatest_moment()) / body_.least_moment();
      const Scalar stiffness_norm = j < jacobians ? scalar::sqrt(Scalar(stiffness_[j].squaredNorm())) : Scalar(0);
      const std::size_t first = j > order ? 0 : order + 1 - j;
      top_sum += powers[j] * series_.rate_norms[j] * top_sums[first];
      bottom_sum += powers[j] * (gyroscopic_norm * bottom_sums[first] + stiffness_norm * top_sums[first]);
    }
    top_sum *= powers[1] / number(order + 2);
    bottom_sum *= powers[1] / number(order + 2);
  }

  const RigidBody<Scalar>& body_;
  const MotionSeries<Scalar, Potential>& series_;
  std::array<Matrix3<Scalar>, jacobians> stiffness_;  // J⁻¹ 𝓜_j
  Blocks top_;                                        // of γ
  Blocks bottom_;                                     // of δω
  Block next_top_;                                    // (order + 1) Y_{order+1}, which Y leaves out
  Block next_bottom_;
  std::array<Scalar, order + 1> top_norms_;
  std::array<Scalar, order + 1> bottom_norms_;
};

/// The linear part over the step of `series`.
/// \return the status of `LinearExpansion::expand`.
template <typename Scalar, typename Potential>
[[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status expand_linear_part(const RigidBody<Scalar>& body,
                                                              const MotionSeries<Scalar, Potential>& series,
                                                              const Matrix6<Scalar>& frame,
                                                              LinearPart<Scalar>& linear) noexcept {
  return LinearExpansion<Scalar, Potential>(body, series).expand(frame, linear);
}

}  // namespace elliptude::detail
