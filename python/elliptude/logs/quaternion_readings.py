"""Ways to read the columns of a quaternion: scalar first or last, from body to reference axes or back.

Which one fits is told by turns: an attitude C turns from one time to another by C₁ᵀC₂, whatever its frame. Read as its
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

# Of the slope: what counts as 1, and how well it must be known.
LEAST, MOST, STANDARD_ERROR = 0.7, 1.4, 0.1
# rad; what a linear formula is good for.
LARGEST_TURN = 1.0
FEWEST_PAIRS = 30


@dataclass(frozen=True)
class Reading:
    """What rotations would be if the order and the direction were others than declared."""

    declared_order: Order
    declared_turns: Turns
    order: Order
    turns: Turns

    def __call__(self, rotations: Rotation) -> Rotation:
        """Read rotations anew that were read as declared."""
        of_file = rotations if self.declared_turns == "body_to_reference" else rotations.inv()
        columns = of_file.as_quat(scalar_first=self.declared_order == "wxyz")
        read = Rotation.from_quat(columns, scalar_first=self.order == "wxyz")
        return read if self.turns == "body_to_reference" else read.inv()

    def __str__(self) -> str:
        """As a configuration says it, what differs from what is declared."""
        said = [f"order = '{self.order}'"] if self.order != self.declared_order else []
        said += [f"turns = '{self.turns}'"] if self.turns != self.declared_turns else []
        return f"as {', '.join(said)}" if said else "as declared"


def readings(order: Order, turns: Turns) -> tuple[Reading, ...]:
    """The four, what is declared first."""
    other_order: Order = "xyzw" if order == "wxyz" else "wxyz"
    other_turns: Turns = "reference_to_body" if turns == "body_to_reference" else "body_to_reference"
    choices = ((order, turns), (other_order, turns), (order, other_turns), (other_order, other_turns))
    return tuple(Reading(order, turns, *choice) for choice in choices)


def slope(changes: FloatArray, predicted: FloatArray) -> tuple[float, float]:
    """Of the least-squares line through 0, and its standard error."""
    power = float((predicted * predicted).sum())
    if power == 0.0:
        return 0.0, np.inf
    value = float((changes * predicted).sum()) / power
    rest = float(((changes - value * predicted) ** 2).sum()) / changes.size
    return value, float(np.sqrt(rest / power))


@dataclass(frozen=True)
class Misread:
    """A reading that fits, where the declared one does not."""

    slope: float
    """How many times as far as they should the attitudes turn, as declared."""
    fitting: str | None
    """The reading that does; None where none does."""


def misread(
    first: Rotation, second: Rotation, turns_between: FloatArray, choices: tuple[Reading, ...]
) -> Misread | None:
    """Whether attitudes turn as they should, and if not, how read they would.

    Parameters
    ----------
    first, second : scipy.spatial.transform.Rotation
        n attitudes each, as declared.
    turns_between : (n, 3) array
        The turns between them got another way, rotation vectors in rad, body axes.
    choices : tuple of Reading
        Of `readings`.

    Returns
    -------
    Misread, optional
        None where they do, or there is too little to tell.
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
