#include <elliptude/base/so3.hpp>
#include <limits>

#include "arrays.hpp"
#include "module.hpp"

namespace elliptude::python {

namespace {

const Shape scalar_item{};
const Shape vector_item{3};
const Shape matrix_item{3, 3};
const Shape quaternion_item{4};

/// A function of a rotation vector or Gibbs vector (..., 3) with values (..., 3, 3).
template <typename Function>
void define_function_of_vector(py::module_& module, const char* name, const char* argument, const char* documentation,
                               const Function& f) {
  module.def(
      name,
      [f, argument](const py::object& value) {
        const Items vectors(value, argument, vector_item);
        return map_items(vectors.leading(), matrix_item, [&](Index i) {
          const Vector3<double> vector = vectors.vector<3>(i);
          if (!scalar::isfinite(vector.squaredNorm())) {
            value_error(vectors.label(i) +
                        " must be shorter than 1e154, where its square overflows, but its length is " +
                        text(scalar::length(vector)));
          }
          return f(vector);
        });
      },
      py::arg(argument), documentation);
}

/// An inverse Jacobian: it exists below a full turn.
template <typename Function>
void define_inverse_jacobian(py::module_& module, const char* name, const char* documentation, const Function& f) {
  module.def(
      name,
      [f](const py::object& rotation_vector) {
        constexpr double full_turn = 6.283185307179586;
        const Items vectors(rotation_vector, "rotation_vector", vector_item);
        return map_items(vectors.leading(), matrix_item, [&](Index i) {
          const Vector3<double> zeta = vectors.vector<3>(i);
          const double angle = scalar::length(zeta);
          if (!(angle < full_turn)) {
            value_error(vectors.label(i) + " must be shorter than a full turn, 2π rad, but its length is " +
                        text(angle));
          }
          return f(zeta);
        });
      },
      py::arg("rotation_vector"), documentation);
}

}  // namespace

void define_rotations(py::module_& module) {
  module.def(
      "hat",
      [](const py::object& vector) {
        const Items vectors(vector, "vector", vector_item);
        return map_items(vectors.leading(), matrix_item, [&](Index i) { return hat(vectors.vector<3>(i)); });
      },
      py::arg("vector"), R"(hat(vector)
--

The skew-symmetric matrix S(x) with S(x) y = x × y (paper, §2.3.1).

Parameters
----------
vector : array_like, shape (..., 3)
    x, in any unit.

Returns
-------
ndarray, shape (..., 3, 3)

Raises
------
ValueError
    If an entry is not finite or the shape is another one.

Examples
--------
>>> import elliptude
>>> elliptude.hat([1.0, 2.0, 3.0])
array([[ 0., -3.,  2.],
       [ 3.,  0., -1.],
       [-2.,  1.,  0.]])
)");

  module.def(
      "vee",
      [](const py::object& matrix) {
        const Items matrices(matrix, "matrix", matrix_item);
        return map_items(matrices.leading(), vector_item, [&](Index i) { return vee(matrices.matrix3(i)); });
      },
      py::arg("matrix"), R"(vee(matrix)
--

The inverse of `hat`; for a general matrix, that of its skew-symmetric part.

Parameters
----------
matrix : array_like, shape (..., 3, 3)

Returns
-------
ndarray, shape (..., 3)

Raises
------
ValueError
    If an entry is not finite or the shape is another one.
)");

  define_function_of_vector(module, "exp", "rotation_vector", R"(exp(rotation_vector)
--

The rotation exp(S(ζ)) of a rotation vector, by Rodrigues' formula (paper, §2).

Parameters
----------
rotation_vector : array_like, shape (..., 3)
    ζ in rad, of any length.

Returns
-------
ndarray, shape (..., 3, 3)

Raises
------
ValueError
    If an entry is not finite or the shape is another one.
)",
                            [](const Vector3<double>& zeta) { return exp(zeta); });

  module.def(
      "log",
      [](const py::object& rotation) {
        const Items rotations = attitudes(rotation, "rotation");
        return map_items(rotations.leading(), vector_item, [&](Index i) { return log(rotations.matrix3(i)); });
      },
      py::arg("rotation"), R"(log(rotation)
--

The rotation vector ζ of a rotation, the inverse of `exp`.

Parameters
----------
rotation : array_like, shape (..., 3, 3), or scipy.spatial.transform.Rotation

Returns
-------
ndarray, shape (..., 3)
    ζ in rad, of length at most π. At a half turn both signs are right, and one is returned.

Raises
------
ValueError
    If a matrix is not a rotation, to within 1.5e-8 in the entries of CᵀC.
)");

