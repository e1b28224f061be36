#pragma once

/// \file
/// The guaranteed filter: its set holds the state of the continuous motion whenever what it was told of errors holds. (theory,
/// sections 16 to 18)

#include "elliptude/filter.hpp"
#include "elliptude/guaranteed_flow.hpp"
#include "elliptude/quadric_fusion.hpp"

namespace elliptude {

/// What to do with measurements that no predicted state can have caused: some bound is then wrong.
enum class Policy : std::uint8_t {
  raise,             ///< report `empty_intersection`, and leave the filter as it was
  drop_measurement,  ///< leave out as few measurements as make the rest agree with the prediction
  restart,           ///< forget the prediction, and start again from the measurements
  relaxed,           ///< let up to k of the measurements of an update be wrong, whether that shows or not
};

/// What the truth's being in the set rests on.
enum class Claim : std::uint8_t {
  unconditional,  ///< on what the filter was told of errors, for all that it has used
  conditional,    ///< also on that what was dropped on the way was what was wrong
  none,           ///< no set: the attitude is not known
};

/// Measurements of one moment. Those that are null or of length zero were not made.
template <typename Scalar>
struct Measurements {
  const Direction<Scalar>* directions = nullptr;
  std::size_t direction_count = 0;
  const AngularVelocity<Scalar>* angular_velocity = nullptr;
  const MeasuredAttitude<Scalar>* attitude = nullptr;
};

/// One bit for each measurement of an update.
using Sensors = std::uint64_t;

inline constexpr std::size_t most_sensor_directions = 32;
[[nodiscard]] constexpr Sensors direction_bit(std::size_t i) noexcept { return Sensors(1) << i; }
inline constexpr Sensors angular_velocity_bit = Sensors(1) << most_sensor_directions;
inline constexpr Sensors attitude_bit = Sensors(1) << (most_sensor_directions + 1);

/// What a guaranteed update did.
template <typename Scalar>
struct GuaranteedUpdate {
  Claim claim = Claim::none;
  bool prediction_used = false;  ///< whether the prediction made the set smaller than the measurements alone
  Sensors dropped = 0;           ///< which measurements were left out, or are proved wrong
  /// How far the constraints are from having no common point; negative if they had none (`QuadricFusion::margin`).
  Scalar margin = Scalar(1);
  Sensors contradicting = 0;  ///< where the margin is negative: the measurement that weighs most against the rest
};

/// The guaranteed filter, in the Gibbs chart throughout. It may know nothing at all of the attitude, at the beginning or when a
/// prediction has become too large to be of use, and then starts from the next measurements that determine one. A function
/// that does not return `ok` has changed nothing.
template <typename FlowType>
class AttitudeFilter<FlowType, GuaranteedEstimator> {
 public:
  using Flow = FlowType;
  using State = typename Flow::State;
  using Input = typename Flow::Input;
  using Scalar = StateScalar<State>;
  using Set = GibbsEllipsoid<State>;
  static constexpr bool measures_rate = std::is_same_v<State, RigidBodyState<Scalar>>;

  struct Settings {
    SizeCriterion<Scalar, 6> criterion = SizeCriterion<Scalar, 6>::volume();
    Policy policy = Policy::raise;
    /// For `Policy::relaxed`: how many of at most eight measurements may be wrong, 0 to 2.
    int most_wrong = 0;
    /// After how many updates in a row without contradiction a conditional claim ends: the set is then taken from the
    /// measurements of that moment alone, if they bound one.
    int regain_after = 10;
    /// Whether the gyro's bias is part of what is estimated. If it is not, it is in the ellipsoid of `bound_vector`, which is all
    /// that is ever known of it, and the attitude is fused by itself: its sets are smaller, as no part of a sum of constraints
    /// has to bound the bias. (theory, section 16.7)
    bool estimates_vector = true;
  };

