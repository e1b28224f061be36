#include <elliptude/wahba.hpp>

#include "arrays.hpp"
#include "module.hpp"

namespace elliptude::python {

namespace {

/// Directions are rows in Python, which in memory is what Eigen takes for columns.
using Directions = Eigen::Map<const Eigen::Matrix<double, 3, Eigen::Dynamic>>;

[[nodiscard]] WahbaMethod method_of(const std::string& name) {
  if (name == "svd") {
    return WahbaMethod::svd;
  }
  if (name == "davenport") {
    return WahbaMethod::davenport;
  }
  if (name == "qr") {
    return WahbaMethod::qr;
  }
  value_error("method must be 'svd', 'davenport' or 'qr', not '" + name + "'");
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

[[nodiscard]] py::object solve(const py::object& reference, const py::object& body, const py::object& weights,
                               const std::string& method) {
  const WahbaMethod chosen = method_of(method);
  Items bodies = directions_argument(body, "body", any_length);
  const Index m = bodies.item()[0];
  Items references = directions_argument(reference, "reference", m);
  Items factors = weights_argument(weights, m);
  const Shape leading = broadcast({&references, &bodies, &factors});
  Results attitude(leading, {3, 3});
  Results cost(leading, {});
  Results condition(leading, {});
  {
    const py::gil_scoped_release release;
    const Index count = count_of(leading);
    for (Index i = 0; i < count; ++i) {
      const Directions e(references[i], 3, m);
      const Directions b(bodies[i], 3, m);
      const Eigen::Map<const Eigen::VectorXd> w(factors[i], m);
      WahbaSolution<double> solution;
      const Status status = solve_wahba(e, b, w, chosen, solution);
      if (status == Status::improper_profile) {
        Matrix3<double> profile;
        raise_unless_ok(attitude_profile(e, b, w, profile), bodies.label(i));
        value_error(bodies.label(i) +
                    ": method 'qr' needs an attitude profile L with det L > 0 that is not singular, but "
                    "det L is " +
                    text(profile.determinant()) + "; use 'svd' or 'davenport'");
      }
      if (status == Status::attitude_undetermined) {
        value_error(bodies.label(i) +
                    " does not determine the attitude: the directions are collinear, or contradict each "
                    "other (condition beyond the limit " +
                    text(wahba_condition_limit<double>()) + ")");
      }
      if (status != Status::ok) {
        raise(status, bodies.label(i));
      }
      attitude.set(i, solution.attitude);
      cost.set(i, solution.cost);
      condition.set(i, solution.condition);
    }
  }
  return py::module_::import("elliptude.results")
      .attr("WahbaSolution")(attitude.object(), cost.object(), condition.object());
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

}  // namespace

void define_wahba(py::module_& module) {
  module.def("wahba", &solve, py::arg("reference"), py::arg("body"), py::arg("weights") = py::none(),
             py::arg("method") = "svd", R"(wahba(reference, body, weights=None, method='svd')
--

The attitude C that minimises ½ Σ wᵢ ‖eᵢ − C b̃ᵢ‖² (paper, §2.1, eq. wahba).

Directions are rows. They need not be of unit length: only their direction counts. The leading shapes of all arguments
broadcast.

Parameters
----------
reference : array_like, shape (..., m, 3)
    Directions eᵢ in reference axes.
body : array_like, shape (..., m, 3)
    The same directions b̃ᵢ as measured in body axes.
weights : array_like, shape (..., m), optional
    wᵢ, not negative, not all zero; ones unless given.
method : {'svd', 'davenport', 'qr'}, optional
    'svd' is Markley's, 'davenport' the q-method, 'qr' the paper's Theorem 1 (eq. soln), which applies only if
    L = Σ wᵢ eᵢ b̃ᵢᵀ has det L > 0. All find the same attitude where they apply.

Returns
-------
WahbaSolution
    With ``attitude``, shape (..., 3, 3), from body to reference axes, ``cost``, shape (...), at the minimum, and
    ``condition``, shape (...), the largest over the smallest curvature of the cost there: large where a rotation is almost free.

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

  module.def("add_cross_product", &complete, py::arg("reference"), py::arg("body"),
             R"(add_cross_product(reference, body)
--

Two directions and, as the paper suggests for m = 2, their cross product as a third, all made unit vectors.

With it `wahba` can be solved by its method 'qr'. The third error is not independent of the others and no bound of it is
given, so bounds must not be built on it.

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
