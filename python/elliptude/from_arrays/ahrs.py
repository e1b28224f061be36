"""One call from arrays to attitudes with their bounds: `elliptude bounds` and `elliptude estimate`, without files."""

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from elliptude import units
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.estimator import Question
from elliptude.configuration.findings import suspicions
from elliptude.configuration.findings.finding import Finding
from elliptude.configuration.motion import GyroFlow
from elliptude.configuration.rules import Carried, rule_for
from elliptude.configuration.statements import VelocityWindowBound
from elliptude.errors import InconsistentMeasurement
from elliptude.estimation import gaps
from elliptude.estimation.estimator import Estimation, estimate
from elliptude.estimation.guaranteed_result import contradicted_up, dropped_columns
from elliptude.estimation.why_no_set import why_no_set
from elliptude.from_arrays.arguments import ARGUMENTS, OF_KINDS
from elliptude.from_arrays.inputs import times_of, vectors_of
from elliptude.io.files import FileError, sentence
from elliptude.io.readers.arrays import ArrayLog
from elliptude.io.toml import validate
from elliptude.logs import log as logs
from elliptude.logs.plausibility import Heard, ImplausibleError, plausible_pieces, suspected
from elliptude.proposal import mapping, proposals
from elliptude.proposal.mapping import Tables
from elliptude.proposal.starting.configuration import (
    MARGIN,
    UP_ALONE,
    ruled_configuration,
    starting_configuration,
)
from elliptude.results import AhrsResult
from elliptude.typing import FloatArray

_NAME = "the arrays"
# The gyro's bias counts as an error here, and is not estimated.
_QUESTIONS = tuple(question for question in get_args(Question) if question != "vector")
_KINDS = {"gyr": "gyroscope", "acc": "accelerometer", "mag": "magnetometer"}
# What directions are called in the tables of the commands; messages call them as the arguments are.
_DIRECTIONS = {"acc": "up", "mag": "field"}
_UNITS: Mapping[str, Mapping[Any, float]] = {
    "gyr": units.ANGULAR_VELOCITY,
    "acc": units.ACCELERATION,
    "mag": units.FIELD,
}
# What to do where a rule does not fit the arrays.
_REMEDY = "statements='recording' takes bounds from what the recording itself shows"


def ahrs(
    time: Any,
    gyr: Any,
    acc: Any,
    mag: Any,
    statements: str | os.PathLike[str],
    stated_units: Mapping[str, Any],
    implausible: str,
    questions: Sequence[str] = (),
) -> AhrsResult:
    """See `elliptude.ahrs`, whose arguments these are; ``stated_units`` has the unit of each sensor."""
    if implausible not in {"refuse", "ignore"}:
        raise ValueError(f"implausible: {implausible!r}, neither 'refuse' nor 'ignore'")
    questions = _known_questions(questions)
    heard = Heard()
    sensors = {"gyr": gyr, "acc": acc, "mag": mag}
    configuration, estimation = _estimated(time, sensors, statements, stated_units, implausible, questions, heard)
    assert estimation.guaranteed is not None
    only_up = _of_up_alone(configuration)
    run, result = estimation.guaranteed, estimation.result
    dropped, wrong = dropped_columns(run), contradicted_up(run)
    columns: dict[str, NDArray[Any]] = {
        name: values if isinstance(values, np.ndarray) else np.array(values)
        for name, values in result.columns().items()
    }
    columns |= {name: _as_in_tables(columns[name]) for name in ("used", "dropped")}
    return AhrsResult(
        times=result.times,
        quaternions=result.quaternions,
        attitudes=run.sets.attitudes,
        roll_pitch_yaw=_of_three(result.roll_pitch_yaw, 0),
        least_roll_pitch_yaw=_of_three(result.roll_pitch_yaw, 1),
        most_roll_pitch_yaw=_of_three(result.roll_pitch_yaw, 2),
        claims=columns["claim"],
        tilt_bounds=_known(result.tilt_bounds),
        heading_from=_known(result.headings)[:, 0],
        heading_to=_known(result.headings)[:, 1],
        largest_angles=result.largest_angles,
        ups=_known(result.ups),
        up_bounds=_known(result.up_bounds),
        up_claims=columns["up_claim"],
        sets=replace(run.sets, are_proposals=configuration.proposed_from is not None),
        statements=str(statements),
        are_proposals=configuration.proposed_from is not None,
        heading="from the first row" if run.starts_heading else "not known" if only_up else "from magnetic east",
        dropped={_DIRECTIONS.get(name, name): count for name, count in Counter(dropped["sensor"]).items()},
        notes=(
            *(one.in_words(ARGUMENTS) for one in heard.ignored),
            *(f"suspicious: {one.in_words(ARGUMENTS)}" for one in _suspicious(configuration, heard)),
            *([] if wrong is None else [wrong["said"]]),
            *only_up,
            *why_no_set(run, configuration),
            *gaps.summarize(run.gaps, run.rows.gyro)["said"],
            *([] if heard.up is None else [str(heard.up)]),
        ),
        columns=columns,
    )


