"""Another filter's attitudes judged by a run: what is read of both, and the table of what comes out."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal, TypeAlias, get_args

import numpy as np
import scipy
from numpy.typing import NDArray

from elliptude.configuration.references import from_enu
from elliptude.io.column_files import Column
from elliptude.io.tables import Result
from elliptude.logs.reference_attitudes import (
    Reference,
    attitudes_at,
    has_sample_at,
    in_words_of_origin,
    to_nearest_sample,
)
from elliptude.monitoring import Limits, Monitored, Sets, UpCaps, monitor, widened
from elliptude.monitoring.monitor import QUESTIONS, Heading
from elliptude.report.run import Run
from elliptude.results import CLAIMS, AttitudeBounds
from elliptude.typing import FloatArray

# rad/s, 16,000 revolutions a second: nothing that carries sensors turns faster.
_FASTEST = 1e5
# The vertical of ENU, NWU and NED, up or down.
_VERTICAL = (0.0, 0.0, 1.0)
GroundFrame: TypeAlias = Literal["ENU", "NED", "NWU"]
# Share of the rows from which on alarms are more likely a mistake about axes, and up to which other axes explain them.
_MOST, _FEW = 0.5, 0.1
_CLAIM_INDEX = {word: index for index, word in enumerate(CLAIMS)} | {"": CLAIMS.index("none")}
_CHOICES = [[bool(code >> i & 1) for i in range(3)] for code in range(8)]


def run_of(result: Result, *, heading_from_start: bool, bounds_from_recording: str | None) -> Run:
    """A run from results of the guaranteed mode that were not written.

    Parameters
    ----------
    result : Result
    heading_from_start : bool
        Whether its heading counts from the first row.
    bounds_from_recording : str, optional
        The recording that its bounds are proposals from.

    Returns
    -------
    Run
    """
    return Run(
        times=result.times,
        quaternions=result.quaternions,
        shapes=result.shapes[:, :3, :3],
        half_widths=result.half_widths[:, :3],
        largest_angles=result.largest_angles,
        used=tuple(result.used),
        refused=tuple(result.refused),
        claims=None if result.claims is None else tuple(result.claims),
        chart=result.chart,
        tilt_bounds=result.tilt_bounds,
        ups=result.ups,
        up_bounds=result.up_bounds,
        up_claims=None if result.up_claims is None else tuple(result.up_claims),
        headings=result.headings,
        heading_from_start=heading_from_start,
        clock_turns=result.clock_turns,
        origin=result.origin,
        bounds_from_recording=bounds_from_recording,
    )


def judge(
    run: Run,
    estimate: Reference,
    *,
    has_vertical: bool,
    heading: Heading,
    limits: Limits,
    largest_gap: float = 0.0,
) -> Monitored:
    """Judge attitudes by the sets of a run, at its rows.

    Parameters
    ----------
    run : Run
    estimate : Reference
        The attitudes to judge, in the reference axes of the run.
    has_vertical : bool
        Whether the third reference axis is the vertical.
    heading : {"same", "free"}
        "free" if the estimate's heading counts from elsewhere.
    limits : Limits
    largest_gap : float
        If the estimate has no sample at a row's time, it is interpolated between two that are no further apart, s.

    Returns
    -------
    Monitored

    Raises
    ------
    ValueError
        If the run is of a mode without guarantee, no row has an attitude to judge, or nothing would be judged.
    """
    found = _as_seen(run, estimate, has_vertical=has_vertical, heading=heading, limits=limits, largest_gap=largest_gap)
    # A stamp some digits beside that of the row may be another moment: what the body turns until then proves nothing.
    proved = widened(found, _FASTEST * to_nearest_sample(estimate, run.times)).least
    # What is interpolated is not the filter's word: it can be off, but it proves nothing against the filter.
    least = np.where(has_sample_at(estimate, run.times)[:, None], proved, np.minimum(found.least, 0.0))
    return replace(found, least=least)


def _as_seen(
    run: Run, estimate: Reference, *, has_vertical: bool, heading: Heading, limits: Limits, largest_gap: float
) -> Monitored:
    """What the sets say of attitudes at their rows, whether a filter said these then or not."""
    if run.claims is None or run.chart != "gibbs":
        raise ValueError("sets without a claim are no guarantee; monitor needs estimator.mode = 'guaranteed'")
    rows, attitudes = attitudes_at(estimate, run.times, np.arange(len(run.times)), largest_gap)
    if not len(rows):
        raise ValueError(
            f"no row has an estimate at its time; rows are from {run.times[0]:g} s to {run.times[-1]:g} s, estimates "
            f"from {estimate.times[0]:g} s to {estimate.times[-1]:g} s, and the largest gap is {largest_gap:g} s"
            f"{in_words_of_origin(run.origin)}"
        )
    quaternions = np.full((len(run.times), 4), np.nan)
    quaternions[rows] = attitudes.as_quat(scalar_first=True)
    claims = np.array([_CLAIM_INDEX[word] for word in run.claims], dtype=np.uint8)
    are_proposals = run.bounds_from_recording is not None
    sets = Sets(run.times, run.quaternions, run.shapes, claims, are_proposals=are_proposals)
    if has_vertical and run.tilt_bounds is not None and run.headings is not None and run.ups is not None:
        upward = _upward(run.ups, _verticals(run))
        bounds = AttitudeBounds(run.tilt_bounds, run.headings[:, 0], run.headings[:, 1], np.full(len(claims), np.pi))
        sets = replace(sets, bounds=bounds, vertical=upward * np.array(_VERTICAL))
    found = monitor(
        sets,
        quaternions,
        up=_VERTICAL if has_vertical else None,
        caps=_caps_of(run, claims) if has_vertical else None,
        heading=heading,
        limits=limits,
    )
    if run.clock_turns is not None:
        found = widened(found, run.clock_turns)
    return found


def _caps_of(run: Run, claims: NDArray[np.uint8]) -> UpCaps | None:
    """Where true up is by the table, also where no attitude is known; by ``tilt_bound`` if it has no columns of up."""
    directions = _verticals(run)
    if run.ups is not None and run.up_bounds is not None and run.up_claims is not None and run.known.any():
        of_up = np.array([_CLAIM_INDEX[word or "none"] for word in run.up_claims], dtype=np.uint8)
        return UpCaps(_upward(run.ups, directions) * run.ups, run.up_bounds, of_up)
    return None if run.tilt_bounds is None else UpCaps(directions, run.tilt_bounds, claims)


def _verticals(run: Run) -> FloatArray:
    """The third reference axis in the body axes of the estimates, shape (N, 3); NaN without one."""
    known = np.isfinite(run.quaternions[:, 0])
    directions = np.full((len(known), 3), np.nan)
    if known.any():
        directions[known] = (
            scipy.spatial.transform.Rotation.from_quat(run.quaternions[known], scalar_first=True).inv().apply(_VERTICAL)
        )
    return directions


def _upward(ups: FloatArray, directions: FloatArray) -> float:
    """1 if the third reference axis is up, −1 if it is down, as the estimates show."""
    return 1.0 if np.nansum(np.einsum("ni,ni->n", ups, directions)) >= 0.0 else -1.0


def columns(monitored: Monitored) -> dict[str, Column]:
    """The table's columns by name: docs/monitor.md."""
    alarms = monitored.alarms
    table: dict[str, Column] = {"time_s": monitored.times}
    for what, angles in (("bound", monitored.bounds), ("least", monitored.least)):
        table |= {
            f"{question}_{what}": np.where(monitored.judged, angles[:, i], np.nan)
            for i, question in enumerate(QUESTIONS)
        }
    words = [[CLAIMS[index] for index in column] for column in monitored.claims.T.tolist()]
    table |= {"claim": _where_judged(monitored, words[0]), "tilt_claim": _where_judged(monitored, words[1])}
    proofs, limits = (np.asarray(flags.any(axis=1)) for flags in (alarms.proved, alarms.over_limit))
    table["alarm"] = [
        " ".join(word for word, is_there in (("proof", proof), ("limit", limit)) if is_there)
        for proof, limit in zip(proofs.tolist(), limits.tolist(), strict=True)
    ]
    table["outside"] = _questions(alarms.proved | alarms.conditional)
    table["over_limit"] = _questions(alarms.over_limit)
    return table


