"""Gaps of a gyro: intervals between its samples that its error bounds do not cover.

Between two samples the rate is taken to follow a straight line, and the bound of its error includes what is wrong with
that, for the usual interval. If samples were lost, this bounds nothing: about such a gap nothing is known but
how fast the body turns at most, and how fast that changes, if these are stated. Derivation: docs/theory.md, sections
17.6 and 18.4.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elliptude.bounds.gyro import GyroBounds, covered_interval, usual_longest, with_rounding
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow
from elliptude.estimation.sizes_in_words import LARGEST_ANGLE, rows_in_words
from elliptude.logs.log import Log
from elliptude.results import GuaranteedLog
from elliptude.typing import FloatArray


def longest_interval(log: Log, configuration: Configuration) -> float:
    """The longest interval that the bounds of the rates in a log cover, s; infinite without rates.

    Raises
    ------
    ValueError
        As `covered_interval`.
    """
    if log.rates is None:
        return np.inf
    stated = None
    if configuration.rule is not None:
        stated = configuration.rule.rule().gyro.longest_interval_s
    elif isinstance(configuration.flow, GyroFlow):
        stated = configuration.flow.longest_interval_s
    return covered_interval(_samples(log), stated)


def _samples(log: Log) -> FloatArray:
    """When rates were measured, s, shape (M,)."""
    if log.gyro_times is not None:
        return log.gyro_times
    return log.times[log.has_rate]


def _intervals(log: Log) -> FloatArray:
    """Time between the samples before and after each step from a row to the next, s, shape (N - 1,)."""
    samples = _samples(log)
    if len(samples) < 2:
        return np.full(max(len(log.times) - 1, 0), np.inf)
    middles = 0.5 * (log.times[1:] + log.times[:-1])
    after = np.clip(np.searchsorted(samples, middles), 1, len(samples) - 1)
    intervals: FloatArray = samples[after] - samples[after - 1]
    return intervals


def without_rates_in_gaps(log: Log, longest: float) -> Log:
    """The log with NaN for rates that were filled in between samples further apart than ``longest``, s."""
    if log.rates is None or log.gyro_times is None:
        return log
    in_gap = np.zeros(len(log.times) + 1, dtype=np.bool_)
    in_gap[1:-1] = _intervals(log) > longest
    inside = in_gap[1:] & in_gap[:-1] & ~np.isin(log.times, log.gyro_times)
    if not inside.any():
        return log
    rates = log.rates.copy()
    rates[inside] = np.nan
    return replace(log, rates=rates)


def filled_in_between(log: Log, longest: float) -> float:
    """The longest interval up to ``longest`` with a row within it, whose rate is filled in, s; 0 without one."""
    if log.gyro_times is None or len(log.times) < 2:
        return 0.0
    intervals = _intervals(log)
    filled = (np.diff(log.times) < (1.0 - 1e-6) * intervals) & (intervals <= longest)
    return float(intervals[filled].max(initial=0.0))


MOST_LISTED = 200
"""How many gaps a summary lists, the longest ones."""
_MOST_SAID = 5


@dataclass(frozen=True)
class Gap:
    """A gap in the gyro, and the size of the set before and after it."""

    time: float
    """Time of the last sample before it, s."""
    duration: float
    """Time to the next one, s."""
    turn: float
    """How far the turn over it may be off, rad; pi, half a turn, means any attitude."""
    before: float
    """Largest angle in the set in the last row before it, rad; NaN without a set."""
    after: float
    """Likewise in the first row after it, with what was measured there."""
    rows_without_set: int
    """Rows from the gap on until there is a set again, whatever is lost later; 0 if there was none before it."""
    is_for_good: bool = False
    """Whether these are all rows to the end: there never is a set again."""


def gaps_of(
    log: Log,
    gyro: GyroBounds,
    found: GuaranteedLog,
    crossed: tuple[NDArray[np.intp], FloatArray] | None = None,
) -> tuple[Gap, ...]:
    """What an estimation lost in the gaps of a log.

    Parameters
    ----------
    log : Log
    gyro : GyroBounds
    found : GuaranteedLog
        The sets at the log's rows.
    crossed : pair of arrays (N,), optional
        From which row each row was predicted, and how far that turn may be off, rad; step by step if left out.

    Returns
    -------
    tuple of Gap
        In order of time; only gaps with rows on both sides.
    """
    samples = _samples(log)
    durations = np.diff(samples)
    long = np.flatnonzero(durations > gyro.longest_interval)
    if not len(long):
        return ()
    angles = found.extents().largest_angles
    with_set = np.append(np.flatnonzero(np.isfinite(angles)), len(angles))
    first = np.searchsorted(log.times, samples[long], side="right") - 1
    last = np.searchsorted(log.times, samples[long + 1])
    gaps = []
    for begin, duration, i, j in zip(samples[long], durations[long], first, last, strict=True):
        if i < 0 or j >= len(log.times):
            continue
        turn = float(gyro.turns_over_gaps(duration))
        if crossed is not None and crossed[0][j] == i:
            turn = min(float(crossed[1][j]), np.pi)
        again = int(with_set[np.searchsorted(with_set, i + 1)])
        gaps.append(
            Gap(
                time=float(begin),
                duration=float(duration),
                turn=turn,
                before=float(angles[i]),
                after=float(angles[j]),
                rows_without_set=again - int(i) - 1 if np.isfinite(angles[i]) else 0,
                is_for_good=bool(np.isfinite(angles[i])) and again == len(angles),
            )
        )
    return tuple(gaps)


class Bridged:
    """Gaps that a mode of first order bridges by straight lines, found piece by piece."""

    def __init__(self, configuration: Configuration) -> None:
        flow = configuration.flow
        self._has_gyro = isinstance(flow, GyroFlow)
        self._longest = flow.longest_interval_s if isinstance(flow, GyroFlow) else None
        self._last = np.empty(0)
        self._count, self._total = 0, 0.0
        self._longest_gap = 0.0, 0.0

    def add(self, log: Log) -> None:
        """Look at the next rows. The usual interval is that of the first rows."""
        if not self._has_gyro:
            return
        samples = np.unique(np.concatenate([self._last, _samples(log)]))
        self._last = samples[-1:]
        intervals = np.diff(samples)
        if self._longest is None and len(intervals):
            self._longest = usual_longest(intervals)
        longest = np.inf if self._longest is None else with_rounding(self._longest, samples)
        for at in np.flatnonzero(intervals > longest):
            self._count, self._total = self._count + 1, self._total + float(intervals[at])
            self._longest_gap = max(self._longest_gap, (float(intervals[at]), float(samples[at])))

    def summarize(self) -> dict[str, Any]:
        """The figures for ``summary.json``."""
        duration, time = self._longest_gap
        said = []
        if self._count:
            said = [
                f"{_counted(self._count)} in the gyro, longer than {self._longest:.4g} s ({self._total:.3g} s in all, "
                f"the longest {duration:.4g} s from {time:.4f} s on): taken for straight lines, which no bound covers"
            ]
        return {"longest_interval_s": self._longest, "count": self._count, "total_s": self._total, "said": said}


def _counted(count: int) -> str:
    return f"{count} gap{'s' if count > 1 else ''}"


def _until(set_again: bool) -> str:
    """How long there is no set."""
    return "until there is a set again" if set_again else "without a set; there is none again to the end"


def summarize(gaps: tuple[Gap, ...], gyro: GyroBounds | None) -> dict[str, Any]:
    """The figures for ``summary.json``: s, degrees; the longest gaps are listed one by one."""

    def finite(value: float) -> float | None:
        return float(value) if np.isfinite(value) else None

    def degrees(angle: float) -> float | None:
        return finite(float(np.rad2deg(angle)))

    worst = sorted(gaps, key=lambda gap: (-gap.rows_without_set, -gap.duration))
    listed = sorted(worst[:MOST_LISTED], key=lambda gap: gap.time)
    summary: dict[str, Any] = {
        # Nine digits are without what is for rounding.
        "longest_interval_s": None if gyro is None else finite(float(f"{gyro.longest_interval:.9g}")),
        "largest_rate_deg_per_s": None if gyro is None else degrees(gyro.largest_rate),
        "largest_angular_acceleration_deg_per_s2": None if gyro is None else degrees(gyro.angular_acceleration),
        "count": len(gaps),
        "total_s": sum(gap.duration for gap in gaps),
        "forgotten": sum(gap.turn >= np.pi or gap.rows_without_set > 0 for gap in gaps),
        "rows_without_set": sum(gap.rows_without_set for gap in gaps),
        "set_again": not any(gap.is_for_good for gap in gaps),
        "without_set_before": sum(not np.isfinite(gap.before) for gap in gaps),
        "listed": [
            {
                "time_s": gap.time,
                "duration_s": gap.duration,
                "turn_bound_deg": degrees(gap.turn),
                "largest_angle_before_deg": degrees(gap.before),
                "largest_angle_after_deg": degrees(gap.after),
                "rows_without_set": gap.rows_without_set,
                "set_again": not gap.is_for_good,
            }
            for gap in listed
        ],
    }
    return summary | {"said": _said(summary)}


def _said(summary: dict[str, Any]) -> list[str]:
    """Lines about the gaps in a summary: the cost of all of them, and the longest one by one."""
    count = summary["count"]
    if not count:
        return []
    rate = summary["largest_rate_deg_per_s"]
    acceleration = summary["largest_angular_acceleration_deg_per_s2"]
    stated = [
        *([] if rate is None else [f"at most {rate:g} °/s in them"]),
        *([] if acceleration is None else [f"a rate that changes by at most {acceleration:g} °/s²"]),
    ]
    known = ", ".join(stated) or "nothing is known of them"
    without, before = summary["rows_without_set"], summary["without_set_before"]
    lost = "the row behind each has a set"
    if without:
        lost = f"{rows_in_words(without)} in all {_until(summary['set_again'])}"
    elif before:
        lost = "none of them ended a set"
    if before:
        lost += f"; before {'each' if before == count else f'{before} of them'} there was no set"
    lines = [
        f"{_counted(count)} in the gyro, longer than {summary['longest_interval_s']:.4g} s "
        f"({summary['total_s']:.3g} s in all; {known}): {lost}"
    ]
    listed: list[dict[str, Any]] = summary["listed"]
    worst = sorted(listed, key=lambda gap: (-gap["rows_without_set"], -gap["duration_s"]))[:_MOST_SAID]
    for gap in sorted(worst, key=lambda gap: gap["time_s"]):
        before, after = gap["largest_angle_before_deg"], gap["largest_angle_after_deg"]
        rows = gap["rows_without_set"]
        forgotten = gap["turn_bound_deg"] >= 180.0
        if before is None:
            cost = "there was no set before it"
        elif rows:
            cost = f"attitude forgotten, {rows_in_words(rows)} {_until(gap['set_again'])}"
        else:
            cost = f"{LARGEST_ANGLE} {before:.3g} degrees before and {after:.3g} after it"
            cost = f"attitude forgotten and measured anew, {cost}" if forgotten else cost
        lines.append(f"  {gap['duration_s']:.4g} s from {gap['time_s']:.4f} s on: {cost}")
    if count > _MOST_SAID:
        lines.append(f"  and {count - _MOST_SAID} more; summary.json lists {len(listed)}")
    return lines