  /// A filter that knows nothing at `time`.
  /// \return `not_finite`; `out_of_range` of the settings; what `validate` says of the criterion.
  [[nodiscard]] static Status make(const Flow& flow, const Settings& settings, const Scalar& time,
                                   AttitudeFilter& filter) noexcept {
    if (!scalar::isfinite(time)) {
      return Status::not_finite;
    }
    if (settings.most_wrong < 0 || settings.most_wrong > 2 || settings.regain_after < 1 ||
        (measures_rate && !settings.estimates_vector)) {
      return Status::out_of_range;
    }
    if (const Status status = validate(settings.criterion); status != Status::ok) {
      return status;
    }
    filter.flow_ = flow;
    filter.settings_ = settings;
    filter.time_ = time;
    filter.knows_attitude_ = false;
    filter.knows_vector_ = false;
    filter.bounds_vector_ = false;
    filter.rests_on_drops_ = false;
    filter.claim_ = Claim::none;
    filter.agreeing_updates_ = 0;
    return Status::ok;
  }

  /// The state is in this set now.
  /// \return what `validate` says; `not_positive_definite` of a flat set; `unbounded` of a set that holds half turns.
  template <typename Chart>
  [[nodiscard]] Status start(const StateEllipsoid<State, Chart>& set) noexcept {
    if (const Status status = validate(set); status != Status::ok) {
      return status;
    }
    Matrix6<Scalar> factor;
    if (const Status status = cholesky(set.shape, factor); status != Status::ok) {
      return status;
    }
    if constexpr (std::is_same_v<Chart, GibbsChart>) {
      set_ = set;
    } else {
      if (const Status status = converted(set, set_); status != Status::ok) {
        return status;
      }
    }
    if (!is_rotation(set_.center.attitude, rounding::share<Scalar>(rounding::rotation))) {
      set_.center.attitude = renormalized(set_.center.attitude);  // about the nearest rotation, which rounding turns
      set_.shape = with_attitude_added(set_.shape, Scalar(0), rounding::share<Scalar>(rounding::center), Scalar(0));
    }
    knows_attitude_ = true;
    knows_vector_ = false;
    rests_on_drops_ = false;
    agreeing_updates_ = 0;
    claim_ = Claim::unconditional;
    return Status::ok;
  }

  /// The angular velocity, or the gyro's bias, is in this ellipsoid at all times, rad/s.
  /// \return what `validate` says; `not_positive_definite` of a flat one.
  [[nodiscard]] Status bound_vector(const Ellipsoid<Scalar, 3>& bound) noexcept {
    if (const Status status = validate(bound); status != Status::ok) {
      return status;
    }
    Matrix3<Scalar> factor;
    if (const Status status = cholesky(bound.shape, factor); status != Status::ok) {
      return status;
    }
    vector_bound_ = bound;
    bounds_vector_ = true;
    return Status::ok;
  }

  [[nodiscard]] const Scalar& time() const noexcept { return time_; }
  [[nodiscard]] const Flow& flow() const noexcept { return flow_; }
  [[nodiscard]] const Settings& settings() const noexcept { return settings_; }
  [[nodiscard]] Claim claim() const noexcept { return claim_; }
  /// Whether there is a set; `ellipsoid` is only then of use.
  [[nodiscard]] bool knows_attitude() const noexcept { return knows_attitude_; }
  [[nodiscard]] const Set& ellipsoid() const noexcept { return set_; }
  /// Whether something is known of the angular velocity or the bias while the attitude is not; `vector` is only then of use.
  [[nodiscard]] bool knows_vector() const noexcept { return knows_vector_; }
  [[nodiscard]] const Ellipsoid<Scalar, 3>& vector() const noexcept { return vector_; }
  /// How many updates in a row were without contradiction (`Settings::regain_after`).
  [[nodiscard]] int agreeing_updates() const noexcept { return agreeing_updates_; }

  /// Whether what is known, of the attitude or of the vector, rests on what was dropped.
  [[nodiscard]] bool rests_on_drops() const noexcept { return rests_on_drops_; }

