// SPDX-License-Identifier: MIT

// The C interface: the guaranteed filters of elliptude.h, compiled once. Compile this file with -ffp-contract=off and
// without -ffast-math (the core refuses that), as cpp/c_interface/CMakeLists.txt does; the rest of a program may have
// any flags.

// One order of sums on every processor.
#ifndef EIGEN_DONT_VECTORIZE
#define EIGEN_DONT_VECTORIZE
#endif
// Functions of templates are the same function in all of a program for the linker. With names of their own those of
// this file are not mixed with what other files make of the same headers with other flags.
#define elliptude elliptude_of_c_interface
#define Eigen Eigen_of_c_interface

#include "elliptude.h"

#include <cstring>
#include <elliptude/base/seal.hpp>
#include <elliptude/base/stamps.hpp>
#include <elliptude/dynamics/potential.hpp>
#include <elliptude/guaranteed/body_flow.hpp>
#include <elliptude/guaranteed/filter.hpp>
#include <elliptude/guaranteed/gyro_flow.hpp>
#include <elliptude/version.hpp>
#include <new>

namespace {

using namespace elliptude;
using Number = elliptude_number;

static_assert(most_directions == ELLIPTUDE_MOST_DIRECTIONS && most_questioned == ELLIPTUDE_MOST_QUESTIONED);
static_assert(static_cast<int>(Status::ok) == ELLIPTUDE_OK &&
              static_cast<int>(Status::zero_direction) == ELLIPTUDE_ZERO_DIRECTION &&
              static_cast<int>(Status::empty_intersection) == ELLIPTUDE_EMPTY_INTERSECTION &&
              static_cast<int>(Status::interrupted) == ELLIPTUDE_INTERRUPTED &&
              static_cast<int>(Status::corrupted) == ELLIPTUDE_CORRUPTED);
static_assert(static_cast<int>(Policy::raise) == ELLIPTUDE_RAISE &&
              static_cast<int>(Policy::drop_measurement) == ELLIPTUDE_DROP_MEASUREMENT &&
              static_cast<int>(Policy::restart) == ELLIPTUDE_RESTART &&
              static_cast<int>(Policy::relaxed) == ELLIPTUDE_RELAXED);
static_assert(static_cast<int>(Claim::unconditional) == ELLIPTUDE_UNCONDITIONAL &&
              static_cast<int>(Claim::conditional) == ELLIPTUDE_CONDITIONAL &&
              static_cast<int>(Claim::none) == ELLIPTUDE_NO_CLAIM);
static_assert(static_cast<int>(Lacks::nothing) == ELLIPTUDE_LACKS_NOTHING &&
              static_cast<int>(Lacks::attitude) == ELLIPTUDE_LACKS_ATTITUDE &&
              static_cast<int>(Lacks::vector) == ELLIPTUDE_LACKS_VECTOR);
static_assert(direction_bit(5) == ELLIPTUDE_DIRECTION_BIT(5) && angular_velocity_bit == ELLIPTUDE_RATE_BIT &&
              attitude_bit == ELLIPTUDE_ATTITUDE_BIT);

// --- from C and to C ---------------------------------------------------------------------------------------------------

[[nodiscard]] elliptude_status code(Status status) noexcept { return static_cast<elliptude_status>(status); }

[[nodiscard]] Vector3<Number> vector(const Number* numbers) noexcept { return {numbers[0], numbers[1], numbers[2]}; }

/// From nine numbers, row by row.
[[nodiscard]] Matrix3<Number> matrix(const Number* numbers) noexcept {
  Matrix3<Number> result;
  for (int i = 0; i < 9; ++i) {
    result(i / 3, i % 3) = numbers[i];
  }
  return result;
}

/// The numbers of a matrix or vector, row by row.
template <typename Matrix>
void write(const Matrix& matrix, Number* numbers) noexcept {
  for (Eigen::Index i = 0; i < matrix.size(); ++i) {
    numbers[i] = matrix(i / matrix.cols(), i % matrix.cols());
  }
}

/// The shape of the ellipsoid with these half-axes, no smaller for rounding.
/// \return `not_finite`; `out_of_range` of a negative one; `beyond_domain`, also of a positive one whose square is not.
[[nodiscard]] Status read_half_axes(const Number* half_axes, Matrix3<Number>& shape) noexcept {
  Matrix3<Number> result = Matrix3<Number>::Zero();
  for (int i = 0; i < 3; ++i) {
    const Number& axis = half_axes[i];
    if (!scalar::isfinite(axis)) {
      return Status::not_finite;
    }
    if (!(axis >= 0)) {
      return Status::out_of_range;
    }
    result(i, i) = rounding::enlarged(axis, rounding::product) * axis;
    if (axis > 0 && !(result(i, i) > 0)) {
      return Status::beyond_domain;
    }
  }
  if (!is_in_domain(result)) {
    return Status::beyond_domain;
  }
  shape = result;
  return Status::ok;
}

[[nodiscard]] BodyInput<Number> body_input(const Number* control_torque, const Number* wheel_momentum) noexcept {
  BodyInput<Number> input;
  if (control_torque != nullptr) {
    input.control_torque = vector(control_torque);
  }
  if (wheel_momentum != nullptr) {
    input.wheel_momentum = vector(wheel_momentum);
  }
  return input;
}

[[nodiscard]] bool is_finite(const BodyInput<Number>& input) noexcept {
  return scalar::all_finite(input.control_torque) && scalar::all_finite(input.wheel_momentum);
}

[[nodiscard]] GuaranteedGyroFlow<Number>::Input gyro_input(const Number* rate) noexcept {
  GuaranteedGyroFlow<Number>::Input input;
  input.is_measured = rate != nullptr;
  input.angular_velocity = rate != nullptr ? vector(rate) : Vector3<Number>(0, 0, 0);
  return input;
}

[[nodiscard]] bool is_finite(const GuaranteedGyroFlow<Number>::Input& input) noexcept {
  return scalar::all_finite(input.angular_velocity);
}

template <typename Settings>
[[nodiscard]] Status read_settings(const elliptude_settings& given, Settings& settings) noexcept {
  if (given.policy < ELLIPTUDE_RAISE || given.policy > ELLIPTUDE_RELAXED || given.criterion < ELLIPTUDE_LEAST_VOLUME ||
      given.criterion > ELLIPTUDE_LEAST_TRACE) {
    return Status::out_of_range;
  }
  using Criterion = SizeCriterion<Number, 6>;
  settings.policy = static_cast<Policy>(given.policy);
  settings.criterion = given.criterion == ELLIPTUDE_LEAST_TRACE ? Criterion::trace() : Criterion::volume();
  settings.most_wrong = given.most_wrong;
  settings.regain_after = given.regain_after;
  settings.keeps_constraints = given.keeps_constraints != 0;
  return Status::ok;
}

[[nodiscard]] elliptude_settings default_settings() noexcept {
  return {static_cast<elliptude_policy>(default_policy), 0, 10, ELLIPTUDE_LEAST_VOLUME, 0};
}

/// Measurements as the core takes them.
struct Measured {
  std::array<Direction<Number>, most_directions> directions;
  AngularVelocity<Number> rate;
  MeasuredAttitude<Number> attitude;
  Measurements<Number> all;

