#include <algorithm>
#include <elliptude/attitude/wahba_set.hpp>

#include "arrays.hpp"
#include "dynamics/ensemble_kernel.hpp"
#include "module.hpp"
#include "threads.hpp"

namespace elliptude::python {

namespace {

/// Directions are rows in Python, which in memory is what Eigen takes for columns.
using Directions = Eigen::Map<const Eigen::Matrix<double, 3, Eigen::Dynamic>>;

[[nodiscard]] WahbaMethod method_of(const std::string& name) {
  if (name == "svd") {
    return WahbaMethod::svd;
  }
  if (name == "foam") {
    return WahbaMethod::foam;
  }
  if (name == "davenport") {
    return WahbaMethod::davenport;
  }
  if (name == "qr") {
    return WahbaMethod::qr;
  }
  value_error("method must be 'svd', 'foam', 'davenport' or 'qr', not '" + name + "'");
}

/// Directions (..., m, 3), none of them zero.
[[nodiscard]] Items directions_argument(const py::object& value, const std::string& name, Index count) {
  Items directions(value, name, {count, 3});
  const py::gil_scoped_release release;
  const Index m = directions.item()[0];
  for (Index i = 0; i < directions.count(); ++i) {
    const Directions columns(directions[i], 3, m);
    for (Index k = 0; k < m; ++k) {
      if (!(columns.col(k).cwiseAbs().maxCoeff() > 0)) {
        Shape shape = directions.leading();
        shape.push_back(m);
        value_error(name + place(shape, i * m + k) + " must be a direction, but its length is 0");
      }
    }
  }
  return directions;
}

[[nodiscard]] Items weights_argument(const py::object& value, Index m) {
  Items weights(value.is_none() ? py::object(to_array(Eigen::VectorXd(Eigen::VectorXd::Ones(m)))) : value, "weights",
                {m});
  const Index count = weights.count();
  for (Index i = 0; i < count; ++i) {
    double total = 0;
    for (Index k = 0; k < m; ++k) {
      const double weight = weights[i][k];
      if (!(weight >= 0)) {
        Shape shape = weights.leading();
        shape.push_back(m);
        value_error("weights must not be negative, but weights" + place(shape, i * m + k) + " is " + text(weight));
      }
      total += weight;
    }
    if (!(total > 0)) {
      value_error(weights.label(i) + " must not be all zero");
    }
  }
  return weights;
}

/// Problems, broadcast, and where their solutions go.
struct WahbaCall {
  Items& references;
  Items& bodies;
  Items& weights;
  Index m;
  Results attitude;
  Results cost;
  Results condition;

  /// \param failed the first problem without a solution, unless all have one.
  [[nodiscard]] Status solve_alone(WahbaMethod method, Index first, Index size, Index& failed) noexcept {
    for (Index i = first; i < first + size; ++i) {
      WahbaSolution<double> solution;
      if (const Status status = solve_wahba(Directions(references[i], 3, m), Directions(bodies[i], 3, m),
                                            Eigen::Map<const Eigen::VectorXd>(weights[i], m), method, solution);
          status != Status::ok) {
        failed = i;
        return status;
      }
      attitude.set(i, solution.attitude);
      cost.set(i, solution.cost);
      condition.set(i, solution.condition);
    }
    return Status::ok;
  }

