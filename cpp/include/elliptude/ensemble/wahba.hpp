#pragma once

/// \file
/// Many of Wahba's problems, `Width` at a time in SIMD registers, by `WahbaMethod::foam`, with the solutions that each
/// has alone.

#include <algorithm>
#include <cstddef>

#include "elliptude/attitude/wahba.hpp"
#include "elliptude/ensemble/ensemble.hpp"
#include "elliptude/ensemble/pack.hpp"

namespace elliptude {

/// Problems of as many directions each, one after the other in memory.
template <typename Number>
struct WahbaProblems {
  const Number* reference;          ///< three numbers for each direction
  const Number* body;               ///< likewise
  const Number* weights;            ///< one for each direction
  std::ptrdiff_t reference_stride;  ///< numbers from one problem to the next; none where all have the same
  std::ptrdiff_t body_stride;
  std::ptrdiff_t weights_stride;
  Eigen::Index directions;  ///< of each problem
};

namespace detail {

/// Problems side by side in packs, for `quick_foam`; the last one again where they are fewer than lanes.
template <typename Number, int Width>
class PackedDirections {
 public:
  using Scalar = Pack<Number, Width>;

  PackedDirections(const WahbaProblems<Number>& problems, std::size_t begin, std::size_t size) noexcept
      : problems_(&problems) {
    for (std::size_t i = 0; i < width; ++i) {
      const auto problem = static_cast<std::ptrdiff_t>(begin + std::min(i, size - 1));
      reference_[i] = problems.reference + problem * problems.reference_stride;
      body_[i] = problems.body + problem * problems.body_stride;
      weights_[i] = problems.weights + problem * problems.weights_stride;
    }
  }

  [[nodiscard]] Triple<Scalar> reference(Eigen::Index i) const noexcept {
    return triple(reference_, 3 * i, problems_->reference_stride == 0);
  }
  [[nodiscard]] Triple<Scalar> body(Eigen::Index i) const noexcept {
    return triple(body_, 3 * i, problems_->body_stride == 0);
  }
  [[nodiscard]] Scalar weight(Eigen::Index i) const noexcept {
    return gathered(weights_, i, problems_->weights_stride == 0);
  }

 private:
  static constexpr auto width = static_cast<std::size_t>(Width);
  using Places = std::array<const Number*, width>;

  [[nodiscard]] static Scalar gathered(const Places& places, Eigen::Index at, bool shared) noexcept {
    if (shared) {
      return Scalar(places[0][at]);
    }
    Scalar result;
    for (std::size_t i = 0; i < width; ++i) {
      result.set(i, places[i][at]);
    }
    return result;
  }
  [[nodiscard]] static Triple<Scalar> triple(const Places& places, Eigen::Index at, bool shared) noexcept {
    return {gathered(places, at, shared), gathered(places, at + 1, shared), gathered(places, at + 2, shared)};
  }

  const WahbaProblems<Number>* problems_;
  Places reference_;
  Places body_;
  Places weights_;
};

}  // namespace detail

/// `solve_wahba` by `foam` for each of `count` problems. What is not as usual, as nearly collinear directions, is
/// solved alone.
/// \param solutions as many; those of problems before the first that fails.
template <int Width, typename Number>
[[nodiscard]] EnsembleStatus solve_wahba_problems(const WahbaProblems<Number>& problems, std::size_t count,
                                                  WahbaSolution<Number>* solutions) noexcept {
  using Scalar = Pack<Number, Width>;
  using Directions = Eigen::Map<const Matrix<Number, 3, Eigen::Dynamic>>;
  for (std::size_t begin = 0; begin < count; begin += std::size_t{Width}) {
    const std::size_t size = std::min(std::size_t{Width}, count - begin);
    WahbaSolution<Scalar> together;
    const auto solved = detail::quick_foam<Scalar>(detail::PackedDirections<Number, Width>(problems, begin, size),
                                                   problems.directions, together);
    for (std::size_t i = 0; i < size; ++i) {
      WahbaSolution<Number>& solution = solutions[begin + i];
      if (solved.lanes[i] != 0) {
        for (int k = 0; k < 9; ++k) {
          solution.attitude.data()[k] = together.attitude.data()[k][i];
        }
        solution.cost = together.cost[i];
        solution.condition = together.condition[i];
        continue;
      }
      const auto problem = static_cast<std::ptrdiff_t>(begin + i);
      const Eigen::Index m = problems.directions;
      const Status status = solve_wahba(
          Directions(problems.reference + problem * problems.reference_stride, 3, m),
          Directions(problems.body + problem * problems.body_stride, 3, m),
          Eigen::Map<const Vector<Number, Eigen::Dynamic>>(problems.weights + problem * problems.weights_stride, m),
          WahbaMethod::foam, solution);
      if (status != Status::ok) {
        return {status, begin + i};
      }
    }
  }
  return {Status::ok, count};
}

}  // namespace elliptude