  /// Goes on, bit for bit, as a filter that was stored, after `make` with its settings and time and `bound_vector`.
  /// \param set its set, or null if it did not know the attitude.
  /// \param vector what it knew without the attitude, or null.
  /// \return `out_of_range` of both, or of a negative count; what `validate` says; `not_positive_definite` of a flat one.
  [[nodiscard]] Status resume(const Set* set, const Ellipsoid<Scalar, 3>* vector, bool rests_on_drops,
                              int agreeing_updates) noexcept {
    if (agreeing_updates < 0 || (set != nullptr && vector != nullptr)) {
      return Status::out_of_range;
    }
    if (set != nullptr) {
      if (const Status status = start(*set); status != Status::ok) {
        return status;
      }
    } else if (vector != nullptr) {
      if (const Status status = validate(*vector); status != Status::ok) {
        return status;
      }
      Matrix3<Scalar> factor;
      if (const Status status = cholesky(vector->shape, factor); status != Status::ok) {
        return status;
      }
      vector_ = *vector;
    }
    knows_attitude_ = set != nullptr;
    knows_vector_ = vector != nullptr;
    rests_on_drops_ = rests_on_drops;
    claim_ = !knows_attitude_ ? Claim::none : rests_on_drops ? Claim::conditional : Claim::unconditional;
    agreeing_updates_ = agreeing_updates;
    return Status::ok;
  }

  /// Moves the set to a later time. If it has become too large to be bounded the attitude is forgotten, and what is known of
  /// the vector is kept.
  /// \return what the flow says, but for `unbounded`; `out_of_range` of a time before the filter's.
  [[nodiscard]] Status predict(const Scalar& time, const Input& input) noexcept {
    const Scalar duration = time - time_;
    if (knows_attitude_) {
      Set predicted;
      const Status status = flow_.predict(time_, duration, input, set_, predicted);
      if (status == Status::ok) {
        set_ = predicted;
        time_ = time;
        return Status::ok;
      }
      if (status != Status::unbounded) {
        return status;
      }
    }
    Ellipsoid<Scalar, 3> vector = knows_attitude_ ? vector_of(set_) : vector_;
    const bool knows_vector = knows_attitude_ || knows_vector_;
    if (knows_vector) {
      if (const Status status = flow_.predict_vector(time_, duration, input, vector, vector); status != Status::ok) {
        return status;
      }
    } else if (!scalar::isfinite(duration)) {
      return Status::not_finite;
    } else if (!(duration >= Scalar(0))) {
      return Status::out_of_range;
    }
    vector_ = vector;
    knows_vector_ = knows_vector;
    knows_attitude_ = false;
    claim_ = Claim::none;
    time_ = time;
    return Status::ok;
  }

  /// Fuses all measurements of one moment with the prediction, at once. Where the attitude is not known they may start it.
  /// \return what the measurements' `validate` says; `out_of_range` of too many directions, of an angular velocity given to a
  /// gyro's filter, which has it as input, or of more than eight measurements of which some may be wrong;
  /// `empty_intersection` if they contradict the prediction, or each other, and the policy is to say so.
  [[nodiscard]] Status update(const Measurements<Scalar>& measurements, GuaranteedUpdate<Scalar>& update) noexcept {
    if (measurements.direction_count > most_sensor_directions ||
        (!measures_rate && measurements.angular_velocity != nullptr)) {
      return Status::out_of_range;
    }
    const Sensors all = present(measurements);
    GuaranteedUpdate<Scalar> result;
    Solution solution;
    Status status = Status::ok;
    if (settings_.policy == Policy::relaxed && settings_.most_wrong > 0 && all != 0) {
      status = relaxed(measurements, all, solution, result);
    } else {
      status = solve(measurements, all, knows_attitude_, solution);
      if (status == Status::empty_intersection) {
        result.contradicting = sensor_of(all, solution.fusion.contradiction);
        result.margin = solution.fusion.margin;
        status = resolve(measurements, all, solution, result);
      } else if (status == Status::ok) {
        result.margin = solution.fusion.margin;
      }
    }
    if (status == Status::empty_intersection) {
      update.margin = result.margin;
      update.contradicting = result.contradicting;
    }
    if (status != Status::ok && status != Status::unbounded) {
      return status;
    }
    return accept(measurements, all, status == Status::ok, solution, result, update);
  }

