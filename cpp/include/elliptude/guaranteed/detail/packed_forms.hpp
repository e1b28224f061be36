#pragma once

/// \file
/// Quadratic forms of six numbers as columns that can be added and multiplied by the matrices of linear maps.
/// (theory, section 17.4)
///
/// A form uᵀHu is packed as the entries H(j, (j + d) mod 6), column after column for d = 0 … 3, those with d = 1 and 2
/// times √2; those with d = 3 stand there twice. Its value is then the inner product with u uᵀ packed in the same way,
/// which has the length ‖u‖². There are 24 entries, whole SIMD registers of any width.

#include "elliptude/base/scalar.hpp"

namespace elliptude {
namespace detail::packed {

constexpr int size = 24;

template <typename Scalar>
using Form = Vector<Scalar, size>;
/// Six forms, one a column: a quadratic map of six numbers to six.
template <typename Scalar>
using Forms = Matrix<Scalar, size, 6>;

/// What the entries of a diagonal are multiplied by.
template <typename Scalar>
[[nodiscard]] Scalar weight(int diagonal) noexcept {
  return diagonal == 1 || diagonal == 2 ? scalar::constant<Scalar>(1.41421356237309504880168872420969807857L)
                                        : Scalar(1);
}

/// As many entries of a form as are worked with at once: with SIMD registers all, else those of one diagonal.
constexpr int part_size = padded(6) > 6 ? size : 6;
template <typename Scalar>
using Part = Vector<Scalar, part_size>;

/// A linear form aᵀu, as it goes into the part of a product from entry `begin` on.
template <typename Scalar>
struct Factor {
  Part<Scalar> first;   // a(j), where the entry (j, k) is packed
  Part<Scalar> second;  // a(k), times half the weight

