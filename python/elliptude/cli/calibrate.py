"""The command ``elliptude calibrate``."""

import json
from pathlib import Path
from typing import Annotated, Any

import tomlkit
import typer
from rich import box
from rich.console import Console
from rich.table import Table

from elliptude.calibration.calibrate import Found, sha256_of
from elliptude.calibration.calibrate import calibrate as calibrate_log
from elliptude.cli.options import Force, refuse_to_replace, require_finite
from elliptude.configuration.calibration import Calibration, CalibrationDocument, read_statements
from elliptude.configuration.configuration import read_configuration
from elliptude.io.files import FileError, replacing
from elliptude.logs import log as logs


def calibrate(
    log: Annotated[
        Path, typer.Argument(help="A recording made for this, in any format of docs/logs.md.", show_default=False)
    ],
    config: Annotated[
        Path, typer.Argument(help="Which columns are which sensors, and a rule: TOML.", show_default=False)
    ],
    out: Annotated[Path, typer.Option(help="The calibration: TOML.", show_default=False)],
    statements: Annotated[
        Path | None,
        typer.Option(
            help="What is known of the sensors and of this recording: TOML, as in docs/calibrate.md. If left out, "
            "that of a sensor in the hand.",
            show_default=False,
        ),
    ] = None,
    disturbance_ut: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            help="How far the field differs from its mean in this recording, µT; instead of the statements'.",
            show_default=False,
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was found as JSON.")] = False,
    force: Force = False,
) -> None:
    """Find what a recording leaves possible of its sensors' offsets and scales, and write how to correct them.

    Nothing is fitted: every set of parameters that agrees with all samples within the stated bounds is kept, and what
    is left of the errors is a bound by the same statements.
    """
    if disturbance_ut is not None:
        require_finite("--disturbance-ut", disturbance_ut)
    refuse_to_replace([out], force)
    configuration = read_configuration(config).model_copy(update={"calibration": None})
    known = read_statements(statements)
    if disturbance_ut is not None:
        magnetometer = known.magnetometer.model_copy(update={"disturbance_ut": disturbance_ut})
        known = known.model_copy(update={"magnetometer": magnetometer})
    if configuration.rule is None:
        raise FileError(
            f"{config}: rule: missing; calibrate needs one, which says what a rest is and what the gyro does"
        )
    recording = logs.read_log(log, configuration)
    try:
        found = calibrate_log(recording, configuration, known)
    except ValueError as error:
        raise FileError(f"{log}: {error}") from error
    calibration = Calibration(
        recording=log.name, recording_sha256=sha256_of(log), sensors=tuple(one.calibration() for one in found)
    )
    document = tomlkit.document()
    document.add(tomlkit.comment(f"Written by `elliptude calibrate` from {log.name}. A corrected sample is"))
    document.add(tomlkit.comment("matrix (sample - offset), in body axes; the errors are what may be left of it."))
    tables = CalibrationDocument(calibration=calibration).model_dump(mode="json", exclude_none=True)
    for name, table in tables.items():
        document.add(name, tomlkit.item(table))
    with replacing(out) as temporary:
        temporary.write_text(tomlkit.dumps(document), encoding="utf-8")
    if as_json:
        typer.echo(json.dumps([_figures(one) for one in found], indent=2, ensure_ascii=False))
        return
    Console(width=max(Console().width, 110)).print(_table(found))
    for one in found:
        for remark in one.remarks():
            typer.echo(remark)
    typer.echo(f'{out}: use it with [calibration] file = "{out.name}" in a configuration')


def _figures(found: Found) -> dict[str, Any]:
    left, stated = found.left, found.stated
    return {
        "name": found.sensor.name,
        "kind": found.sensor.kind,
        "unit": found.unit,
        "poses": left.poses,
        "offset": left.offset.tolist(),
        "matrix": left.matrix.tolist(),
        "offset_error": left.offset_error,
        "stated_offset": stated.offset,
        "lowest_offset": left.lowest.tolist(),
        "highest_offset": left.highest.tolist(),
        "scale_error": left.scale_error,
        "stated_scale_error": stated.scale_error,
        "undetermined": found.undetermined,
        "proposed_offset": None if found.proposed_offset is None else found.proposed_offset.tolist(),
        "stated_disturbance": stated.disturbance,
        "least_disturbance": found.needed_disturbance,
        "remarks": found.remarks(),
    }


def _table(found: list[Found]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
    for heading in ("sensor", "unit"):
        table.add_column(heading, no_wrap=True)
    for heading in ("poses", "offset x", "y", "z", "off by", "stated", "scale error", "stated", "least squares"):
        table.add_column(heading, justify="right")
    for one in found:
        left = one.left
        ranges = (f"{low:.3g} to {high:.3g}" for low, high in zip(left.lowest, left.highest, strict=True))
        proposed = "" if one.proposed_offset is None else " ".join(f"{value:.2g}" for value in one.proposed_offset)
        table.add_row(
            one.sensor.name,
            one.unit,
            f"{left.poses}",
            *ranges,
            f"{left.offset_error:.3g}",
            f"{one.stated.offset:g}",
            f"{left.scale_error:.3g}",
            f"{one.stated.scale_error:g}",
            proposed,
        )
    return table
