"""Sets that use a whole recording: a pass forward, one backward, and what both leave possible; theory, section 20."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import elliptude
from elliptude.configuration.configuration import Configuration
from elliptude.estimation import estimator
from elliptude.estimation.direction_rows import Contradiction
from elliptude.estimation.estimator import Estimation
from elliptude.estimation.guaranteed_run import CONDITIONAL, GuaranteedRun, gaps_between, run_filter, run_guaranteed
from elliptude.estimation.questions.answers import Answers, answers_of
from elliptude.estimation.sizes_in_words import HEADING, LARGEST_ANGLE, TILT, UP
from elliptude.estimation.vertical import contradictions_of_up, followed
from elliptude.logs.log import Log
from elliptude.results import CLAIMS, GuaranteedLog
from elliptude.smoothing import disputes
from elliptude.smoothing.both import Passes, both_passes
from elliptude.smoothing.disputes import Disputes
from elliptude.smoothing.mirror import caps_turned_round, mirrored, mirrored_set, turned_round
from elliptude.smoothing.questions import Answered, answers_of_both
from elliptude.smoothing.questions import turned_round as answers_turned_round
from elliptude.typing import FloatArray

_NONE = CLAIMS.index("none")


@dataclass(frozen=True, eq=False)
class SmoothedRun(GuaranteedRun):
    """A run whose sets use the whole recording."""

    disagreements: NDArray[np.intp] | None = None
    """Rows where both passes claim sets (or caps) without a condition, and these have nothing in common."""
    contested: NDArray[np.bool_] | None = None
    """Rows where a pass claims less since the other one has found a contradiction, shape (n,)."""
    backward: GuaranteedRun | None = None
    """The pass over the mirrored log, in its own order."""
    counts: tuple[NDArray[np.bool_], NDArray[np.bool_]] | None = None
    """Rows whose set rests on the pass forward, and rows whose set rests on the one backward, shape (n,) each."""


def smooth(log: Log, configuration: Configuration) -> Estimation:
    """Estimate with sets that use the whole recording.

    Parameters
    ----------
    log : Log
    configuration : Configuration
        Its ``estimator.mode`` is "guaranteed".

    Returns
    -------
    Estimation
        Its ``guaranteed`` is a `SmoothedRun`.

    Raises
    ------
    InconsistentMeasurement
        As `elliptude.estimation.estimate`; also if both passes contradict one another, and the policy is to raise.
    ValueError
        As `elliptude.estimation.estimate`; also in another mode, or if the motion cannot be followed backward.
    """
    require_guaranteed(configuration)
    return estimator.estimate(log, configuration, smoothed_run, smoothed_answers)


def require_guaranteed(configuration: Configuration) -> None:
    """Refuse a configuration of another mode.

    Raises
    ------
    ValueError
        If it is one.
    """
    mode = configuration.estimator.mode
    if mode != "guaranteed":
        raise ValueError(f"smoothing needs estimator.mode = 'guaranteed', not {mode!r}")


def smoothed_run(log: Log, configuration: Configuration) -> SmoothedRun:
    """As `elliptude.estimation.guaranteed_run.run_guaranteed`, with sets that use the whole recording."""
    forward = run_guaranteed(log, configuration)
    try:
        back = _backward(forward, configuration)
    except (elliptude.InconsistentMeasurement, elliptude.RowError) as error:
        raise _in_order(error, forward.log) from error
    backward = turned_round(back.run.sets, forward.given.times)
    caps = None if back.run.caps is None else caps_turned_round(back.run.caps)
    found = both_passes(
        Passes(forward, backward, caps, back.disputes, back.disputes_of_caps),
        configuration,
    )
    if len(found.disagreements) and configuration.estimator.policy == "raise":
        row = int(found.disagreements[0])
        raise elliptude.InconsistentMeasurement(
            f"what is known from before {log.times[row]:.6f} s and from after it has nothing in common; some bound is "
            "wrong (estimator.policy says what to do then)",
            np.nan,
            float(log.times[row]),
            "",
            row,
        )
    return SmoothedRun(
        log=forward.log,
        given=forward.given,
        start=forward.start,
        sets=found.sets,
        rows=forward.rows,
        vertical=found.vertical,
        caps=found.caps,
        starts_heading=forward.starts_heading,
        gaps=gaps_between(log, configuration, forward.rows, found.sets, forward.given.turns),
        forward=forward,
        up_contradictions=_of_both(forward, back.run),
        disagreements=found.disagreements,
        contested=found.contested,
        backward=back.run,
        counts=found.counts,
    )


def smoothed_answers(run: GuaranteedRun, configuration: Configuration) -> Answers | None:
    """As `elliptude.estimation.questions.answers.answers_of`, by both passes of a `SmoothedRun`."""
    assert isinstance(run, SmoothedRun)
    assert run.forward is not None
    assert run.backward is not None
    assert run.counts is not None
    forward, backward = answers_of(run.forward, configuration), answers_of(run.backward, configuration)
    if forward is None or backward is None:
        return None
    of_backward = turned_round(run.backward.sets, run.forward.given.times)
    return answers_of_both(
        run,
        Answered(run.forward.sets, forward, run.counts[0]),
        Answered(of_backward, answers_turned_round(backward), run.counts[1]),
        configuration,
    )


@dataclass(frozen=True, eq=False)
class _Backward:
    run: GuaranteedRun
    """The pass over the mirrored log, in its own order."""
    disputes: tuple[Disputes, Disputes]
    """Where the sets of the passes forward and backward are in dispute, in the order of the rows."""
    disputes_of_caps: tuple[Disputes, Disputes] | None


def _backward(forward: GuaranteedRun, configuration: Configuration) -> _Backward:
    """The pass over the mirrored log, and where each of the two has met contradictions; theory, section 20.2."""
    back = mirrored(forward, configuration)
    start, weakest = None, 0
    if forward.start is not None:
        # The measurements may not bound a state, nor know the frame that the heading counts in.
        start = mirrored_set(forward.sets, -1, back.given.estimates_vector)
        weakest = int(forward.sets.claims[-1]) if start is not None else 0
    if forward.contradictions:
        weakest = max(weakest, CONDITIONAL)
    sets = run_filter(back.given, start, configuration, forward.rows.up)
    caps = followed(configuration, back.rows, back.turns, sets, from_anchors=back.given.turns is not None)
    wrong = tuple(contradictions_of_up(back.rows, back.turns, caps))
    forward_anchors = None if forward.given.turns is None else forward.given.turns.anchors
    anchors = None if back.given.turns is None else back.given.turns.anchors
    of_caps = None
    if forward.caps is not None and caps is not None and forward.turns is not None and back.turns is not None:
        of_caps = (
            disputes.of_caps(forward.caps, forward.turns.anchors),
            disputes.of_caps(caps, back.turns.anchors).turned_round(),
        )
    of_sets = disputes.of_sets(forward.sets, forward_anchors), disputes.of_sets(sets, anchors).turned_round()
    sets = replace(sets, claims=np.maximum(sets.claims, weakest).astype(np.uint8))
    run = replace(
        forward,
        given=back.given,
        start=start,
        sets=sets,
        rows=back.rows,
        vertical=None,
        caps=caps,
        turns=back.turns,
        up_contradictions=wrong,
    )
    return _Backward(run, of_sets, of_caps)


def _of_both(forward: GuaranteedRun, backward: GuaranteedRun) -> tuple[Contradiction, ...]:
    """Measurements of up that contradict what either pass followed of it, in the order of the rows."""
    last = len(forward.given.times) - 1
    found = {last - one.row: replace(one, row=last - one.row) for one in backward.up_contradictions}
    found |= {one.row: one for one in forward.up_contradictions}
    return tuple(found[row] for row in sorted(found))


def _in_order(
    error: elliptude.InconsistentMeasurement | elliptude.RowError, log: Log
) -> elliptude.InconsistentMeasurement | elliptude.RowError:
    """An error of the pass backward, with its row in the order of the log."""
    row = None if error.row is None else len(log.times) - 1 - error.row
    message = f"backward in time: {error.args[0]}"
    if isinstance(error, elliptude.RowError):
        assert row is not None
        return elliptude.RowError(message, row)
    return elliptude.InconsistentMeasurement(message, error.margin, -error.time, error.sensor, row)


def summarize(estimation: Estimation, configuration: Configuration) -> dict[str, Any]:
    """`elliptude.estimation.summarize`, and ``smoothing``: how much smaller the sets are than the pass forward's."""
    assert estimation.guaranteed is not None
    return estimator.summarize(estimation, configuration) | {"smoothing": figures(estimation.guaranteed)}


