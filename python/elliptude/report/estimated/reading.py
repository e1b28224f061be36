"""Reads what `elliptude estimate` wrote: a table of results, and what is beside it.

A table of results (docs/tables.md) may have empty cells where nothing is known, and may have these columns:

``claim``
    ``unconditional``, ``conditional`` or ``none``: what the row's set rests on.
``dropped``
    The sensors whose measurements were left out as contradictory, with a space between their names.
``chart``
    ``exponential`` (if left out) or ``gibbs``: the coordinates of the attitude error whose shape P is.
``prediction_used``, ``tilt_bound``, ``heading_from``, ``heading_to``, ``up_bound``, ``up_claim``
    Whether the prediction went into the row's set; how far up and heading of the estimate may be off, and up alone.
``roll``, ``roll_from``, ``roll_to``, ``pitch``, ..., ``yaw``, ``yaw_from``, ``yaw_to``
    These angles, and between which ones the truth is.

In the guaranteed mode ``dropped.csv`` beside it lists each measurement that was left out, and by how much.
``measured.csv`` has what the sensors measured.
"""

import json
import math
import os
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, get_args

from elliptude.io.column_files import (
    column_names,
    proposed_from,
    read_columns,
    read_events,
    stacked,
    symmetric,
    time_origin,
)
from elliptude.io.files import FileError, system_fault
from elliptude.io.tables import (
    ATTITUDE_ERRORS,
    ATTITUDE_HALF_WIDTHS,
    ATTITUDE_SHAPE,
    HEADINGS,
    QUATERNION,
    ROLL_PITCH,
    TURNS_BODY,
    TURNS_REFERENCE,
    UP,
    YAW,
    stacked_if_there,
)
from elliptude.report.estimated.stored import MEASURED, read_measured
from elliptude.report.run import DroppedMeasurements, Run
from elliptude.results import CLAIMS
from elliptude.typing import Chart

_SINGLE_COLUMNS = {
    "forms": "form",
    "prediction_used": "prediction_used",
    "tilt_bounds": "tilt_bound",
    "up_bounds": "up_bound",
    "clock_turns": "turn_within_offset",
}


def _result_columns(table: Path) -> tuple[str, ...]:
    """The names of a table's columns, if it is one of results."""
    names = column_names(table, "results")
    if "time_s" not in names:
        raise FileError(
            f"{table}: no column 'time_s', so no table of results, as `elliptude estimate` writes it; a log is for "
            "estimate, or for monitor with --config"
        )
    return names


def read_run(result: str | os.PathLike[str]) -> tuple[Run, str]:
    """Read what `elliptude estimate` wrote.

    Parameters
    ----------
    result : path-like
        Its folder, or the table of results.

    Returns
    -------
    run : Run
    label : str
        What the errors in the table are against: of the folder's summary, else "truth".

    Raises
    ------
    FileError
        If there is no such table; the message names file, line and column. Or if the summary beside it is damaged.
        If ``measured.csv`` is, or is of other results, the run says so.
    """
    table = _table_of(Path(result))
    names = _result_columns(table)
    texts = [name for name in ("claim", "dropped", "chart", "up_claim") if name in names]
    with_errors = ATTITUDE_ERRORS[0] in names
    further = [name for name in _SINGLE_COLUMNS.values() if name in names]
    columns = read_columns(
        table,
        optional=[QUATERNION, ATTITUDE_SHAPE, ATTITUDE_HALF_WIDTHS, ("largest_angle",)]
        + [ATTITUDE_ERRORS] * with_errors
        + [one for one in (HEADINGS, UP, ROLL_PITCH, YAW, TURNS_REFERENCE, TURNS_BODY) if one[0] in names]
        + [(name,) for name in further],
        texts=("used", "refused", *texts),
    )

    def words(name: str) -> tuple[str, ...] | None:
        return tuple(str(text or "") for text in columns[name]) if name in columns else None

    claims, charts, up_claims = words("claim"), words("chart"), words("up_claim")
    _require_words(table, "claim", claims, CLAIMS)
    _require_words(table, "chart", charts, get_args(Chart))
    _require_words(table, "up_claim", up_claims, CLAIMS)
    used_charts = {word for word in charts or () if word} or {"exponential"}
    if len(used_charts) > 1:
        raise FileError(f"{table}: column 'chart' changes; one table has one chart")
    summary, beside = _read_summary(table.with_name("summary.json")), table.with_name("dropped.csv")
    single: dict[str, Any] = {field: columns.get(name) for field, name in _SINGLE_COLUMNS.items()}
    run = Run(
        times=columns["time_s"],
        quaternions=stacked(columns, QUATERNION),
        shapes=symmetric(columns, ATTITUDE_SHAPE),
        half_widths=stacked(columns, ATTITUDE_HALF_WIDTHS),
        largest_angles=columns["largest_angle"],
        used=words("used") or (),
        refused=words("refused") or (),
        dropped=words("dropped"),
        claims=claims,
        chart="gibbs" if used_charts == {"gibbs"} else "exponential",
        errors=stacked(columns, ATTITUDE_ERRORS) if with_errors else None,
        reference_error=math.radians(summary.truth_error_deg),
        headings=stacked_if_there(columns, HEADINGS),
        ups=stacked_if_there(columns, UP),
        up_claims=up_claims,
        roll_pitch_yaw=stacked(columns, ROLL_PITCH + YAW) if YAW[0] in columns else None,
        turns_reference=stacked_if_there(columns, TURNS_REFERENCE),
        turns_body=stacked_if_there(columns, TURNS_BODY),
        listed=_read_dropped(beside) if claims is not None and beside.is_file() else None,
        void=summary.void,
        heading_from_start=summary.heading_from_start,
        gaps=summary.gaps,
        smoothing=summary.smoothing,
        implausible=summary.implausible,
        suspicious=summary.suspicious,
        bounds_from_recording=summary.bounds_from_recording or proposed_from(table),
        up_at_rest=summary.up_at_rest,
        best=summary.best,
        frame=summary.frame,
        title=summary.title,
        origin=time_origin(table),
        longest_step=summary.longest_step,
        **single,
    )
    return _with_measured(run, table), summary.label


