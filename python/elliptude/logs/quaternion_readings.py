"""Ways to read the columns of a quaternion: scalar first or last, from body to reference axes or back.

Turns show which one fits: an attitude C turns from one time to another by C₁ᵀC₂, whatever its frame. Read as its
inverse that is C₁C₂ᵀ, a turn about the axis in the reference frame, against that in the body; read in the other order
it is something else again.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from elliptude.typing import FloatArray

Order: TypeAlias = Literal["wxyz", "xyzw"]
Turns: TypeAlias = Literal["body_to_reference", "reference_to_body"]

# Which slopes count as 1, and how well a slope must be known.
LEAST, MOST, STANDARD_ERROR = 0.7, 1.4, 0.1
# rad; the largest turn for which a linear formula is good enough.
LARGEST_TURN = 1.0
FEWEST_PAIRS = 30


@dataclass(frozen=True)
class Reading:
    """A way to read rotations whose order or direction is other than declared."""

    declared_order: Order
    declared_turns: Turns
    order: Order
    turns: Turns

    def __call__(self, rotations: Rotation) -> Rotation:
        """Read rotations anew that were first read as declared."""
        of_file = rotations if self.declared_turns == "body_to_reference" else rotations.inv()
        columns = of_file.as_quat(scalar_first=self.declared_order == "wxyz")
        read = Rotation.from_quat(columns, scalar_first=self.order == "wxyz")
        return read if self.turns == "body_to_reference" else read.inv()

    def __str__(self) -> str:
        """The difference from what is declared, in the configuration's syntax."""
        said = [f"order = '{self.order}'"] if self.order != self.declared_order else []
        said += [f"turns = '{self.turns}'"] if self.turns != self.declared_turns else []
        return f"as {', '.join(said)}" if said else "as declared"


def readings(order: Order, turns: Turns) -> tuple[Reading, ...]:
    """The four readings, the declared one first."""
    other_order: Order = "xyzw" if order == "wxyz" else "wxyz"
    other_turns: Turns = "reference_to_body" if turns == "body_to_reference" else "body_to_reference"
    choices = ((order, turns), (other_order, turns), (order, other_turns), (other_order, other_turns))
    return tuple(Reading(order, turns, *choice) for choice in choices)


def slope(changes: FloatArray, predicted: FloatArray) -> tuple[float, float]:
    """The slope of the least-squares line through 0, and its standard error."""
    power = float((predicted * predicted).sum())
    if power == 0.0:
        return 0.0, np.inf
    value = float((changes * predicted).sum()) / power
    rest = float(((changes - value * predicted) ** 2).sum()) / changes.size
    return value, float(np.sqrt(rest / power))


@dataclass(frozen=True)
class Misread:
    """A quaternion that does not turn as declared, and the reading that fits."""

    slope: float
    """The slope of the attitudes' turns as declared: 1 if right."""
    fitting: str | None
    """The reading that fits; None if none does."""


def misread(
    first: Rotation, second: Rotation, turns_between: FloatArray, choices: tuple[Reading, ...]
) -> Misread | None:
    """Check whether attitudes turn as they should, and if not, find the reading with which they would.

    Parameters
    ----------
    first, second : scipy.spatial.transform.Rotation
        n attitudes each, as declared.
    turns_between : (n, 3) array
        The turns between them from another source, rotation vectors in rad, body axes.
    choices : tuple of Reading
        Readings that `readings` returns.

    Returns
    -------
    Misread, optional
        None if they do, or if there is too little data.
    """
    small = np.linalg.norm(turns_between, axis=1) < LARGEST_TURN
    if small.sum() < FEWEST_PAIRS:
        return None
    declared, *others = (
        slope((read(first).inv() * read(second)).as_rotvec()[small], turns_between[small]) for read in choices
    )
    value, error = declared
    if error >= STANDARD_ERROR or LEAST <= value <= MOST:
        return None
    fitting = [str(read) for read, (other, _) in zip(choices[1:], others, strict=True) if LEAST <= other <= MOST]
    return Misread(value, fitting[0] if fitting else None)
