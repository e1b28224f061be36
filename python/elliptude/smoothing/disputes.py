"""What a pass rests on, and whether the other one has found it to contradict; theory, section 20.4."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elliptude.results import CLAIMS, DirectionLog, GuaranteedLog

_CONDITIONAL, _NONE = CLAIMS.index("conditional"), CLAIMS.index("none")
_Rows = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Disputes:
    """Where a pass over n rows was in dispute: it had contradicted, and not got over it."""

    met: _Rows
    """Rows in dispute, shape (n,)."""
    inherited: _Rows
    """Rows that are predicted from one in dispute, shape (n,)."""
    carried: _Rows
    """Rows in dispute that others are predicted from, (n,): not one between two anchors, whose dispute ends there."""

    def turned_round(self) -> "Disputes":
        """The same for the rows in the other order."""
        return Disputes(self.met[::-1], self.inherited[::-1], self.carried[::-1])


def of_sets(sets: GuaranteedLog, anchors: NDArray[np.intp] | None) -> Disputes:
    """Disputes of a pass, in its own order; rows are predicted from their anchors, or each from the one before."""
    return _disputes((sets.claims == _CONDITIONAL) | ((sets.claims == _NONE) & (sets.margins < 0.0)), anchors)


def of_caps(caps: DirectionLog, anchors: NDArray[np.intp] | None) -> Disputes:
    """The same for a direction by itself."""
    return _disputes((caps.claims == _CONDITIONAL) | ((caps.claims == _NONE) & caps.dropped), anchors)


def _disputes(met: _Rows, anchors: NDArray[np.intp] | None) -> Disputes:
    n = len(met)
    before = np.arange(n) - 1 if anchors is None else anchors
    inherited = (before >= 0) & met[before] if n else met
    goes_on = np.zeros(n, dtype=np.bool_)
    goes_on[before[before >= 0]] = True
    return Disputes(met, inherited, met & goes_on)


def contested(own: Disputes, other: Disputes) -> _Rows:
    """Rows at which a pass rests on what it contradicts together with what the other pass rests on.

    A set of a pass forward rests on the rows since its last dispute, one of a pass backward on those until its next. If
    the other pass comes into dispute at a row, the rows that it rested on contradict together with that row. Where a
    set of this pass rests on rows beyond that one, and begins among those that it rested on or before, it is contested.

    Parameters
    ----------
    own, other : Disputes
        In the order of the rows of a log in which ``own`` is of a pass backward.

    Returns
    -------
    (n,) array of bool
        False where the pass is in dispute itself.
    """
    # Where the other pass met a contradiction, of what its set of this row rests on, or the next one after a dispute.
    begins = _first_from(~(other.met & other.inherited))
    met = np.append(_first_from(other.met), len(other.met))[begins]
    return np.asarray((met < _first_from(own.carried)) & ~own.met, dtype=np.bool_)


def _first_from(those: _Rows) -> NDArray[np.intp]:
    """The first of those rows from each row on, itself among them; their number where there is none."""
    n = len(those)
    found = np.where(those, np.arange(n), n)
    return np.asarray(np.minimum.accumulate(found[::-1])[::-1], dtype=np.intp)
