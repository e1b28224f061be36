"""How far another filter's attitude can be off at each row, where it is proved wrong, and where beyond a limit."""

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elliptude._arrays import unmasked
from elliptude._core import is_rotation, quaternion_from_rotation, rotation_from_quaternion
from elliptude.monitoring import arcs
from elliptude.monitoring.error_angles import ANGLE_ROUNDING, ErrorAngles, error_angles
from elliptude.monitoring.from_center import from_center
from elliptude.results import CLAIMS, AttitudeBounds, GuaranteedLog
from elliptude.typing import AttitudeLike, FloatArray, SupportsAsMatrix

Heading: TypeAlias = Literal["same", "free"]
"""Whether an attitude's heading counts as that of the sets does, or from anywhere: then its tilt alone is judged."""
QUESTIONS = ("total", "tilt", "heading")
"""What is judged: the whole attitude, the up direction, the turn about up."""

_UNCONDITIONAL, _NONE = CLAIMS.index("unconditional"), CLAIMS.index("none")
_CONDITIONAL = np.uint8(CLAIMS.index("conditional"))
# How far a quaternion may be from length 1.
_LENGTH_TOLERANCE = 0.01
# Rows that are worked out at once: what is computed then stays near the processor.
_AT_ONCE = 8192
# How far two vectors that are the same may be apart by rounding.
_SAME_VECTOR = 8.0 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class Sets:
    """The sets of n rows; NaN where there is none."""

    times: FloatArray
    """s, shape (n,)."""
    quaternions: FloatArray
    """(qw, qx, qy, qz) of the centers, from body to reference axes, shape (n, 4)."""
    shapes: FloatArray
    """P of the attitude's Gibbs vector, rad², shape (n, 3, 3)."""
    claims: NDArray[np.uint8]
    """What the sets rest on, an index of `elliptude.results.CLAIMS`, shape (n,)."""
    bounds: AttitudeBounds | None = None
    """How far tilt and heading of the centers may be off, which says more than the sets; arrays of shape (n,)."""
    vertical: FloatArray | None = None
    """The vertical in reference axes that tilt and heading refer to, shape (3,)."""
    are_proposals: bool = False
    """Whether the bounds behind them are only what a recording showed: then every claim is conditional at most."""

    @cached_property
    def principal(self) -> tuple[FloatArray, FloatArray]:
        """Eigenvalues of the shapes, increasing, (n, 3), and eigenvectors as columns, (n, 3, 3); NaN without a set."""
        values, vectors = np.full(self.shapes.shape[:2], np.nan), np.full(self.shapes.shape, np.nan)
        known = np.isfinite(self.shapes).all(axis=(1, 2))
        values[known], vectors[known] = np.linalg.eigh(self.shapes[known])
        return values, vectors

    @classmethod
    def of(cls, log: GuaranteedLog, vertical: ArrayLike | None = None) -> Self:
        """The sets that a guaranteed filter's ``run`` returned: their projections on the attitude.

        Parameters
        ----------
        log : GuaranteedLog
        vertical : (3,) array_like, optional
            The one that ``run`` was given. With it the log's bounds of tilt and heading count, too.
        """
        quaternions = np.full((len(log.times), 4), np.nan)
        known = np.isfinite(log.attitudes[:, 0, 0])
        quaternions[known] = quaternion_from_rotation(log.attitudes[known])
        sets = cls(log.times, quaternions, log.shapes[:, :3, :3], log.claims, are_proposals=log.are_proposals)
        if vertical is None:
            return sets
        if log.attitude_bounds is None:
            raise ValueError("vertical: the log has no bounds of tilt and heading; run was not given one")
        return replace(sets, bounds=log.attitude_bounds, vertical=_unit_vector("vertical", vertical))


@dataclass(frozen=True, eq=False)
class UpCaps:
    """Where true up may be, at n rows, as a circle on the sphere; NaN where that is not known."""

    directions: FloatArray
    """The circles' middles, unit vectors in body axes, shape (n, 3)."""
    angles: FloatArray
    """How far true up may be from them, rad, shape (n,)."""
    claims: NDArray[np.uint8]
    """What that rests on, an index of `elliptude.results.CLAIMS`, shape (n,)."""


