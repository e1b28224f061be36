#include <algorithm>

#include "arrays.hpp"
#include "truth/extrapolation.hpp"

namespace elliptude::python {

namespace {

template <typename Scalar>
[[nodiscard]] truth::Vector<Scalar> vector_at(const double* data) {
  return {Scalar(data[0]), Scalar(data[1]), Scalar(data[2])};
}

template <typename Scalar>
[[nodiscard]] truth::Matrix<Scalar> matrix_at(const double* data) {
  truth::Matrix<Scalar> result{};
  std::copy_n(data, result.size(), result.begin());
  return result;
}

[[nodiscard]] py::object zeros_unless_given(const py::object& given, const Shape& shape) {
  if (!given.is_none()) {
    return given;
  }
  Results zeros({}, shape);
  std::fill_n(zeros[0], count_of(shape), 0.0);
  return zeros.object();
}

/// The motion from each initial state, at all times. `motion_of(i, k)` is that of item i between times k and k + 1.
template <typename Scalar, typename MotionOf>
[[nodiscard]] py::tuple motions(const Items& times, const Items& attitude, const Items& angular_velocity,
                                const Shape& leading, const MotionOf& motion_of) {
  const Index count = count_of(leading);
  const Index rows = times.item()[0];
  Results attitudes_out(leading, {rows, 3, 3});
  Results rates_out(leading, {rows, 3});
  const double* time = times[0];
  {
    const py::gil_scoped_release release;
    for (Index k = 0; k + 1 < rows; ++k) {
      if (!(time[k + 1] > time[k])) {
        value_error("times must increase, but times[" + std::to_string(k + 1) + "] is " + text(time[k + 1]) +
                    " s after " + text(time[k]) + " s");
      }
    }
    for (Index i = 0; i < count; ++i) {
      const truth::Matrix<Scalar> attitude0 = matrix_at<Scalar>(attitude[i]);
      const truth::Vector<Scalar> rate = vector_at<Scalar>(angular_velocity[i]);
      truth::State<Scalar> state{1, 0, 0, 0, rate[0], rate[1], rate[2]};
      Scalar step(rows > 1 ? time[1] - time[0] : 0);
      for (Index k = 0; k < rows; ++k) {
        if (k > 0 &&
            !truth::integrate<Scalar>(motion_of(i, k - 1), Scalar(time[k - 1]), Scalar(time[k]), step, state)) {
          overflow_error("the motion" + place(leading, i) + " cannot be integrated from " + text(time[k - 1]) +
                         " s to " + text(time[k]) + " s");
        }
        const truth::Matrix<Scalar> now = truth::product(attitude0, truth::rotation(state));
        const truth::Vector<Scalar> rate_now = truth::angular_velocity(state);
        std::copy(now.begin(), now.end(), attitudes_out[i] + 9 * k);
        std::copy(rate_now.begin(), rate_now.end(), rates_out[i] + 3 * k);
      }
    }
  }
  return py::make_tuple(attitudes_out.array(), rates_out.array());
}

/// Calls `calculate` with a zero of the scalar to calculate with.
template <typename Calculate>
[[nodiscard]] py::tuple in_precision(bool precise, const Calculate& calculate) {
  return precise ? calculate(0.0L) : calculate(0.0);
}

[[nodiscard]] py::tuple true_motion(const py::object& times, const py::object& attitude,
                                    const py::object& angular_velocity, const py::object& inertia,
                                    const py::object& weighted_center, const py::object& orbit_rate,
                                    const py::object& eccentricity, const py::object& wheel_momentum,
                                    const py::object& torque, bool precise) {
  const Items at = single(times, "times", {any_length});
  const Index intervals = at.item()[0] - 1;
  Items attitude0 = attitudes(attitude, "attitude");
  Items rate0(angular_velocity, "angular_velocity", {3});
  Items torques(zeros_unless_given(torque, {intervals, 3}), "torque", {intervals, 3});
  const Shape leading = broadcast({&attitude0, &rate0, &torques});
  const Items moments = single(inertia, "inertia", {3, 3});
  const Items center = single(zeros_unless_given(weighted_center, {3}), "weighted_center", {3});
  const Items wheels = single(zeros_unless_given(wheel_momentum, {3}), "wheel_momentum", {3});
  const double mean_motion = single(orbit_rate, "orbit_rate", {}).number(0);
  const double of_orbit = single(eccentricity, "eccentricity", {}).number(0);
  if (!(of_orbit >= 0 && of_orbit <= 0.9)) {
    value_error("eccentricity must be from 0 to 0.9, not " + text(of_orbit));
  }
  return in_precision(precise, [&](auto zero) {
    using Scalar = decltype(zero);
    const truth::Matrix<Scalar> j = matrix_at<Scalar>(moments[0]);
    truth::RigidBodyMotion<Scalar> motion{j,
                                          truth::inverse(j),
                                          vector_at<Scalar>(center[0]),
                                          Scalar(mean_motion),
                                          Scalar(of_orbit),
                                          vector_at<Scalar>(wheels[0]),
                                          {},
                                          {}};
    return motions<Scalar>(at, attitude0, rate0, leading, [&](Index i, Index k) {
      motion.attitude0 = matrix_at<Scalar>(attitude0[i]);
      motion.torque = vector_at<Scalar>(torques[i] + 3 * k);
      return motion;
    });
  });
}

[[nodiscard]] py::tuple true_rotation(const py::object& times, const py::object& attitude,
                                      const py::object& angular_velocity, const py::object& angular_acceleration,
                                      bool precise) {
  const Items at = single(times, "times", {any_length});
  Items attitude0 = attitudes(attitude, "attitude");
  Items rate0(angular_velocity, "angular_velocity", {3});
  Items accelerations(angular_acceleration, "angular_acceleration", {at.item()[0] - 1, 3});
  const Shape leading = broadcast({&attitude0, &rate0, &accelerations});
  return in_precision(precise, [&](auto zero) {
    using Scalar = decltype(zero);
    return motions<Scalar>(at, attitude0, rate0, leading, [&](Index i, Index k) {
      return truth::AcceleratedMotion<Scalar>{vector_at<Scalar>(accelerations[i] + 3 * k)};
    });
  });
}

}  // namespace
}  // namespace elliptude::python