  [[nodiscard]] Status read(const elliptude_measurements& given) noexcept {
    all = Measurements<Number>();
    for (std::size_t i = 0; i < given.direction_count; ++i) {
      const elliptude_direction& one = given.directions[i];
      if (!scalar::isfinite(one.bound)) {
        return Status::not_finite;
      }
      if (!(one.bound > 0)) {
        return Status::out_of_range;
      }
      directions[i] = Direction<Number>::within(vector(one.reference), vector(one.body), one.bound);
    }
    all.directions = directions.data();
    all.direction_count = given.direction_count;
    if (given.rate != nullptr) {
      rate.value = vector(given.rate->value);
      if (const Status status = read_half_axes(given.rate->bound, rate.bound); status != Status::ok) {
        return status;
      }
      all.angular_velocity = &rate;
    }
    if (given.attitude != nullptr) {
      attitude.attitude = matrix(given.attitude->value);
      if (const Status status = read_half_axes(given.attitude->bound, attitude.bound); status != Status::ok) {
        return status;
      }
      all.attitude = &attitude;
    }
    return Status::ok;
  }
};

// --- the filters -------------------------------------------------------------------------------------------------------

template <typename Filter>
[[nodiscard]] Status bound_vector(const Number* half_axes, Filter& filter) noexcept {
  if (half_axes[0] == 0 && half_axes[1] == 0 && half_axes[2] == 0) {
    return Status::ok;
  }
  Ellipsoid<Number, 3> bound{Vector3<Number>::Zero(), Matrix3<Number>::Zero()};
  if (const Status status = read_half_axes(half_axes, bound.shape); status != Status::ok) {
    return status;
  }
  return filter.bound_vector(bound);
}

/// A rigid body's filter. A free body is one without an orbital motion: no torque acts on it.
struct Body {
  using Memory = elliptude_body;
  using Parameters = elliptude_body_parameters;
  using Potential = GravityGradient<Number>;
  using Flow = GuaranteedRigidBodyFlow<Number, Potential>;
  using Filter = GuaranteedFilter<Flow>;
  static constexpr std::uint64_t mark = 0x656c6c6970740001U + sizeof(Number);