@dataclass(frozen=True)
class Limits:
    """The errors that the user can bear, rad; None for those that do not matter."""

    total: float | None = None
    tilt: float | None = None
    heading: float | None = None

    def __post_init__(self) -> None:
        """Refuse what is no angle."""
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None and not 0.0 <= value <= np.pi:
                raise ValueError(f"limit of {field.name} must be from 0 to π rad, not {value}")


class Alarms(NamedTuple):
    """Rows with a reason to distrust the attitude, for each of `QUESTIONS`, shape (n, 3)."""

    proved: NDArray[np.bool_]
    """It is not what the set allows, and the set rests on the stated bounds alone."""
    conditional: NDArray[np.bool_]
    """It is not what the set allows, but the set also rests on measurements that were left out."""
    over_limit: NDArray[np.bool_]
    """No unconditional bound is within the limit; perhaps because there is none."""


@dataclass(frozen=True, eq=False)
class Monitored:
    """How far the attitudes of n rows can be off; NaN where nothing is known or nothing is judged."""

    times: FloatArray
    """s, shape (n,)."""
    judged: NDArray[np.bool_]
    """Rows with an attitude to judge, shape (n,)."""
    bounds: FloatArray
    """How far total, tilt and heading can be off, rad, shape (n, 3)."""
    least: FloatArray
    """How far they are off at least, rad, shape (n, 3): above 0 the attitude is not what the set allows."""
    claims: NDArray[np.uint8]
    """What each number rests on, an index of `elliptude.results.CLAIMS`, shape (n, 3)."""
    headings: FloatArray
    """The turn about up from the attitude to the truth: at least and at most, rad, modulo 2π, shape (n, 2)."""
    questions: tuple[str, ...]
    """Those of `QUESTIONS` that were judged."""
    limits: Limits

    @property
    def alarms(self) -> Alarms:
        """Where the attitude is proved wrong, or its error not shown to be within a limit."""
        outside = self.least > 0.0
        is_proof = self.claims == _UNCONDITIONAL
        limits = [getattr(self.limits, question) for question in QUESTIONS]
        over = np.zeros_like(outside)
        for i, limit in enumerate(limits):
            if limit is not None:
                over[:, i] = self.judged & ~(is_proof[:, i] & (self.bounds[:, i] <= limit))
        return Alarms(outside & is_proof, outside & ~is_proof, over)

    def to_dict(self) -> dict[str, Any]:
        """Figures for a summary, angles in degrees: bounds by claim, alarms, limits; None for what is not judged."""
        alarms = self.alarms
        proved = alarms.proved.any(axis=1)
        result: dict[str, Any] = {
            "rows": len(self.times),
            "judged": int(self.judged.sum()),
            "questions": list(self.questions),
            "rows_with_proof": int(proved.sum()),
            "first_proof_s": float(self.times[np.argmax(proved)]) if proved.any() else None,
            "rows_with_alarm": int((proved | alarms.over_limit.any(axis=1)).sum()),
        }
        for i, question in enumerate(QUESTIONS):
            if question not in self.questions:
                result[question] = None
                continue
            bounds, limit = np.rad2deg(self.bounds[:, i]), getattr(self.limits, question)
            by_claim = {
                claim: _figures(bounds[self.judged & (self.claims[:, i] == index)])
                for index, claim in enumerate(CLAIMS[:_NONE])
            }
            least = self.least[alarms.proved[:, i], i]
            result[question] = {
                "bound_deg": by_claim,
                "without_bound": int((self.judged & (self.claims[:, i] == _NONE)).sum()),
                "proved_wrong": int(alarms.proved[:, i].sum()),
                "wrong_if_condition_holds": int(alarms.conditional[:, i].sum()),
                "largest_least_deg": float(np.rad2deg(least.max())) if len(least) else None,
                "limit_deg": None if limit is None else float(np.rad2deg(limit)),
                "not_within_limit": None if limit is None else int(alarms.over_limit[:, i].sum()),
            }
        return result


