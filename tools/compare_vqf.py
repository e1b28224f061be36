"""The error of the center beside that of the filter vqf (PyPI), on the same rows of the same recordings.

`python tools/compare_vqf.py FOLDER/*.npz [--config CONFIG]`, in an environment with `elliptude[cli]` and `vqf`. The
recordings are those of BROAD as NPZ: t, gyr, acc, mag and q_ref. Both estimates get the same raw samples. North is not
the same for magnetometer and cameras, so each is turned about the vertical once, by the heading that it is off at
`--align-at`, and scored from then on at every row that the cameras saw. The noise of that one row then stays in every
error, and the ratio depends on it: `--no-align` shows both as they are. Quote both.

Without a configuration it is the rule for a sensor in the hand, in the guaranteed mode, the same for each recording;
rows without a set are left out for both.
"""

import argparse
from pathlib import Path

import numpy as np
from elliptude import estimation, logs
from elliptude.configuration import Configuration, read_configuration
from elliptude.logs import reference_attitudes
from scipy.spatial.transform import Rotation
from vqf import VQF

RULE = {
    "time_column": "t",
    "reference_frame": "ENU",
    "rule": {"kind": "hand_held", "anchor_s": 4.0},
    "flow": {"kind": "gyro", "columns": ["gyr[0]", "gyr[1]", "gyr[2]"], "unit": "rad/s"},
    "directions": [
        {"name": "up", "kind": "accelerometer", "columns": ["acc[0]", "acc[1]", "acc[2]"], "unit": "m/s^2"},
        {"name": "field", "kind": "magnetometer", "columns": ["mag[0]", "mag[1]", "mag[2]"], "unit": "uT"},
    ],
    "estimator": {"mode": "guaranteed", "policy": "drop_measurement", "criterion": "trace"},
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", nargs="+", type=Path)
    parser.add_argument("--config", type=Path, help="of an estimation; TOML")
    parser.add_argument("--align-at", type=float, default=2.0, help="s (default: 2)")
    parser.add_argument("--no-align", action="store_true", help="score both without turning them")
    arguments = parser.parse_args()
    configuration = (
        Configuration.model_validate(RULE) if arguments.config is None else read_configuration(arguments.config)
    )
    print(f"{'recording':45s} {'rows':>6s}   elliptude: mean, max °     vqf: mean, max °   ratio of means")
    for path in arguments.recordings:
        ours, theirs = errors(path, configuration, arguments.align_at, align=not arguments.no_align)
        print(
            f"{path.stem:45s} {len(ours):6d}   {ours.mean():14.2f} {ours.max():7.2f}   {theirs.mean():14.2f} "
            f"{theirs.max():7.2f}   {ours.mean() / theirs.mean():9.2f}"
        )


def errors(
    path: Path, configuration: Configuration, align_at: float, *, align: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Attitude errors in degrees of both, shape (n,)."""
    with np.load(path) as file:
        times, gyro, force, field, true = (
            np.ascontiguousarray(file[name], dtype=np.float64) for name in ("t", "gyr", "acc", "mag", "q_ref")
        )
    results = estimation.estimate(logs.read_log(path, configuration), configuration).result
    theirs = VQF(float(np.median(np.diff(times)))).updateBatch(gyro, force, field)["quat9D"]
    known = np.isfinite(true).all(axis=1)
    reference = reference_attitudes.Reference(times[known], Rotation.from_quat(true[known], scalar_first=True))
    there = np.isfinite(results.quaternions).all(axis=1) & (results.times >= align_at)
    rows, references = reference_attitudes.attitudes_at(reference, results.times, np.flatnonzero(there), 0.0)
    same = np.searchsorted(times, results.times[rows])
    assert np.array_equal(times[same], results.times[rows])
    return tuple(
        (aligned_errors if align else errors_as_they_are)(
            Rotation.from_quat(quaternions, scalar_first=True), references
        )
        for quaternions in (results.quaternions[rows], theirs[same])
    )


def aligned_errors(estimated: Rotation, true: Rotation) -> np.ndarray:
    """Errors in degrees after the turn about the vertical that takes away the heading error of the first row."""
    _, _, z, w = (true[0] * estimated[0].inv()).as_quat()
    heading = Rotation.from_rotvec([0.0, 0.0, 2.0 * np.arctan2(z, w)])
    return errors_as_they_are(heading * estimated, true)


def errors_as_they_are(estimated: Rotation, true: Rotation) -> np.ndarray:
    """Errors in degrees."""
    return np.rad2deg((estimated.inv() * true).magnitude())


if __name__ == "__main__":
    main()