  [[nodiscard]] static Status make(const Parameters& parameters, const Number& time, Filter& filter) noexcept {
    RigidBody<Number> body;
    if (const Status status = RigidBody<Number>::make(matrix(parameters.inertia), body); status != Status::ok) {
      return status;
    }
    Potential potential;
    if (const Status status = Potential::make(body, parameters.orbit_rate, matrix(parameters.orbit), potential);
        status != Status::ok) {
      return status;
    }
    BodyUncertainty<Number> uncertainty;
    uncertainty.inertia = parameters.inertia_error;
    if (const Status status = read_half_axes(parameters.torque_bound, uncertainty.torque); status != Status::ok) {
      return status;
    }
    Flow flow;
    if (const Status status = Flow::make(body, potential, parameters.longest_step, uncertainty, flow);
        status != Status::ok) {
      return status;
    }
    if (const Status status = flow.set_most_steps(parameters.most_steps); status != Status::ok) {
      return status;
    }
    typename Filter::Settings settings;
    if (const Status status = read_settings(parameters.settings, settings); status != Status::ok) {
      return status;
    }
    if (const Status status = Filter::make(flow, settings, time, filter); status != Status::ok) {
      return status;
    }
    return bound_vector(parameters.rate_bound, filter);
  }
};

/// The filter of a gyro.
struct Gyro {
  using Memory = elliptude_gyro;
  using Parameters = elliptude_gyro_parameters;
  using Flow = GuaranteedGyroFlow<Number>;
  using Filter = GuaranteedFilter<Flow>;
  using IntervalRate = Flow::IntervalRate;
  static constexpr std::uint64_t mark = 0x656c6c6970740101U + sizeof(Number);
  static_assert(static_cast<int>(IntervalRate::first_sample) == ELLIPTUDE_FIRST_SAMPLE &&
                static_cast<int>(IntervalRate::mean_of_ends) == ELLIPTUDE_MEAN_OF_ENDS &&
                static_cast<int>(IntervalRate::mean) == ELLIPTUDE_MEAN &&
                static_cast<int>(IntervalRate::last_sample) == ELLIPTUDE_LAST_SAMPLE);

  [[nodiscard]] static Status make(const Parameters& parameters, const Number& time, Filter& filter) noexcept {
    // A largest rate of 0 is a body that never turns, or a bound that nobody has stated.
    if (parameters.interval_rate < ELLIPTUDE_FIRST_SAMPLE || parameters.interval_rate > ELLIPTUDE_LAST_SAMPLE ||
        parameters.largest_rate == Number(0)) {
      return Status::out_of_range;
    }
    GyroUncertainty<Number> uncertainty;
    if (const Status status = read_half_axes(parameters.noise, uncertainty.noise); status != Status::ok) {
      return status;
    }
    if (const Status status = read_half_axes(parameters.drift, uncertainty.drift); status != Status::ok) {
      return status;
    }
    uncertainty.scale = parameters.scale;
    uncertainty.angular_acceleration = parameters.angular_acceleration;
    uncertainty.longest_interval = parameters.longest_interval;
    uncertainty.largest_rate = parameters.largest_rate;
    Flow flow;
    if (const Status status = Flow::make(uncertainty, static_cast<IntervalRate>(parameters.interval_rate), flow);
        status != Status::ok) {
      return status;
    }
    typename Filter::Settings settings;
    if (const Status status = read_settings(parameters.settings, settings); status != Status::ok) {
      return status;
    }
    settings.estimates_vector = parameters.estimates_bias != 0;
    if (const Status status = Filter::make(flow, settings, time, filter); status != Status::ok) {
      return status;
    }
    return bound_vector(parameters.bias_bound, filter);
  }
};

/// What the memory of a filter holds.
template <typename Kind>
struct Kept {
  using Stamped = StampedFilter<typename Kind::Filter>;