def _with_measured(run: Run, table: Path) -> Run:
    """With what the sensors measured, if there is a file of it that is of this table."""
    path = table.with_name(MEASURED)
    if not path.is_file():
        return run
    try:
        return replace(run, measured=read_measured(path, table))
    except FileError as error:
        return replace(run, why_not_measured=f"what the sensors measured is not drawn: {error}")


def _require_words(table: Path, column: str, found: tuple[str, ...] | None, allowed: tuple[str, ...]) -> None:
    for row, word in enumerate(found or ()):
        if word and word not in allowed:
            raise FileError(f"{table}: row {row + 1} below the header, column {column!r}: {word!r}, not {_or(allowed)}")


def files_of_run(result: Path) -> list[Path]:
    """What may be read of a result: itself, and what `elliptude estimate` wrote beside it or in it.

    Parameters
    ----------
    result : pathlib.Path
        A folder, or the table of results.

    Returns
    -------
    list of pathlib.Path
        Not all of them need be there.
    """
    folder = result if result.is_dir() else result.parent
    names = ("results.csv", "results.parquet", "summary.json", "dropped.csv", MEASURED)
    return [result, *(folder / name for name in names)]


def _table_of(result: Path) -> Path:
    if not result.is_dir():
        return result
    found = [result / name for name in ("results.csv", "results.parquet") if (result / name).is_file()]
    if len(found) != 1:
        what = "both results.csv and results.parquet" if found else "no results.csv or results.parquet"
        raise FileError(f"{result}: {what} in this folder; name the table")
    return found[0]


class _Summary(NamedTuple):
    """What a summary beside a table may say about it."""

    label: str = "truth"
    title: str | None = None
    truth_error_deg: float = 0.0
    void: tuple[str, ...] = ()
    heading_from_start: bool = False
    gaps: tuple[str, ...] = ()
    implausible: tuple[str, ...] = ()
    suspicious: tuple[str, ...] = ()
    bounds_from_recording: str | None = None
    up_at_rest: str | None = None
    best: str | None = None
    smoothing: tuple[str, ...] = ()
    frame: str | None = None
    longest_step: float | None = None


def _read_summary(path: Path) -> _Summary:
    """What the errors are against, how far that may be off, and which sensors were left out altogether."""
    if not path.exists():
        return _Summary()
    try:
        read = json.loads(path.read_text(encoding="utf-8"))
    except OSError as fault:
        raise FileError(f"{path}: {system_fault(fault)}") from fault
    except ValueError:
        read = None
    if not isinstance(read, dict):
        # It may say that the sets are no guarantee, or where the heading counts from.
        raise FileError(
            f"{path}: damaged, not the summary that `estimate` wrote; without that file the table is read alone"
        )
    label, title, error, void = (read.get(name) for name in ("compared_with", "title", "truth_error_deg", "void"))
    gaps, smoothing = (_said(read.get(name)) for name in ("gaps", "smoothing"))
    best, frame = read.get("best"), read.get("reference_frame")
    longest = read["gaps"].get("longest_interval_s") if isinstance(read.get("gaps"), dict) else None
    up, recording = read.get("up_at_rest"), read.get("bounds_from_recording")
    return _Summary(
        label if isinstance(label, str) else "truth",
        title if isinstance(title, str) else None,
        float(error) if isinstance(error, int | float) else 0.0,
        _lines(void),
        read.get("heading") == "from the first row",
        gaps,
        _lines(read.get("implausible")),
        _lines(read.get("suspicious_statements")),
        recording if isinstance(recording, str) else None,
        str(up["in_words"]) if isinstance(up, dict) and "in_words" in up else None,
        str(best["in_words"]) if isinstance(best, dict) and "in_words" in best else None,
        smoothing,
        frame if isinstance(frame, str) else None,
        longest if isinstance(longest, int | float) and longest > 0.0 else None,
    )


def _said(part: Any) -> tuple[str, ...]:
    """The lines of a part of a summary."""
    return _lines(part.get("said") if isinstance(part, dict) else None)


def _lines(part: Any) -> tuple[str, ...]:
    """A list of texts; empty if it is none."""
    return tuple(map(str, part)) if isinstance(part, list) else ()


def _read_dropped(path: Path) -> DroppedMeasurements:
    columns = read_events(path, "dropped", numbers=("margin",), texts=("place", "sensor", "contradicts", "unit"))
    texts = {
        name: tuple(str(text or "") for text in columns[name]) for name in ("place", "sensor", "contradicts", "unit")
    }
    return DroppedMeasurements(
        times=columns["time_s"],
        places=texts["place"],
        sensors=texts["sensor"],
        contradicts=texts["contradicts"],
        margins=columns["margin"],
        units=texts["unit"],
    )


def _or(words: tuple[str, ...]) -> str:
    return f"{', '.join(words[:-1])} or {words[-1]}"
