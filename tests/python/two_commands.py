"""A recording whose truth is known, and the two commands that lead from it to results, through the command line."""

import functools
import json
import tomllib

import numpy as np
from elliptude import cli
from elliptude.io.tables import Result
from test_proposals import attitude
from typer.testing import CliRunner

HEADER = ["Time (s)"] + [
    f"{sensor} {axis} ({unit})"
    for sensor, unit in (("Gyroscope", "deg/s"), ("Accelerometer", "g"), ("Magnetometer", "uT"))
    for axis in "XYZ"
]


@functools.cache
def app():
    return cli.make_app()


def succeed(*arguments):
    done = CliRunner().invoke(app(), [str(argument) for argument in arguments])
    assert done.exit_code == 0, done.output
    # What takes long says so on the error stream.
    return " ".join((done.stdout if "--json" in arguments else done.output).split())


def columns_of(recording):
    return np.column_stack(
        [
            recording.times,
            np.rad2deg(recording.angular_velocities),
            recording.specific_forces / 9.80665,
            recording.fields,
        ]
    )


def two_commands(folder, log, *options):
    """The configuration, what is said, the summary and the results."""
    config, out = folder / "config.toml", folder / "result"
    said = succeed("bounds", log, *options, "--out", config)
    said += succeed("estimate", log, "--config", config, "--out", out)
    summary = json.loads((out / "summary.json").read_text())
    return tomllib.loads(config.read_text()), said, summary, Result.read(out / "results.csv")


def inside(results):
    """Whether the true attitude is in each set; True without a set."""
    known = np.isfinite(results.quaternions[:, 0])
    true = attitude(results.times[known]).as_matrix()
    estimated = results.attitudes[known]
    error = np.einsum("nji,njk->nik", estimated, true)
    angles = np.arccos(np.clip(0.5 * (np.trace(error, axis1=1, axis2=2) - 1.0), -1.0, 1.0))
    return angles <= results.largest_angles[known] * (1.0 + 1e-9)


def dirty(recording):
    rows = [";".join(f"{value:.9g}" for value in row).replace(".", ",") for row in columns_of(recording)]
    rows = rows[:3000] + rows[3040:]
    for i in (1500, 1501, 4000):
        rows[i] = ";".join([rows[i].split(";")[0]] + ["NaN"] * 9)
    rows[5000:5000] = [rows[4999]] * 2
    return "\n".join([";".join(HEADER), *rows, "40;0,5"]) + "\n"
