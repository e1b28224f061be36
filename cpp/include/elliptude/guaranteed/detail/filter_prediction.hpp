#pragma once

/// \file
/// A guaranteed filter's predictions: what it knows at a later time, and what it forgets.
/// (theory, sections 16.8, 16.9 and 17)

#include "elliptude/base/out_of_line.hpp"
#include "elliptude/guaranteed/detail/filter_memory.hpp"

namespace elliptude::detail {

/// A prediction of what a filter knows.
template <typename Flow>
class FilterPrediction {
 public:
  using Memory = FilterMemory<Flow>;
  using State = typename Memory::State;
  using Scalar = typename Memory::Scalar;
  using Set = typename Memory::Set;
  using Input = typename Flow::Input;

  explicit FilterPrediction(Memory& filter) noexcept : filter_(filter) {}

  /// `GuaranteedFilter::predict_interval`.
  [[nodiscard]] Status by_motion(const Scalar& time, const Scalar& duration, const Input& input) noexcept {
    return predict_by(time, duration, input,
                      [&](const Set& set, Set& predicted) { return predicted_set(duration, input, set, predicted); });
  }

  /// `GuaranteedFilter::predict_turn_interval`, of a finite turn and an angle that is not negative.
  [[nodiscard]] Status by_turn(const Scalar& time, const Scalar& duration, const Vector3<Scalar>& turn,
                               const Scalar& angle) noexcept {
    return predict_by(time, duration, Input{}, [&](const Set& set, Set& predicted) {
      return predicted_turn(duration, turn, angle, set, predicted);
    });
  }

 private:
  /// \param move from a set to the set that is predicted, as `Flow::predict`.
  template <typename Move>
  [[nodiscard]] Status predict_by(const Scalar& time, const Scalar& duration, const Input& input,
                                  const Move& move) noexcept {
    if (filter_.known.has_attitude) {
      const Status status = predict_set(time, move);
      if (status == Status::ok || status == Status::interrupted ||
          (status != Status::unbounded && (filter_.has_policy(Policy::raise) || !predicts_another(move)))) {
        return status;
      }
    }
    return predict_vector(time, duration, input);
  }

  /// \return `unbounded` also of a set that cannot be kept.
  template <typename Move>
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status predict_set(const Scalar& time, const Move& move) noexcept {
    Set predicted;
    if (const Status status = move(filter_.known.set, predicted); status != Status::ok) {
      return status;
    }
    // A rigid body's flow has factored the shape itself.
    if (!(Memory::measures_rate ? in_domain(predicted) : can_be_kept(predicted))) {
      return Status::unbounded;
    }
    filter_.known.set = predicted;
    filter_.constraints.count = 0;
    filter_.time = time;
    return Status::ok;
  }

  /// What is known of the vector, where no attitude is known any more.
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE Status predict_vector(const Scalar& time, const Scalar& duration,
                                                            const Input& input) noexcept {
    Ellipsoid<Scalar, 3> vector = filter_.known_vector();
    bool has_vector = !only_whole_states && filter_.settings.estimates_vector && filter_.knows_vector();
    if (has_vector) {
      const Status status = filter_.flow.predict_vector(filter_.time, duration, input, vector, vector);
      // What was given so flat that its factor is rounding has none after a turn: nothing can be made of it.
      const bool is_flat = status == Status::not_positive_definite && !filter_.has_policy(Policy::raise);
      if (status != Status::ok && status != Status::beyond_domain && !is_flat) {
        return status;
      }
      has_vector = status == Status::ok && can_be_kept(vector);
    } else if (!scalar::isfinite(duration)) {
      return Status::not_finite;
    } else if (!(duration >= Scalar(0))) {
      return Status::out_of_range;
    }
    filter_.known.vector = vector;
    filter_.known.has_vector = has_vector;
    filter_.known.set = Knowledge<State>::no_set();
    filter_.known.has_attitude = false;
    if (!has_vector) {
      filter_.trust.forget();
    }
    filter_.claim = Claim::none;
    filter_.time = time;
    return Status::ok;
  }

  [[nodiscard]] Status predicted_set(const Scalar& duration, const Input& input, const Set& set,
                                     Set& predicted) const noexcept {
    if constexpr (!Memory::measures_rate) {
      const Vector3<Scalar> turn = duration * input.angular_velocity;
      if (input.is_measured && scalar::isfinite(duration) && scalar::all_finite(input.angular_velocity) &&
          turns_too_far(turn)) {
        return beyond_all_turns();
      }
      if (filter_.leaves_vector()) {
        return filter_.flow.predict_attitude(filter_.time, duration, input, filter_.known.vector_bound, set, predicted);
      }
    }
    return filter_.flow.predict(filter_.time, duration, input, set, predicted);
  }

  [[nodiscard]] Status predicted_turn(const Scalar& duration, const Vector3<Scalar>& turn, const Scalar& angle,
                                      const Set& set, Set& predicted) const noexcept {
    if (!scalar::isfinite(duration)) {
      return Status::not_finite;
    }
    if (turns_too_far(turn)) {
      return beyond_all_turns();
    }
    if (filter_.leaves_vector()) {
      return filter_.flow.predict_attitude_turn(duration, turn, angle, filter_.known.vector_bound, set, predicted);
    }
    return filter_.flow.predict_turn(duration, turn, angle, set, predicted);
  }

  [[nodiscard]] static bool turns_too_far(const Vector3<Scalar>& turn) noexcept {
    return !(turn.cwiseAbs().maxCoeff() <= FilterDomain<Scalar>::largest());
  }

  [[nodiscard]] Status beyond_all_turns() const noexcept {
    return filter_.has_policy(Policy::raise) ? Status::out_of_range : Status::unbounded;
  }

  /// Whether a prediction fails because of the set and not because of the input: a small set at rest can be predicted.
  template <typename Move>
  [[nodiscard]] ELLIPTUDE_OUT_OF_LINE ELLIPTUDE_SELDOM bool predicts_another(const Move& move) const noexcept {
    Set another{{filter_.known.set.center.attitude, Vector3<Scalar>::Zero()}, Matrix6<Scalar>::Identity()};
    another.shape *= scalar::constant<Scalar>(1e-6L);
    Set ignored;
    const Status status = move(another, ignored);
    return status == Status::ok || status == Status::unbounded;
  }

  Memory& filter_;
};

}  // namespace elliptude::detail