  std::uint64_t mark;  // that `init` has made it, of which kind, and in which precision
  Stamped stamped;

  static_assert(sizeof(Stamped) + sizeof(std::uint64_t) + sizeof(Seal) <= sizeof(typename Kind::Memory),
                "elliptude.h has too few words for this filter");
  static_assert(alignof(Stamped) <= alignof(typename Kind::Memory));
  static_assert(std::is_trivially_destructible_v<Stamped>);

  [[nodiscard]] typename Kind::Filter& filter() noexcept { return stamped.filter(); }
  [[nodiscard]] const typename Kind::Filter& filter() const noexcept { return stamped.filter(); }
};

/// How many bytes of a filter's memory are sealed: all but those of the seal, which is at the end.
template <typename Kind>
constexpr std::size_t sealed_size = sizeof(typename Kind::Memory) - sizeof(Seal);

/// Seals the memory as it is.
template <typename Kind>
void seal(typename Kind::Memory* memory) noexcept {
  const Seal present = seal_of(memory, sealed_size<Kind>);
  std::memcpy(reinterpret_cast<unsigned char*>(memory) + sealed_size<Kind>, &present, sizeof present);
}

/// \return `ELLIPTUDE_NULL_POINTER`, `ELLIPTUDE_NOT_INITIALIZED`, `ELLIPTUDE_CORRUPTED`.
template <typename Kind>
[[nodiscard]] elliptude_status open(const typename Kind::Memory* memory, const Kept<Kind>*& kept) noexcept {
  static_assert(sizeof(Kept<Kind>) <= sealed_size<Kind> && alignof(Kept<Kind>) <= alignof(typename Kind::Memory));
  if (memory == nullptr) {
    return ELLIPTUDE_NULL_POINTER;
  }
  std::uint64_t mark = 0;
  std::memcpy(&mark, memory->memory, sizeof mark);
  if (mark != Kind::mark) {
    return ELLIPTUDE_NOT_INITIALIZED;
  }
  Seal left;
  std::memcpy(&left, reinterpret_cast<const unsigned char*>(memory) + sealed_size<Kind>, sizeof left);
  if (left != seal_of(memory, sealed_size<Kind>)) {
    return ELLIPTUDE_CORRUPTED;
  }
  kept = std::launder(reinterpret_cast<const Kept<Kind>*>(memory->memory));
  return ELLIPTUDE_OK;
}
template <typename Kind>
[[nodiscard]] elliptude_status open(typename Kind::Memory* memory, Kept<Kind>*& kept) noexcept {
  const Kept<Kind>* found = nullptr;
  const elliptude_status status = open<Kind>(static_cast<const typename Kind::Memory*>(memory), found);
  kept = const_cast<Kept<Kind>*>(found);  // of memory that is not const
  return status;
}

/// \param time that of the filter; it need not be that of its stamp, if it is never predicted to one.
template <typename Kind>
[[nodiscard]] elliptude_status init(typename Kind::Memory* memory, std::size_t size,
                                    const typename Kind::Parameters* parameters, const Number& time, std::int64_t epoch,
                                    std::int64_t stamp) noexcept {
  if (memory == nullptr || parameters == nullptr) {
    return ELLIPTUDE_NULL_POINTER;
  }
  if (size != sizeof(typename Kind::Memory) || parameters->size != sizeof(typename Kind::Parameters)) {
    return ELLIPTUDE_WRONG_SIZE;
  }
  if (const elliptude_status status = elliptude_self_test(); status != ELLIPTUDE_OK) {
    return status;
  }
  typename Kind::Filter made{};  // a filter in use stays as it was if a parameter is wrong
  if (const Status status = Kind::make(*parameters, time, made); status != Status::ok) {
    return code(status);
  }
  std::memset(memory, 0, sizeof *memory);  // filters that were told the same have the same bytes
  new (memory->memory) Kept<Kind>{Kind::mark, {made, epoch, stamp}};
  seal<Kind>(memory);
  return ELLIPTUDE_OK;
}

/// \param limits bits of `limits_hit` beside those that follow from the status and the update.
template <typename Kind>
[[nodiscard]] elliptude_status report_call(const Kept<Kind>* kept, elliptude_status status, std::uint32_t limits,
                                           const GuaranteedUpdate<Number>& update, elliptude_report* report) noexcept {
  if (report == nullptr) {
    return status;
  }
  limits |= status == ELLIPTUDE_TOO_MANY_STEPS ? ELLIPTUDE_LIMIT_STEPS : 0;
  limits |= update.ended_by_limit ? ELLIPTUDE_LIMIT_SEARCH : 0;
  const Trust trust = kept != nullptr ? kept->filter().trust() : Trust();
  report->time = kept != nullptr ? kept->filter().time() : Number(0);
  report->margin = update.margin;
  report->dropped = update.dropped;
  report->contradicting = update.contradicting;
  report->status = status;
  report->claim = static_cast<elliptude_claim>(kept != nullptr ? kept->filter().claim() : Claim::none);
  report->lacks = static_cast<elliptude_lacks>(kept != nullptr ? kept->filter().lacks() : Lacks::vector);
  report->limits_hit = limits;
  report->fusions = update.fusions;
  report->iterations = update.steps;
  report->prediction_used = update.prediction_used ? 1 : 0;
  report->agreeing_updates = trust.agreeing_updates();
  report->disputed_updates = trust.disputed_updates();
  return status;
}

/// \param move predicts a stamped filter.
template <typename Kind, typename Move>
[[nodiscard]] elliptude_status predict(typename Kind::Memory* memory, bool input_is_finite, const Move& move,
                                       elliptude_report* report) noexcept {
  Kept<Kind>* kept = nullptr;
  elliptude_status status = open<Kind>(memory, kept);
  std::uint32_t limits = 0;
  if (status == ELLIPTUDE_OK && !input_is_finite) {
    status = ELLIPTUDE_NOT_FINITE;
  }
  if (status == ELLIPTUDE_OK) {
    const bool knew = kept->filter().knows_attitude();
    status = code(move(kept->stamped));
    limits = knew && !kept->filter().knows_attitude() ? ELLIPTUDE_LIMIT_SET : 0;
    seal<Kind>(memory);
  }
  return report_call<Kind>(kept, status, limits, {}, report);
}

template <typename Kind>
[[nodiscard]] elliptude_status predict_to_time(typename Kind::Memory* memory, const Number& time,
                                               const typename Kind::Flow::Input& input,
                                               elliptude_report* report) noexcept {
  const auto move = [&](auto& stamped) { return stamped.filter().predict(time, input); };
  return predict<Kind>(memory, is_finite(input) && scalar::isfinite(time), move, report);
}
template <typename Kind>
[[nodiscard]] elliptude_status predict_to_stamp(typename Kind::Memory* memory, std::int64_t stamp,
                                                const typename Kind::Flow::Input& input,
                                                elliptude_report* report) noexcept {
  const auto move = [&](auto& stamped) { return stamped.predict(stamp, input); };
  return predict<Kind>(memory, is_finite(input), move, report);
}

template <typename Kind>
[[nodiscard]] elliptude_status update(typename Kind::Memory* memory, const elliptude_measurements* measurements,
                                      elliptude_report* report) noexcept {
  Kept<Kind>* kept = nullptr;
  elliptude_status status = open<Kind>(memory, kept);
  std::uint32_t limits = 0;
  GuaranteedUpdate<Number> done;
  if (status == ELLIPTUDE_OK &&
      (measurements == nullptr || (measurements->directions == nullptr && measurements->direction_count != 0))) {
    status = ELLIPTUDE_NULL_POINTER;
  }
  if (status == ELLIPTUDE_OK && measurements->direction_count > most_directions) {
    status = ELLIPTUDE_OUT_OF_RANGE;
    limits = ELLIPTUDE_LIMIT_DIRECTIONS;
  }
  if (status == ELLIPTUDE_OK) {
    Measured measured;
    status = code(measured.read(*measurements));
    status = status == ELLIPTUDE_OK ? code(kept->filter().update(measured.all, done)) : status;
    seal<Kind>(memory);
  }
  return report_call<Kind>(kept, status, limits, done, report);
}

template <typename Kind>
[[nodiscard]] elliptude_status forget(typename Kind::Memory* memory) noexcept {
  Kept<Kind>* kept = nullptr;
  const elliptude_status status = open<Kind>(memory, kept);
  if (status == ELLIPTUDE_OK) {
    kept->filter().forget();
    seal<Kind>(memory);
  }
  return status;
}

template <typename Kind>
[[nodiscard]] elliptude_status check(const typename Kind::Memory* memory) noexcept {
  const Kept<Kind>* kept = nullptr;
  return open<Kind>(memory, kept);
}

template <typename Kind>
[[nodiscard]] elliptude_status set_of(const typename Kind::Memory* memory, elliptude_set* set) noexcept {
  const Kept<Kind>* kept = nullptr;
  if (const elliptude_status status = open<Kind>(memory, kept); status != ELLIPTUDE_OK) {
    return status;
  }
  if (set == nullptr) {
    return ELLIPTUDE_NULL_POINTER;
  }
  if (!kept->filter().knows_attitude()) {
    return ELLIPTUDE_UNBOUNDED;
  }
  const auto& ellipsoid = kept->filter().ellipsoid();
  set->time = kept->filter().time();
  write(ellipsoid.center.attitude, set->attitude);
  write(vector_part(ellipsoid.center), set->vector);
  write(ellipsoid.shape, set->shape);
  write(half_widths(ellipsoid.in_coordinates()), set->half_widths);
  set->claim = static_cast<elliptude_claim>(kept->filter().claim());
  return ELLIPTUDE_OK;
}

template <typename Kind>
[[nodiscard]] elliptude_status bounds_of(const typename Kind::Memory* memory, const Number* vertical,
                                         elliptude_bounds* bounds) noexcept {
  const Kept<Kind>* kept = nullptr;
  if (const elliptude_status status = open<Kind>(memory, kept); status != ELLIPTUDE_OK) {
    return status;
  }
  if (vertical == nullptr || bounds == nullptr) {
    return ELLIPTUDE_NULL_POINTER;
  }
  AttitudeBounds<Number> found;
  if (const Status status = kept->filter().bounds(vector(vertical), found); status != Status::ok) {
    return code(status);
  }
  *bounds = {found.tilt, found.heading_from, found.heading_to, found.angle};
  return ELLIPTUDE_OK;
}

}  // namespace