  /// Several problems in one register.
  [[nodiscard]] Status solve_together(elliptude_kernels::SolveWahba kernel, Index first, Index size,
                                      Index& failed) noexcept {
    const elliptude_kernels::Outcome outcome = kernel(
        {references[first], bodies[first], weights[first], references.stride(), bodies.stride(), weights.stride(), m},
        static_cast<std::size_t>(size), {attitude[first], cost[first], condition[first]});
    failed = first + static_cast<Index>(outcome.body);
    return static_cast<Status>(outcome.status);
  }
};

/// \throws ValueError, what is wrong with problem i.
[[noreturn]] void raise_wahba(const WahbaCall& call, Index i, Status status) {
  const std::string label = call.bodies.label(i);
  if (status == Status::improper_profile) {
    Matrix3<double> profile;
    raise_unless_ok(attitude_profile(Directions(call.references[i], 3, call.m), Directions(call.bodies[i], 3, call.m),
                                     Eigen::Map<const Eigen::VectorXd>(call.weights[i], call.m), profile),
                    label);
    value_error(label + ": method 'qr' needs an attitude profile L with det L > 0 that is not singular, but det L is " +
                text(profile.determinant()) + "; use 'svd' or 'davenport'");
  }
  if (status == Status::attitude_undetermined) {
    value_error(
        label +
        " does not determine the attitude: the directions are collinear, or contradict each other (condition beyond "
        "the limit " +
        text(wahba_condition_limit<double>()) + ")");
  }
  raise(status, label);
}

[[nodiscard]] py::object solve(const py::object& reference, const py::object& body, const py::object& weights,
                               const std::string& method, const py::object& threads) {
  const WahbaMethod chosen = method_of(method);
  // The core looks at each number; only after it has refused one is looked for what to say.
  Items bodies(body, "body", {any_length, 3}, Items::Require::anything);
  const Index m = bodies.item()[0];
  Items references(reference, "reference", {m, 3}, Items::Require::anything);
  Items factors(weights.is_none() ? py::object(to_array(Eigen::VectorXd(Eigen::VectorXd::Ones(m)))) : weights,
                "weights", {m}, Items::Require::anything);
  const Shape leading = broadcast({&references, &bodies, &factors});
  const Index count = count_of(leading);
  const elliptude_kernels::SolveWahba kernel =
      chosen == WahbaMethod::foam ? elliptude_kernels::widest().solve_wahba : nullptr;
  // A thread is worth its start for half a millisecond of work.
  const Index taken = thread_count(threads, static_cast<double>(count * m) / (kernel != nullptr ? 1 << 16 : 1 << 12));
  WahbaCall call{references, bodies, factors, m, Results(leading, {3, 3}), Results(leading, {}), Results(leading, {})};
  FirstFailure failure;
  {
    const py::gil_scoped_release release;
    constexpr Index block = 256;
    in_blocks(count, block, taken, [&](Index first, Index size) {
      Index at = first;
      const Status status =
          kernel != nullptr ? call.solve_together(kernel, first, size, at) : call.solve_alone(chosen, first, size, at);
      if (status != Status::ok) {
        failure.note(at, status);
      }
      return status == Status::ok;
    });
  }
  if (failure.status() != Status::ok) {
    static_cast<void>(directions_argument(body, "body", any_length));
    static_cast<void>(directions_argument(reference, "reference", m));
    static_cast<void>(weights_argument(weights, m));
    raise_wahba(call, failure.item(), failure.status());
  }
  return py::module_::import("elliptude.results")
      .attr("WahbaSolution")(call.attitude.object(), call.cost.object(), call.condition.object());
}

[[nodiscard]] py::tuple complete(const py::object& reference, const py::object& body) {
  Items references = directions_argument(reference, "reference", 2);
  Items bodies = directions_argument(body, "body", 2);
  const Shape leading = broadcast({&references, &bodies});
  Results all_references(leading, {3, 3});
  Results all_bodies(leading, {3, 3});
  {
    const py::gil_scoped_release release;
    const Index count = count_of(leading);
    for (Index i = 0; i < count; ++i) {
      const Matrix<double, 3, 2> e = Directions(references[i], 3, 2);
      const Matrix<double, 3, 2> b = Directions(bodies[i], 3, 2);
      ThreeDirections<double> three;
      const Status status = add_cross_product(e, b, three);
      if (status == Status::attitude_undetermined) {
        value_error(references.label(i) + " or " + bodies.label(i) + " are collinear: they have no cross product");
      }
      if (status != Status::ok) {
        raise(status, bodies.label(i));
      }
      all_references.set(i, three.reference.transpose());
      all_bodies.set(i, three.body.transpose());
    }
  }
  return py::make_tuple(all_references.array(), all_bodies.array());
}

/// One bound for all directions, or one for each, between 0 and π.
[[nodiscard]] Items bounds_argument(const py::object& value, Index m) {
  const Array given = real_array(value, "bounds");
  Items bounds(given.ndim() > 0 ? value : py::object(to_array(Eigen::VectorXd::Constant(m, *given.data()))), "bounds",
               {m});
  const double half_turn = scalar::pi<double>();
  for (Index i = 0; i < bounds.count() * m; ++i) {
    const double bound = bounds[0][i];
    if (!(bound > 0) || !(bound < half_turn)) {
      Shape shape = bounds.leading();
      shape.push_back(m);
      value_error("bounds must be angles between 0 and π, but bounds" + (given.ndim() > 0 ? place(shape, i) : "") +
                  " is " + text(bound));
    }
  }
  return bounds;
}

[[nodiscard]] bool is_exponential(const std::string& chart) {
  if (chart != "exponential" && chart != "gibbs") {
    value_error("chart must be 'exponential' or 'gibbs', not '" + chart + "'");
  }
  return chart == "exponential";
}

[[nodiscard]] WahbaCriterion wahba_criterion_of(const std::string& name) {
  if (name != "trace" && name != "volume") {
    value_error("criterion must be 'trace' or 'volume', not '" + name + "'");
  }
  return name == "trace" ? WahbaCriterion::trace : WahbaCriterion::volume;
}

/// The sum of cones with the least margin among those that `minimal_wahba_set` tries.
[[nodiscard]] Status tightest_cone_sum(const Directions& e, const Directions& b, const Eigen::VectorXd& bounds,
                                       WahbaCriterion criterion, ConeSum<double>& sum) {
  DirectionCones<double> cones;
  if (const Status status = DirectionCones<double>::make(e, b, bounds, cones); status != Status::ok) {
    return status;
  }
  if (const Status status = cones.add_up(cones.weights_by_bound(), sum); status != Status::ok) {
    return status;
  }
  ConeSum<double> other;
  const Status status = cones.add_up(cones.minimal_weights(sum.attitude, criterion), other);
  if (status == Status::ok && other.margin < sum.margin) {
    sum = other;
  }
  return status;
}

template <typename Chart>
[[nodiscard]] py::object set_of_directions(Items& references, Items& bodies, Items& bounds, Items* given_weights,
                                           WahbaCriterion criterion, const std::string& chart) {
  const Index m = bodies.item()[0];
  const Shape leading = given_weights != nullptr ? broadcast({&references, &bodies, &bounds, given_weights})
                                                 : broadcast({&references, &bodies, &bounds});
  Results attitude(leading, {3, 3});
  Results shape(leading, {3, 3});
  Results margin(leading, {});
  Results weights(leading, {m});
  {
    const py::gil_scoped_release release;
    const Index count = count_of(leading);
    for (Index i = 0; i < count; ++i) {
      const Directions e(references[i], 3, m);
      const Directions b(bodies[i], 3, m);
      const Eigen::VectorXd r = bounds.dynamic_vector(i);
      Eigen::VectorXd w(m);
      WahbaSet<double> set;
      Status status = Status::ok;
      if (given_weights != nullptr) {
        w = given_weights->dynamic_vector(i);
        status = wahba_set<Chart>(e, b, r, w, set);
      } else {
        status = minimal_wahba_set<Chart>(e, b, r, criterion, w, set);
      }
      if (status == Status::empty_intersection) {
        ConeSum<double> sum;
        raise_unless_ok(
            given_weights != nullptr ? cone_sum(e, b, r, w, sum) : tightest_cone_sum(e, b, r, criterion, sum),
            bodies.label(i));
        throw InconsistentSets(bodies.label(i) + ": no attitude brings all directions within their bounds (margin " +
                                   text(sum.margin) + "): some bound is wrong",
                               sum.margin);
      }
      if (status == Status::unbounded) {
        value_error(bodies.label(i) +
                    ": half turns are consistent with the directions and their bounds, so that no ellipsoid bounds the "
                    "attitude: too few directions, nearly collinear ones, or bounds too large");
      }
      if (status != Status::ok) {
        raise(status, bodies.label(i));
      }
      attitude.set(i, set.attitude);
      shape.set(i, set.error.shape);
      margin.set(i, set.margin);
      weights.set(i, w);
    }
  }
  return py::module_::import("elliptude.results")
      .attr("WahbaSet")(attitude.object(), shape.object(), chart, margin.object(), weights.object());
}

[[nodiscard]] py::object set_of_attitudes(const py::object& reference, const py::object& body, const py::object& bounds,
                                          const py::object& weights, const std::string& chart,
                                          const std::string& criterion) {
  const bool exponential = is_exponential(chart);
  const WahbaCriterion chosen = wahba_criterion_of(criterion);
  Items bodies = directions_argument(body, "body", any_length);
  const Index m = bodies.item()[0];
  constexpr Index most = DirectionCones<double>::most_directions;
  if (m > most) {
    value_error("body has " + std::to_string(m) + " directions; at most " + std::to_string(most) + " are supported");
  }
  Items references = directions_argument(reference, "reference", m);
  Items angles = bounds_argument(bounds, m);
  if (weights.is_none()) {
    return exponential ? set_of_directions<ExponentialChart>(references, bodies, angles, nullptr, chosen, chart)
                       : set_of_directions<GibbsChart>(references, bodies, angles, nullptr, chosen, chart);
  }
  Items factors = weights_argument(weights, m);
  return exponential ? set_of_directions<ExponentialChart>(references, bodies, angles, &factors, chosen, chart)
                     : set_of_directions<GibbsChart>(references, bodies, angles, &factors, chosen, chart);
}

}  // namespace

void define_wahba(py::module_& module) {
  module.def("wahba", &solve, py::arg("reference"), py::arg("body"), py::arg("weights") = py::none(),
             py::arg("method") = "svd", py::kw_only(), py::arg("threads") = py::none(),
             R"(wahba(reference, body, weights=None, method='svd', *, threads=None)
--

The attitude C that minimises ½ Σ wᵢ ‖eᵢ − C b̃ᵢ‖² (paper, §2.1, eq. wahba).

Directions are rows. They need not be of unit length: only their direction counts. The leading shapes of all arguments
broadcast: many problems are solved in one call, on several threads, and with 'foam' several go through one SIMD register. The numbers
depend on neither, and not on how many problems there are.

Parameters
----------
reference : array_like, shape (..., m, 3)
    Directions eᵢ in reference axes.
body : array_like, shape (..., m, 3)
    The same directions b̃ᵢ as measured in body axes.
weights : array_like, shape (..., m), optional
    wᵢ, not negative, not all zero; ones unless given.
method : {'svd', 'foam', 'davenport', 'qr'}, optional
    'svd' is Markley's; 'foam' his fast one, which falls back on 'svd' where the condition may be above a thousand, and whose
    ``condition`` is right to half of the digits; 'davenport' the q-method; 'qr' the paper's Theorem 1 (eq. soln), which applies only if
    L = Σ wᵢ eᵢ b̃ᵢᵀ has det L > 0. All find the same attitude where they apply.
threads : int, optional
    As many as there are processors and as the work is worth, unless given.

Returns
-------
WahbaSolution
    With ``attitude``, shape (..., 3, 3), from body to reference axes, ``cost``, shape (...), at the minimum, and
    ``condition``, shape (...), the largest over the smallest curvature of the cost there: large if a rotation is almost free.

Raises
------
ValueError
    If an entry is not finite, the shapes do not fit, a direction is zero, a weight is negative or all are zero, the method is
    unknown or does not apply, or the directions do not determine the attitude (collinear, for instance).

Examples
--------
>>> import numpy as np
>>> import elliptude
>>> attitude = elliptude.exp([0.1, 0.2, 0.3])
>>> reference = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
>>> solution = elliptude.wahba(reference, reference @ attitude)
>>> bool(np.allclose(solution.attitude, attitude))
True
)");

  module.def("wahba_set", &set_of_attitudes, py::arg("reference"), py::arg("body"), py::arg("bounds"),
             py::arg("weights") = py::none(), py::arg("chart") = "exponential", py::arg("criterion") = "trace",
             R"(wahba_set(reference, body, bounds, weights=None, chart='exponential', criterion='trace')
--

An ellipsoid that contains every attitude for which each direction is within its bound.

If the angle between Cᵀeᵢ and b̃ᵢ is at most rᵢ for each direction, the true attitude C is in the set: nothing is linearized,
and rounding is on the safe side. Weights decide only how large the set is. (theory, section 15)

Directions are rows. They need not be of unit length: only their direction counts. The leading shapes of all arguments
broadcast. In a batch, the first item without a set raises.

Parameters
----------
reference : array_like, shape (..., m, 3)
    Directions eᵢ in reference axes; m is at most 32.
body : array_like, shape (..., m, 3)
    The same directions b̃ᵢ as measured in body axes.
bounds : float or array_like, shape (..., m)
    rᵢ in rad, between 0 and π: how far a measured direction is at most from the true one.
weights : array_like, shape (..., m), optional
    μᵢ, not negative, not all zero; a direction with weight zero is not used. If omitted, a search finds weights that make the
    ellipsoid small.
chart : {'exponential', 'gibbs'}, optional
    Coordinates of the error: the rotation vector ζ, Ĉᵀ C = exp(S(ζ)), in rad, or γ = 2 tan(θ/2) n, twice the Gibbs vector.
criterion : {'trace', 'volume'}, optional
    What the search makes small; without effect on given weights.

Returns
-------
WahbaSet
    With ``attitude``, shape (..., 3, 3), the Wahba solution for the weights; ``shape``, shape (..., 3, 3), of the ellipsoid of
    errors about it; ``chart``; ``margin``, shape (...), 1 for directions that fit exactly, 0 if a single attitude is left; and
    ``weights``, shape (..., m).

Raises
------
InconsistentMeasurement
    If the directions, added up with the weights, admit no attitude: a proof that some bound is wrong. Contradictions that only
    other weights would show are not found.
ValueError
    If an entry is not finite, the shapes do not fit, a direction is zero, a bound is not between 0 and π, a weight is negative or
    all are zero; or if half turns about the attitude cannot be excluded, so that no ellipsoid bounds the set: with one
    direction, with collinear ones, or with very large bounds.

Examples
--------
>>> import numpy as np
>>> import elliptude
>>> truth = elliptude.exp([0.1, 0.2, 0.3])
>>> reference = np.eye(3)
>>> body = reference @ truth + [0.0, 0.01, -0.01]
>>> found = elliptude.wahba_set(reference, body, np.radians(2.0))
>>> bool(found.contains(truth))
True
>>> float(np.degrees(found.largest_angle()).round(2))
2.42
)");

  module.def("add_cross_product", &complete, py::arg("reference"), py::arg("body"),
             R"(add_cross_product(reference, body)
--

Two directions and, as the paper suggests for m = 2, their cross product as a third, all made unit vectors.

With it the method 'qr' of `wahba` can be used. The third error is not independent of the others and has no bound of its
own, so bounds must not be built on it.

Parameters
----------
reference : array_like, shape (..., 2, 3)
    In reference axes; directions are rows.
body : array_like, shape (..., 2, 3)
    The same directions in body axes.

Returns
-------
reference : ndarray, shape (..., 3, 3)
body : ndarray, shape (..., 3, 3)

Raises
------
ValueError
    If an entry is not finite, a shape does not fit, a direction is zero, or two directions are collinear.
)");
}

}  // namespace elliptude::python
