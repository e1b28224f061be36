#pragma once

/// \file
/// The potentials that offer bounds of their torque, behind one type.

#include <array>
#include <elliptude/guaranteed/own_torque_expansion.hpp>
#include <variant>

namespace elliptude::python {

class Potential;

/// The torque of a potential behind one interface, which must outlive it. What a function written in Python raises waits in
/// `failure_of_this_thread`.
struct TorqueOfPotential {
  const Potential* potential = nullptr;

  [[nodiscard]] Vector3<double> torque(const Matrix3<double>& attitude, const double& time) const noexcept;
  [[nodiscard]] Matrix3<double> torque_jacobian(const Matrix3<double>& attitude, const double& time) const noexcept;
};

template <typename... Potentials>
struct PotentialList {
  using Any = std::variant<Potentials...>;
  template <int Terms>
  using AnyExpansion = std::variant<std::monostate, TorqueExpansion<Potentials, double, Terms>...>;
};

/// The potentials that guaranteed flows take: those with a `TorqueExpansion`. A new one is added here.
using PotentialsWithBounds = PotentialList<UniformGravity<double>, GravityGradient<double>, LinearPotential<double>,
                                           QuadraticPotential<double>, StatedTorque<double, TorqueOfPotential>>;

/// The sum of up to `most_terms` of them; a free body is the sum of none.
class BoundedPotential {
 public:
  static constexpr std::size_t most_terms = 8;
  using Term = PotentialsWithBounds::Any;

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
  static constexpr bool is_local = true;

  explicit TorqueExpansion(const python::BoundedPotential& potential) noexcept : count_(potential.count()) {
    for (std::size_t i = 0; i < count_; ++i) {
      std::visit([&](const auto& term) { terms_[i].template emplace<Expansion<std::decay_t<decltype(term)>>>(term); },
                 potential.term(i));
    }
  }

  [[nodiscard]] Status begin_step(const Matrix3<double>& attitude, const Vector3<double>& rate, const double& time,
                                  const double& h) noexcept {
    Status status = Status::ok;
    for_each(*this, [&](auto& term) {
      if constexpr (elliptude::is_local<std::decay_t<decltype(term)>>) {
        status = status == Status::ok ? term.begin_step(attitude, rate, time, h) : status;
      }
    });
    return status;
  }
  [[nodiscard]] double remainder(const double& angle, const double& duration) const noexcept {
    double sum = 0;
    for_each(*this, [&](const auto& term) {
      if constexpr (elliptude::is_local<std::decay_t<decltype(term)>>) {
        sum += term.remainder(angle, duration);
      }
    });
    return sum;
  }
  [[nodiscard]] Vector3<double> start(const Matrix3<double>& attitude, const double& time) noexcept {
    Vector3<double> sum = Vector3<double>::Zero();
    for_each(*this, [&](auto& term) { sum += term.start(attitude, time); });
    return sum;
  }
  [[nodiscard]] Vector3<double> extend(int k, const std::array<Vector3<double>, Terms>& rate) noexcept {
    Vector3<double> sum = Vector3<double>::Zero();
    for_each(*this, [&](auto& term) { sum += term.extend(k, rate); });
    return sum;
  }
  [[nodiscard]] Matrix3<double> jacobian(int k) const noexcept {
    Matrix3<double> sum = Matrix3<double>::Zero();
    for_each(*this, [&](const auto& term) { sum += term.jacobian(k); });
    return sum;
  }
  void add_curvature(const double& s, const Matrix3<double>& transform,
                     expansion::Forms<double>& forms) const noexcept {
    for_each(*this, [&](const auto& term) { term.add_curvature(s, transform, forms); });
  }
  void add_cubic(const double& s, const Matrix3<double>& transform, const Matrix3<double>& axes,
                 expansion::CubicForms<double>& forms) const noexcept {
    for_each(*this, [&](const auto& term) { term.add_cubic(s, transform, axes, forms); });
  }
  /// As for `SumPotential`: the bounds of the terms add up, for the largest degree and rate among them.
  [[nodiscard]] TorqueBounds<double> bounds(const Matrix3<double>& transform) const noexcept {
    TorqueBounds<double> sum;
    for_each(*this, [&](const auto& term) { sum.add(term.bounds(transform)); });
    return sum;
  }

 private:
  template <typename Potential>
  using Expansion = TorqueExpansion<Potential, double, Terms>;
  using Term = python::PotentialsWithBounds::AnyExpansion<Terms>;

  template <typename Self, typename Function>
  static void for_each(Self& self, const Function& f) noexcept {
    for (std::size_t i = 0; i < self.count_; ++i) {
      // Not std::visit: it throws where a variant has no value.
      visit_kind(self.terms_[i], f, std::make_index_sequence<std::variant_size_v<Term>>());
    }
  }
  template <typename AnyTerm, typename Function, std::size_t... Kinds>
  static void visit_kind(AnyTerm& any, const Function& f, std::index_sequence<Kinds...> /*kinds*/) noexcept {
    const auto visit_if = [&](auto* term) {
      if constexpr (!std::is_same_v<std::decay_t<decltype(*term)>, std::monostate>) {
        if (term != nullptr) {
          f(*term);
        }
      }
    };
    (visit_if(std::get_if<Kinds>(&any)), ...);
  }

  std::array<Term, python::BoundedPotential::most_terms> terms_;
  std::size_t count_;
};

}  // namespace elliptude
