"""An hour of the Fermi spacecraft: attitude from its solar arrays and its rates, compared with what it recorded.

``data/fermi/README.md`` says what is in the data, where they come from and how far each measurement is trusted;
``data/fermi/estimate.toml`` is the configuration. The star is synthetic; the Sun and the rates are Fermi's.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np
import scipy

from elliptude.bounds.angles.about_axes import half_widths_along
from elliptude.configuration import sun
from elliptude.configuration.configuration import Configuration, read_configuration
from elliptude.io import column_files, tables
from elliptude.io.tables import Measurements, Result
from elliptude.typing import FloatArray

_FOLDER = resources.files("elliptude") / "data" / "fermi"
_DATA, _CONFIGURATION = "fermi_gbm_2015-10-13.csv.gz", "estimate.toml"

STAR_BOUND_DEG = 1.0
"""How far the synthetic star's measured direction may be off."""

# Vega, right ascension 18 h 36 min 56 s and declination +38° 47' (J2000): about 90° from the Sun in October.
_STAR_RIGHT_ASCENSION_DEG, _STAR_DECLINATION_DEG = 279.23, 38.78


@dataclass(frozen=True, eq=False)
class Telemetry:
    """What the spacecraft recorded in N seconds."""

    met: FloatArray
    """Mission elapsed time, s, shape (N,)."""
    quaternions: FloatArray
    """(qw, qx, qy, qz) from body axes to J2000, shape (N, 4)."""
    angular_velocities: FloatArray
    """rad/s, body axes, shape (N, 3)."""
    array_angles: FloatArray
    """Angles of the +Y solar array, rad, shape (N,)."""


def telemetry() -> Telemetry:
    """Read the telemetry that comes with this package."""
    quaternion, rate = tables.QUATERNION, tables.RATE
    with resources.as_file(_FOLDER / _DATA) as file:
        columns = column_files.read_columns(file, time="met_s", numbers=(*quaternion, *rate, "sada_py_deg"))
    return Telemetry(
        met=columns["met_s"],
        quaternions=np.column_stack([columns[name] for name in quaternion]),
        angular_velocities=np.column_stack([columns[name] for name in rate]),
        array_angles=np.deg2rad(columns["sada_py_deg"]),
    )


@contextmanager
def configuration_file() -> Iterator[Path]:
    """The configuration of the estimation, as a file."""
    with resources.as_file(_FOLDER / _CONFIGURATION) as file:
        yield file


def configuration() -> Configuration:
    """The configuration of the estimation."""
    with configuration_file() as file:
        return read_configuration(file)


def sun_in_body(array_angles: FloatArray) -> FloatArray:
    """The Sun's direction in body axes, shape (N, 3), from the +Y solar array's angle (rad, shape (N,)).

    The array turns about Y and follows the Sun. It measures nothing along Y; Fermi keeps the Sun near the X-Z plane.
    """
    angle = array_angles + np.pi / 2.0
    return np.column_stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)])


def measurements(recorded: Telemetry, *, star_until: int | None = None, seed: int = 0) -> Measurements:
    """Make a log of the telemetry: the Sun, a synthetic star, the rates, and the recorded attitude to compare with.

    Parameters
    ----------
    recorded : Telemetry
    star_until : int, optional
        The star is measured in this many rows only; in all if left out.
    seed : int
        Seed of the star's errors, which are uniform in a ball of rotation vectors.

    Returns
    -------
    Measurements
        Times from 0.
    """
    count = len(recorded.met)
    ascension, declination = np.deg2rad([_STAR_RIGHT_ASCENSION_DEG, _STAR_DECLINATION_DEG])
    star = np.array(
        [np.cos(declination) * np.cos(ascension), np.cos(declination) * np.sin(ascension), np.sin(declination)]
    )
    attitudes = scipy.spatial.transform.Rotation.from_quat(recorded.quaternions, scalar_first=True)
    errors = scipy.spatial.transform.Rotation.from_rotvec(
        np.deg2rad(STAR_BOUND_DEG) * _in_unit_ball(np.random.default_rng(seed), count)
    )
    star_in_body = errors.inv().apply(attitudes.inv().apply(star))
    if star_until is not None:
        star_in_body[star_until:] = np.nan
    sun_in_space = sun.sun_direction_j2000(sun.fermi_julian_date(recorded.met))
    return Measurements(
        times=recorded.met - recorded.met[0],
        sensors=("sun", "star"),
        directions=np.stack([sun_in_body(recorded.array_angles), star_in_body], axis=1),
        references=np.stack([sun_in_space, np.broadcast_to(star, (count, 3))], axis=1),
        angular_velocities=recorded.angular_velocities,
        true_quaternions=recorded.quaternions,
    )


def _in_unit_ball(draws: np.random.Generator, count: int) -> FloatArray:
    vectors = draws.standard_normal((count, 3))
    vectors *= np.cbrt(draws.random((count, 1))) / np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors


def half_widths_about(result: Result, line: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How far the attitude is bounded about a line and across it.

    Parameters
    ----------
    result : Result
        N rows.
    line : (N, 3) array
        Unit vectors in reference axes.

    Returns
    -------
    about : (N,) array
        Half-width of the set along the line, rad: the turn about it. NaN without a set.
    across : (N,) array
        The largest one perpendicular to it, rad.
    """
    about, across = np.full((2, len(result.times)), np.nan)
    known = np.isfinite(result.shapes[:, 0, 0])
    shapes = result.shapes[known, :3, :3]
    in_body = np.einsum("nji,nj->ni", result.attitudes[known], line[known])
    about[known] = half_widths_along(in_body[:, None], shapes, result.chart)[:, 0]
    projectors = np.eye(3) - in_body[:, :, None] * in_body[:, None, :]
    across[known] = np.sqrt(np.linalg.eigvalsh(projectors @ shapes @ projectors)[:, -1])
    if result.chart == "gibbs":
        across = 2.0 * np.arctan(0.5 * across)
    return about, across