def _estimated(
    time: Any,
    sensors: Mapping[str, Any],
    statements: str | os.PathLike[str],
    stated_units: Mapping[str, Any],
    implausible: str,
    questions: Sequence[str],
    heard: Heard,
) -> tuple[Configuration, Estimation]:
    """What follows from the arrays, and what was found out about them; errors name arguments."""
    file, tables = _recording(time, sensors, stated_units)
    tables["implausible"] = implausible
    try:
        configuration = _configuration(file, tables, statements, heard).with_questions(questions)
        pieces = plausible_pieces(logs.read_pieces(file, configuration), configuration, _NAME, heard)
        return configuration, estimate(logs.joined(list(pieces)), configuration)
    except ImplausibleError as error:
        raise ValueError(str(ImplausibleError(_NAME, error.errors, heard, ARGUMENTS))) from error
    except FileError as error:
        raise ValueError(heard.after(str(error), ARGUMENTS)) from error
    except InconsistentMeasurement:
        raise
    except ValueError as error:
        if statements not in get_args(Carried):
            raise ValueError(heard.after(str(error), ARGUMENTS)) from error
        beside = heard.beside(words=ARGUMENTS)
        raise ValueError(f"statements={statements!r}: {sentence(str(error))}{beside} {_REMEDY}") from error


def _suspicious(configuration: Configuration, heard: Heard) -> list[Finding]:
    """What may be wrong in what is stated or measured, each once."""
    found = dict.fromkeys([*suspicions.of_configuration(configuration), *heard.suspicious])
    return [one for one in found if one not in heard.ignored]


def _known_questions(questions: Sequence[str]) -> Sequence[str]:
    """The questions as a list of words that are some."""
    if not isinstance(questions, Sequence):
        raise TypeError(f"questions: {questions!r}, not a list of words: {', '.join(_QUESTIONS)}")
    for question in (questions := [questions] if isinstance(questions, str) else questions):
        if question not in _QUESTIONS:
            raise ValueError(f"questions: {question!r} is none of {', '.join(_QUESTIONS)}")
    return questions


def _of_up_alone(configuration: Configuration) -> list[str]:
    """What to know where a gyro and an accelerometer have no rule: nothing is known of the heading. Else nothing."""
    accelerometer, flow = configuration.accelerometer, configuration.flow
    if configuration.rule is not None or accelerometer is None or len(configuration.directions) > 1:
        return []
    stated = [f"a bias of at most {flow.bias_deg_per_s:g} deg/s"] if isinstance(flow, GyroFlow) else []
    bound = accelerometer.bound_from
    if isinstance(bound, VelocityWindowBound):
        stated += [f"at most {bound.velocity_m_per_s:g} m/s"] if bound.velocity_m_per_s is not None else []
        stated += [f"within {bound.position_m:g} m"] if bound.position_m is not None else []
    return [
        f"{UP_ALONE} It rests on {', '.join(stated)} and other numbers of a sensor in the hand, which the recording "
        "does not show: each needs a reason"
    ]


