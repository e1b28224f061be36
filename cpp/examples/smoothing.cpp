// A spacecraft with a gyro whose bias is not known, and a star tracker that sees one star at a time. What was possible
// at a moment is known better when more has been measured: with a fixed lag while the stream runs, and for the whole
// recording at its end.
#include <elliptude/elliptude.hpp>
#include <iostream>
#include <vector>

using namespace elliptude;
using Flow = GuaranteedGyroFlow<double>;
using Filter = GuaranteedFilter<Flow>;
using State = GyroState<double>;

namespace {

double largest_angle_mrad(const GibbsEllipsoid<State>& set) {
  Extent<double> reach;
  return extent(set, reach) == Status::ok ? 1e3 * reach.largest_angle : -1;
}

/// The whole recording, last moment first.
int smooth_recording(const Filter& filter, const std::vector<FilterMoment<Filter>>& moments,
                     const std::vector<State>& truth) {
  BackwardPass<Filter> pass(filter, moments.back());
  for (std::size_t k = moments.size() - 1; k-- > 0;) {
    double form = 0;
    if (pass.to(moments[k]) != Status::ok || pass.smoothed().claim == Claim::none ||
        quadratic_form(pass.smoothed().set, truth[k], form) != Status::ok || !(form <= 1)) {
      return 1;
    }
    if (k % 5 == 0) {
      std::cout << pass.smoothed().time << " s, with the whole recording: within "
                << largest_angle_mrad(pass.smoothed().set) << " mrad\n";
    }
  }
  return pass.has_contradicted() ? 1 : 0;
}

}  // namespace

int main() {
  GyroUncertainty<double> uncertainty;
  uncertainty.noise = ball_shape<3>(1e-4);  // rad/s
  uncertainty.drift = ball_shape<3>(1e-7);  // of the bias, rad/s²
  Flow flow;
  Filter filter;
  constexpr std::size_t lag = 10;
  FixedLag<Filter, lag> stream;
  if (Flow::make(uncertainty, Flow::IntervalRate::mean, flow) != Status::ok ||
      Filter::make(flow, {}, 0.0, filter) != Status::ok ||
      filter.bound_vector({Vector3<double>::Zero(), 1e-4 * Matrix3<double>::Identity()}) != Status::ok) {
    return 1;
  }
  State now{Matrix3<double>::Identity(), Vector3<double>(0.006, -0.004, 0.002)};
  const GibbsEllipsoid<State> start{{exp(Vector3<double>(0.01, 0.02, -0.01)), Vector3<double>::Zero()},
                                    Vector6<double>(2.5e-3, 2.5e-3, 2.5e-3, 1e-4, 1e-4, 1e-4).asDiagonal()};
  if (filter.start(start) != Status::ok || FixedLag<Filter, lag>::make(filter, stream) != Status::ok) {
    return 1;
  }

  const double step = 0.5;
  const Vector3<double> rate(0.02, 0.05, -0.03);
  const std::array<Vector3<double>, 3> stars{Vector3<double>::UnitX(), Vector3<double>::UnitY(),
                                             Vector3<double>::UnitZ()};
  std::vector<FilterMoment<Filter>> moments;
  std::vector<State> truth;
  for (std::size_t k = 0; k <= 20; ++k) {
    PredictedInterval<Filter> interval;
    if (k > 0) {
      interval.duration = step;
      interval.input.angular_velocity = rate + now.gyro_bias + Vector3<double>(6e-5, -4e-5, 3e-5);
      now.attitude = now.attitude * exp(Vector3<double>(step * rate));
      if (stream.predict(step * static_cast<double>(k), interval.input) != Status::ok) {
        return 1;
      }
    }
    const Vector3<double>& star = stars[k % 3];
    const auto seen = Direction<double>::within(
        star, exp(Vector3<double>(0.0005, 0.0007, -0.0004)) * (now.attitude.transpose() * star), 0.001);
    GuaranteedUpdate<double> update;
    if (stream.update(Measurements<double>{&seen, 1, nullptr, nullptr}, update) != Status::ok) {
      return 1;
    }
    moments.push_back(FilterMoment<Filter>::of(stream.filter(), interval));
    truth.push_back(now);
    if (k >= lag && k % 5 == 0) {  // what was possible five seconds ago, by all that was measured until now
      SmoothedSet<State> earlier;
      double form = 0;
      if (stream.smoothed(lag, earlier) != Status::ok || earlier.claim == Claim::none ||
          quadratic_form(earlier.set, truth[k - lag], form) != Status::ok || !(form <= 1)) {
        return 1;
      }
      std::cout << earlier.time << " s: within " << largest_angle_mrad(moments[k - lag].known.set) << " mrad then, "
                << largest_angle_mrad(earlier.set) << " mrad five seconds later\n";
    }
  }
  return smooth_recording(stream.filter(), moments, truth);
}
