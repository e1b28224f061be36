"""Trials of a configuration: recordings within what it states, estimated as `elliptude estimate` does it."""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

import elliptude
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow
from elliptude.estimation.estimator import Estimation, estimate
from elliptude.io import tables
from elliptude.io.files import FileError
from elliptude.logs import log as logs
from elliptude.logs.plausibility import ImplausibleError, plausible_pieces
from elliptude.smoothing.smoother import smoothed_answers, smoothed_run
from elliptude.typing import FloatArray
from elliptude.validation.recordings.drawing import Recording, draw_recording
from elliptude.validation.recordings.judging import Verdict, judge
from elliptude.validation.recordings.statements import Stated


@dataclass(frozen=True)
class RecordingArguments:
    """Everything that a validation of a configuration depends on."""

    configuration: Configuration
    trials: int
    seed: int
    smooth: bool = False
    """Whether each recording is smoothed, too."""

    def to_dict(self) -> dict[str, Any]:
        """For JSON, with the version of the package."""
        return {
            "elliptude": elliptude.__version__,
            "configuration": self.configuration.model_dump(mode="json"),
            "trials": self.trials,
            "seed": self.seed,
            "smooth": self.smooth,
        }


@dataclass(frozen=True, eq=False)
class Tried:
    """A trial with its recording."""

    recording: Recording
    verdict: Verdict
    smoothed: Verdict | None = field(default=None)


def try_recording(arguments: RecordingArguments, trial: int) -> Tried:
    """Draw a recording, estimate it and judge the result.

    Parameters
    ----------
    arguments : RecordingArguments
    trial : int
        From 0.

    Returns
    -------
    Tried
    """
    seed = np.random.SeedSequence(arguments.seed, spawn_key=(trial,))
    recording = draw_recording(arguments.configuration, seed)
    verdict = _verdict_of(recording, arguments.configuration, smooth=False)
    smoothed = _verdict_of(recording, arguments.configuration, smooth=True) if arguments.smooth else None
    return Tried(recording, verdict, smoothed)


def _verdict_of(recording: Recording, configuration: Configuration, *, smooth: bool) -> Verdict:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "log.csv"
        write_recording(recording, file)
        implausible = None
        try:
            try:
                estimation = estimated(file, configuration, smooth=smooth)
            except ImplausibleError as error:
                implausible = "; ".join(map(str, error.errors))
                regardless = configuration.model_copy(update={"implausible": "ignore"})
                estimation = estimated(file, regardless, smooth=smooth)
            verdict = judge(recording, configuration, estimation)
            verdict.implausible = implausible
            return verdict
        except (FileError, ValueError, RuntimeError) as error:
            return Verdict(error=str(error).replace(str(file), "the log"))


def estimated(file: Path, configuration: Configuration, *, smooth: bool) -> Estimation:
    """What `elliptude estimate` makes of a log."""
    pieces = plausible_pieces(logs.read_pieces(file, configuration), configuration, str(file))
    log = logs.joined(list(pieces))
    if smooth:
        return estimate(log, configuration, smoothed_run, smoothed_answers)
    return estimate(log, configuration)


def write_recording(recording: Recording, file: Path) -> None:
    """Write a recording's log as CSV; columns of clocks with fewer rows end earlier."""
    rows = max(len(values) for values in recording.columns.values())
    names = list(recording.columns)
    cells = [_cells(recording.columns[name]) for name in names]
    padded = [column + [""] * (rows - len(column)) for column in cells]
    lines = [",".join(names), *(",".join(row) for row in zip(*padded, strict=True))]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _cells(values: FloatArray) -> list[str]:
    """Numbers of a column; whole ones, as ticks of a clock, without a point."""
    if np.array_equal(values, np.round(values)):
        return [str(int(x)) for x in values]
    return [repr(float(x)) if np.isfinite(x) else "" for x in values]


# --- what came of it --------------------------------------------------------------------------------------------------

_PASSES = ("forward", "smoothed")
_COUNTS = ("answers", "missing", "outside")


def result_of(arguments: RecordingArguments, trial: int) -> dict[str, Any]:
    """What became of a trial, in plain numbers that `summarize` puts together."""
    tried = try_recording(arguments, trial)
    verdicts = {"forward": tried.verdict, "smoothed": tried.smoothed}
    return {"trial": trial, "drawn": tried.recording.kinds} | {
        name: None if verdict is None else asdict(verdict) for name, verdict in verdicts.items()
    }