def monitor(
    sets: Sets | GuaranteedLog,
    attitudes: AttitudeLike,
    *,
    up: ArrayLike | None = None,
    caps: UpCaps | None = None,
    heading: Heading = "same",
    limits: Limits | None = None,
) -> Monitored:
    """Bound the error of another filter's attitudes, row by row: theory, section 18.8.

    Parameters
    ----------
    sets : Sets or GuaranteedLog
        What `elliptude.GuaranteedFilter.run` returned, or other sets. If their bounds are proposals
        (``are_proposals``), nothing is a proof, caps included.
    attitudes : (n, 3, 3) array_like, SciPy's ``Rotation`` or (n, 4) array_like
        The attitudes to judge, at the times of the rows, from the same body to the same reference axes; as quaternions
        (qw, qx, qy, qz). NaN where there is none.
    up : (3,) array_like, optional
        Up (or down) in reference axes. Without it neither tilt nor heading is judged.
    caps : UpCaps, optional
        What else is known of up. Of the sources with the strongest claim the smallest bound counts.
    heading : {"same", "free"}
        "free" if the attitudes' heading counts from elsewhere: then the tilt alone is judged.
    limits : Limits, optional
        Errors from which on a row is an alarm.

    Returns
    -------
    Monitored

    Raises
    ------
    ValueError
        If an argument has a wrong shape, an attitude is none, or nothing would be judged.
    """
    sets = Sets.of(sets) if isinstance(sets, GuaranteedLog) else sets
    limits = Limits() if limits is None else limits
    count = len(sets.times)
    if sets.shapes.shape != (count, 3, 3) or sets.claims.shape != (count,):
        raise ValueError(f"sets: shapes {sets.shapes.shape} and claims {sets.claims.shape} are not of {count} rows")
    centers, estimated = (
        as_quaternions("sets.quaternions", sets.quaternions, count),
        as_quaternions("attitudes", attitudes, count),
    )
    vertical = None if up is None else _unit_vector("up", up)
    questions = _questions(heading, vertical, caps)
    for question in set(QUESTIONS) - set(questions):
        if getattr(limits, question) is not None:
            why = "there is no up" if vertical is None else "the heading is free"
            raise ValueError(f"limit of {question}: it is not judged, because {why}")
    known, there = np.isfinite(estimated[:, 0]), np.isfinite(centers[:, 0]) & (sets.claims < _NONE)
    both = known & there
    numbers = ErrorAngles(*(np.full(count, np.nan) for _ in ErrorAngles._fields))
    for rows in np.array_split(np.flatnonzero(both), 1 + int(both.sum()) // _AT_ONCE):
        offsets = product(centers[rows] * [1.0, -1.0, -1.0, -1.0], estimated[rows])
        center_up = None if vertical is None else rotation_from_quaternion(centers[rows]).swapaxes(1, 2) @ vertical
        values, vectors = sets.principal
        found = error_angles(offsets, sets.shapes[rows], center_up, (values[rows], vectors[rows]))
        if center_up is not None and sets.bounds is not None:
            found = _narrowed(found, offsets, center_up, _bounds_about(sets, vertical, rows))
        for whole, some in zip(numbers, found, strict=True):
            whole[rows] = some
    bounds = np.column_stack([numbers.total, numbers.tilt, numbers.heading])
    least = np.column_stack([numbers.least_total, numbers.least_tilt, numbers.least_heading])
    headings = np.column_stack([numbers.heading_from, numbers.heading_to])
    claims = np.where(np.isfinite(bounds), sets.claims[:, None], _NONE).astype(np.uint8)
    if caps is not None:
        assert vertical is not None
        _narrow_by_caps(bounds, least, claims, caps, estimated, vertical)
    if vertical is not None:
        # What rests on a stronger claim holds under a weaker one.
        bounds[:, 0] = np.minimum(bounds[:, 0], _whole_by_parts(bounds[:, 1], bounds[:, 2]))
        least[:, 0] = np.maximum(least[:, 0], np.maximum(least[:, 1], least[:, 2]))
    if heading == "free":
        bounds[:, [0, 2]] = least[:, [0, 2]] = headings[:] = np.nan
        claims[:, [0, 2]] = _NONE
    if sets.are_proposals:
        claims = np.maximum(claims, _CONDITIONAL)
    return Monitored(sets.times, known, bounds, least, claims, headings, questions, limits)


def _bounds_about(sets: Sets, up: FloatArray | None, rows: NDArray[np.intp]) -> AttitudeBounds:
    """Bounds of the centers of some rows about up, which may be the other end of the vertical that they are about."""
    if sets.bounds is None or sets.vertical is None or up is None:
        raise ValueError("sets: bounds of tilt and heading without the vertical that they are of")
    tilt, heading_from, heading_to, angle = (np.asarray(values)[rows] for values in sets.bounds)
    if (np.abs(up - sets.vertical) <= _SAME_VECTOR).all():
        return AttitudeBounds(tilt, heading_from, heading_to, angle)
    if (np.abs(up + sets.vertical) <= _SAME_VECTOR).all():
        return AttitudeBounds(tilt, -heading_to, -heading_from, angle)
    raise ValueError(f"up: {up.tolist()} is not the vertical {sets.vertical.tolist()} that the sets' bounds are of")


def _narrowed(found: ErrorAngles, offsets: FloatArray, up: FloatArray, bounds: AttitudeBounds) -> ErrorAngles:
    """What the set says, and what bounds of the center's tilt and heading do: both hold, (18.29) and (18.30)."""
    seen = from_center(offsets, up, bounds)
    headings = arcs.common(np.column_stack([found.heading_from, found.heading_to]), seen.headings)
    return found._replace(
        tilt=np.fmin(found.tilt, seen.tilt),
        least_tilt=np.fmax(found.least_tilt, seen.least_tilt),
        heading=arcs.largest(headings),
        least_heading=arcs.least(headings),
        heading_from=headings[:, 0],
        heading_to=headings[:, 1],
    )


def _whole_by_parts(tilt: FloatArray, heading: FloatArray) -> FloatArray:
    """The largest angle by those of tilt and heading, (18.26), in sines so that small ones keep their digits."""
    of_tilt, of_heading = np.sin(0.5 * tilt) ** 2, np.sin(0.5 * heading) ** 2
    share = np.minimum((1.0 + ANGLE_ROUNDING) * (of_tilt + of_heading * np.cos(0.5 * tilt) ** 2), 1.0)
    return np.asarray(np.minimum(2.0 * np.arcsin(np.sqrt(share)) + ANGLE_ROUNDING, np.pi))


def _questions(heading: Heading, up: FloatArray | None, caps: UpCaps | None) -> tuple[str, ...]:
    """Those that can be judged."""
    if heading not in {"same", "free"}:
        raise ValueError(f"heading must be 'same' or 'free', not {heading!r}")
    if up is None and (heading == "free" or caps is not None):
        raise ValueError("up: missing; a free heading leaves the tilt alone, and caps are about up")
    if heading == "free":
        return ("tilt",)
    return ("total",) if up is None else QUESTIONS


def _narrow_by_caps(
    bounds: FloatArray,
    least: FloatArray,
    claims: NDArray[np.uint8],
    caps: UpCaps,
    estimated: FloatArray,
    up: FloatArray,
) -> None:
    """What caps about up say of the tilt, (18.25)."""
    count = len(bounds)
    if caps.directions.shape != (count, 3) or caps.angles.shape != (count,) or caps.claims.shape != (count,):
        raise ValueError(f"caps must have directions ({count}, 3), angles ({count},) and claims ({count},)")
    if (caps.angles < 0.0).any() or (caps.directions == 0.0).all(axis=1).any():
        raise ValueError("caps: angles must be at least 0, and directions not zero")
    there = np.isfinite(caps.angles) & np.isfinite(caps.directions).all(axis=1) & np.isfinite(estimated[:, 0])
    there &= caps.claims < _NONE
    off = np.full(len(bounds), np.nan)
    seen = rotation_from_quaternion(estimated[there]).swapaxes(1, 2) @ up
    middles = caps.directions[there]
    off[there] = np.arctan2(np.linalg.norm(np.cross(seen, middles), axis=1), np.einsum("ni,ni->n", seen, middles))
    largest = np.minimum(off + caps.angles + ANGLE_ROUNDING, np.pi)
    smallest = np.maximum(off - caps.angles - ANGLE_ROUNDING, 0.0)
    stronger, equal = there & (caps.claims < claims[:, 1]), there & (caps.claims == claims[:, 1])
    bounds[:, 1] = np.where(stronger, largest, np.where(equal, np.fmin(bounds[:, 1], largest), bounds[:, 1]))
    least[:, 1] = np.where(stronger, smallest, np.where(equal, np.fmax(least[:, 1], smallest), least[:, 1]))
    claims[:, 1] = np.where(stronger, caps.claims, claims[:, 1])


def as_quaternions(name: str, attitudes: AttitudeLike, count: int) -> FloatArray:
    """Unit quaternions (n, 4), NaN where there is no attitude."""
    values = np.asarray(
        attitudes.as_matrix() if isinstance(attitudes, SupportsAsMatrix) else unmasked(attitudes), dtype=np.float64
    )
    if values.shape not in ((count, 4), (count, 3, 3)):
        raise ValueError(f"{name} must have shape ({count}, 3, 3) or ({count}, 4), not {values.shape}")
    known: NDArray[np.bool_] = np.asarray(np.isfinite(values.reshape(count, -1)).all(axis=1))
    if values.shape == (count, 4):
        lengths = np.linalg.norm(values, axis=1)
        wrong = known & ~(np.abs(lengths - 1.0) <= _LENGTH_TOLERANCE)
        if wrong.any():
            row = int(np.argmax(wrong))
            raise ValueError(f"{name}: the quaternion of row {row} is {lengths[row]:.4g} long, not 1 within 0.01")
        return np.where(known[:, None], values / np.where(known, lengths, 1.0)[:, None], np.nan)
    quaternions = np.full((count, 4), np.nan)
    wrong = known.copy()
    wrong[known] = ~np.asarray(is_rotation(values[known]))
    if wrong.any():
        raise ValueError(f"{name}: row {int(np.argmax(wrong))} is not a rotation matrix")
    quaternions[known] = quaternion_from_rotation(values[known])
    return quaternions


def _unit_vector(name: str, values: ArrayLike) -> FloatArray:
    vector = np.asarray(values, dtype=np.float64)
    length = float(np.linalg.norm(vector)) if vector.shape == (3,) else 0.0
    if not 0.0 < length < np.inf:
        raise ValueError(f"{name} must be three finite numbers, not all 0: {values!r}")
    return vector / length


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products of quaternions (n, 4), scalar first."""
    (aw, ax, ay, az), (bw, bx, by, bz) = a.T, b.T
    products = np.empty((len(a), 4))
    products[:, 0] = aw * bw - (ax * bx + ay * by + az * bz)
    products[:, 1] = aw * bx + bw * ax + (ay * bz - az * by)
    products[:, 2] = aw * by + bw * ay + (az * bx - ax * bz)
    products[:, 3] = aw * bz + bw * az + (ax * by - ay * bx)
    return products


def _figures(values: FloatArray) -> dict[str, float | int | None]:
    values = values[np.isfinite(values)]
    if not len(values):
        return {"rows": 0, "mean": None, "median": None, "max": None}
    return {
        "rows": len(values),
        "mean": float(values.mean()),
        "median": float(np.median(values)),
        "max": float(values.max()),
    }
