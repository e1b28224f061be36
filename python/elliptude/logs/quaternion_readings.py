"""Ways to read the columns of a quaternion: in which order, and from body to reference axes or back; and their words.

Turns show which one fits: an attitude C turns from one time to another by C₁ᵀC₂, whatever its frame. Read as its
inverse that is C₁C₂ᵀ, a turn about the axis in the reference frame, against that in the body; read in the other order
it is something else again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

import numpy as np
import scipy

from elliptude.configuration.sensors import Truth
from elliptude.io.tables import QUATERNION
from elliptude.typing import FloatArray

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

Order: TypeAlias = Literal["wxyz", "xyzw"]
Turns: TypeAlias = Literal["body_to_reference", "reference_to_body"]
Columns: TypeAlias = tuple[str, str, str, str]

_TURNS_IN_WORDS = {
    "body_to_reference": "it takes vectors from body to reference axes",
    "reference_to_body": "it takes vectors from reference to body axes",
}

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
    order: str
    """What the columns, as they are declared, hold: "xyzw" where the first is x; beside an `Order` a shift of one."""
    turns: Turns
    columns: Columns
    """As they are declared."""

    def __call__(self, rotations: Rotation) -> Rotation:
        """Read rotations anew that were first read as declared."""
        of_file = rotations if self.declared_turns == "body_to_reference" else rotations.inv()
        columns = of_file.as_quat(scalar_first=self.declared_order == "wxyz")
        read = scipy.spatial.transform.Rotation.from_quat(
            columns[:, [self.order.index(part) for part in "wxyz"]], scalar_first=True
        )
        return read if self.turns == "body_to_reference" else read.inv()

    def __str__(self) -> str:
        """The difference from what is declared: in the configuration's syntax, and in words."""
        said = []
        if self.order != self.declared_order:
            held = ", ".join(f"{column} is {part}" for column, part in zip(self.columns, self.order, strict=True))
            said.append(f"{self._where()} ({held})")
        if self.turns != self.declared_turns:
            said.append(f"turns = '{self.turns}' ({_TURNS_IN_WORDS[self.turns]})")
        return f"as {', '.join(said)}" if said else "as declared"

    def _where(self) -> str:
        """The order of the parts; of columns named in another order than their numbers have, these."""
        if self.order in get_args(Order):
            return f"order = '{self.order}'"
        listed = [self.columns[self.order.index(part)] for part in self.declared_order]
        return f"attitude_columns = {listed}"


def readings(order: Order, turns: Turns, columns: Sequence[str]) -> tuple[Reading, ...]:
    """All readings, the declared one first.

    Parameters
    ----------
    order, turns : str
        As they are declared.
    columns : sequence of str
        The four columns of the quaternion, in that order.

    Returns
    -------
    tuple of Reading
        Scalar first and last, as the order says; and where the headers have the one and the numbers the other, which is
        a shift of one: `qx,qy,qz,qw` above w, x, y, z. Each from body to reference axes and back.
    """
    other_order: Order = "xyzw" if order == "wxyz" else "wxyz"
    other_turns: Turns = "reference_to_body" if turns == "body_to_reference" else "body_to_reference"
    # Of columns that are named in one order and filled in the other, only one case is not the other order again.
    shifted = {"wxyz": "zwxy", "xyzw": "yzwx"}[order]
    first, second, third, fourth = columns
    orders: tuple[str, ...] = (order, other_order)
    choices = [(one, turned) for turned in (turns, other_turns) for one in orders]
    choices += [(shifted, turned) for turned in (turns, other_turns)]
    return tuple(Reading(order, turns, *choice, (first, second, third, fourth)) for choice in choices)


def readings_of(truth: Truth | None) -> tuple[Reading, ...]:
    """Those of the attitudes that a configuration names, or of a table with the columns qw,qx,qy,qz."""
    if truth is None:
        return readings("wxyz", "body_to_reference", QUATERNION)
    return readings(truth.order, truth.turns, truth.attitude_columns)


def not_as_declared(what: str, option: str | None = None) -> str:
    """What is said of attitudes that fit when they are read otherwise.

    Parameters
    ----------
    what : str
        Whose attitudes, and how they are off: "the reference turns ... when read as ...".
    option : str, optional
        The option of the configuration that describes them.

    Returns
    -------
    str
    """
    where = "" if option is None else f" ({option})"
    return f"{what}: its quaternions are not as declared; [truth] of a configuration{where} says how they are"


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
