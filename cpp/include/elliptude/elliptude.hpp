#pragma once

/// \file
/// Everything, in the order in which data passes through it.

// clang-format off
#include "elliptude/version.hpp"
#include "elliptude/status.hpp"
#include "elliptude/interruption.hpp"
#include "elliptude/scalar.hpp"
#include "elliptude/factorization.hpp"
#include "elliptude/so3.hpp"
#include "elliptude/ellipsoid.hpp"
#include "elliptude/intersection.hpp"
#include "elliptude/quadric.hpp"
#include "elliptude/quadric_fusion.hpp"
#include "elliptude/chart.hpp"
#include "elliptude/rigid_body.hpp"
#include "elliptude/potential.hpp"
#include "elliptude/integrator.hpp"
#include "elliptude/linearization.hpp"
#include "elliptude/state.hpp"
#include "elliptude/flow.hpp"
#include "elliptude/torque_expansion.hpp"
#include "elliptude/motion_series.hpp"
#include "elliptude/packed_forms.hpp"
#include "elliptude/error_tube.hpp"
#include "elliptude/guaranteed_flow.hpp"
#include "elliptude/wahba.hpp"
#include "elliptude/wahba_set.hpp"
#include "elliptude/measurement.hpp"
#include "elliptude/fusion.hpp"
#include "elliptude/convergence.hpp"
#include "elliptude/estimator.hpp"
#include "elliptude/filter.hpp"
#include "elliptude/guaranteed_filter.hpp"
// clang-format on