// --- what C calls ------------------------------------------------------------------------------------------------------

const char* elliptude_message(elliptude_status status) {
  switch (status) {
    case ELLIPTUDE_NULL_POINTER:
      return "an argument that is needed is NULL";
    case ELLIPTUDE_NOT_INITIALIZED:
      return "the filter was not initialized, or its memory was overwritten";
    case ELLIPTUDE_WRONG_SIZE:
      return "the filter or the parameters have another size than in the library, or the parameters no defaults";
    case ELLIPTUDE_WRONG_ARITHMETIC:
      return "the processor or the compiler does not round as the guarantee needs it";
    default:
      return status >= ELLIPTUDE_OK && status <= ELLIPTUDE_CORRUPTED ? message(static_cast<Status>(status))
                                                                     : "unknown status";
  }
}

const char* elliptude_version(void) { return version_string; }

elliptude_status elliptude_self_test(void) {
  using Limits = std::numeric_limits<Number>;
  // Volatile: calculated here, and not by the compiler.
  const volatile Number one = 1;
  const volatile Number two = 2;
  const volatile Number step = Limits::epsilon();
  const volatile Number least = Limits::min();
  const Number above = one + step;
  const volatile Number half_least = least / two;
  const bool is_not_contracted = above * above - (one + two * step) == 0;  // else ε²
  const bool rounds_to_nearest = one + step / 4 == 1 && one - step / 8 == 1 && one + step * Number(0.75) == above;
  const bool keeps_subnormal = half_least > 0 && half_least * two == least;
  return is_not_contracted && rounds_to_nearest && keeps_subnormal ? ELLIPTUDE_OK : ELLIPTUDE_WRONG_ARITHMETIC;
}

