#pragma once

/// \file
/// What a guaranteed filter holds, and the few tests that everything passes which it takes up. (theory, section 16.9)

#include "elliptude/guaranteed/detail/kept_constraints.hpp"
#include "elliptude/guaranteed/detail/solution.hpp"
#include "elliptude/guaranteed/recovery.hpp"
#include "elliptude/guaranteed/settings.hpp"
#include "elliptude/sets/overlap.hpp"

namespace elliptude::detail {

/// A guaranteed filter's memory.
template <typename FlowType>
struct FilterMemory {
  using Flow = FlowType;
  using State = typename Flow::State;
  using Scalar = StateScalar<State>;
  using Set = GibbsEllipsoid<State>;
  using Settings = GuaranteedSettings<Scalar>;
  static constexpr bool measures_rate = std::is_same_v<State, RigidBodyState<Scalar>>;

  Flow flow;
  Settings settings;
  Scalar time{0};
  Knowledge<State> known;
  KeptConstraints<Scalar> constraints;
  Trust trust;  ///< in the set, of the attitude or of the vector
  Claim claim = Claim::none;

  /// Forgets everything but the bound of the vector.
  void forget() noexcept {
    constraints.count = 0;
    known.set = Knowledge<State>::no_set();
    known.has_attitude = false;
    known.has_vector = false;
    trust.forget();
    claim = Claim::none;
  }

  [[nodiscard]] bool has_policy(Policy policy) const noexcept { return is_policy(settings.policy, policy); }

  [[nodiscard]] bool may_be_wrong() const noexcept {
    return most_that_are_wrong > 0 && has_policy(Policy::relaxed) && settings.most_wrong > 0;
  }

  /// Whether the vector is left to its bound: the set is then a product of the attitude's and of that.
  /// (theory, section 16.7)
  [[nodiscard]] bool leaves_vector() const noexcept {
    return !only_whole_states && !settings.estimates_vector && known.has_vector_bound;
  }

  [[nodiscard]] Claim present_claim() const noexcept {
    return !known.has_attitude ? Claim::none : trust.rests_on_drops() ? Claim::conditional : Claim::unconditional;
  }

  [[nodiscard]] SetSolver<State> solver_of(const Measurements<Scalar>& measurements) const noexcept {
    return {known, settings.criterion, settings.estimates_vector, measurements};
  }

  /// \return the status of `validate` for an ellipsoid of the vector; `not_positive_definite`; `out_of_range` beyond
  /// the domain.
  [[nodiscard]] static Status validated(const Ellipsoid<Scalar, 3>& vector) noexcept {
    if (const Status status = validate(vector); status != Status::ok) {
      return status;
    }
    if (!is_positive_definite(vector.shape)) {
      return Status::not_positive_definite;
    }
    return in_domain(vector) ? Status::ok : Status::out_of_range;
  }

  /// If the vector is left to its bound, nothing else is known about it.
  void confine(Set& set) const noexcept {
    if constexpr (!measures_rate) {
      if (leaves_vector()) {
        set.center.gyro_bias = known.vector_bound.center;
        set.shape = product_shape(Matrix3<Scalar>(set.shape.template topLeftCorner<3, 3>()), known.vector_bound.shape);
      }
    }
  }

  [[nodiscard]] bool knows_vector() const noexcept { return known.has_attitude || known.has_vector; }

  /// What is known of the vector, with the attitude or without.
  [[nodiscard]] Ellipsoid<Scalar, 3> known_vector() const noexcept {
    return known.has_attitude ? vector_of(known.set) : known.vector;
  }

  /// Whether a bound of the vector surely has nothing in common with what is known of it, where that is not the bound
  /// itself. Both are raised, so that rounding cannot call sets apart that are not. (theory, section 16.9)
  [[nodiscard]] bool contradicts(const Ellipsoid<Scalar, 3>& vector, const Ellipsoid<Scalar, 3>& bound) const noexcept {
    const Scalar root = rounding::root<Scalar>();
    Ellipsoid<Scalar, 3> wider_vector = vector;
    Ellipsoid<Scalar, 3> wider_bound = bound;
    wider_vector.shape.diagonal() *= Scalar(1) + root;
    wider_bound.shape.diagonal() *= Scalar(1) + root;
    Scalar margin(1);
    return !leaves_vector() && overlap_margin(wider_vector, wider_bound, margin) == Status::ok &&
           margin < Scalar(-rounding::raised_overlap) * root;
  }

  /// A set of errors about a center put about its own. All sets but predictions come this way.
  /// \return `unbounded` if it may hold half turns, or cannot be kept.
  [[nodiscard]] Status place(const State& center, const Ellipsoid<Scalar, 6>& errors, Set& next) const noexcept {
    Set placed;
    if (recentred(center, errors, placed) != Status::ok) {
      return Status::unbounded;
    }
    confine(placed);
    if (!can_be_kept(placed)) {
      return Status::unbounded;
    }
    next = placed;
    return Status::ok;
  }
};

}  // namespace elliptude::detail