  Factor(const Vector6<Scalar>& a, int begin) noexcept {
    Vector<Scalar, 12> twice;
    twice << a, a;
    for (int at = 0; at < part_size; at += 6) {
      const int d = (begin + at) / 6;
      first.template segment<6>(at) = a;
      second.template segment<6>(at) =
          (scalar::constant<Scalar>(0.5L) * weight<Scalar>(d)) * twice.template segment<6>(d);
    }
  }
};

/// Three linear forms.
template <typename Scalar>
using Factors = std::array<Factor<Scalar>, 3>;
template <typename Scalar, typename Rows>
[[nodiscard]] Factors<Scalar> factors_of(const Rows& rows, int begin) noexcept {
  return {Factor<Scalar>(rows.row(0), begin), Factor<Scalar>(rows.row(1), begin), Factor<Scalar>(rows.row(2), begin)};
}

/// The part of the form (aᵀu)(bᵀu).
template <typename Scalar>
[[nodiscard]] Part<Scalar> product(const Factor<Scalar>& a, const Factor<Scalar>& b) noexcept {
  return a.first.cwiseProduct(b.second) + a.second.cwiseProduct(b.first);
}

/// The six products of three linear forms, as `expansion::RowForms` counts them, but those of two different ones not
/// times √2.
template <typename Scalar>
[[nodiscard]] Matrix<Scalar, part_size, 6> products(const Factors<Scalar>& factors) noexcept {
  Matrix<Scalar, part_size, 6> parts;
  for (std::size_t a = 0; a < 3; ++a) {
    parts.col(static_cast<int>(a)) = product(factors[a], factors[a]);
    parts.col(static_cast<int>(a) + 3) = product(factors[(a + 1) % 3], factors[(a + 2) % 3]);
  }
  return parts;
}

/// A symmetric matrix of six rows, and zeros below where they fill SIMD registers.
template <typename Scalar>
using Slice = Matrix<Scalar, padded(6), 6>;

/// The symmetric matrix of a form.
template <typename Scalar>
[[nodiscard]] Slice<Scalar> unpacked(const Form<Scalar>& form) noexcept {
  Slice<Scalar> matrix;
  if constexpr (padded(6) > 6) {
    matrix.template bottomRows<padded(6) - 6>().setZero();
  }
  for (int d = 0; d < 4; ++d) {
    const Scalar factor = Scalar(1) / weight<Scalar>(d);
    for (int j = 0; j < 6; ++j) {
      const int k = j + d < 6 ? j + d : j + d - 6;
      const Scalar entry = factor * form(6 * d + j);
      matrix(j, k) = entry;
      matrix(k, j) = entry;
    }
  }
  return matrix;
}

/// Six forms as symmetric matrices, each a column. Unlike packed forms they are cheap to multiply by maps. The inner
/// product of columns is that of packed forms.
template <typename Scalar>
using Slices = Matrix<Scalar, 6 * padded(6), 6>;

template <typename Scalar>
[[nodiscard]] auto slice(Slices<Scalar>& slices, int i) noexcept {
  return Eigen::Map<Slice<Scalar>>(slices.col(i).data());
}
template <typename Scalar>
[[nodiscard]] auto slice(const Slices<Scalar>& slices, int i) noexcept {
  return Eigen::Map<const Slice<Scalar>>(slices.col(i).data());
}

/// The product of a and a lower triangle b; and of a and any b, in which of column j only what is from row j on is
/// right.
template <typename Scalar, typename A, typename B, typename Product>
void multiply_from_diagonal(const A& a, const B& b, Product&& product) noexcept {
  for (int j = 0; j < 6; ++j) {
    Vector<Scalar, padded(6)> column =
        b(j, j) * a.col(j);  // not in its place, or a processor would write it there each time
    for (int k = j + 1; k < 6; ++k) {
      column += b(k, j) * a.col(k);
    }
    product.col(j) = column;
  }
}

/// The quadratic map q in the coordinates of a set, u = map v: map⁻¹ q(map v). The map is a lower triangle, and so is
/// its inverse.
template <typename Scalar>
[[nodiscard]] Slices<Scalar> seen_from(const Forms<Scalar>& forms, const Matrix6<Scalar>& map,
                                       const Matrix6<Scalar>& inverse) noexcept {
  Slice<Scalar> transposed = Slice<Scalar>::Zero();
  transposed.template topRows<6>() = map.transpose();
  Slices<Scalar> result;
  for (int i = 0; i < 6; ++i) {
    Form<Scalar> form = inverse(i, 0) * forms.col(0);
    for (int k = 1; k <= i; ++k) {
      form += inverse(i, k) * forms.col(k);
    }
    Slice<Scalar> half;
    multiply_from_diagonal<Scalar>(unpacked(form), map, half);
    auto image = slice(result, i);
    multiply_from_diagonal<Scalar>(transposed, half, image);
    for (int j = 1; j < 6; ++j) {
      for (int k = 0; k < j; ++k) {
        image(k, j) = image(j, k);
      }
    }
  }
  return result;
}

/// The cubic form uᵀq(u) of a quadratic map q, as a symmetric tensor: slice i is a quadratic form again. Its norm can
/// be much smaller than that of q: a part of q that only turns u is no growth.
template <typename Scalar>
[[nodiscard]] Slices<Scalar> symmetric_part(const Slices<Scalar>& slices) noexcept {
  const Scalar third = scalar::constant<Scalar>(1.0L / 3.0L);
  constexpr int rows = padded(6);
  Slices<Scalar> result;
  for (int i = 0; i < 6; ++i) {
    for (int k = 0; k <= i; ++k) {
      Vector<Scalar, rows> across = Vector<Scalar, rows>::Zero();  // H_j(i, k)
      across.template head<6>() = slices.row(rows * k + i).transpose();
      slice(result, i).col(k) = third * (slice(slices, i).col(k) + slice(slices, k).col(i) + across);
      slice(result, k).col(i) = slice(result, i).col(k);
    }
  }
  return result;
}

}  // namespace detail::packed
}  // namespace elliptude
