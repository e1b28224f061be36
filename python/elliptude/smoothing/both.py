"""What a pass forward and one backward leave possible, row by row and question by question: theory, section 20.4."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import elliptude
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.estimator import Estimator
from elliptude.estimation.guaranteed_run import CONDITIONAL, GuaranteedRun
from elliptude.estimation.vertical import Vertical, vertical_of
from elliptude.monitoring import Sets, arcs, monitor
from elliptude.results import CLAIMS, DirectionLog, GuaranteedLog
from elliptude.smoothing.disputes import Disputes, contested
from elliptude.smoothing.fusion import StateSets, common, log_sizes
from elliptude.typing import FloatArray

_UNCONDITIONAL, _NONE = CLAIMS.index("unconditional"), CLAIMS.index("none")


@dataclass(frozen=True, eq=False)
class Passes:
    """What two passes over a log found."""

    forward: GuaranteedRun
    backward: GuaranteedLog
    """In the order of the rows."""
    caps: DirectionLog | None
    """Where up may be by the pass backward, in the order of the rows."""
    disputes: tuple[Disputes, Disputes] | None = None
    """Where the sets of both passes are in dispute, in the order of the rows; None if neither met a contradiction."""
    disputes_of_caps: tuple[Disputes, Disputes] | None = None
    """Where the caps of both passes are in dispute, likewise."""


@dataclass(frozen=True, eq=False)
class Both:
    """What both passes leave possible."""

    sets: GuaranteedLog
    vertical: Vertical | None
    caps: DirectionLog | None
    disagreements: NDArray[np.intp]
    """Rows where the passes prove that a statement is wrong."""
    contested: NDArray[np.bool_]
    """Rows where a pass claims less since the other one has found a contradiction, shape (n,)."""
    counts: tuple[NDArray[np.bool_], NDArray[np.bool_]]
    """Rows whose set rests on the pass forward, and rows whose set rests on the one backward, shape (n,) each."""


def both_passes(passes: Passes, configuration: Configuration) -> Both:
    """Combine two passes.

    Parameters
    ----------
    passes : Passes
    configuration : Configuration

    Returns
    -------
    Both
    """
    forward, backward = passes.forward.sets, passes.backward
    up = passes.forward.rows.up
    both_unconditional = _both_unconditional(forward.claims, backward.claims)
    left = _claims_left(forward.claims, backward.claims, passes.disputes)
    weaker = (left[0] != forward.claims) | (left[1] != backward.claims)
    forward, backward = replace(forward, claims=left[0]), replace(backward, claims=left[1])
    of_cap = caps = passes.forward.caps
    caps_apart = np.zeros(len(forward.claims), dtype=np.bool_)
    if of_cap is not None and passes.caps is not None:
        first, second = of_cap.claims, passes.caps.claims
        left = _claims_left(first, second, passes.disputes_of_caps)
        weaker |= (left[0] != first) | (left[1] != second)
        of_cap, other_cap = replace(of_cap, claims=left[0]), replace(passes.caps, claims=left[1])
        caps, caps_apart = common_caps(of_cap, other_cap, _both_unconditional(first, second))
    equal = (forward.claims == backward.claims) & (forward.claims < _NONE)
    fused, meet = _fused(forward, backward, equal, configuration)
    apart = equal & ~meet & both_unconditional
    known = np.isfinite(fused.shapes[:, 0, 0])
    # Where both hold, about two centers: that of the pass forward, about which no bound gets wider, and the common one.
    stronger = backward.claims < forward.claims
    single = _rows_of(forward, backward, stronger)
    common_set = _rows_of(single, fused, known)
    if up is not None and forward.question_bounds is not None:
        of_forward, of_backward = (Sets.of(_only(one, equal & meet), up) for one in (forward, backward))
        of_fused = Sets.of(_only(fused, known))
        single = _narrowed(single, [of_backward, of_fused], up)
        common_set = _narrowed(common_set, [of_forward, of_backward, of_fused], up)
    before = passes.forward.vertical if not weaker.any() else vertical_of(forward, of_cap, up)
    if apart.any() or caps_apart.any():
        # A statement is wrong, and may be wrong elsewhere without showing it.
        single, common_set, weakened = (
            replace(sets, claims=_weakened(sets.claims, True)) for sets in (single, common_set, forward)
        )
        # What the pass forward knew of up by its sets rests on no more; by its cap it may.
        if of_cap is not None and caps_apart.any():
            of_cap = replace(of_cap, claims=_weakened(of_cap.claims, True))
        before = vertical_of(weakened, of_cap, up)
    vertical, of_common = vertical_of(single, caps, up), vertical_of(common_set, caps, up)
    takes = known & _no_wider(common_set, of_common, forward, before)
    if passes.forward.starts_heading:
        # Headings count from the first row's center.
        takes[0] = False
    return Both(
        _rows_of(single, common_set, takes),
        _chosen_vertical(before, vertical, of_common, takes, takes | stronger),
        caps,
        np.flatnonzero(apart | caps_apart),
        weaker,
        ((forward.claims < _NONE) & ~stronger, stronger | (equal & meet)),
    )


def _both_unconditional(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> NDArray[np.bool_]:
    return np.asarray((one == _UNCONDITIONAL) & (other == _UNCONDITIONAL), dtype=np.bool_)


def _claims_left(
    forward: NDArray[np.uint8], backward: NDArray[np.uint8], disputes: tuple[Disputes, Disputes] | None
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """What each of two passes claims once the contradictions that the other one has found are known."""
    if disputes is None:
        return forward, backward
    of_backward = contested(disputes[1], disputes[0])
    of_forward = contested(disputes[0].turned_round(), disputes[1].turned_round())[::-1]
    return _weakened(forward, of_forward), _weakened(backward, of_backward | of_forward)


def _weakened(claims: NDArray[np.uint8], rows: NDArray[np.bool_] | bool) -> NDArray[np.uint8]:
    """Claims of which those of some rows are not unconditional."""
    return np.where(rows, np.maximum(claims, CONDITIONAL), claims).astype(np.uint8)


def _rows_of(one: GuaranteedLog, other: GuaranteedLog, takes_other: NDArray[np.bool_]) -> GuaranteedLog:
    """The rows of one log, and some of another; what was left out by either is left out."""

    def chosen(name: str) -> Any:
        first, second = getattr(one, name), getattr(other, name)
        if first is None or second is None:
            return None
        return np.where(takes_other.reshape(-1, *[1] * (first.ndim - 1)), second, first)

    names = ("attitudes", "vectors", "shapes", "claims", "prediction_used", "question_bounds")
    return replace(
        one,
        **{name: chosen(name) for name in names},
        dropped=one.dropped | other.dropped,
        margins=np.fmin(one.margins, other.margins),
    )


def _only(sets: GuaranteedLog, rows: NDArray[np.bool_]) -> GuaranteedLog:
    """The sets of some rows, as if nothing were known at the others."""
    return replace(sets, claims=np.where(rows, sets.claims, _NONE).astype(np.uint8))


def _fused(
    forward: GuaranteedLog, backward: GuaranteedLog, rows: NDArray[np.bool_], configuration: Configuration
) -> tuple[GuaranteedLog, NDArray[np.bool_]]:
    """Sets about what both leave possible, NaN where there is none; and False where they have nothing in common."""
    k = 6 if configuration.estimates_vector else 3
    at = np.flatnonzero(rows)

    def states(sets: GuaranteedLog) -> StateSets:
        return StateSets(sets.attitudes[at], sets.vectors[at, : k - 3], sets.shapes[at, :k, :k])

    one = states(forward)
    weight = weight_of(configuration.estimator, k)
    found = common(one, states(backward), weight)
    shapes = np.where(np.isfinite(found.sets.shapes), found.sets.shapes, np.nan)
    smaller = log_sizes(shapes, weight) <= log_sizes(one.shapes, weight)
    attitudes, vectors, whole = (
        np.full_like(part, np.nan) for part in (forward.attitudes, forward.vectors, forward.shapes)
    )
    kept = at[smaller]
    attitudes[kept], whole[kept], vectors[kept] = (
        found.sets.attitudes[smaller],
        forward.shapes[kept],
        forward.vectors[kept],
    )
    whole[kept, :k, :k], vectors[kept, : k - 3] = shapes[smaller], found.sets.vectors[smaller]
    meet = np.ones(len(rows), dtype=np.bool_)
    meet[at] = found.meet
    return (
        replace(
            forward,
            attitudes=attitudes,
            vectors=vectors,
            shapes=whole,
            prediction_used=np.ones(len(rows), dtype=np.bool_),
            question_bounds=None if forward.question_bounds is None else np.full((len(rows), 4), np.nan),
        ),
        meet,
    )


def weight_of(settings: Estimator, k: int) -> FloatArray | None:
    """The weight (k, k) of the trace that a configuration minimises; None for the volume."""
    if settings.criterion == "volume":
        return None
    weight = settings.weight()
    return np.eye(k) if weight is None else weight[:k, :k]


def _narrowed(sets: GuaranteedLog, sources: list[Sets], up: FloatArray) -> GuaranteedLog:
    """Bounds of the centers' tilt, heading and angle, narrowed by what sources say of them; all of them hold."""
    assert sets.question_bounds is not None
    bounds = sets.question_bounds.copy()
    headings = bounds[:, 1:3].copy()
    for source in sources:
        seen = monitor(source, sets.attitudes, up=up)
        bounds[:, 0] = np.fmin(bounds[:, 0], seen.bounds[:, 1])
        headings = arcs.common(headings, seen.headings)
        bounds[:, 3] = np.fmin(bounds[:, 3], seen.bounds[:, 0])
    # An arc beyond half a turn to either side says nothing that an interval could: what was known before stays.
    beyond = (headings[:, 0] < -np.pi) | (headings[:, 1] > np.pi)
    headings[beyond] = np.where(np.isfinite(bounds[beyond, 1:3]), bounds[beyond, 1:3], [-np.pi, np.pi])
    bounds[:, 1:3] = headings
    return replace(sets, question_bounds=bounds)


