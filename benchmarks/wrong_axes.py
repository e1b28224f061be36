"""How many wrong axes `estimate` refuses, and whether it names the right ones: the five excerpts of BROAD.

    python benchmarks/wrong_axes.py --datasets ../shared/datasets

Each of the 48 signed permutations is applied to the accelerometer, then to the magnetometer, then to the gyro of a
recording. One leaves it as it is, and one of a vector is its opposite, which turns alike: no log can decide that one.
So 46 of a vector's are counted, and 47 of the gyro's. `estimate` is told nothing but the rule `hand_held`.

"Named" are the right axes as the first of those that would fit; of a vector, they or their opposite.
"""

import argparse
import dataclasses
import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
from elliptude import logs
from elliptude.logs import Log
from elliptude.logs.axes.axes_check import look_at_axes
from elliptude.typing import FloatArray
from real_recordings import TRIALS, broad_configuration

SENSORS = ("up", "field", "the gyro")


def signed_permutations() -> list[FloatArray]:
    """All 48, the identity first."""
    return [
        np.array(signs)[:, None] * np.eye(3)[list(order)]
        for order in itertools.permutations(range(3))
        for signs in itertools.product((1.0, -1.0), repeat=3)
    ]


def with_axes(log: Log, sensor: str, matrix: FloatArray) -> Log:
    """The log as if that sensor's axes were others."""
    if sensor == "the gyro":
        assert log.rates is not None
        return dataclasses.replace(log, rates=log.rates @ matrix.T)
    directions = log.directions.copy()
    directions[:, SENSORS.index(sensor)] = directions[:, SENSORS.index(sensor)] @ matrix.T
    return dataclasses.replace(log, directions=directions)


def count(log: Log, sensor: str) -> dict[str, int]:
    """What is said of each wrong choice of axes."""
    counted = {"wrong": 0, "refused": 0, "named": 0, "named alone": 0}
    for matrix in signed_permutations():
        trace = float(np.trace(matrix))
        if trace == 3.0 or (trace == -3.0 and sensor != "the gyro"):
            continue
        counted["wrong"] += 1
        wrong = look_at_axes(with_axes(log, sensor, matrix), broad_configuration()).wrong
        counted["refused"] += any(one.is_sure for one in wrong)
        if len(wrong) != 1 or not wrong[0].is_sure or wrong[0].sensor != sensor:
            continue
        back = np.round(wrong[0].fitting[0][1] @ matrix)
        is_right = np.array_equal(back, np.eye(3)) or (sensor != "the gyro" and np.array_equal(back, -np.eye(3)))
        counted["named"] += is_right
        counted["named alone"] += is_right and len(wrong[0].fitting) == 1
    return counted


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--datasets", type=Path, default=Path("../shared/datasets"), help="the folder with the recordings"
    )
    parser.add_argument("--trial", nargs="+", default=TRIALS)
    parser.add_argument("--json", type=Path, help="write all figures to this file")
    arguments = parser.parse_args()
    lines: list[dict[str, Any]] = []
    print("trial  unaltered  sensor    wrong  refused  named  named alone", flush=True)
    for trial in arguments.trial:
        (path,) = (arguments.datasets / "broad").glob(f"{trial}_*.npz")
        log = logs.read_log(path, broad_configuration())
        unaltered = "warned of" if look_at_axes(log, broad_configuration()).wrong else "passes"
        for sensor in SENSORS:
            counted = count(log, sensor)
            lines.append({"trial": trial, "unaltered": unaltered, "sensor": sensor} | counted)
            print(
                f"{trial:5}  {unaltered:9}  {sensor:8}  {counted['wrong']:5}  {counted['refused']:7}  "
                f"{counted['named']:5}  {counted['named alone']:11}",
                flush=True,
            )
    for name, chosen in (("accelerometer and magnetometer", SENSORS[:2]), ("gyro", SENSORS[2:])):
        sums = {
            key: sum(line[key] for line in lines if line["sensor"] in chosen) for key in ("wrong", "refused", "named")
        }
        print(
            f"{name}: {sums['refused']} of {sums['wrong']} refused ({100.0 * sums['refused'] / sums['wrong']:.1f} %), "
            f"the right axes named of {sums['named']}"
        )
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(lines, indent=2), encoding="utf-8")


if __name__ == "__main__":
    main()
