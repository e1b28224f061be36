"""What a pass rests on, and whether the other one has found it to contradict; theory, section 20.4."""

import numpy as np
from numpy.typing import NDArray

from elliptude.results import CLAIMS, DirectionLog, GuaranteedLog

_CONDITIONAL, _NONE = CLAIMS.index("conditional"), CLAIMS.index("none")
_Rows = NDArray[np.bool_]


def of_sets(sets: GuaranteedLog) -> _Rows:
    """Rows in which a pass was in dispute: it had contradicted, and not got over it."""
    return np.asarray((sets.claims == _CONDITIONAL) | ((sets.claims == _NONE) & (sets.margins < 0.0)), dtype=np.bool_)


def of_caps(caps: DirectionLog) -> _Rows:
    """The same for a direction by itself."""
    return np.asarray((caps.claims == _CONDITIONAL) | ((caps.claims == _NONE) & caps.dropped), dtype=np.bool_)


def contested(own: _Rows, other: _Rows) -> _Rows:
    """Rows at which a pass rests on what it contradicts together with what the other pass rests on.

    A set of a pass forward rests on the rows since its last dispute, one of a pass backward on those until its next. If
    the other pass comes into dispute at a row, the rows that it rested on contradict together with that row. Where a
    set of this pass rests on that row, and begins among those rows or before, it is contested.

    Parameters
    ----------
    own, other : (n,) array of bool
        Where each pass was in dispute, in the order of the rows of a log in which ``own`` is of a pass backward.

    Returns
    -------
    (n,) array of bool
        False where the pass is in dispute itself.
    """
    # Where the other pass met a contradiction, of what its set of this row rests on, or the next one after a dispute.
    begun_before = other & np.append(False, other)[:-1]
    met = np.append(_first_from(other), len(other))[_first_from(~begun_before)]
    return np.asarray((met < _first_from(own)) & ~own, dtype=np.bool_)


def _first_from(those: _Rows) -> NDArray[np.intp]:
    """The first of those rows from each row on, itself among them; their number where there is none."""
    n = len(those)
    found = np.where(those, np.arange(n), n)
    return np.asarray(np.minimum.accumulate(found[::-1])[::-1], dtype=np.intp)