elliptude_status elliptude_body_defaults(elliptude_body_parameters* parameters) {
  if (parameters == nullptr) {
    return ELLIPTUDE_NULL_POINTER;
  }
  *parameters = {};
  parameters->size = sizeof *parameters;
  parameters->settings = default_settings();
  parameters->most_steps = static_cast<std::int32_t>(default_most_steps);
  parameters->longest_step = Number(0.1);
  write(Matrix3<Number>::Identity().eval(), parameters->inertia);
  write(Matrix3<Number>::Identity().eval(), parameters->orbit);
  return ELLIPTUDE_OK;
}

elliptude_status elliptude_body_init(elliptude_body* filter, size_t size, const elliptude_body_parameters* parameters,
                                     elliptude_number time) {
  return init<Body>(filter, size, parameters, time, 0, 0);
}

elliptude_status elliptude_body_init_at_stamp(elliptude_body* filter, size_t size,
                                              const elliptude_body_parameters* parameters, int64_t epoch,
                                              int64_t stamp) {
  return init<Body>(filter, size, parameters, seconds_between<Number>(epoch, stamp), epoch, stamp);
}

elliptude_status elliptude_body_predict(elliptude_body* filter, elliptude_number time,
                                        const elliptude_number control_torque[3],
                                        const elliptude_number wheel_momentum[3], elliptude_report* report) {
  return predict_to_time<Body>(filter, time, body_input(control_torque, wheel_momentum), report);
}

