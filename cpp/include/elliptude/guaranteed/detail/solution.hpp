#pragma once

/// \file
/// The set of states that the measurements of one moment and the past leave possible: one fusion, which decides nothing
/// about contradictions. (theory, sections 16.5 to 16.7)

#include <array>
#include <cstdint>

#include "elliptude/base/rounding.hpp"
#include "elliptude/guaranteed/kept_set.hpp"
#include "elliptude/measurement/sensors.hpp"
#include "elliptude/sets/quadric_fusion.hpp"

namespace elliptude::detail {

/// What a guaranteed filter knows.
template <typename State>
struct Knowledge {
  using Scalar = StateScalar<State>;

  GibbsEllipsoid<State> set = no_set();             ///< where the attitude is known; else not finite
  Ellipsoid<Scalar, 3> vector = no_vector();        ///< what is known about the vector while the attitude is not known
  Ellipsoid<Scalar, 3> vector_bound = no_vector();  ///< what always holds for the vector
  bool has_attitude = false;
  bool has_vector = false;
  bool has_vector_bound = false;

  /// What nobody can take for a set.
  [[nodiscard]] static GibbsEllipsoid<State> no_set() noexcept {
    const Scalar none = scalar::not_a_number<Scalar>();
    return {State{Matrix3<Scalar>::Identity(), Vector3<Scalar>::Constant(none)}, Matrix6<Scalar>::Constant(none)};
  }
  [[nodiscard]] static Ellipsoid<Scalar, 3> no_vector() noexcept {
    const Scalar none = scalar::not_a_number<Scalar>();
    return {Vector3<Scalar>::Constant(none), Matrix3<Scalar>::Constant(none)};
  }
};

/// What a set says of the vector, and of the attitude, alone.
template <typename State>
[[nodiscard]] Ellipsoid<StateScalar<State>, 3> vector_of(const GibbsEllipsoid<State>& set) noexcept {
  return {vector_part(set.center), set.shape.template bottomRightCorner<3, 3>()};
}
template <typename State>
[[nodiscard]] Ellipsoid<StateScalar<State>, 3> attitude_of(const GibbsEllipsoid<State>& set) noexcept {
  return {Vector3<StateScalar<State>>::Zero(), set.shape.template topLeftCorner<3, 3>()};
}

/// A set of states about a center that is only the origin of its coordinates.
template <typename State>
struct Solution {
  State center;
  QuadricFusion<StateScalar<State>, 6> fusion;
  bool used_prediction;
};

/// Two blocks with zeros between: an attitude's, and that of a vector that is left to its bound. Each is a set of its
/// own, and the state is in the product of both. (theory, section 16.7)
template <typename Scalar>
[[nodiscard]] Matrix6<Scalar> product_shape(const Matrix3<Scalar>& attitude, const Matrix3<Scalar>& vector) noexcept {
  Matrix6<Scalar> shape = Matrix6<Scalar>::Zero();
  shape.template topLeftCorner<3, 3>() = attitude;
  shape.template bottomRightCorner<3, 3>() = vector;
  return shape;
}

/// How the search for an attitude alone has ended, as that of a state.
template <typename Scalar>
void put_search(const QuadricFusion<Scalar, 3>& found, QuadricFusion<Scalar, 6>& fusion) noexcept {
  fusion.margin = found.margin;
  fusion.contradiction = found.contradiction;
  fusion.steps = found.steps;
  fusion.ended_by_limit = found.ended_by_limit;
}

/// The set that it has found, with the vector left to its bound.
/// \param vector about the center of the attitude's coordinates.
template <typename Scalar>
void put_product(const QuadricFusion<Scalar, 3>& found, const Ellipsoid<Scalar, 3>& vector,
                 QuadricFusion<Scalar, 6>& fusion) noexcept {
  fusion.set.center << found.set.center, vector.center;
  fusion.set.shape = product_shape(found.set.shape, vector.shape);
  fusion.multipliers = found.multipliers;
  fusion.predicted_multiplier = found.predicted_multiplier;
  fusion.prediction_alone = found.prediction_alone;
}

/// Finds the smallest ellipsoid about the states that selected measurements, and the past if wanted, leave possible.
template <typename State>
class SetSolver {
 public:
  using Scalar = StateScalar<State>;

  const Knowledge<State>& known;
  const SizeCriterion<Scalar, 6>& criterion;
  bool estimates_vector;
  const Measurements<Scalar>& measurements;

