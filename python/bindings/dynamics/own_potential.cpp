#include <elliptude/dynamics/own_potential.hpp>

#include "dynamics/built_in_potential.hpp"
#include "module.hpp"

namespace elliptude::python {

namespace {

struct LinearPotentialSettings {
  Vector3<double> moment;
  Vector3<double> direction;
  Vector3<double> turn;
};
using OwnLinearPotential = BuiltIn<LinearPotential<double>, LinearPotentialSettings>;

struct QuadraticPotentialSettings {
  Matrix3<double> matrix;
  Vector3<double> direction;
  Vector3<double> turn;
};
using OwnQuadraticPotential = BuiltIn<QuadraticPotential<double>, QuadraticPotentialSettings>;

/// A torque by functions, with what is stated of it.
class StatedTorquePotential final : public Potential {
 public:
  StatedTorquePotential(PotentialReference torque, const TorqueStatement<double>& statement)
      : torque_(std::move(torque)), statement_(statement) {}

  [[nodiscard]] const PotentialReference& stated() const noexcept { return torque_; }
  [[nodiscard]] const TorqueStatement<double>& statement() const noexcept { return statement_; }

  [[nodiscard]] double energy(const Matrix3<double>& attitude, double time, Failure& failure) const noexcept override {
    return (*torque_).energy(attitude, time, failure);
  }
  [[nodiscard]] Vector3<double> torque(const Matrix3<double>& attitude, double time,
                                       Failure& failure) const noexcept override {
    return (*torque_).torque(attitude, time, failure);
  }
  [[nodiscard]] Matrix3<double> torque_jacobian(const Matrix3<double>& attitude, double time,
                                                Failure& failure) const noexcept override {
    return (*torque_).torque_jacobian(attitude, time, failure);
  }
  [[nodiscard]] std::optional<double> torque_curvature_bound() const override { return statement_.curvature; }
  [[nodiscard]] Added add_to(BoundedPotential& sum) const noexcept override {
    StatedTorque<double, TorqueOfPotential> term;
    const Status status = StatedTorque<double, TorqueOfPotential>::make({&*torque_}, statement_, term);
    return status != Status::ok ? Added::no_bounds : sum.add(term) ? Added::yes : Added::too_many;
  }
  [[nodiscard]] int traverse(visitproc visit, void* argument) const noexcept override {
    return torque_.traverse(visit, argument);
  }

