"""Pieces of work, and what is said of those that failed."""

from dataclasses import dataclass
from typing import Any

from elliptude.io.files import FileError

MOST_FAILED = 20
"""After this many failed pieces the others are not tried: the fault is elsewhere."""
_LISTED = 3


@dataclass(frozen=True)
class Piece:
    """A piece of work: its name, and what a function is called with."""

    name: str
    arguments: tuple[Any, ...]


class Failures:
    """Pieces that failed, with the reasons."""

    def __init__(self) -> None:
        self.reasons: dict[str, str] = {}

    def add(self, piece: Piece, reason: str) -> None:
        """Note a piece; FileError if there are too many of them."""
        self.reasons[piece.name] = reason
        if len(self.reasons) >= MOST_FAILED:
            self.complain()

    def complain(self) -> None:
        """Raise FileError if there are any, with the names."""
        if not self.reasons:
            return
        listed = [f"{name}: {reason}" for name, reason in list(self.reasons.items())[:_LISTED]]
        more = len(self.reasons) - len(listed)
        said = "; ".join(listed) + (f"; and {more} more" if more else "")
        count = len(self.reasons)
        raise FileError(
            f"{count} piece{'s' if count > 1 else ''} of the work failed: {said}. What is done is kept, and the same "
            "command tries again"
        )
