"""What is known of the vertical: by the sets of the attitude, and by a filter of its own, which needs no heading."""

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

import elliptude
from elliptude.configuration.configuration import Configuration
from elliptude.estimation.direction_rows import Contradiction, DirectionRows
from elliptude.results import CLAIMS, DirectionLog, GuaranteedLog
from elliptude.typing import FloatArray

_UNCONDITIONAL, _CONDITIONAL, _NONE = range(len(CLAIMS))
# rad; caps that only touch meet: what is left between them is rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Turns:
    """How the body turned to each row from its anchor, an earlier row, by the gyro."""

    anchors: NDArray[np.intp]
    """The row that each is predicted from, −1 for the first, shape (N,)."""
    vectors: FloatArray
    """Rotation vectors, rad, body axes, shape (N, 3)."""
    angles: FloatArray
    """How far they may be off, rad, shape (N,)."""


@dataclass(frozen=True, eq=False)
class Vertical:
    """Up in the body axes of every row, as well as it is known, and how far the estimated attitude's up may be off."""

    directions: FloatArray
    """Unit vectors, body axes, NaN where up is not known, shape (N, 3)."""
    angles: FloatArray
    """How far true up may be from there, rad, NaN where it is not known, shape (N,)."""
    claims: NDArray[np.uint8]
    """What that rests on, an index of `elliptude.results.CLAIMS`, shape (N,)."""
    tilt_bounds: FloatArray
    """Bound of the angle between the estimated attitude's up and true up, rad, NaN without an attitude, shape (N,)."""


def followed(
    configuration: Configuration,
    rows: DirectionRows,
    turns: Turns | None,
    sets: GuaranteedLog | None = None,
    *,
    from_anchors: bool = False,
) -> DirectionLog | None:
    """Up by its measured direction and the gyro alone; section 18.9.

    Parameters
    ----------
    configuration : Configuration
    rows : DirectionRows
    turns : Turns, optional
        None where nothing says how the body turned.
    sets : GuaranteedLog, optional
        Of the attitude, by the same rows. Where they have left out a measured up, or their past, up that rests on it is
        conditional; what else contradicts does not count.
    from_anchors : bool
        Whether the rows of the sets are predicted by these turns, and not each from the one before.

    Returns
    -------
    DirectionLog or None
        None without a measured up, or without turns; nor where any measurement may be wrong unseen, as there is only
        one of up in a row.

    Raises
    ------
    InconsistentMeasurement
        If a measured up contradicts the one before, and the policy is to raise.
    """
    policy = configuration.estimator.policy
    if rows.up is None or rows.up_column is None or turns is None or policy == "relaxed":
        return None
    up = elliptude.DirectionFilter(policy, configuration.estimator.regain_after).run_turns(
        turns.vectors,
        turns.angles,
        anchors=turns.anchors,
        directions=rows.directions[:, rows.up_column],
        bounds=rows.angles[:, rows.up_column],
    )
    if sets is not None:
        left_out = _left_out(sets, rows.up_column)
        lasting = left_out.copy()
        if from_anchors:
            # A row between two anchors says that it contradicts, and counts no further.
            lasting[np.setdiff1d(np.arange(len(lasting)), turns.anchors)] = False
        if lasting.any():
            up, rests_on_it = _through_disputes(configuration, rows, turns, lasting)
            left_out |= rests_on_it
        up = _weakened(up, left_out)
    sensor = rows.names[rows.up_column]
    if any(one.sensor == sensor for one in rows.contradictions):
        # A statement about this sensor is wrong, and may be wrong elsewhere without showing it.
        return _weakened(up, np.ones(len(up.claims), dtype=np.bool_))
    return up


def _weakened(up: DirectionLog, rows: NDArray[np.bool_]) -> DirectionLog:
    claims = np.where(rows & (up.claims == _UNCONDITIONAL), _CONDITIONAL, up.claims)
    return replace(up, claims=claims.astype(np.uint8))


def _left_out(sets: GuaranteedLog, up_column: int) -> NDArray[np.bool_]:
    """Rows at which sets have left out what up is followed by: the measured up, or what was known before."""
    past = (sets.margins < 0.0) & ~sets.dropped.any(axis=1)
    return np.asarray(past | sets.dropped[:, up_column], dtype=np.bool_)