def _no_wider(
    sets: GuaranteedLog, vertical: Vertical | None, forward: GuaranteedLog, of_forward: Vertical | None
) -> NDArray[np.bool_]:
    """Rows whose set answers no question worse than the pass forward does."""
    no_wider = sets.extents().largest_angles <= forward.extents().largest_angles
    if vertical is None or of_forward is None or sets.attitude_bounds is None or forward.attitude_bounds is None:
        return np.asarray(no_wider)
    bounds, before = sets.attitude_bounds, forward.attitude_bounds
    no_wider &= vertical.tilt_bounds <= of_forward.tilt_bounds
    no_wider &= (bounds.heading <= before.heading) & (bounds.angle <= before.angle)
    return np.asarray(no_wider)


def _chosen_vertical(
    forward: Vertical | None,
    single: Vertical | None,
    of_common: Vertical | None,
    takes_common: NDArray[np.bool_],
    moved: NDArray[np.bool_],
) -> Vertical | None:
    """Up by the sharpest with the strongest claim, and the tilt of the center that is taken, which may have moved."""
    if forward is None or single is None or of_common is None:
        return None
    sharper = of_common.angles < single.angles
    directions = np.where(sharper[:, None], of_common.directions, single.directions)
    angles = np.where(sharper, of_common.angles, single.angles)
    # What the pass forward knew holds, too, unless something rests on a stronger claim now.
    holds = forward.claims <= single.claims
    sharper = holds & (forward.angles < angles)
    # Its tilt is of its own centers.
    own_center = holds & ~moved & np.isfinite(forward.tilt_bounds)
    tilts = np.where(takes_common, of_common.tilt_bounds, single.tilt_bounds)
    return Vertical(
        directions=np.where(sharper[:, None], forward.directions, directions),
        angles=np.where(sharper, forward.angles, angles),
        claims=single.claims,
        tilt_bounds=np.where(own_center, np.fmin(tilts, forward.tilt_bounds), tilts),
    )


