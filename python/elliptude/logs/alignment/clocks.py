"""What is read of each sensor until it is in a row.

A `Channel` is one sensor's columns, a `Clock` some channels with the same stamps.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import chain
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from elliptude import units
from elliptude.typing import FloatArray

BoolArray: TypeAlias = NDArray[np.bool_]
Fill: TypeAlias = Literal["none", "linear", "previous", "next"]
"""The value of a channel between two samples: none, one on the line between both, or one of them."""


@dataclass(eq=False)
class Channel:
    """The columns of one sensor, and its samples."""

    name: str
    columns: tuple[str, ...]
    convert: Callable[[FloatArray], FloatArray]
    """From what the file holds (n, k) to SI units and body axes (n, k)."""
    fill: Fill = "none"
    vectors: int = 0
    """How many vectors of three among the columns must not be zero: a direction, and its reference if that moves."""
    companions: int = 0
    """How many columns at the end must be there if the others are, and may be there without them."""
    last_time: float = -np.inf
    times: list[FloatArray] = field(default_factory=list)
    values: list[FloatArray] = field(default_factory=list)


@dataclass(eq=False)
class Clock:
    """Channels with the same time stamps and the same delay."""

    column: str
    unit: units.TimeUnit
    delay: float
    is_own: bool
    """Whether the stamps are the channels' own: a row without stamp and samples does not count."""
    channels: list[Channel]
    stream: str = ""
    last: float = -np.inf
    """The last stamp, s, delay not subtracted."""
    is_empty: bool = True
    stamps: list[FloatArray] = field(default_factory=list)
    rows: list[NDArray[np.int64]] = field(default_factory=list)

    def columns(self) -> list[str]:
        """All columns that are read."""
        return [self.column, *chain.from_iterable(channel.columns for channel in self.channels)]