def _where_judged(monitored: Monitored, words: Sequence[str]) -> list[str]:
    return [word if judged else "" for word, judged in zip(words, monitored.judged, strict=True)]


def _questions(chosen: NDArray[np.bool_]) -> list[str]:
    """The names of the questions that are chosen in each row, a space between them."""
    texts = [" ".join(name for name, bit in zip(QUESTIONS, bits, strict=True) if bit) for bits in _CHOICES]
    return [texts[code] for code in (chosen @ [1, 2, 4]).tolist()]


def in_frame(estimate: Reference, turn: FloatArray) -> Reference:
    """Attitudes whose reference axes are turned into others.

    Parameters
    ----------
    estimate : Reference
    turn : (3, 3) array
        Takes vectors from their reference axes to the others.

    Returns
    -------
    Reference
    """
    return Reference(estimate.times, scipy.spatial.transform.Rotation.from_matrix(turn) * estimate.attitudes)


def rows_that_may_prove(run: Run, estimate: Reference, found: Monitored) -> int:
    """How many of the judged rows have a sample of the estimate at their very time."""
    return int((found.judged & has_sample_at(estimate, run.times)).sum())


def hint(
    run: Run,
    estimate: Reference,
    *,
    has_vertical: bool,
    heading: Heading,
    largest_gap: float,
    frames: tuple[GroundFrame | None, GroundFrame | None],
) -> str | None:
    """What is probably the matter if the sets exclude most rows: another frame, another heading.

    Parameters
    ----------
    run, estimate, has_vertical, heading, largest_gap
        As `judge` takes them.
    frames : pair of str, optional
        The reference frames of the sets and of the estimate, as far as they are stated.

    Returns
    -------
    str, optional
        In words.
    """

    def excluded(attitudes: Reference) -> FloatArray:
        found = _as_seen(
            run, attitudes, has_vertical=has_vertical, heading=heading, limits=Limits(), largest_gap=largest_gap
        )
        with np.errstate(invalid="ignore"):
            shares: FloatArray = (found.least[found.judged] > 0.0).mean(axis=0)
        return shares

    total, tilt, of_heading = excluded(estimate)
    if not max(total, tilt, of_heading) > _MOST:
        return None
    of_sets, of_estimate = frames
    if of_estimate is None and (option := _fitting_frame(run, estimate, of_sets, excluded)) is not None:
        return f"most rows are outside, and with {option} they are not: the reference frames differ"
    if tilt > _MOST:
        return "the up direction is wrong at most rows: has the estimate the same body axes and reference frame?"
    if of_heading > _MOST:
        return "the heading is wrong at most rows: if it counts from elsewhere, --heading-free judges the tilt alone"
    return "the attitude is wrong at most rows: has the estimate the same body axes and reference frame?"


def _fitting_frame(
    run: Run, estimate: Reference, of_sets: GroundFrame | None, excluded: Callable[[Reference], FloatArray]
) -> str | None:
    """The options with which the sets exclude few rows, if there are any."""
    stated = of_sets
    if of_sets is None:
        is_down = run.ups is not None and run.known.any() and _upward(run.ups, _verticals(run)) < 0.0
        of_sets = "NED" if is_down else "ENU"
    shares: dict[GroundFrame, float] = {}
    for frame in get_args(GroundFrame):
        if frame != of_sets:
            shares[frame] = float(excluded(in_frame(estimate, frame_to_frame(frame, of_sets))).max())
    best = min(shares, key=lambda frame: shares[frame])
    if shares[best] > _FEW:
        return None
    return f"--estimate-frame {best}" if stated is not None else f"--frame {of_sets} --estimate-frame {best}"


def frame_to_frame(of_estimate: GroundFrame, of_sets: GroundFrame) -> FloatArray:
    """What takes vectors from the reference axes of an estimate to those of sets, (3, 3)."""
    turn: FloatArray = np.asarray(from_enu(np.eye(3), of_sets).T @ from_enu(np.eye(3), of_estimate))
    return turn