def common_caps(
    one: DirectionLog, other: DirectionLog, unconditional: NDArray[np.bool_] | None = None
) -> tuple[DirectionLog, NDArray[np.bool_]]:
    """Caps about what two caps have in common, (18.28), and rows where they prove that a statement is wrong.

    Parameters
    ----------
    one, other : DirectionLog
        Of the same rows. Of unequal claims the stronger counts alone; where caps have nothing in common, the first.
    unconditional : (n,) array of bool, optional
        Where both were claimed to hold without a condition; by their claims, if omitted.

    Returns
    -------
    caps : DirectionLog
    apart : (n,) array of bool
        Where both claim to hold without a condition, and have nothing in common.
    """
    takes_other = other.claims < one.claims
    directions = np.where(takes_other[:, None], other.directions, one.directions)
    angles = np.where(takes_other, other.angles, one.angles)
    apart = np.zeros(len(angles), dtype=np.bool_)
    for row in np.flatnonzero((one.claims == other.claims) & (one.claims < _NONE)):
        cap = elliptude.DirectionFilter()
        cap.update(one.directions[row], one.angles[row])
        try:
            cap.update(other.directions[row], other.angles[row])
        except elliptude.InconsistentMeasurement:
            apart[row] = one.claims[row] == _UNCONDITIONAL if unconditional is None else unconditional[row]
            continue
        if cap.direction is not None and cap.angle < angles[row]:
            directions[row], angles[row] = cap.direction, cap.angle
    claims = np.minimum(one.claims, other.claims)
    if apart.any():
        claims = np.maximum(claims, CONDITIONAL)
    return DirectionLog(directions, angles, claims.astype(np.uint8), one.dropped | other.dropped), apart
