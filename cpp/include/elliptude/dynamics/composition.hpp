#pragma once

/// \file
/// How one step of an integrator is put together from shorter ones: turns of the free body, and kicks of the torque
/// between them (theory, sections 4 and 4.2).

#include <array>

#include "elliptude/base/scalar.hpp"
#include "elliptude/base/status.hpp"

namespace elliptude {

/// How the step is composed of shorter ones: stage i has length weights[i] h; the weights sum to 1 and read the same
/// from both ends, so that the composition is time-reversible like the step itself.
template <typename Scalar>
struct Composition {
  static constexpr int most_stages = 17;
  static constexpr bool needs_exact_rotor = false;

  int stages;
  std::array<Scalar, most_stages> weights;

  /// How long the free body turns in stage i, as a share of the step.
  [[nodiscard]] Scalar turn(int i) const noexcept { return weights[static_cast<std::size_t>(i)]; }
  /// How long the torque at the start of stage i acts then: half of the stage.
  [[nodiscard]] Scalar kick_before(int i) const noexcept { return scalar::constant<Scalar>(0.5L) * turn(i); }
  /// How long the torque at the end of stage i acts then: half of the stage.
  [[nodiscard]] Scalar kick_after(int i) const noexcept { return kick_before(i); }
};

/// A step of the splitting with the exact free rotor: kicks of lengths kicks[0], …, kicks[stages] and, between them,
/// turns of the free body of lengths turns[0], …, as shares of the step. Both read the same from both ends. The lengths
/// are free of one another, which takes fewer stages, or smaller errors, than composing whole steps; only where the
/// turns are exact does it have its order.
template <typename Scalar>
struct Splitting {
  static constexpr int most_stages = 17;
  static constexpr bool needs_exact_rotor = true;

  int stages;
  std::array<Scalar, most_stages> turns;
  std::array<Scalar, most_stages + 1> kicks;

  [[nodiscard]] Scalar turn(int i) const noexcept { return turns[static_cast<std::size_t>(i)]; }
  [[nodiscard]] Scalar kick_before(int i) const noexcept { return i == 0 ? kicks[0] : Scalar(0); }
  [[nodiscard]] Scalar kick_after(int i) const noexcept { return kicks[static_cast<std::size_t>(i) + 1]; }
};

namespace detail {

/// Fills in numbers that read the same from both ends, from their first half; a middle one, if there is one, is the
/// last of it.
template <typename Numbers, std::size_t N>
void fill_symmetric(const std::array<long double, N>& half, int count, Numbers& numbers) noexcept {
  using Scalar = typename Numbers::value_type;
  for (int i = 0; i < static_cast<int>(N); ++i) {
    const Scalar number = scalar::constant<Scalar>(half[static_cast<std::size_t>(i)]);
    numbers[static_cast<std::size_t>(i)] = number;
    numbers[static_cast<std::size_t>(count - 1 - i)] = number;
  }
}

}  // namespace detail

/// Order 2: the step itself. Order 4: Suzuki's five stages, 1/(4 − 4^⅓). Orders 6 and 8: Kahan and Li (1997), 9 and 17
/// stages.
/// \return `out_of_range` for any other order.
template <typename Scalar>
[[nodiscard]] Status composition_of_order(int order, Composition<Scalar>& composition) noexcept {
  Composition<Scalar> result{};
  const auto symmetric = [&result](const auto& half) {
    result.stages = 2 * static_cast<int>(half.size()) - 1;
    detail::fill_symmetric(half, result.stages, result.weights);
  };
  switch (order) {
    case 2:
      symmetric(std::array<long double, 1>{1.0L});
      break;
    case 4:
      symmetric(std::array<long double, 3>{0.41449077179437573714235406286L, 0.41449077179437573714235406286L,
                                           -0.65796308717750294856941625144L});
      break;
    case 6:
      symmetric(std::array<long double, 5>{0.39216144400731413927925056L, 0.33259913678935943859974864L,
                                           -0.70624617255763935980996482L, 0.08221359629355080023149045L,
                                           0.79854399093482996339895035L});
      break;
    case 8:
      symmetric(std::array<long double, 9>{
          0.13020248308889008087881763L, 0.56116298177510838456196441L, -0.38947496264484728640807860L,
          0.15884190655515560089621075L, -0.39590389413323757733623154L, 0.18453964097831570709183254L,
          0.25837438768632204729397911L, 0.29501172360931029887096624L, -0.60550853383003451169892108L});
      break;
    default:
      return Status::out_of_range;
  }
  composition = result;
  return Status::ok;
}

/// Orders 4 and 6: the Runge–Kutta–Nyström splittings SRKN₆ᵇ and SRKN₁₁ᵇ of Blanes and Moan (2002), 6 and 11 stages,
/// their coefficients to 32 digits from the order conditions. Orders 2 and 8: `composition_of_order`, with its kicks
/// joined.
/// \return `out_of_range` for any other order.
template <typename Scalar>
[[nodiscard]] Status splitting_of_order(int order, Splitting<Scalar>& splitting) noexcept {
  Splitting<Scalar> result{};
  const auto symmetric = [&result](int stages, const auto& turns, const auto& kicks) {
    result.stages = stages;
    detail::fill_symmetric(turns, stages, result.turns);
    detail::fill_symmetric(kicks, stages + 1, result.kicks);
  };
  switch (order) {
    case 4:
      symmetric(6,
                std::array<long double, 3>{0.2452989571842711234486544562783L, 0.60487266571107992362618432989252L,
                                           -0.35017162289535104707483878617082L},
                std::array<long double, 4>{0.082984406417404982334898567313179L, 0.39630980149836806185395464370709L,
                                           -0.039056304922348437334305653429234L, 0.11952419401315078629090488481793L});
      break;
    case 6:
      symmetric(11,
                std::array<long double, 6>{0.12322977594627115016010759907643L, 0.29055379779955829115240993705171L,
                                           -0.12704921262541699725688780913703L, -0.24633176106207543571270645490093L,
                                           0.35720887279592786333577007520753L, 0.20477705429147025664261330540457L},
                std::array<long double, 6>{0.041464998518262842282544826929621L, 0.19812867191806652588900715815623L,
                                           -0.040006192104152692780899302551421L, 0.075253984301580309449752123722382L,
                                           -0.011511387420687756043808850023211L, 0.2366699247869307712034040437664L});
      break;
    default: {
      Composition<Scalar> composition{};
      if (const Status status = composition_of_order(order, composition); status != Status::ok) {
        return status;
      }
      result.stages = composition.stages;
      result.kicks[0] = composition.kick_before(0);
      for (int i = 0; i < composition.stages; ++i) {
        const auto here = static_cast<std::size_t>(i);
        result.turns[here] = composition.turn(i);
        result.kicks[here + 1] =
            composition.kick_after(i) + (i + 1 < composition.stages ? composition.kick_before(i + 1) : Scalar(0));
      }
    }
  }
  splitting = result;
  return Status::ok;
}

}  // namespace elliptude