  /// One linear measurement of the error [ζ; δ] about the present center.
  /// \return what `to_quadric` and `minimal_intersection` say; `unbounded` if the attitude is not known.
  template <int Rows>
  [[nodiscard]] Status update(const LinearMeasurement<Scalar, Rows>& measurement,
                              GuaranteedUpdate<Scalar>& update) noexcept {
    if (!knows_attitude_) {
      return Status::unbounded;
    }
    Quadric<Scalar, 6> quadric;
    if (const Status status = to_quadric(measurement, set_, quadric); status != Status::ok) {
      return status;
    }
    const Ellipsoid<Scalar, 6> predicted = set_.in_coordinates();
    QuadricFusion<Scalar, 6> fusion;
    if (const Status status = minimal_intersection(&predicted, &quadric, 1, settings_.criterion, fusion);
        status != Status::ok) {
      if (status == Status::empty_intersection) {
        update.margin = fusion.margin;
      }
      return status;
    }
    if (!fusion.prediction_alone) {
      if (const Status status = recentred(set_.center, fusion.set, set_); status != Status::ok) {
        return status;
      }
    }
    update = {claim_, true, 0, fusion.margin, 0};
    return Status::ok;
  }

 private:
  /// A set of states about a center that is only where its coordinates begin.
  struct Solution {
    State center;
    QuadricFusion<Scalar, 6> fusion;
    bool used_prediction;
  };

  [[nodiscard]] static Ellipsoid<Scalar, 3> vector_of(const Set& set) noexcept {
    return {vector_part(set.center), set.shape.template bottomRightCorner<3, 3>()};
  }

  [[nodiscard]] static Sensors present(const Measurements<Scalar>& measurements) noexcept {
    Sensors all = 0;
    for (std::size_t i = 0; i < measurements.direction_count; ++i) {
      all |= direction_bit(i);
    }
    all |= measurements.angular_velocity != nullptr ? angular_velocity_bit : 0;
    all |= measurements.attitude != nullptr ? attitude_bit : 0;
    return all;
  }

  [[nodiscard]] static int number_of(Sensors sensors) noexcept {
    int count = 0;
    for (; sensors != 0; sensors &= sensors - 1) {
      ++count;
    }
    return count;
  }

  /// Which measurement the constraint of this index is; they come in the order of their bits.
  [[nodiscard]] static Sensors sensor_of(Sensors selected, std::size_t index) noexcept {
    for (; selected != 0; selected &= selected - 1) {
      const Sensors lowest = selected & (~selected + 1);
      if (index == 0) {
        return lowest;
      }
      --index;
    }
    return 0;
  }

  /// A center for the coordinates where there is no prediction: any will do, one near the truth does best. It does not depend
  /// on which measurements are selected.
  [[nodiscard]] Status measured_center(const Measurements<Scalar>& measurements, State& center) const noexcept {
    Vector3<Scalar> vector = Vector3<Scalar>::Zero();
    if (measurements.angular_velocity != nullptr) {
      vector = measurements.angular_velocity->value;
    } else if (!knows_attitude_ && knows_vector_) {
      vector = vector_.center;
    } else if (bounds_vector_) {
      vector = vector_bound_.center;
    }
    Matrix3<Scalar> attitude;
    if (measurements.attitude != nullptr) {
      // Within `rotation_tolerance`, but cones hold about a rotation to rounding.
      attitude = renormalized(measurements.attitude->attitude);
    } else {
      Matrix3<Scalar> profile = Matrix3<Scalar>::Zero();
      for (std::size_t i = 0; i < measurements.direction_count; ++i) {
        const Direction<Scalar>& direction = measurements.directions[i];
        const Scalar weight = Scalar(1) / direction.bound.trace();
        profile += (weight * scalar::unit(direction.reference)) * scalar::unit(direction.body).transpose();
      }
      Scalar condition;
      if (attitude_by_svd(profile, attitude, condition) != Status::ok) {
        return Status::unbounded;
      }
    }
    center = State{attitude, vector};
    return Status::ok;
  }