elliptude_status elliptude_body_predict_to_stamp(elliptude_body* filter, int64_t stamp,
                                                 const elliptude_number control_torque[3],
                                                 const elliptude_number wheel_momentum[3], elliptude_report* report) {
  return predict_to_stamp<Body>(filter, stamp, body_input(control_torque, wheel_momentum), report);
}

elliptude_status elliptude_body_update(elliptude_body* filter, const elliptude_measurements* measurements,
                                       elliptude_report* report) {
  return update<Body>(filter, measurements, report);
}

elliptude_status elliptude_body_forget(elliptude_body* filter) { return forget<Body>(filter); }

elliptude_status elliptude_body_check(const elliptude_body* filter) { return check<Body>(filter); }

elliptude_status elliptude_body_set(const elliptude_body* filter, elliptude_set* set) {
  return set_of<Body>(filter, set);
}

elliptude_status elliptude_body_bounds(const elliptude_body* filter, const elliptude_number vertical[3],
                                       elliptude_bounds* bounds) {
  return bounds_of<Body>(filter, vertical, bounds);
}

elliptude_status elliptude_gyro_defaults(elliptude_gyro_parameters* parameters) {
  if (parameters == nullptr) {
    return ELLIPTUDE_NULL_POINTER;
  }
  *parameters = {};
  parameters->size = sizeof *parameters;
  parameters->settings = default_settings();
  parameters->interval_rate = ELLIPTUDE_FIRST_SAMPLE;
  parameters->estimates_bias = 1;
  parameters->longest_interval = -1;
  parameters->largest_rate = -1;
  return ELLIPTUDE_OK;
}

elliptude_status elliptude_gyro_init(elliptude_gyro* filter, size_t size, const elliptude_gyro_parameters* parameters,
                                     elliptude_number time) {
  return init<Gyro>(filter, size, parameters, time, 0, 0);
}

elliptude_status elliptude_gyro_init_at_stamp(elliptude_gyro* filter, size_t size,
                                              const elliptude_gyro_parameters* parameters, int64_t epoch,
                                              int64_t stamp) {
  return init<Gyro>(filter, size, parameters, seconds_between<Number>(epoch, stamp), epoch, stamp);
}

elliptude_status elliptude_gyro_predict(elliptude_gyro* filter, elliptude_number time, const elliptude_number rate[3],
                                        elliptude_report* report) {
  return predict_to_time<Gyro>(filter, time, gyro_input(rate), report);
}

elliptude_status elliptude_gyro_predict_to_stamp(elliptude_gyro* filter, int64_t stamp, const elliptude_number rate[3],
                                                 elliptude_report* report) {
  return predict_to_stamp<Gyro>(filter, stamp, gyro_input(rate), report);
}

elliptude_status elliptude_gyro_update(elliptude_gyro* filter, const elliptude_measurements* measurements,
                                       elliptude_report* report) {
  return update<Gyro>(filter, measurements, report);
}

elliptude_status elliptude_gyro_forget(elliptude_gyro* filter) { return forget<Gyro>(filter); }

elliptude_status elliptude_gyro_check(const elliptude_gyro* filter) { return check<Gyro>(filter); }

elliptude_status elliptude_gyro_set(const elliptude_gyro* filter, elliptude_set* set) {
  return set_of<Gyro>(filter, set);
}

elliptude_status elliptude_gyro_bounds(const elliptude_gyro* filter, const elliptude_number vertical[3],
                                       elliptude_bounds* bounds) {
  return bounds_of<Gyro>(filter, vertical, bounds);
}