  define_function_of_vector(module, "cayley", "gibbs_vector", R"(cayley(gibbs_vector)
--

The rotation I + 2/(1 + cᵀc) (S(c) + S(c)²) of a Gibbs vector.

It reaches every rotation but the half turns.

Parameters
----------
gibbs_vector : array_like, shape (..., 3)
    c = tan(θ/2) n for the rotation by θ about the unit vector n; without a unit.

Returns
-------
ndarray, shape (..., 3, 3)

Raises
------
ValueError
    If an entry is not finite or the shape is another one.
)",
                            [](const Vector3<double>& gibbs) { return cayley(gibbs); });

  module.def(
      "cayley_inverse",
      [](const py::object& rotation) {
        const Items rotations = attitudes(rotation, "rotation");
        return map_items(rotations.leading(), vector_item, [&](Index i) {
          const Vector3<double> gibbs = cayley_inverse(rotations.matrix3(i));
          if (!scalar::all_finite(gibbs)) {
            value_error(rotations.label(i) + " is a half turn, which has no Gibbs vector");
          }
          return gibbs;
        });
      },
      py::arg("rotation"), R"(cayley_inverse(rotation)
--

The Gibbs vector c = tan(θ/2) n of a rotation, the inverse of `cayley`.

Parameters
----------
rotation : array_like, shape (..., 3, 3), or scipy.spatial.transform.Rotation

Returns
-------
ndarray, shape (..., 3)

Raises
------
ValueError
    If a matrix is not a rotation, or is a half turn.
)");

  define_function_of_vector(module, "right_jacobian", "rotation_vector", R"(right_jacobian(rotation_vector)
--

The right Jacobian of the exponential map.

exp(S(ζ + δ)) = exp(S(ζ)) exp(S(J_r(ζ) δ)) to first order in δ;
J_r = I − (1 − cos θ)/θ² S(ζ) + (θ − sin θ)/θ³ S(ζ)².

Parameters
----------
rotation_vector : array_like, shape (..., 3)
    ζ in rad.

Returns
-------
ndarray, shape (..., 3, 3)

Raises
------
ValueError
    If an entry is not finite or the shape is another one.
)",
                            [](const Vector3<double>& zeta) { return right_jacobian(zeta); });

  define_function_of_vector(module, "left_jacobian", "rotation_vector", R"(left_jacobian(rotation_vector)
--

The left Jacobian of the exponential map, J_l(ζ) = J_r(−ζ).

exp(S(ζ + δ)) = exp(S(J_l(ζ) δ)) exp(S(ζ)) to first order in δ.

Parameters
----------
rotation_vector : array_like, shape (..., 3)
    ζ in rad.

Returns
-------
ndarray, shape (..., 3, 3)

Raises
------
ValueError
    If an entry is not finite or the shape is another one.
)",
                            [](const Vector3<double>& zeta) { return left_jacobian(zeta); });

  define_inverse_jacobian(module, "right_jacobian_inverse", R"(right_jacobian_inverse(rotation_vector)
--

The inverse of `right_jacobian`.

log(exp(S(ζ)) exp(S(δ))) = ζ + J_r⁻¹(ζ) δ to first order in δ;
J_r⁻¹ = I + ½ S(ζ) + (1 − (θ/2) cot(θ/2))/θ² S(ζ)².

Parameters
----------
rotation_vector : array_like, shape (..., 3)
    ζ in rad, shorter than a full turn.

Returns
-------
ndarray, shape (..., 3, 3)

Raises
------
ValueError
    If an entry is not finite, the shape is another one, or ‖ζ‖ ≥ 2π.
)",
                          [](const Vector3<double>& zeta) { return right_jacobian_inverse(zeta); });

  define_inverse_jacobian(module, "left_jacobian_inverse", R"(left_jacobian_inverse(rotation_vector)
--

The inverse of `left_jacobian`.

log(exp(S(δ)) exp(S(ζ))) = ζ + J_l⁻¹(ζ) δ to first order in δ.

Parameters
----------
rotation_vector : array_like, shape (..., 3)
    ζ in rad, shorter than a full turn.

Returns
-------
ndarray, shape (..., 3, 3)

Raises
------
ValueError
    If an entry is not finite, the shape is another one, or ‖ζ‖ ≥ 2π.
)",
                          [](const Vector3<double>& zeta) { return left_jacobian_inverse(zeta); });

  module.def(
      "project_to_rotation",
      [](const py::object& matrix) {
        const Items matrices(matrix, "matrix", matrix_item);
        return map_items(matrices.leading(), matrix_item, [&](Index i) {
          const Matrix3<double> m = matrices.matrix3(i);
          Matrix3<double> rotation;
          if (const Status status = project_to_rotation(m, rotation); status != Status::ok) {
            value_error(matrices.label(i) +
                        " has no nearest rotation: its determinant must be positive (and not rounding), "
                        "but is " +
                        text(m.determinant()));
          }
          return rotation;
        });
      },
      py::arg("matrix"), R"(project_to_rotation(matrix)
--

The rotation nearest to a matrix in the Frobenius norm, its orthogonal polar factor.

Parameters
----------
matrix : array_like, shape (..., 3, 3)
    With a positive determinant.

Returns
-------
ndarray, shape (..., 3, 3)

Raises
------
ValueError
    If an entry is not finite, or the determinant is not positive or so small that the nearest rotation is not determined.
)");

  module.def(
      "renormalized",
      [](const py::object& rotation) {
        const Items rotations = attitudes(rotation, "rotation");
        return map_items(rotations.leading(), matrix_item, [&](Index i) { return renormalized(rotations.matrix3(i)); });
      },
      py::arg("rotation"), R"(renormalized(rotation)
--

Brings a rotation that has drifted by rounding back to a rotation: X (3I − XᵀX)/2.

One Newton step of the polar decomposition. For a matrix farther from a rotation use `project_to_rotation`.

Parameters
----------
rotation : array_like, shape (..., 3, 3), or scipy.spatial.transform.Rotation

Returns
-------
ndarray, shape (..., 3, 3)

Raises
------
ValueError
    If a matrix is not a rotation, to within 1.5e-8 in the entries of CᵀC.
)");

  module.def(
      "is_rotation",
      [](const py::object& matrix, const py::object& tolerance) {
        const Items matrices(matrix, "matrix", matrix_item, Items::Require::anything);
        double limit = rotation_tolerance<double>();
        if (!tolerance.is_none()) {
          limit = single(tolerance, "tolerance", scalar_item).number(0);
          if (!(limit >= 0)) {
            value_error("tolerance must not be negative, but is " + text(limit));
          }
        }
        return map_questions(matrices.leading(), [&](Index i) { return is_rotation(matrices.matrix3(i), limit); });
      },
      py::arg("matrix"), py::arg("tolerance") = py::none(), R"(is_rotation(matrix, tolerance=None)
--

Whether a matrix C is a rotation.

Parameters
----------
matrix : array_like, shape (..., 3, 3)
    A matrix with NaN or an infinity is not a rotation.
tolerance : float, optional
    Largest size of an entry of CᵀC − I; √ε = 1.5e-8 unless given.

Returns
-------
bool or ndarray of bool, shape (...)

Raises
------
ValueError
    If the shape is another one or the tolerance is negative.
)");

  module.def(
      "quaternion_from_rotation",
      [](const py::object& rotation) {
        const Items rotations = attitudes(rotation, "rotation");
        return map_items(rotations.leading(), quaternion_item, [&](Index i) {
          const Quaternion<double> q = to_quaternion(rotations.matrix3(i));
          return Vector<double, 4>(q.w, q.vector.x(), q.vector.y(), q.vector.z());
        });
      },
      py::arg("rotation"), R"(quaternion_from_rotation(rotation)
--

The unit quaternion (qw, qx, qy, qz) of a rotation, scalar first, with qw ≥ 0.

SciPy's own order is (qx, qy, qz, qw).

Parameters
----------
rotation : array_like, shape (..., 3, 3), or scipy.spatial.transform.Rotation

Returns
-------
ndarray, shape (..., 4)
    (cos(θ/2), sin(θ/2) n) for the rotation by θ about the unit vector n.

Raises
------
ValueError
    If a matrix is not a rotation.
)");

  module.def(
      "rotation_from_quaternion",
      [](const py::object& quaternion) {
        const Items quaternions(quaternion, "quaternion", quaternion_item);
        return map_items(quaternions.leading(), matrix_item, [&](Index i) {
          const Vector<double, 4> q = quaternions.vector<4>(i);
          const double size = q.cwiseAbs().maxCoeff();
          if (!(size > 0)) {
            value_error(quaternions.label(i) + " must not be zero");
          }
          // Scaled so that squares neither overflow nor vanish.
          const Vector<double, 4> scaled = q / size;
          return to_rotation(Quaternion<double>{scaled(0), scaled.tail<3>()});
        });
      },
      py::arg("quaternion"), R"(rotation_from_quaternion(quaternion)
--

The rotation of a quaternion (qw, qx, qy, qz), scalar first.

SciPy's own order is (qx, qy, qz, qw).

Parameters
----------
quaternion : array_like, shape (..., 4)
    Of any length except zero.

Returns
-------
ndarray, shape (..., 3, 3)

Raises
------
ValueError
    If an entry is not finite, the shape is another one, or a quaternion is zero.
)");
}

}  // namespace elliptude::python
