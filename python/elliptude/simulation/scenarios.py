"""Scenarios: a body, its motion, and how it is measured, as TOML files; some are built in.

SI units and radians, except in keys that end in ``_deg``. What each key means: ``docs/scenarios.md``.
"""

import os
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from elliptude.io.files import FileError
from elliptude.io.toml import Attitude, Matrix, Model, Number, Vector, VectorOfAnyLength, read_toml, unit
from elliptude.simulation.potentials import Potential
from elliptude.typing import FloatArray

Positive = Annotated[Number, Field(gt=0)]
Count = Annotated[int, Field(strict=True, gt=0, le=1_000_000)]


class Estimate0(Model):
    """Where an estimator starts."""

    attitude: Attitude | Literal["first measurement"]
    rate: Vector | None = None
    P_diagonal: tuple[Positive, Positive, Positive, Positive, Positive, Positive] | None = None

    @model_validator(mode="after")
    def _complete(self) -> "Estimate0":
        from_measurement = self.attitude == "first measurement"
        if from_measurement != (self.rate is None) or from_measurement != (self.P_diagonal is None):
            raise ValueError("an attitude needs rate and P_diagonal beside it, 'first measurement' takes neither")
        return self


def _as_matrix(value: object) -> object:
    """Principal moments as a matrix; pydantic checks everything else."""
    if isinstance(value, list) and len(value) == 3 and not any(isinstance(item, list) for item in value):
        return [[value[i] if i == j else 0.0 for j in range(3)] for i in range(3)]
    return value


def _of_a_body(inertia: Matrix) -> Matrix:
    matrix = np.array(inertia)
    if not np.array_equal(matrix, matrix.T):
        raise ValueError("an inertia matrix is symmetric")
    moments = np.linalg.eigvalsh(matrix)
    if not (moments[0] > 0.0 and moments[2] <= moments[0] + moments[1]):
        raise ValueError("no body has these moments: each is positive and at most the sum of the other two")
    return inertia


Inertia = Annotated[Matrix, BeforeValidator(_as_matrix), AfterValidator(_of_a_body)]
"""Three principal moments or a symmetric 3x3 matrix, kg m^2, in body axes."""
Direction = Annotated[VectorOfAnyLength, AfterValidator(unit)]
DirectionSet = Annotated[tuple[Direction, ...], Field(min_length=1)]
BoundDeg = Annotated[Number, Field(gt=0, le=90)]


class Scenario(Model):
    """A body, its motion, and how it is measured.

    ``attitude0`` and ``rate0`` are the true state at time 0, ``estimate0`` is what an estimator believes then;
    measurements come at ``interval``, ``2 interval``, ... ``measurements * interval``.
    """

    name: str = Field(min_length=1)
    """The random errors depend on it; if left out, the name of the file without ``.toml``."""
    description: str = ""
    inertia: Inertia
    potential: Potential
    attitude0: Attitude
    """From body to reference axes."""
    rate0: Vector
    """rad/s, body axes."""
    step: Positive
    """An estimator's step, s; the truth does not depend on it."""
    integrator_order: Literal[2, 4, 6, 8] = 4
    """Order of an estimator's integrator."""
    steps_between_measurements: Count
    measurements: Count
    directions: Annotated[dict[str, DirectionSet], Field(min_length=1)]
    """Sets of reference directions to choose from, unit vectors in reference axes."""
    bound_deg: Annotated[tuple[BoundDeg, ...], Field(min_length=1)]
    """Bounds that figures are quoted for: of a direction's error, and the same number per s of the rate's."""
    weights: Literal["equal"] = "equal"
    """Weights of the directions, in an estimator."""
    estimate0: Estimate0

    @property
    def interval(self) -> float:
        """Time between measurements, s."""
        return self.step * self.steps_between_measurements

    @property
    def inertia_matrix(self) -> FloatArray:
        """J in kg m^2, body axes, shape (3, 3)."""
        return np.array(self.inertia)


_BUILT_IN = resources.files("elliptude") / "data" / "scenarios"


def names() -> tuple[str, ...]:
    """The names of the scenarios that are built in.

    Returns
    -------
    tuple of str
    """
    return tuple(sorted(file.name.removesuffix(".toml") for file in _BUILT_IN.iterdir() if file.name.endswith(".toml")))


def load(scenario: str | os.PathLike[str]) -> Scenario:
    """Load a scenario, one of the built-in ones by its name or one of your own from its file.

    Parameters
    ----------
    scenario : str or path-like
        One of `names`, or a path that ends in ``.toml``.

    Returns
    -------
    Scenario

    Raises
    ------
    FileError
        If there is none, or it does not fit; the message names the file and the keys.
    """
    given = os.fspath(scenario)
    if given.endswith(".toml"):
        return read_toml(given, Scenario, name=Path(given).stem)
    if given not in names():
        raise FileError(f"no scenario {given!r}: there are {', '.join(names())}; a file of your own ends in .toml")
    with resources.as_file(_BUILT_IN / f"{given}.toml") as file:
        return read_toml(file, Scenario, name=given)