  /// Whether the past takes part, besides what bounds the vector at all times.
  enum class Past : std::uint8_t { used, forgotten };

  /// \param center where the coordinates begin if there is no prediction; null for one by the selected measurements.
  /// \return `unbounded` if they do not bound the attitude; `empty_intersection`; the status of `validate`.
  [[nodiscard]] Status solve(Sensors selected, Past past, const State* center,
                             Solution<State>& solution) const noexcept {
    const bool with_prediction = past == Past::used && known.has_attitude;
    if (with_prediction) {
      solution.center = known.set.center;
    } else if (center != nullptr) {
      solution.center = *center;
    } else if (const Status status = measured_center(selected, past, solution.center); status != Status::ok) {
      return sensors::checked(measurements, status);
    }
    return only_whole_states || estimates_vector ? solve_state(selected, past, with_prediction, solution)
                                                 : solve_attitude(selected, with_prediction, solution);
  }

  /// A center for coordinates where there is no prediction: any will do, one near the truth does best. Only what is
  /// selected may choose it, and of the vector what is known best: seen from far away a sharp set is lost in rounding.
  [[nodiscard]] ELLIPTUDE_SELDOM Status measured_center(Sensors selected, Past past, State& center) const noexcept {
    Vector3<Scalar> vector = Vector3<Scalar>::Zero();
    Scalar least_trace(std::numeric_limits<scalar::Value<Scalar>>::infinity());
    const auto offer = [&](const Vector3<Scalar>& value, const Matrix3<Scalar>& shape) {
      if (shape.trace() < least_trace) {
        vector = value;
        least_trace = shape.trace();
      }
    };
    if ((selected & angular_velocity_bit) != 0) {
      offer(measurements.angular_velocity->value, measurements.angular_velocity->bound);
    }
    if (past == Past::used && !known.has_attitude && known.has_vector) {
      offer(known.vector.center, known.vector.shape);
    }
    if (known.has_vector_bound) {
      offer(known.vector_bound.center, known.vector_bound.shape);
    }
    Matrix3<Scalar> attitude;
    if (!only_directions && (selected & attitude_bit) != 0) {
      // Within `rotation_tolerance`, but cones hold about a rotation to rounding.
      attitude = renormalized(measurements.attitude->attitude);
    } else {
      Matrix3<Scalar> profile = Matrix3<Scalar>::Zero();
      for (std::size_t i = 0; i < measurements.direction_count; ++i) {
        if ((selected & direction_bit(i)) != 0) {
          const Direction<Scalar>& direction = measurements.directions[i];
          // A weight is any positive number: within these no sum is lost.
          const Scalar least = rounding::one_rounding<Scalar>();
          const Scalar square = direction.bound.trace();
          const Scalar weight = square < least ? Scalar(Scalar(1) / least)
                                               : (square < Scalar(1) / least ? Scalar(Scalar(1) / square) : least);
          profile += profile_term(weight, scalar::unit(direction.reference), scalar::unit(direction.body));
        }
      }
      RotationSvd<Scalar> svd;
      // Directions that are not collinear may still leave Wahba's problem undetermined, as a mirror image of them does:
      // then they contradict each other, which any center shows.
      if (rotation_svd(profile, svd) != Status::ok ||
          !(svd.values(1) * wahba_condition_limit<Scalar>() > svd.values(0))) {
        return Status::unbounded;
      }
      attitude = renormalized(Matrix3<Scalar>(svd.u * svd.v.transpose()));
    }
    center = State{attitude, vector};
    return Status::ok;
  }