PYBIND11_MODULE(_truth, module) {
  using namespace elliptude::python;
  using namespace py::literals;

  py::options options;
  options.disable_function_signatures();
  module.doc() = "True motions to judge the estimators by; nothing here is of the core.";

  module.def(
      "motion", &true_motion, "times"_a, "attitude"_a, "angular_velocity"_a, "inertia"_a, py::kw_only(),
      "weighted_center"_a = py::none(), "orbit_rate"_a = 0.0, "eccentricity"_a = 0.0, "wheel_momentum"_a = py::none(),
      "torque"_a = py::none(), "precise"_a = false,
      R"(motion(times, attitude, angular_velocity, inertia, *, weighted_center=None, orbit_rate=0.0, eccentricity=0.0, wheel_momentum=None, torque=None, precise=False)
--

The continuous motion of rigid bodies, to 1e-13 an interval, by code that shares nothing with the filter.

Parameters
----------
times : (n,) array_like
    s, increasing; the first is that of the initial state.
attitude : (..., 3, 3) array_like
    At times[0], body to reference.
angular_velocity : (..., 3) array_like
    At times[0], rad/s, body axes.
inertia : (3, 3) array_like
    kg m², body axes.
weighted_center : (3,) array_like, optional
    m g ρ of uniform gravity, N m, body axes; the third reference axis points down.
orbit_rate : float
    n of a gravity gradient, rad/s; the radial direction is (cos nt, sin nt, 0).
eccentricity : float
    Eccentricity of the orbit, which is at its perigee, (1, 0, 0), at time 0, with the mean motion n; at most 0.9.
wheel_momentum : (3,) array_like, optional
    Angular momentum of wheels that keep it, N m s, body axes.
torque : (..., n - 1, 3) array_like, optional
    N m, body axes, constant in each interval.
precise : bool
    To 1e-17 an interval, in long double; results are rounded.

Returns
-------
attitudes : (..., n, 3, 3) ndarray
angular_velocities : (..., n, 3) ndarray

Raises
------
ArithmeticError
    OverflowError, if numbers overflow or no step is short enough.
)");
  module.def("rotation", &true_rotation, "times"_a, "attitude"_a, "angular_velocity"_a, "angular_acceleration"_a,
             py::kw_only(), "precise"_a = false,
             R"(rotation(times, attitude, angular_velocity, angular_acceleration, *, precise=False)
--

As `motion`, for bodies whose angular acceleration is given: (..., n - 1, 3), rad/s², body axes, constant in each interval.
)");
}
