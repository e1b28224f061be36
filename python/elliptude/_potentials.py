"""The core's potentials as dictionaries, for filters that are stored."""

from typing import Any

from elliptude import _core


def potential_to_dict(potential: object) -> dict[str, Any]:
    """A built-in potential by its kind and parameters.

    Raises
    ------
    TypeError
        If it is written in Python: JSON cannot hold it, pickle can.
    """
    match potential:
        case _core.FreeBody():
            return {"kind": "free"}
        case _core.UniformGravity():
            return {
                "kind": "uniform_gravity",
                "mass": potential.mass,
                "gravity": potential.gravity,
                "center_of_mass": potential.center_of_mass.tolist(),
            }
        case _core.GravityGradient():
            return {
                "kind": "gravity_gradient",
                "inertia": potential.body.inertia.tolist(),
                "orbit_rate": potential.orbit_rate,
                "orbit": potential.orbit.tolist(),
            }
        case _core.LinearPotential():
            return {
                "kind": "linear",
                "moment": potential.moment.tolist(),
                "direction": potential.direction.tolist(),
                "turn": potential.turn.tolist(),
            }
        case _core.QuadraticPotential():
            return {
                "kind": "quadratic",
                "matrix": potential.matrix.tolist(),
                "direction": potential.direction.tolist(),
                "turn": potential.turn.tolist(),
            }
        case _core.SumPotential():
            return {"kind": "sum", "potentials": [potential_to_dict(term) for term in potential.potentials]}
    raise TypeError(f"a potential of the type {type(potential).__name__} cannot be stored as JSON; use pickle")


def potential_from_dict(fields: dict[str, Any]) -> _core.Potential:
    """The inverse of `potential_to_dict`.

    Raises
    ------
    ValueError
        If there is no such kind.
    """
    match fields["kind"]:
        case "free":
            return _core.FreeBody()
        case "uniform_gravity":
            return _core.UniformGravity(fields["mass"], fields["gravity"], fields["center_of_mass"])
        case "gravity_gradient":
            return _core.GravityGradient(_core.RigidBody(fields["inertia"]), fields["orbit_rate"], fields["orbit"])
        case "linear":
            return _core.LinearPotential(fields["moment"], fields["direction"], fields["turn"])
        case "quadratic":
            return _core.QuadraticPotential(fields["matrix"], fields["direction"], fields["turn"])
        case "sum":
            return _core.SumPotential([potential_from_dict(term) for term in fields["potentials"]])
    raise ValueError(
        f"potential.kind is {fields['kind']!r}, which is none of free, uniform_gravity, gravity_gradient, linear, "
        "quadratic, sum"
    )