  /// Selected measurements and what bounds the vector, as quadrics of [γ; δ] about a center.
  /// \param past whether what was known of the vector while the attitude was not known is among them.
  [[nodiscard]] Status collect(Sensors selected, Past past, const State& center,
                               std::array<HalfQuadric<Scalar>, most_quadrics>& quadrics,
                               std::size_t& count) const noexcept {
    count = 0;
    Quadric<Scalar, 3> quadric;
    const Matrix3<Scalar>& attitude = center.attitude;
    const auto add_vector = [&](const Vector3<Scalar>& value, const Matrix3<Scalar>& shape) {
      const Vector3<Scalar> offset = value - vector_part(center);
      const Status status = to_quadric(with_least_width(Ellipsoid<Scalar, 3>{offset, shape}), quadric);
      if (status == Status::ok) {
        quadrics[count++] = of_vector(quadric);
      }
      return status;
    };
    for (std::size_t i = 0; i < measurements.direction_count; ++i) {
      if ((selected & direction_bit(i)) != 0) {
        if (const Status status = cone(attitude, measurements.directions[i], quadric); status != Status::ok) {
          return status;
        }
        quadrics[count++] = of_attitude(quadric);
      }
    }
    if ((selected & angular_velocity_bit) != 0) {
      const AngularVelocity<Scalar>& measured = *measurements.angular_velocity;
      if (const Status status = validate(measured); status != Status::ok) {
        return status;
      }
      if (const Status status = add_vector(measured.value, measured.bound); status != Status::ok) {
        return status;
      }
    }
    if (!only_directions && (selected & attitude_bit) != 0) {
      if (const Status status = to_quadric(attitude, *measurements.attitude, quadric); status != Status::ok) {
        return status;
      }
      quadrics[count++] = of_attitude(quadric);
    }
    // A bound that cannot be used must not be left out silently.
    if (known.has_vector_bound) {
      if (const Status status = add_vector(known.vector_bound.center, known.vector_bound.shape); status != Status::ok) {
        return status;
      }
    }
    if (past == Past::used && !known.has_attitude && known.has_vector) {
      if (const Status status = add_vector(known.vector.center, known.vector.shape); status != Status::ok) {
        return status;
      }
    }
    return Status::ok;
  }

 private:
  /// Below this a multiplier is what the search has left of zero.
  static Scalar least_multiplier() noexcept { return scalar::constant<Scalar>(1e-6L); }

  [[nodiscard]] Status solve_state(Sensors selected, Past past, bool with_prediction,
                                   Solution<State>& solution) const noexcept {
    std::array<HalfQuadric<Scalar>, most_quadrics> quadrics;
    std::size_t count = 0;
    if (const Status status = collect(selected, past, solution.center, quadrics, count); status != Status::ok) {
      return status;
    }
    const Ellipsoid<Scalar, 6> predicted = known.set.in_coordinates();
    const Status status =
        detail::fuse(with_prediction ? &predicted : nullptr, quadrics.data(), count, criterion, solution.fusion);
    if (!only_whole_states && status == Status::unbounded) {
      // What leaves the state open may still contradict itself: two directions, where nothing tells the vector.
      const Status alone = solve_attitude(selected, false, solution);
      return alone == Status::empty_intersection ? alone : status;
    }
    solution.used_prediction =
        with_prediction && status == Status::ok &&
        (solution.fusion.prediction_alone || solution.fusion.predicted_multiplier > least_multiplier());
    return status;
  }

  /// Solves for the attitude alone: the vector is in its bound, and the state in the product of both sets.
  /// \return `unbounded` also of a vector without a bound.
  [[nodiscard]] Status solve_attitude(Sensors selected, bool with_prediction,
                                      Solution<State>& solution) const noexcept {
    const Matrix3<Scalar>& attitude = solution.center.attitude;
    std::array<Quadric<Scalar, 3>, most_quadrics> quadrics;
    std::size_t count = 0;
    for (std::size_t i = 0; i < measurements.direction_count; ++i) {
      if ((selected & direction_bit(i)) != 0) {
        if (const Status status = cone(attitude, measurements.directions[i], quadrics[count]); status != Status::ok) {
          return status;
        }
        ++count;
      }
    }
    if (!only_directions && (selected & attitude_bit) != 0) {
      if (const Status status = to_quadric(attitude, *measurements.attitude, quadrics[count]); status != Status::ok) {
        return status;
      }
      ++count;
    }
    const Ellipsoid<Scalar, 3> predicted{Vector3<Scalar>::Zero(), known.set.shape.template topLeftCorner<3, 3>()};
    QuadricFusion<Scalar, 3> found;
    found.margin = Scalar(1);
    found.contradiction = QuadricFusion<Scalar, 3>::none;
    const Status status = minimal_intersection(with_prediction ? &predicted : nullptr, quadrics.data(), count,
                                               criterion.template of_first<3>(), found);
    put_search(found, solution.fusion);
    if (status != Status::ok) {
      return status;
    }
    if (!known.has_vector_bound) {
      return Status::unbounded;
    }
    const Vector3<Scalar> offset = known.vector_bound.center - vector_part(solution.center);
    put_product(found, Ellipsoid<Scalar, 3>{offset, known.vector_bound.shape}, solution.fusion);
    solution.used_prediction =
        with_prediction && (found.prediction_alone || found.predicted_multiplier > least_multiplier());
    return Status::ok;
  }
};

}  // namespace elliptude::detail