def _recording(time: Any, sensors: Mapping[str, Any], stated: Mapping[str, Any]) -> tuple[ArrayLog, Tables]:
    """The arrays as a log, and which of its columns are which sensors."""
    times = times_of(time)
    columns: dict[str, FloatArray] = {"time[:]": times}
    named: dict[str, tuple[list[str], str]] = {}
    for name, values in sensors.items():
        known, unit = _UNITS[name], stated[name]
        if not isinstance(unit, str) or unit not in known:
            raise ValueError(f"{name}_unit: {unit!r} is none of {', '.join(known)}")
        if values is None and name == "mag":
            continue
        vectors = vectors_of(name, values, unit, len(times), may_be_missing=name != "gyr")
        axes = [f"{name}[:, {i}]" for i in range(3)]
        columns |= dict(zip(axes, vectors.T, strict=True))
        named[_KINDS[name]] = axes, unit
    file = ArrayLog(columns, _NAME)
    tables = mapping.of_sensors("time[:]", "s", named)
    for direction in tables["directions"]:
        direction["name"] = OF_KINDS[direction["kind"]]
    return file, mapping.as_written(tables, file, repair=False)


def _configuration(file: ArrayLog, tables: Tables, statements: str | os.PathLike[str], heard: Heard) -> Configuration:
    """What `elliptude bounds` would write for the recording; or with a rule that says all bounds."""
    if statements != "recording":
        ruled = validate(file.path, ruled_configuration(tables, _rule(statements)), Configuration)
        assert ruled.rule is not None
        ruled.rule.rule()  # a file that is no rule is better found before the work
        return ruled
    configuration = mapping.configuration_of(tables, file.path)
    recording, origin = mapping.read_recording(file, configuration)
    try:
        document = starting_configuration(
            tables,
            proposals.propose(recording),
            MARGIN,
            mode="guaranteed",
            log=_NAME,
            origin=origin,
            shared_stamps=recording.shared_stamps,
            shared_forces=recording.shared_forces,
        )
    except ValueError:
        # Nothing is stated yet, so that it is suspicious at most.
        found = suspected(logs.read_pieces(file, configuration), configuration)
        heard.of_units = {str(one): one for one in found}
        raise
    return validate(file.path, document.unwrap(), Configuration)


def _rule(statements: Any) -> Tables:
    """The table ``rule`` of a configuration: by how a sensor is carried, or in a file."""
    for carried in get_args(Carried):
        if statements == carried:
            stated = rule_for(carried).model_dump(mode="json", exclude_none=True)
            return {"kind": "hand_held"} if carried == "hand" else {"kind": "stated"} | stated
    if not isinstance(statements, str | os.PathLike) or not Path(statements).exists():
        words = ", ".join(repr(word) for word in (*get_args(Carried), "recording"))
        raise ValueError(f"statements: {statements!r} is none of {words}, and there is no such file")
    return {"kind": "file", "file": os.fspath(statements)}


def _as_in_tables(cells: NDArray[Any]) -> NDArray[Any]:
    """Names of sensors with a space between them, as the commands write them."""
    texts, rows = np.unique(cells, return_inverse=True)
    return np.array([" ".join(_DIRECTIONS.get(name, name) for name in text.split()) for text in texts])[rows]


def _of_three(angles: FloatArray | None, end: int) -> FloatArray:
    """Roll, pitch and yaw, or one end of each, shape (N, 3)."""
    return _known(angles)[:, end::3]


def _known(values: FloatArray | None) -> FloatArray:
    assert values is not None  # an accelerometer shows up
    return values