 private:
  PotentialReference torque_;
  TorqueStatement<double> statement_;
};

[[nodiscard]] Vector3<double> turn_or_none(const py::object& turn) {
  return turn.is_none() ? Vector3<double>(Vector3<double>::Zero()) : single(turn, "turn", {3}).vector<3>(0);
}

[[nodiscard]] TurningDirection<double> turning_direction(const Vector3<double>& direction,
                                                         const Vector3<double>& turn) {
  TurningDirection<double> result;
  const Status status = TurningDirection<double>::make(direction, turn, result);
  if (status == Status::out_of_range) {
    value_error("turn must be at right angles to direction, or zero: the direction turns in a plane");
  }
  raise_unless_ok(status, "direction");
  return result;
}

[[nodiscard]] StatedTorquePotential make_stated_torque(const py::object& torque, const py::object& rate,
                                                       const py::object& error, const py::object& curvature) {
  PotentialReference reference(torque, "torque", false);
  TorqueStatement<double> statement;
  if (curvature.is_none()) {
    const std::optional<double> own = (*reference).torque_curvature_bound();
    if (!own) {
      value_error("curvature must be given, as the torque has no torque_curvature_bound() of its own");
    }
    statement.curvature = *own;
  } else {
    statement.curvature = not_negative(curvature, "curvature");
  }
  statement.rate = not_negative(rate, "rate");
  statement.error = not_negative(error, "error");
  return {std::move(reference), statement};
}

/// The parameters of a potential along a direction that may turn.
/// \param strength the one before the direction.
template <typename Core, typename Settings, typename Strength>
void define_along_direction(py::class_<BuiltIn<Core, Settings>, Potential>& potential,
                            const Parameter<Settings, Strength>& strength) {
  define_parameters(
      potential, strength,
      Parameter{"direction", &Settings::direction, "The direction at time 0 as it was given, shape (3,); read-only."},
      Parameter{"turn", &Settings::turn, "Its angular velocity, rad/s, reference axes, shape (3,); read-only."});
}

}  // namespace

void define_own_potentials(py::module_& module) {
  using namespace py::literals;

  py::class_<OwnLinearPotential, Potential> linear(module, "LinearPotential", py::is_final(),
                                                   R"(LinearPotential(moment, direction, turn=None)
--

A potential that is linear in the attitude: U = −pᵀb with b = Cᵀr(t). M = p × b.

A magnetic dipole in a field, a weight, a force at a point of a body that is held. Every potential that is a polynomial of at
most second degree in the entries of C is a sum of linear and quadratic ones.

Parameters
----------
moment : array_like, shape (3,)
    p in N m, body axes: the dipole times the field's strength, or an arm times a force.
direction : array_like, shape (3,)
    r at time 0, reference axes; its length does not count.
turn : array_like, shape (3,), optional
    The angular velocity with which r turns in the reference frame, rad/s, at right angles to it. It stands still if omitted.

Raises
------
ValueError
    If an entry is not finite, the direction is zero, or the turn is not at right angles to it.
)");
  linear.def(
      py::init([](const py::object& moment, const py::object& direction, const py::object& turn) {
        const LinearPotentialSettings settings{single(moment, "moment", {3}).vector<3>(0),
                                               single(direction, "direction", {3}).vector<3>(0), turn_or_none(turn)};
        LinearPotential<double> core;
        raise_unless_ok(
            LinearPotential<double>::make(settings.moment, turning_direction(settings.direction, settings.turn), core),
            "moment");
        return OwnLinearPotential(core, settings);
      }),
      "moment"_a, "direction"_a, "turn"_a = py::none(), "__init__(self, moment, direction, turn=None)\n--\n\n");
  define_along_direction(
      linear, Parameter{"moment", &LinearPotentialSettings::moment, "p in N m, body axes, shape (3,); read-only."});

  py::class_<OwnQuadraticPotential, Potential> quadratic(module, "QuadraticPotential", py::is_final(),
                                                         R"(QuadraticPotential(matrix, direction, turn=None)
--

A potential that is quadratic in the attitude: U = ½ bᵀKb with b = Cᵀr(t). M = b × Kb.

The gravity gradient of any mass (K = 3μ/r³ J), a dipole that a field induces.

Parameters
----------
matrix : array_like, shape (3, 3)
    K in N m, body axes, symmetric. Multiples of the identity do nothing.
direction : array_like, shape (3,)
    r at time 0, reference axes; its length does not count.
turn : array_like, shape (3,), optional
    The angular velocity with which r turns in the reference frame, rad/s, at right angles to it. It stands still if omitted.

Raises
------
ValueError
    If an entry is not finite, the matrix is not symmetric, the direction is zero, or the turn is not at right angles to it.
)");
  quadratic.def(
      py::init([](const py::object& matrix, const py::object& direction, const py::object& turn) {
        const QuadraticPotentialSettings settings{single(matrix, "matrix", {3, 3}).matrix3(0),
                                                  single(direction, "direction", {3}).vector<3>(0), turn_or_none(turn)};
        QuadraticPotential<double> core;
        raise_unless_ok(QuadraticPotential<double>::make(settings.matrix,
                                                         turning_direction(settings.direction, settings.turn), core),
                        "matrix");
        return OwnQuadraticPotential(core, settings);
      }),
      "matrix"_a, "direction"_a, "turn"_a = py::none(), "__init__(self, matrix, direction, turn=None)\n--\n\n");
  define_along_direction(quadratic, Parameter{"matrix", &QuadraticPotentialSettings::matrix,
                                              "K in N m, body axes, shape (3, 3); read-only."});

  py::class_<StatedTorquePotential, Potential>(module, "StatedTorque", py::is_final(),
                                               collectable<StatedTorquePotential>(),
                                               R"(StatedTorque(torque, *, rate, error, curvature=None)
--

A torque by functions of yours, with what you state of it, for a guaranteed flow.

For all attitudes C, times t and s, and all turns ζ up to a half turn, the torque M° that acts on the body obeys

    ‖M°(C exp(S(ζ)), t + s) − M(C, t) − 𝓜(C, t) ζ‖ ≤ error + curvature ‖ζ‖² + rate |s|

with what your functions return as M and 𝓜. It is your statement: the set holds the truth if it is true. The torque need not
have a potential.

Parameters
----------
torque : object
    With the methods ``torque(attitude, time)``, N m, shape (3,), and ``torque_jacobian(attitude, time)``, N m/rad, shape (3, 3),
    as `PotentialLike`; for a flow of first order with ``energy`` too.
rate : float
    How fast the torque changes at a fixed attitude, at most, N m/s; 0 if it does not depend on time.
error : float
    How far the functions may be off, N m: rounding, interpolation, π times the error of the Jacobian. A plain formula in
    double errs by some 1e-14 of its largest products.
curvature : float, optional
    Half of the torque's largest second derivative along any turn, N m/rad²; the torque's own ``torque_curvature_bound()`` if
    omitted.

Raises
------
ValueError
    If a number is not finite or negative, or there is no curvature.
TypeError
    If the torque lacks a method.
)")
      .def(py::init(&make_stated_torque), "torque"_a, py::kw_only(), "rate"_a, "error"_a, "curvature"_a = py::none(),
           "__init__(self, torque, *, rate, error, curvature=None)\n--\n\n")
      .def_property_readonly(
          "stated", [](const StatedTorquePotential& self) { return self.stated().object(); },
          "The torque, as it was given.")
      .def_property_readonly(
          "rate", [](const StatedTorquePotential& self) { return self.statement().rate; },
          "Largest change with time, N m/s.")
      .def_property_readonly(
          "error", [](const StatedTorquePotential& self) { return self.statement().error; },
          "How far the functions may be off, N m.")
      .def_property_readonly(
          "curvature", [](const StatedTorquePotential& self) { return self.statement().curvature; },
          "Half of the largest second derivative, N m/rad².")
      .def("__repr__",
           [](const StatedTorquePotential& self) {
             return py::str("StatedTorque({}, rate={}, error={}, curvature={})")
                 .format(py::repr(self.stated().object()), self.statement().rate, self.statement().error,
                         self.statement().curvature);
           })
      .def(py::pickle(
          [](const StatedTorquePotential& self) {
            return py::make_tuple(self.stated().object(), self.statement().rate, self.statement().error,
                                  self.statement().curvature);
          },
          [](const py::tuple& state) { return make_stated_torque(state[0], state[1], state[2], state[3]); }));
}

}  // namespace elliptude::python