def _through_disputes(
    configuration: Configuration, rows: DirectionRows, turns: Turns, contradicts: NDArray[np.bool_]
) -> tuple[DirectionLog, NDArray[np.bool_]]:
    """Up where something else contradicts it at some rows, and the rows at which it rests on that.

    As after a contradiction of its own, up is taken from a measurement alone once as many anchors have agreed as the
    configuration says.
    """
    regain_after, n = configuration.estimator.regain_after, len(contradicts)
    directions, angles = rows.directions[:, rows.up_column], rows.angles[:, rows.up_column]
    measured = np.isfinite(directions[:, 0]) & (angles < np.pi)
    filter_of_up = elliptude.DirectionFilter(configuration.estimator.policy, regain_after)
    found = DirectionLog(np.empty((n, 3)), np.empty(n), np.empty(n, dtype=np.uint8), np.empty(n, dtype=np.bool_))

    def run(block: slice) -> None:
        part = filter_of_up.run_turns(
            turns.vectors[block],
            turns.angles[block],
            anchors=np.full(block.stop - block.start, -1),
            directions=directions[block],
            bounds=angles[block],
        )
        for name in ("directions", "angles", "claims", "dropped"):
            getattr(found, name)[block] = getattr(part, name)

    rests_on_it = np.zeros(n, dtype=np.bool_)
    disputed, agreed, begin = False, 0, 0
    # All rows from one anchor's next to the next anchor are predicted from the first.
    for end in np.union1d(turns.anchors[turns.anchors >= 0], [n - 1]).tolist():
        block = slice(begin, end + 1)
        run(block)
        rests_on_it[block] = np.logical_or.accumulate(np.append(disputed, contradicts[block]))[1:]
        disputed = bool(rests_on_it[end]) and found.claims[end] != _NONE
        agreed = 0 if contradicts[block].any() else agreed
        agreed += int(measured[end] and not contradicts[end])
        if disputed and agreed >= regain_after and measured[end] and found.claims[end] == _UNCONDITIONAL:
            filter_of_up.forget()
            run(slice(end, end + 1))
            rests_on_it[end] = disputed = False
        begin = end + 1
    return found, rests_on_it


def contradictions_of_up(rows: DirectionRows, turns: Turns | None, up: DirectionLog | None) -> list[Contradiction]:
    """Measurements of up that have no direction in common with what was followed to their rows.

    Parameters
    ----------
    rows : DirectionRows
    turns : Turns, optional
    up : DirectionLog, optional
        As `followed` found it.

    Returns
    -------
    list of Contradiction
        By how much is in degrees. Whatever the policy did about them, each proves that a statement is wrong.
    """
    if up is None or turns is None or rows.up_column is None:
        return []
    measured, angles = rows.directions[:, rows.up_column], rows.angles[:, rows.up_column]
    before = turns.anchors
    at = np.flatnonzero((before >= 0) & np.isfinite(turns.vectors).all(axis=1) & (angles < np.pi))
    expected = scipy.spatial.transform.Rotation.from_rotvec(-turns.vectors[at]).apply(up.directions[before[at]])
    away = _angles_between(measured[at], expected)
    excess = np.full(len(before), -np.inf)
    excess[at] = away - angles[at] - turns.angles[at] - up.angles[before[at]]
    return [
        Contradiction(int(row), rows.names[rows.up_column], float(np.rad2deg(max(excess[row], 0.0))), "deg")
        for row in np.flatnonzero(up.dropped | (excess > _ROUNDING))
    ]


def _angles_between(one: FloatArray, other: FloatArray) -> FloatArray:
    """Angles of unit vectors, rad, shape (N,)."""
    across = np.linalg.norm(np.cross(one, other), axis=1)
    angles: FloatArray = np.arctan2(across, np.einsum("ni,ni->n", one, other))
    return angles


def vertical_of(sets: GuaranteedLog, up: DirectionLog | None, reference: FloatArray | None) -> Vertical | None:
    """Up from both: of each row what has the stronger claim, and of equal claims what is sharper.

    Parameters
    ----------
    sets : GuaranteedLog
        With bounds of the tilt.
    up : DirectionLog, optional
    reference : (3,) array, optional
        Up in reference axes; None if it is not known.

    Returns
    -------
    Vertical or None
    """
    bounds = sets.attitude_bounds
    if reference is None or bounds is None:
        return None
    estimated = np.einsum("nji,j->ni", sets.attitudes, reference)
    if up is None:
        return Vertical(estimated, bounds.tilt, sets.claims, bounds.tilt)
    of_estimate = np.minimum(_angles_between(estimated, up.directions) + up.angles, np.pi)
    followed_is_stronger = up.claims < sets.claims
    set_is_stronger = sets.claims < up.claims
    tilt = np.where(
        set_is_stronger, bounds.tilt, np.where(followed_is_stronger, of_estimate, np.fmin(bounds.tilt, of_estimate))
    )
    tilt[sets.claims == _NONE] = np.nan
    takes_followed = followed_is_stronger | (~set_is_stronger & (up.angles <= bounds.tilt))
    return Vertical(
        directions=np.where(takes_followed[:, None], up.directions, estimated),
        angles=np.where(takes_followed, up.angles, bounds.tilt),
        claims=np.minimum(up.claims, sets.claims),
        tilt_bounds=tilt,
    )
