"""The best estimate beside the guaranteed set on real recordings: how good it is, and how far it may be off.

    python benchmarks/best_estimate.py --datasets ../shared/datasets

BROAD: a sensor in the hand, bounds by the rule `hand_held` as it stands. The best estimate is VQF's (the extra `best`),
put back into the set where it leaves it. Beside it are VQF as it comes, from the same samples, and the center of the
set. The optical attitude says how far each is off, within 0.5°; an error above its guaranteed bound by more than that
would be a broken promise.
"""

import argparse
import time
from pathlib import Path

import numpy as np
from elliptude import estimation, logs
from elliptude.logs.reference_attitudes import Reference, read_reference
from elliptude.typing import FloatArray
from monitor_vqf import REFERENCE_ERROR_DEG, vqf_attitudes
from real_recordings import TRIALS, broad_configuration
from scipy.spatial.transform import Rotation


def errors_deg(quaternions: FloatArray, true: Rotation) -> FloatArray:
    """Total, tilt and heading from attitudes to the truth, the heading with its sign, degrees, shape (n, 3)."""
    difference = (true * Rotation.from_quat(quaternions, scalar_first=True).inv()).as_quat(scalar_first=True)
    w, z = difference[:, 0], difference[:, 3]
    tilt = 2.0 * np.arctan2(np.hypot(difference[:, 1], difference[:, 2]), np.hypot(w, z))
    total = 2.0 * np.arctan2(np.linalg.norm(difference[:, 1:], axis=1), np.abs(w))
    return np.rad2deg(np.column_stack([total, tilt, 2.0 * np.arctan2(z * np.sign(w), np.abs(w))]))


def line(datasets: Path, trial: str, criterion: str) -> str:
    """One line of the table."""
    configuration = broad_configuration(criterion)
    (path,) = (datasets / "broad").glob(f"{trial}_*.npz")
    begin = time.perf_counter()
    estimated = estimation.estimate(logs.read_log(path, configuration), configuration)
    elapsed = time.perf_counter() - begin
    best, result = estimated.best, estimated.result
    assert best is not None
    truth: Reference = read_reference(path, configuration)
    plain = vqf_attitudes(path, True)
    rows = np.searchsorted(result.times, truth.times)
    there = np.isfinite(best.errors.bounds[rows, 0])
    rows, true = rows[there], truth.attitudes[there]
    of_best, of_center = errors_deg(best.quaternions[rows], true), errors_deg(result.quaternions[rows], true)
    at = np.searchsorted(plain.times, truth.times[there])
    of_plain = errors_deg(plain.attitudes[at].as_quat(scalar_first=True), true)
    errors = best.errors
    bounds, claimed = np.rad2deg(errors.bounds[rows]), errors.claims[rows] == 0
    least, most = np.rad2deg(errors.headings[rows]).T
    middle = 0.5 * (least + most)
    heading = of_best[:, 2] - 360.0 * np.round((of_best[:, 2] - middle) / 360.0)
    beyond = np.column_stack(
        [of_best[:, :2] - bounds[:, :2], np.maximum(heading - most, least - heading)],
    )
    broken = ((beyond > REFERENCE_ERROR_DEG) & claimed).sum(axis=0)
    means = [np.abs(values).mean(axis=0) for values in (of_best, of_plain, of_center)]
    return (
        f"{trial:6} {criterion:7} {100.0 * np.mean(claimed[:, 0]):6.1f} | "
        + " | ".join(" ".join(f"{value:6.2f}" for value in mean) for mean in means)
        + f" | {means[0][0] / means[1][0]:5.3f} | {best.put_back.sum():5d} | "
        + " ".join(f"{value:6.1f}" for value in bounds.mean(axis=0))
        + f" | {' '.join(str(count) for count in broken)} | {elapsed:5.1f}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--datasets", type=Path, default=Path("../shared/datasets"), help="the recordings' folder")
    parser.add_argument("--criterion", nargs="+", default=["trace", "volume"], help="what the filter makes small")
    parser.add_argument("--trials", nargs="+", default=TRIALS, help="which excerpts")
    arguments = parser.parse_args()
    print("mean errors and bounds in degrees: total, tilt, heading; over rows with a set and a truth")
    print(
        "trial  crit.   claim % | best                 | vqf as it comes      | center               | best/vqf | "
        "put back | bound | broken | s"
    )
    for criterion in arguments.criterion:
        for trial in arguments.trials:
            print(line(arguments.datasets, trial, criterion), flush=True)


if __name__ == "__main__":
    main()
