/// \file
/// The kernels of filter_kernel.hpp for the instruction set that this is compiled for. Before it is included: ELLIPTUDE_FILTERS, the
/// function's name; ELLIPTUDE_WIDTH, how many numbers a register holds; names of their own for `elliptude` and `Eigen`.

#define EIGEN_DONT_VECTORIZE  // the packs are what is vectorised
#include <algorithm>
#include <array>
#include <cstring>
#include <elliptude/first_order/filter_ensemble.hpp>

#include "first_order/filter_kernel.hpp"

// In the library's namespace, so that symbols bear the name of the instruction set.
namespace elliptude::filter_kernel {

namespace {

using namespace elliptude_kernels;

constexpr std::size_t width = ELLIPTUDE_WIDTH;
using Scalar = Pack<double, ELLIPTUDE_WIDTH>;

[[nodiscard]] Matrix3<double> matrix(const double* numbers) noexcept {
  return Eigen::Map<const Matrix3<double>>(numbers);
}

/// A register of the same number of `width` filters from the memory, or into it.
template <int Rows, int Columns>
void load(const FilterMemory& memory, std::size_t number, std::size_t first,
          Matrix<Scalar, Rows, Columns>& packed) noexcept {
  for (std::size_t k = 0; k < std::size_t{Rows * Columns}; ++k) {
    std::memcpy(&packed.data()[k].lanes, memory.numbers + (number + k) * memory.stride + first, sizeof(Scalar));
  }
}
template <int Rows, int Columns>
void store(const Matrix<Scalar, Rows, Columns>& packed, std::size_t number, std::size_t first,
           const FilterMemory& memory) noexcept {
  for (std::size_t k = 0; k < std::size_t{Rows * Columns}; ++k) {
    std::memcpy(memory.numbers + (number + k) * memory.stride + first, &packed.data()[k].lanes, sizeof(Scalar));
  }
}

/// Calls `work(lanes, first, size)` for each group of the block that fits a register.
template <typename Filter, typename Work>
void each_group(const FilterBlock& block, const Work& work) noexcept {
  FilterLanes<Filter, ELLIPTUDE_WIDTH> lanes;
  const FilterMemory& memory = block.memory;
  for (std::size_t first = block.first; first < block.first + block.count; first += width) {
    lanes.size = std::min(width, block.first + block.count - first);
    lanes.time = Scalar(block.time);
    Vector3<Scalar> vector;
    load(memory, FilterMemory::vector, first, vector);
    load(memory, FilterMemory::attitude, first, lanes.ellipsoid.center.attitude);
    lanes.ellipsoid.center = {lanes.ellipsoid.center.attitude, vector};
    load(memory, FilterMemory::shape, first, lanes.ellipsoid.shape);
    load(memory, FilterMemory::transition, first, lanes.transition);
    load(memory, FilterMemory::prior_shape, first, lanes.prior_shape);
    work(lanes, first);
    store(lanes.ellipsoid.center.attitude, FilterMemory::attitude, first, memory);
    store(vector_part(lanes.ellipsoid.center), FilterMemory::vector, first, memory);
    store(lanes.ellipsoid.shape, FilterMemory::shape, first, memory);
    store(lanes.transition, FilterMemory::transition, first, memory);
    store(lanes.prior_shape, FilterMemory::prior_shape, first, memory);
  }
}

[[nodiscard]] SizeCriterion<double, 6> criterion_of(const FilterSettings& settings) noexcept {
  switch (settings.criterion) {
    case FilterSettings::Criterion::trace:
      break;
    case FilterSettings::Criterion::weighted_trace:
      return SizeCriterion<double, 6>::weighted_trace(Eigen::Map<const Matrix6<double>>(settings.weight));
    case FilterSettings::Criterion::volume:
      return SizeCriterion<double, 6>::volume();
  }
  return SizeCriterion<double, 6>::trace();
}

void set_all(Status status, const FilterBlock& block, int* statuses) noexcept {
  std::fill_n(statuses + block.first, block.count, static_cast<int>(status));
}

/// What a prediction is asked for.
struct Prediction {
  const FilterSettings& settings;
  const FilterBlock& block;
  double time;
  const double* inputs;
  std::ptrdiff_t input_stride;
  const Stop& stop;
  int* status;
};

/// A prediction does not depend on the mode: all go the way of one.
template <typename Flow>
void predict_by(const Flow& flow, const Prediction& asked) noexcept {
  using Filter = AttitudeFilter<Flow, PaperEstimator>;
  using Ensemble = FilterEnsemble<Filter, ELLIPTUDE_WIDTH>;
  Ensemble ensemble;
  if (const Status status = Ensemble::make(flow, criterion_of(asked.settings), ensemble); status != Status::ok) {
    set_all(status, asked.block, asked.status);
    return;
  }
  each_group<Filter>(asked.block, [&](auto& lanes, std::size_t first) {
    std::array<typename Filter::Input, width> inputs;
    std::array<Status, width> statuses;
    for (std::size_t i = 0; i < lanes.size; ++i) {
      const auto filter = static_cast<std::ptrdiff_t>(first + i);
      inputs[i] = {Eigen::Map<const Vector3<double>>(asked.inputs + filter * asked.input_stride)};
    }
    ensemble.predict(asked.time, inputs.data(), lanes, statuses.data());
    for (std::size_t i = 0; i < lanes.size; ++i) {
      asked.status[first + i] = static_cast<int>(statuses[i]);
    }
  });
}

template <typename Potential>
void predict_in(const Potential& potential, const Prediction& asked) noexcept {
  const FilterSettings& settings = asked.settings;
  RigidBody<double> body;
  RigidBodyFlow<double, Potential> flow;
  Status status = RigidBody<double>::make(matrix(settings.body.inertia), body);
  if (status == Status::ok) {
    status = RigidBodyFlow<double, Potential>::make(body, potential, settings.body.step, settings.body.order,
                                                    matrix(settings.unknown_torque), flow);
  }
  if (status == Status::ok) {
    status = flow.set_most_steps(settings.most_steps);
  }
  if (status != Status::ok) {
    set_all(status, asked.block, asked.status);
    return;
  }
  flow.set_interruption({asked.stop.asked, asked.stop.context});
  predict_by(flow, asked);
}

void predict_with_gyro(const Prediction& asked) noexcept {
  GyroFlow<double> flow;
  const Status status = GyroFlow<double>::make(matrix(asked.settings.noise), matrix(asked.settings.drift), flow);
  if (status != Status::ok) {
    set_all(status, asked.block, asked.status);
    return;
  }
  predict_by(flow, asked);
}

void predict(const FilterSettings& settings, const FilterBlock& block, double time, const double* inputs,
             std::ptrdiff_t input_stride, const Stop& stop, int* status) noexcept {
  const Prediction asked{settings, block, time, inputs, input_stride, stop, status};
  if (settings.has_gyro) {
    predict_with_gyro(asked);
    return;
  }
  switch (settings.body.potential) {
    case Settings::Potential::free:
      predict_in(FreeBody<double>(), asked);
      return;
    case Settings::Potential::uniform_gravity: {
      UniformGravity<double> gravity;
      const Status made =
          UniformGravity<double>::make(1.0, 1.0, Eigen::Map<const Vector3<double>>(settings.body.moment), gravity);
      made == Status::ok ? predict_in(gravity, asked) : set_all(made, block, status);
      return;
    }
    case Settings::Potential::gravity_gradient: {
      RigidBody<double> acted_on;
      GravityGradient<double> gradient;
      Status made = RigidBody<double>::make(matrix(settings.body.gradient), acted_on);
      if (made == Status::ok) {
        made = GravityGradient<double>::make(acted_on, settings.body.orbit_rate, matrix(settings.body.orbit), gradient);
      }
      made == Status::ok ? predict_in(gradient, asked) : set_all(made, block, status);
      return;
    }
  }
}

/// The directions of the filters of a group, one filter's after the other's.
using Directions = std::array<Direction<double>, width * most_directions>;

void gather(const FilterMeasurements& measured, std::size_t first, std::size_t size, Directions& directions) noexcept {
  for (std::size_t i = 0; i < size; ++i) {
    const auto filter = static_cast<std::ptrdiff_t>(first + i);
    for (std::ptrdiff_t k = 0; k < measured.directions; ++k) {
      directions[i * static_cast<std::size_t>(measured.directions) + static_cast<std::size_t>(k)] = {
          Eigen::Map<const Vector3<double>>(measured.reference + filter * measured.reference_stride + 3 * k),
          Eigen::Map<const Vector3<double>>(measured.body + filter * measured.body_stride + 3 * k),
          matrix(measured.bounds + 9 * k), measured.weights[k]};
    }
  }
}

/// An update does not depend on the flow but for what its state is.
template <typename Flow, typename Estimator>
void update_by(const FilterSettings& settings, const FilterBlock& block, const FilterMeasurements& measured,
               const FilterOutcomes& outcomes) noexcept {
  using Filter = AttitudeFilter<Flow, Estimator>;
  using Ensemble = FilterEnsemble<Filter, ELLIPTUDE_WIDTH>;
  Ensemble ensemble;
  if (const Status status = Ensemble::make(Flow(), criterion_of(settings), ensemble); status != Status::ok) {
    set_all(status, block, outcomes.status);
    return;
  }
  const auto count = static_cast<std::size_t>(measured.directions);
  each_group<Filter>(block, [&](auto& lanes, std::size_t first) {
    Directions directions;
    gather(measured, first, lanes.size, directions);
    std::array<Update<double>, width> updates;
    std::array<Status, width> statuses;
    for (std::size_t i = 0; i < lanes.size; ++i) {
      updates[i] = {outcomes.share[first + i], outcomes.margin[first + i]};
    }
    if constexpr (std::is_same_v<typename Filter::State, RigidBodyState<double>>) {
      if (measured.rate != nullptr) {
        std::array<AngularVelocity<double>, width> rates;
        for (std::size_t i = 0; i < lanes.size; ++i) {
          const auto filter = static_cast<std::ptrdiff_t>(first + i);
          rates[i] = {Eigen::Map<const Vector3<double>>(measured.rate + filter * measured.rate_stride),
                      matrix(measured.rate_bound)};
        }
        ensemble.update(directions.data(), count, rates.data(), lanes, updates.data(), statuses.data());
      } else {
        ensemble.update(directions.data(), count, lanes, updates.data(), statuses.data());
      }
    } else {
      ensemble.update(directions.data(), count, lanes, updates.data(), statuses.data());
    }
    for (std::size_t i = 0; i < lanes.size; ++i) {
      outcomes.status[first + i] = static_cast<int>(statuses[i]);
      outcomes.share[first + i] = updates[i].share;
      outcomes.margin[first + i] = updates[i].margin;
    }
  });
}

void update(const FilterSettings& settings, const FilterBlock& block, const FilterMeasurements& measured,
            const FilterOutcomes& outcomes) noexcept {
  using Body = RigidBodyFlow<double, FreeBody<double>>;
  using Gyro = GyroFlow<double>;
  if (settings.has_gyro) {
    settings.is_first_order ? update_by<Gyro, FirstOrderEstimator>(settings, block, measured, outcomes)
                            : update_by<Gyro, PaperEstimator>(settings, block, measured, outcomes);
  } else {
    settings.is_first_order ? update_by<Body, FirstOrderEstimator>(settings, block, measured, outcomes)
                            : update_by<Body, PaperEstimator>(settings, block, measured, outcomes);
  }
}

}  // namespace

}  // namespace elliptude::filter_kernel

namespace elliptude_kernels {

FilterKernels ELLIPTUDE_FILTERS() noexcept {
  return {&elliptude::filter_kernel::predict, &elliptude::filter_kernel::update};
}

}  // namespace elliptude_kernels