  /// The smallest ellipsoid about what the selected measurements, and the prediction if wanted, leave possible.
  /// \return `unbounded` if they do not bound the attitude; `empty_intersection`; what `validate` says.
  [[nodiscard]] Status solve(const Measurements<Scalar>& measurements, Sensors selected, bool with_prediction,
                             Solution& solution) const noexcept {
    if (!settings_.estimates_vector) {
      return solve_attitude(measurements, selected, with_prediction, solution);
    }
    std::array<HalfQuadric<Scalar>, most_quadrics> quadrics;
    std::size_t count = 0;
    if (with_prediction) {
      solution.center = set_.center;
    } else if (const Status status = measured_center(measurements, solution.center); status != Status::ok) {
      return checked(measurements, status);
    }
    const Matrix3<Scalar>& attitude = solution.center.attitude;
    const Vector3<Scalar>& vector = vector_part(solution.center);
    Quadric<Scalar, 3> quadric;
    for (std::size_t i = 0; i < measurements.direction_count; ++i) {
      if ((selected & direction_bit(i)) != 0) {
        if (const Status status = cone(attitude, measurements.directions[i], quadric); status != Status::ok) {
          return status;
        }
        quadrics[count++] = of_attitude(quadric);
      }
    }
    if ((selected & angular_velocity_bit) != 0) {
      if (const Status status = to_quadric(vector, *measurements.angular_velocity, quadric); status != Status::ok) {
        return status;
      }
      quadrics[count++] = of_vector(quadric);
    }
    if ((selected & attitude_bit) != 0) {
      if (const Status status = to_quadric(attitude, *measurements.attitude, quadric); status != Status::ok) {
        return status;
      }
      quadrics[count++] = of_attitude(quadric);
    }
    const auto add_vector = [&](const Ellipsoid<Scalar, 3>& known) {
      if (to_quadric(Ellipsoid<Scalar, 3>{known.center - vector, known.shape}, quadric) == Status::ok) {
        quadrics[count++] = of_vector(quadric);
      }
    };
    if (bounds_vector_) {
      add_vector(vector_bound_);
    }
    if (!knows_attitude_ && knows_vector_) {
      add_vector(vector_);
    }
    const Ellipsoid<Scalar, 6> predicted = set_.in_coordinates();
    const Status status = fusion::fuse(with_prediction ? &predicted : nullptr, quadrics.data(), count,
                                       settings_.criterion, solution.fusion);
    solution.used_prediction =
        with_prediction && status == Status::ok &&
        (solution.fusion.prediction_alone || solution.fusion.predicted_multiplier > scalar::constant<Scalar>(1e-6L));
    return status;
  }

  /// As `solve`, of the attitude alone: the vector is in its bound. The state is in the product of both sets, and so in
  /// (1 − s) γᵀP⁻¹γ + s δᵀV⁻¹δ ≤ 1, whose attitudes are larger by no more than s.
  [[nodiscard]] Status solve_attitude(const Measurements<Scalar>& measurements, Sensors selected, bool with_prediction,
                                      Solution& solution) const noexcept {
    if (!bounds_vector_) {
      return Status::unbounded;
    }
    if (with_prediction) {
      solution.center = set_.center;
    } else if (const Status status = measured_center(measurements, solution.center); status != Status::ok) {
      return checked(measurements, status);
    }
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
    if ((selected & attitude_bit) != 0) {
      if (const Status status = to_quadric(attitude, *measurements.attitude, quadrics[count]); status != Status::ok) {
        return status;
      }
      ++count;
    }
    const Ellipsoid<Scalar, 3> predicted{Vector3<Scalar>::Zero(), set_.shape.template topLeftCorner<3, 3>()};
    const SizeCriterion<Scalar, 3> criterion{settings_.criterion.kind == SizeCriterion<Scalar, 6>::Kind::volume
                                                 ? SizeCriterion<Scalar, 3>::Kind::volume
                                                 : SizeCriterion<Scalar, 3>::Kind::weighted_trace,
                                             settings_.criterion.weight.template topLeftCorner<3, 3>()};
    QuadricFusion<Scalar, 3> found;
    found.contradiction = QuadricFusion<Scalar, 3>::none;
    const Status status =
        minimal_intersection(with_prediction ? &predicted : nullptr, quadrics.data(), count, criterion, found);
    solution.fusion.margin = found.margin;
    solution.fusion.contradiction = found.contradiction;
    if (status != Status::ok) {
      return status;
    }
    const Scalar share = scalar::constant<Scalar>(1e-6L);
    const Vector3<Scalar> offset = vector_bound_.center - vector_part(solution.center);
    solution.fusion.set.center << found.set.center, offset;
    solution.fusion.set.shape.setZero();
    solution.fusion.set.shape.template topLeftCorner<3, 3>() = (Scalar(1) / (Scalar(1) - share)) * found.set.shape;
    solution.fusion.set.shape.template bottomRightCorner<3, 3>() = (Scalar(1) / share) * vector_bound_.shape;
    solution.fusion.multipliers = found.multipliers;
    solution.fusion.predicted_multiplier = found.predicted_multiplier;
    solution.fusion.prediction_alone = false;  // what is left of correlations with the vector goes, too
    solution.used_prediction =
        with_prediction && (found.prediction_alone || found.predicted_multiplier > scalar::constant<Scalar>(1e-6L));
    return Status::ok;
  }

