"""The core's potentials, a row for each: how it is stored, and what it is backward in time.

A new potential of the core has a row in `POTENTIALS`; CONTRIBUTING.md says what else it needs.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from elliptude import _core

_BACKWARD_ORBIT = np.diag([1.0, -1.0, -1.0])
"""An orbit that is run through backward: its direction of motion and its normal turn round."""


@dataclass(frozen=True)
class Row:
    """What the package knows of a potential."""

    type: Callable[..., _core.Potential]
    """The core's class."""
    parameters: tuple[str, ...]
    """What its constructor takes, in this order; it has a property of each name."""
    backward: Mapping[str, Callable[[Any], Any]] = field(default_factory=dict)
    """What becomes of those parameters that are others at the time −t."""

    def values_of(self, potential: _core.Potential) -> dict[str, Any]:
        """Its parameters by name."""
        return {name: getattr(potential, name) for name in self.parameters}


POTENTIALS = {
    "free": Row(_core.FreeBody, ()),
    "uniform_gravity": Row(_core.UniformGravity, ("mass", "gravity", "center_of_mass")),
    "gravity_gradient": Row(
        _core.GravityGradient, ("body", "orbit_rate", "orbit"), {"orbit": lambda orbit: orbit @ _BACKWARD_ORBIT}
    ),
    "linear": Row(_core.LinearPotential, ("moment", "direction", "turn"), {"turn": np.negative}),
    "quadratic": Row(_core.QuadraticPotential, ("matrix", "direction", "turn"), {"turn": np.negative}),
}
"""The potentials by their kind, their name in files. Those made of other potentials or of functions have no row."""


def kind_of(potential: object) -> str | None:
    """The kind of one of the core's potentials, None of anything else."""
    return next((kind for kind, row in POTENTIALS.items() if type(potential) is row.type), None)


def names() -> str:
    """The potentials that a guaranteed flow takes, for messages."""
    return ", ".join(getattr(row.type, "__name__", kind) for kind, row in POTENTIALS.items())


def backward(potential: _core.Potential) -> _core.Potential | None:
    """One of the core's potentials at the time −t; None of a potential that is not in the table."""
    kind = kind_of(potential)
    if kind is None:
        return None
    row = POTENTIALS[kind]
    return row.type(*(row.backward.get(name, _same)(value) for name, value in row.values_of(potential).items()))


def _same(value: Any) -> Any:
    return value


def potential_to_dict(potential: object) -> dict[str, Any]:
    """A built-in potential by its kind and parameters.

    Raises
    ------
    TypeError
        If it is written in Python: JSON cannot hold it, pickle can.
    """
    if isinstance(potential, _core.SumPotential):
        return {"kind": "sum", "potentials": [potential_to_dict(term) for term in potential.potentials]}
    kind = kind_of(potential)
    if kind is None or not isinstance(potential, _core.Potential):
        raise TypeError(f"a potential of the type {type(potential).__name__} cannot be stored as JSON; use pickle")
    fields: dict[str, Any] = {"kind": kind}
    for name, value in POTENTIALS[kind].values_of(potential).items():
        if isinstance(value, _core.RigidBody):
            fields["inertia"] = value.inertia.tolist()
        else:
            fields[name] = value.tolist() if isinstance(value, np.ndarray) else value
    return fields


def potential_from_dict(fields: dict[str, Any]) -> _core.Potential:
    """The inverse of `potential_to_dict`.

    Raises
    ------
    ValueError
        If there is no such kind.
    """
    kind = fields["kind"]
    if kind == "sum":
        return _core.SumPotential([potential_from_dict(term) for term in fields["potentials"]])
    if not isinstance(kind, str) or kind not in POTENTIALS:
        raise ValueError(f"potential.kind is {kind!r}, which is none of {', '.join(POTENTIALS)}, sum")
    row = POTENTIALS[kind]
    return row.type(
        *(_core.RigidBody(fields["inertia"]) if name == "body" else fields[name] for name in row.parameters)
    )