def figures(run: GuaranteedRun) -> dict[str, Any]:
    """Figures of a smoothed run against its pass forward: means in degrees over the rows that both know."""
    assert isinstance(run, SmoothedRun)
    assert run.forward is not None
    assert run.disagreements is not None
    assert run.contested is not None
    forward = run.forward

    def compared(one: FloatArray | None, other: FloatArray | None) -> dict[str, float] | None:
        if one is None or other is None:
            return None
        rows = np.isfinite(one) & np.isfinite(other)
        if not rows.any():
            return None
        return {
            "forward": float(np.rad2deg(one[rows].mean())),
            "smoothed": float(np.rad2deg(other[rows].mean())),
        }

    def heading(sets: GuaranteedLog) -> FloatArray | None:
        return None if sets.attitude_bounds is None else np.asarray(sets.attitude_bounds.heading)

    before, after = forward.vertical, run.vertical
    result: dict[str, Any] = {
        "tilt_bound_deg": None if before is None or after is None else compared(before.tilt_bounds, after.tilt_bounds),
        "heading_bound_deg": compared(heading(forward.sets), heading(run.sets)),
        "up_bound_deg": None if before is None or after is None else compared(before.angles, after.angles),
        "largest_angle_deg": compared(forward.sets.extents().largest_angles, run.sets.extents().largest_angles),
        "rows_with_set": {
            "forward": int((forward.sets.claims < _NONE).sum()),
            "smoothed": int((run.sets.claims < _NONE).sum()),
        },
        "disagreeing_rows": len(run.disagreements),
        "contested_rows": int(run.contested.sum()),
    }
    return result | {"said": _said(result)}


def _said(figures_of: dict[str, Any]) -> list[str]:
    """Figures of a smoothed run in words."""
    names = {
        "heading_bound_deg": HEADING,
        "tilt_bound_deg": TILT,
        "up_bound_deg": UP,
        "largest_angle_deg": LARGEST_ANGLE,
    }
    parts = [
        f"{name} {one['smoothed']:.3g} instead of {one['forward']:.3g}"
        for key, name in names.items()
        if (one := figures_of[key]) is not None
    ]
    lines = [f"smoothed: {', '.join(parts)} degrees (means)"] if parts else ["smoothed, but no row has a set"]
    if figures_of["disagreeing_rows"]:
        lines.append(
            f"at {figures_of['disagreeing_rows']} rows what comes before and what comes after contradict one another: "
            "some statement is wrong, and no set is unconditional"
        )
    elif figures_of["contested_rows"]:
        lines.append(
            f"at {figures_of['contested_rows']} rows one pass rests on what the other has found to contradict, and "
            "claims less for it"
        )
    return lines