  /// Measurements that are not valid are refused also where they would not have been used.
  [[nodiscard]] static Status checked(const Measurements<Scalar>& measurements, Status status) noexcept {
    for (std::size_t i = 0; i < measurements.direction_count; ++i) {
      if (const Status invalid = validate(measurements.directions[i]); invalid != Status::ok) {
        return invalid;
      }
    }
    if (measurements.angular_velocity != nullptr) {
      if (const Status invalid = validate(*measurements.angular_velocity); invalid != Status::ok) {
        return invalid;
      }
    }
    if (measurements.attitude != nullptr) {
      Quadric<Scalar, 3> quadric;
      if (const Status invalid = to_quadric(measurements.attitude->attitude, *measurements.attitude, quadric);
          invalid != Status::ok) {
        return invalid;
      }
    }
    return status;
  }

  /// After a contradiction, by the policy.
  /// \return `unbounded` if measurements that contradict each other are all left out, and the attitude remains unknown.
  [[nodiscard]] Status resolve(const Measurements<Scalar>& measurements, Sensors all, Solution& solution,
                               GuaranteedUpdate<Scalar>& result) const noexcept {
    if (settings_.policy != Policy::drop_measurement && settings_.policy != Policy::restart) {
      return Status::empty_intersection;
    }
    if (settings_.policy == Policy::restart && knows_attitude_) {
      Solution alone;
      if (solve(measurements, all, false, alone) == Status::ok) {
        solution = alone;
        return Status::ok;
      }
    }
    // The fewest that have to go; among as many, those without which the others agree best.
    const auto attempt = [&](Sensors dropped, Scalar& best) {
      Solution trial;
      const Sensors kept = all & ~dropped;
      if (kept == 0 && !knows_attitude_) {
        return;
      }
      if (solve(measurements, kept, knows_attitude_, trial) == Status::ok &&
          (result.dropped == 0 || trial.fusion.margin > best)) {
        best = trial.fusion.margin;
        result.dropped = dropped;
        solution = trial;
      }
    };
    Scalar best(0);
    for (Sensors rest = all; rest != 0; rest &= rest - 1) {
      attempt(rest & (~rest + 1), best);
    }
    if (result.dropped == 0) {
      for (Sensors first = all; first != 0; first &= first - 1) {
        for (Sensors second = first & (first - 1); second != 0; second &= second - 1) {
          attempt((first & (~first + 1)) | (second & (~second + 1)), best);
        }
      }
    }
    if (result.dropped == 0) {
      attempt(all, best);
    }
    if (result.dropped != 0) {
      return Status::ok;
    }
    // Without a prediction, and with none of them to go by: which ones are right is not to be known. What the angular velocity
    // says does not need them.
    result.dropped = all & ~angular_velocity_bit;
    return result.dropped != 0 ? Status::unbounded : Status::empty_intersection;
  }

