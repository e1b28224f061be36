#pragma once

/// \file
/// A symmetric positive definite system of a few equations, how many is known at run time alone.
/// (theory, section 16.11)

#include <array>
#include <cstddef>

#include "elliptude/base/scalar.hpp"

namespace elliptude::detail {

/// H x = b with H = L diag(p)⁻¹ Lᵀ. The right side is one more column, so that eliminating the unknowns makes L⁻¹b of
/// it too. Whole rows are added up, though of what is before the diagonal nothing is used: a sum of constant length is
/// a few instructions.
template <typename Scalar, std::size_t Most>
class BorderedSystem {
 public:
  /// Room for so many unknowns. The upper triangle and the right side are then to be set.
  void begin(std::size_t count) noexcept {
    count_ = count;
    for (std::size_t i = 0; i < count; ++i) {
      rows_[i].setZero();
    }
  }

  [[nodiscard]] Scalar& entry(std::size_t row, std::size_t column) noexcept {
    return rows_[row](static_cast<Eigen::Index>(column));
  }
  [[nodiscard]] const Scalar& entry(std::size_t row, std::size_t column) const noexcept {
    return rows_[row](static_cast<Eigen::Index>(column));
  }
  [[nodiscard]] Scalar& right_side(std::size_t row) noexcept { return entry(row, count_); }
  /// p, once the unknowns are eliminated.
  [[nodiscard]] const Scalar& inverse_pivot(std::size_t row) const noexcept { return inverse_pivots_[row]; }

  /// Leaves diag(p)⁻¹ Lᵀ in the upper triangle and L⁻¹b as the right side.
  /// \return whether H is positive definite.
  [[nodiscard]] bool eliminate() noexcept {
    for (std::size_t j = 0; j < count_; ++j) {
      if (!(entry(j, j) > Scalar(0))) {
        return false;
      }
      inverse_pivots_[j] = Scalar(1) / entry(j, j);
      for (std::size_t i = j + 1; i < count_; ++i) {
        const Scalar factor = entry(j, i) * inverse_pivots_[j];
        rows_[i] -= factor * rows_[j];
      }
    }
    return true;
  }

  /// x, after `eliminate`.
  void solve(std::array<Scalar, Most>& x) const noexcept {
    for (std::size_t i = count_; i-- > 0;) {
      Scalar sum = entry(i, count_);
      for (std::size_t k = i + 1; k < count_; ++k) {
        sum -= entry(i, k) * x[k];
      }
      x[i] = sum * inverse_pivots_[i];
    }
  }

 private:
  static constexpr int width = static_cast<int>((Most / 4 + 1) * 4);  // whole registers of four

  std::size_t count_ = 0;
  std::array<Vector<Scalar, width>, Most> rows_;
  std::array<Scalar, Most> inverse_pivots_;
};

}  // namespace elliptude::detail
