#pragma once

/// \file
/// Includes the whole library, folder by folder, in the order in which data flows.

// clang-format off
#include "elliptude/version.hpp"

#include "elliptude/base/limits.hpp"
#include "elliptude/base/out_of_line.hpp"
#include "elliptude/base/status.hpp"
#include "elliptude/base/unrolling.hpp"
#include "elliptude/base/seal.hpp"
#include "elliptude/base/interruption.hpp"
#include "elliptude/base/elementary.hpp"
#include "elliptude/base/scalar.hpp"
#include "elliptude/base/rounding.hpp"
#include "elliptude/base/so3.hpp"
#include "elliptude/base/stamps.hpp"

#include "elliptude/linear/triangular.hpp"
#include "elliptude/linear/cholesky.hpp"
#include "elliptude/linear/inverse.hpp"
#include "elliptude/linear/eigen.hpp"
#include "elliptude/linear/svd.hpp"
#include "elliptude/linear/norms.hpp"

#include "elliptude/sets/ellipsoid.hpp"
#include "elliptude/sets/sum.hpp"
#include "elliptude/sets/overlap.hpp"
#include "elliptude/sets/intersection.hpp"
#include "elliptude/sets/quadric.hpp"
#include "elliptude/sets/quadric_fusion.hpp"
#include "elliptude/sets/quotient.hpp"
#include "elliptude/sets/projected_fusion.hpp"

#include "elliptude/attitude/chart.hpp"
#include "elliptude/attitude/state.hpp"
#include "elliptude/attitude/state_ellipsoid.hpp"
#include "elliptude/attitude/wahba.hpp"
#include "elliptude/attitude/direction_cones.hpp"
#include "elliptude/attitude/wahba_set.hpp"
#include "elliptude/attitude/attitude_bounds.hpp"
#include "elliptude/attitude/direction_cap.hpp"

#include "elliptude/measurement/types.hpp"
#include "elliptude/measurement/linearization.hpp"
#include "elliptude/measurement/quadrics.hpp"
#include "elliptude/measurement/sensors.hpp"

#include "elliptude/dynamics/rigid_body.hpp"
#include "elliptude/dynamics/composition.hpp"
#include "elliptude/dynamics/exact_rotor.hpp"
#include "elliptude/dynamics/potential.hpp"
#include "elliptude/dynamics/own_potential.hpp"
#include "elliptude/dynamics/integrator.hpp"
#include "elliptude/dynamics/interpolation.hpp"
#include "elliptude/dynamics/linearization.hpp"

#include "elliptude/first_order/flow.hpp"
#include "elliptude/first_order/fusion.hpp"
#include "elliptude/first_order/convergence.hpp"
#include "elliptude/first_order/estimator.hpp"
#include "elliptude/first_order/filter.hpp"

#if defined(__GNUC__)  // and Clang: their vectors
#include "elliptude/ensemble/pack.hpp"
#include "elliptude/ensemble/ensemble.hpp"
#include "elliptude/ensemble/wahba.hpp"
#include "elliptude/first_order/filter_ensemble.hpp"
#endif

#include "elliptude/guaranteed/torque_forms.hpp"
#include "elliptude/guaranteed/torque_expansion.hpp"
#include "elliptude/guaranteed/own_torque_expansion.hpp"
#include "elliptude/guaranteed/motion_series.hpp"
#include "elliptude/guaranteed/error_tube.hpp"
#include "elliptude/guaranteed/body_flow.hpp"
#include "elliptude/guaranteed/gyro_flow.hpp"
#include "elliptude/guaranteed/kept_set.hpp"
#include "elliptude/guaranteed/policy.hpp"
#include "elliptude/guaranteed/settings.hpp"
#include "elliptude/guaranteed/recovery.hpp"
#include "elliptude/guaranteed/update_constraints.hpp"
#include "elliptude/guaranteed/filter.hpp"
#include "elliptude/guaranteed/direction_filter.hpp"

#include "elliptude/smoothing/mirror.hpp"
#include "elliptude/smoothing/common_set.hpp"
#include "elliptude/smoothing/both_directions.hpp"
#include "elliptude/smoothing/backward_pass.hpp"
#include "elliptude/smoothing/fixed_lag.hpp"
// clang-format on
