"""What is found of a log, and the rows and turns by which it is."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from elliptude.typing import FloatArray

Severity: TypeAlias = Literal["error", "warning"]

_PAIRS = 50_000
FACTORS = {
    np.pi / 180.0: "as if its degrees were declared as radians",
    180.0 / np.pi: "as if its radians were declared as degrees",
    1e-3: "as if the unit of time (or of the gyro) were 1000 times smaller",
    1e3: "as if the unit of time (or of the gyro) were 1000 times larger",
    1e-6: "as if the unit of time (or of the gyro) were a million times smaller",
    1e-9: "as if the unit of time were a billion times smaller",
}
"""How much further than the rate says a body may seem to turn, and what that is like."""


@dataclass(frozen=True)
class Finding:
    """A fault, or something that may be one."""

    severity: Severity
    sensor: str
    message: str

    def __str__(self) -> str:
        """The kind of finding, and its message."""
        return f"{self.sensor}: {self.message}" if self.sensor else self.message


def unit_vectors(vectors: FloatArray) -> FloatArray:
    """Vectors (..., 3) of length 1."""
    unit: FloatArray = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit


def spread_rows(count: int) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Indices spread over all rows, at most as many as are needed."""
    return np.unique(np.linspace(0, count - 1, min(count, _PAIRS)).astype(np.intp))