def summarize(arguments: RecordingArguments, results: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Figures of all trials, for JSON.

    Parameters
    ----------
    arguments : RecordingArguments
    results : sequence of dict
        Of `result_of`, in the order of trials.

    Returns
    -------
    dict
        ``total`` has counts, ``answers`` by name how many there were, missing how many, without the truth how many, and
        the largest share with its trial and row; ``faults`` lists trials in which something is wrong.
    """
    total = dict.fromkeys(
        ("rows", "unconditional", "answers", "missing", "outside", "contradicted", "failed", "implausible"), 0
    )
    answers: dict[str, dict[str, Any]] = {}
    faults: list[dict[str, Any]] = []
    for result in results:
        for which in _PASSES:
            verdict = result[which]
            if verdict is None:
                continue
            for name in ("rows", "unconditional", "contradicted"):
                total[name] += verdict[name]
            total["failed"] += verdict["error"] is not None
            total["implausible"] += verdict["implausible"] is not None
            for name, one in verdict["answers"].items():
                _add(answers, name if which == "forward" else f"{name}, smoothed", one, result["trial"])
                for count in _COUNTS:
                    total[count] += one[count]
            said = _said(result["trial"], which, verdict)
            if said is not None:
                faults.append({"trial": result["trial"], "pass": which, "said": said, "drawn": result["drawn"]})
    return arguments.to_dict() | {"total": total, "answers": answers, "faults": faults}


def _add(answers: dict[str, dict[str, Any]], name: str, one: Mapping[str, Any], trial: int) -> None:
    counted = answers.setdefault(name, dict.fromkeys(_COUNTS, 0) | {"largest": None})
    for count in _COUNTS:
        counted[count] += one[count]
    largest = one["largest"]
    if largest is not None and (counted["largest"] is None or largest["share"] > counted["largest"]["share"]):
        counted["largest"] = {**largest, "trial": trial}


def _said(trial: int, which: str, verdict: Mapping[str, Any]) -> str | None:
    """What is wrong with a trial, in words; None if nothing is."""
    found = [] if verdict["error"] is None else [f"no result: {verdict['error']}"]
    if verdict["contradicted"]:
        found.append(f"{verdict['contradicted']} true measurements called contradictory or left out")
    found += [
        f"{name}: {one['missing']} answers are missing in rows that claim them"
        for name, one in verdict["answers"].items()
        if one["missing"]
    ]
    found += [
        f"{name}: the truth is outside of {one['outside']} answers, share {one['largest']['share']:.6g} at row "
        f"{one['largest']['row']}"
        for name, one in verdict["answers"].items()
        if one["outside"]
    ]
    return f"trial {trial}{', smoothed' if which == 'smoothed' else ''}: {'; '.join(found)}" if found else None


def worst_of(summary: Mapping[str, Any]) -> int:
    """The trial with the first fault, or else with the largest share of an answer."""
    if summary["faults"]:
        return int(summary["faults"][0]["trial"])
    largest = [one["largest"] for one in summary["answers"].values() if one["largest"] is not None]
    return int(max(largest, key=lambda one: one["share"])["trial"]) if largest else 0


def keep(arguments: RecordingArguments, trial: int, folder: Path) -> Path:
    """Write a trial's log and a configuration that also names its truth, for `elliptude estimate`; the log's file."""
    configuration = arguments.configuration
    seed = np.random.SeedSequence(arguments.seed, spawn_key=(trial,))
    recording = draw_recording(configuration, seed)
    of = Stated(configuration)
    attitudes = recording.motion.attitudes(recording.clocks[of.main_clock] - of.main_delay)
    names = [f"true_{name}" for name in ("qw", "qx", "qy", "qz")]
    recording.columns |= dict(zip(names, tables.quaternions_from_attitudes(attitudes).T, strict=True))
    truth: dict[str, Any] = {"attitude_columns": names, "delay_s": of.main_delay}
    if isinstance(of.flow, GyroFlow) and of.flow.time_column is not None:
        truth |= {"time_column": of.flow.time_column, "time_unit": of.flow.time_unit}
    stated = configuration.model_dump(mode="json", exclude_unset=True, exclude_none=True) | {"truth": truth}
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "config.toml").write_text(tomlkit.dumps(stated), encoding="utf-8")
    write_recording(recording, folder / "log.csv")
    return folder / "log.csv"