  /// All states that the prediction allows and that at most `most_wrong` measurements exclude: the union over what may be left
  /// out, in one ellipsoid. Measurements that every consistent choice leaves out are proved wrong.
  [[nodiscard]] Status relaxed(const Measurements<Scalar>& measurements, Sensors all, Solution& solution,
                               GuaranteedUpdate<Scalar>& result) const noexcept {
    if (number_of(all) > 8) {
      return Status::out_of_range;
    }
    if (const Status status = checked(measurements, Status::ok); status != Status::ok) {
      return status;
    }
    bool found = false;
    bool uses_prediction = true;
    Sensors kept_by_some = 0;
    result.margin = Scalar(-1);
    Status failure = Status::ok;
    const auto add = [&](Sensors kept) {
      if (failure != Status::ok) {
        return;  // what one choice leaves unbounded, no other bounds
      }
      Solution trial;
      Status status = knows_attitude_ ? Status::ok : Status::unbounded;
      if (knows_attitude_ || kept != 0) {
        status = solve(measurements, kept, knows_attitude_, trial);
      }
      if (status == Status::empty_intersection) {
        result.contradicting = sensor_of(kept, trial.fusion.contradiction);
        return;
      }
      if (status != Status::ok) {
        failure = status;
        return;
      }
      kept_by_some |= kept;
      result.margin = trial.fusion.margin > result.margin ? trial.fusion.margin : result.margin;
      if (!found) {
        solution = trial;
        found = true;
        uses_prediction = trial.used_prediction;
        return;
      }
      uses_prediction = uses_prediction && trial.used_prediction;
      Ellipsoid<Scalar, 6> both;
      if (const Status joined = enclosing(solution.fusion.set, trial.fusion.set, both); joined != Status::ok) {
        failure = joined;
        return;
      }
      solution.fusion.set = both;
      solution.fusion.prediction_alone = false;
    };
    for_each_subset(all, settings_.most_wrong, add);
    if (failure != Status::ok) {
      return failure;
    }
    if (!found) {
      return Status::empty_intersection;
    }
    solution.used_prediction = uses_prediction;
    result.dropped = all & ~kept_by_some;
    return Status::ok;
  }

  /// Calls `add` with every choice of all but `wrong` of the sensors.
  template <typename Add>
  static void for_each_subset(Sensors all, int wrong, const Add& add) noexcept {
    const int count = number_of(all);
    if (wrong >= count) {
      add(Sensors(0));
      return;
    }
    for (Sensors first = all; first != 0; first &= first - 1) {
      const Sensors one = first & (~first + 1);
      if (wrong == 1) {
        add(all & ~one);
        continue;
      }
      for (Sensors second = first & (first - 1); second != 0; second &= second - 1) {
        add(all & ~one & ~(second & (~second + 1)));
      }
    }
  }

  /// An ellipsoid about two: about the middle of their centers, with a shape that majorises both, and the distance added.
  [[nodiscard]] static Status enclosing(const Ellipsoid<Scalar, 6>& first, const Ellipsoid<Scalar, 6>& second,
                                        Ellipsoid<Scalar, 6>& both) noexcept {
    Matrix6<Scalar> l;
    if (const Status status = cholesky(first.shape, l); status != Status::ok) {
      return status;
    }
    const Matrix6<Scalar> inverse = lower_inverse(l);
    const Matrix6<Scalar> half = inverse.lazyProduct(second.shape);
    SymmetricEigen<Scalar, 6> eigen;
    if (const Status status = symmetric_eigen(Matrix6<Scalar>(half.lazyProduct(inverse.transpose())), eigen);
        status != Status::ok) {
      return status;
    }
    const Matrix6<Scalar> axes = l.lazyProduct(eigen.vectors);
    const Matrix6<Scalar> scaled = axes * eigen.values.cwiseMax(Scalar(1)).asDiagonal();
    Matrix6<Scalar> shape = scaled.lazyProduct(axes.transpose());
    const Vector6<Scalar> offset = scalar::constant<Scalar>(0.5L) * (second.center - first.center);
    shape = enlarged(shape, Matrix6<Scalar>(offset * offset.transpose()));
    both.center = first.center + offset;
    both.shape =
        (scalar::constant<Scalar>(0.5L) + Scalar(64) * Scalar(scalar::epsilon<Scalar>)) * (shape + shape.transpose());
    return Status::ok;
  }

