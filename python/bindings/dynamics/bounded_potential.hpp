#pragma once

/// \file
/// The potentials that offer bounds of their torque, behind one type.

#include <array>
#include <elliptude/guaranteed/torque_expansion.hpp>
#include <variant>

namespace elliptude::python {

/// The sum of up to `most_terms` of the core's potentials; a free body is the sum of none.
class BoundedPotential {
 public:
  static constexpr std::size_t most_terms = 8;
  using Term = std::variant<UniformGravity<double>, GravityGradient<double>>;

  /// \return whether there was room.
  [[nodiscard]] bool add(const Term& term) noexcept {
    if (count_ == most_terms) {
      return false;
    }
    terms_[count_++] = term;
    return true;
  }
  [[nodiscard]] std::size_t count() const noexcept { return count_; }
  [[nodiscard]] const Term& term(std::size_t i) const noexcept { return terms_[i]; }

 private:
  std::array<Term, most_terms> terms_;
  std::size_t count_ = 0;
};

}  // namespace elliptude::python

namespace elliptude {

/// The functions are described in guaranteed/torque_expansion.hpp.
template <int Terms>
class TorqueExpansion<python::BoundedPotential, double, Terms> {
 public:
  explicit TorqueExpansion(const python::BoundedPotential& potential) noexcept : count_(potential.count()) {
    for (std::size_t i = 0; i < count_; ++i) {
      std::visit([&](const auto& term) { terms_[i].template emplace<Expansion<std::decay_t<decltype(term)>>>(term); },
                 potential.term(i));
    }
  }

  [[nodiscard]] Vector3<double> start(const Matrix3<double>& attitude, const double& time) noexcept {
    return sum<Vector3<double>>([&](auto& term) { return term.start(attitude, time); });
  }
  [[nodiscard]] Vector3<double> extend(int k, const std::array<Vector3<double>, Terms>& rate) noexcept {
    return sum<Vector3<double>>([&](auto& term) { return term.extend(k, rate); });
  }
  [[nodiscard]] Matrix3<double> jacobian(int k) const noexcept {
    Matrix3<double> sum = Matrix3<double>::Zero();
    for_each([&](const auto& term) { sum += term.jacobian(k); });
    return sum;
  }
  void add_curvature(const double& s, const Matrix3<double>& transform,
                     expansion::Forms<double>& forms) const noexcept {
    for_each([&](const auto& term) { term.add_curvature(s, transform, forms); });
  }
  void add_cubic(const double& s, const Matrix3<double>& transform, const Matrix3<double>& axes,
                 expansion::CubicForms<double>& forms) const noexcept {
    for_each([&](const auto& term) { term.add_cubic(s, transform, axes, forms); });
  }
  /// As for `SumPotential`: the bounds of the terms add up, for the largest degree and rate among them.
  [[nodiscard]] TorqueBounds<double> bounds(const Matrix3<double>& transform) const noexcept {
    TorqueBounds<double> sum;
    for_each([&](const auto& term) { sum.add(term.bounds(transform)); });
    return sum;
  }

 private:
  template <typename Potential>
  using Expansion = TorqueExpansion<Potential, double, Terms>;
  using Term = std::variant<std::monostate, Expansion<UniformGravity<double>>, Expansion<GravityGradient<double>>>;
  static_assert(std::variant_size_v<Term> == 3, "each kind of term needs a branch in for_each and sum");

  template <typename Function>
  void for_each(const Function& f) const noexcept {
    for (std::size_t i = 0; i < count_; ++i) {
      if (const auto* gravity = std::get_if<1>(&terms_[i])) {
        f(*gravity);
      } else if (const auto* gradient = std::get_if<2>(&terms_[i])) {
        f(*gradient);
      }
    }
  }
  template <typename Result, typename Function>
  [[nodiscard]] Result sum(const Function& f) noexcept {
    Result sum = Result::Zero();
    for (std::size_t i = 0; i < count_; ++i) {
      if (auto* gravity = std::get_if<1>(&terms_[i])) {
        sum += f(*gravity);
      } else if (auto* gradient = std::get_if<2>(&terms_[i])) {
        sum += f(*gradient);
      }
    }
    return sum;
  }

  std::array<Term, python::BoundedPotential::most_terms> terms_;
  std::size_t count_;
};

}  // namespace elliptude