  /// Takes up a solution, or, where the attitude remains unknown, what was measured of the vector.
  [[nodiscard]] Status accept(const Measurements<Scalar>& measurements, Sensors all, bool bounded, Solution& solution,
                              GuaranteedUpdate<Scalar>& result, GuaranteedUpdate<Scalar>& update) noexcept {
    const bool contradicted = result.margin < Scalar(0) || (settings_.policy != Policy::relaxed && result.dropped != 0);
    // Where nothing is taken up there is nothing that could rest on what was left out.
    bool rests_on_drops = rests_on_drops_ || (contradicted && (bounded || knows_attitude_));
    int agreeing = contradicted ? 0 : agreeing_updates_ + (all != 0 ? 1 : 0);
    if (bounded && knows_attitude_ && rests_on_drops && !contradicted && agreeing >= settings_.regain_after) {
      Solution alone;
      if (solve(measurements, all, false, alone) == Status::ok) {
        solution = alone;
        rests_on_drops = false;
      }
    }
    if (bounded) {
      Set next = set_;
      if (!(solution.used_prediction && solution.fusion.prediction_alone)) {
        if (const Status status = recentred(solution.center, solution.fusion.set, next); status == Status::unbounded) {
          bounded = false;  // half turns: the measurements say too little, and what was kept is kept
          rests_on_drops = rests_on_drops_;
        } else if (status != Status::ok) {
          return status;
        }
      }
      if (bounded) {
        set_ = next;
        knows_attitude_ = true;
        knows_vector_ = false;
      }
    }
    const bool may_be_wrong = settings_.policy == Policy::relaxed && settings_.most_wrong > 0;
    if (!bounded && !knows_attitude_ && !may_be_wrong && (all & angular_velocity_bit & ~result.dropped) != 0) {
      const Status status = update_vector(*measurements.angular_velocity, result.margin);
      if (status == Status::empty_intersection && settings_.policy != Policy::raise) {
        rests_on_drops = true;
        if (settings_.policy == Policy::restart) {
          vector_ = {measurements.angular_velocity->value, measurements.angular_velocity->bound};
        } else {
          result.dropped |= angular_velocity_bit;
        }
      } else if (status != Status::ok) {
        if (status == Status::empty_intersection) {
          update.margin = result.margin;
          update.contradicting = angular_velocity_bit;
        }
        return status;
      }
    }
    rests_on_drops_ = rests_on_drops;
    claim_ = !knows_attitude_ ? Claim::none : rests_on_drops ? Claim::conditional : Claim::unconditional;
    agreeing_updates_ = agreeing;
    result.claim = claim_;
    result.prediction_used = bounded && solution.used_prediction;
    update = result;
    return Status::ok;
  }

  /// \param margin set after `empty_intersection`.
  [[nodiscard]] Status update_vector(const AngularVelocity<Scalar>& measured, Scalar& margin) noexcept {
    if (!knows_vector_) {
      vector_ = {measured.value, measured.bound};
      knows_vector_ = true;
      return Status::ok;
    }
    Quadric<Scalar, 3> quadric;
    if (const Status status = to_quadric(vector_.center, measured, quadric); status != Status::ok) {
      return status;
    }
    const Ellipsoid<Scalar, 3> known{Vector3<Scalar>::Zero(), vector_.shape};
    QuadricFusion<Scalar, 3> fusion;
    const Status status = minimal_intersection(&known, &quadric, 1, SizeCriterion<Scalar, 3>::volume(), fusion);
    if (status == Status::ok) {
      vector_ = {vector_.center + fusion.set.center, fusion.set.shape};
    } else if (status == Status::empty_intersection) {
      margin = fusion.margin;
    }
    return status;
  }

  Flow flow_;
  Settings settings_;
  Scalar time_;
  Set set_;                            // where the attitude is known
  Ellipsoid<Scalar, 3> vector_;        // what is known of the vector where it is not
  Ellipsoid<Scalar, 3> vector_bound_;  // what always holds for it
  bool knows_attitude_;
  bool knows_vector_;
  bool bounds_vector_;
  bool rests_on_drops_;  // whether what is known, of the attitude or of the vector, rests on what was dropped
  Claim claim_;
  int agreeing_updates_;
};

/// The guaranteed filter of a flow.
template <typename Flow>
using GuaranteedFilter = AttitudeFilter<Flow, GuaranteedEstimator>;

}  // namespace elliptude
