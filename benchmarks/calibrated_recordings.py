"""What a calibration on one recording changes on others: the BROAD trials with and without `elliptude calibrate`.

    python benchmarks/calibrated_recordings.py --datasets ../shared/datasets

The rule is `hand_held` as it stands. What is stated of the field while the sensors are calibrated is varied, down to
where the samples contradict it; each line says how the sets of the other trials change, and whether they hold.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from elliptude import estimation, logs
from elliptude.calibration.calibrate import calibrate
from elliptude.calibration.found import FoundGyro
from elliptude.configuration import Configuration
from elliptude.configuration.calibration import Calibration, read_statements
from elliptude.configuration.estimator import StatedRule
from real_recordings import broad_configuration

TRIALS = ("02", "05", "24", "07")
DISTURBANCES_UT = (5.0, 0.5, 0.265)


def calibration_of(folder: Path, trial: str, disturbance_ut: float) -> Calibration:
    """The calibration on one trial; raises ValueError if the statement contradicts the samples."""
    (path,) = folder.glob(f"{trial}_*.npz")
    known = read_statements()
    magnetometer = known.magnetometer.model_copy(update={"disturbance_ut": disturbance_ut})
    configuration = broad_configuration()
    found = calibrate(
        logs.read_log(path, configuration), configuration, known.model_copy(update={"magnetometer": magnetometer})
    )
    for one in found:
        for remark in one.remarks():
            print(f"  {remark}")
        if isinstance(one, FoundGyro):
            continue
        offset = " ".join(f"{value:.2f}" for value in one.left.offset)
        off = f"off by {one.left.offset_distance:.3g} {one.unit}, {one.stated.offset:g} stated"
        print(f"  {one.sensor.name}: offset {offset}, {off}")
    return Calibration(recording=path.name, recording_sha256="", sensors=tuple(one.calibration() for one in found))


def perfect(configuration: Configuration, *, all_sensors: bool) -> Configuration:
    """What a calibration without any remainder would leave of the rule: noise alone. A wish, not a statement."""
    assert configuration.rule is not None
    rule, known = configuration.rule.rule(), read_statements()
    assert rule.magnetometer is not None
    changes: dict[str, Any] = {
        "magnetometer": rule.magnetometer.model_copy(
            update={
                "error_ut": known.magnetometer.later_noise_ut,
                "averaged_error_ut": known.magnetometer.later_averaged_noise_ut,
                "scale_error": 0.0,
            }
        )
    }
    if all_sensors:
        changes["accelerometer"] = rule.accelerometer.model_copy(
            update={
                "error_m_per_s2": known.accelerometer.later_noise_m_per_s2,
                "averaged_error_m_per_s2": known.accelerometer.later_averaged_noise_m_per_s2,
                "scale_error": 0.0,
            }
        )
        changes["gyro"] = rule.gyro.model_copy(update={"scale_error": 0.0})
    tables = rule.model_copy(update=changes).model_dump()
    stated = StatedRule.model_validate(tables | {"kind": "stated", "anchor_s": configuration.rule.anchor_s})
    return configuration.model_copy(update={"rule": stated})


def line(folder: Path, trial: str, configuration: Configuration) -> str:
    """Whether the sets of a trial hold, and the half-widths about the vertical."""
    (path,) = folder.glob(f"{trial}_*.npz")
    summary = estimation.summarize(
        estimation.estimate(logs.read_log(path, configuration), configuration), configuration
    )
    rest, moving = (summary["sizes"][when]["half_width_reference_deg"]["mean"][2] for when in ("at_rest", "moving"))
    inside, claimed = summary["inside_share_of_unconditional_rows"], summary["claim_share_of_rows"]["unconditional"]
    return (
        f"{trial:5}  {np.nan if inside is None else 100.0 * inside:8.3f}  "
        f"{100.0 * claimed:15.2f}  {summary['attitude_error_deg']['mean']:7.2f}  "
        f"{rest:16.1f}  {moving:6.1f}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--datasets", type=Path, default=Path("../shared/datasets"), help="the folder with the recordings"
    )
    parser.add_argument("--on", default="02", help="the trial to calibrate on")
    parser.add_argument("--trials", nargs="+", default=list(TRIALS), help="the trials to estimate")
    parser.add_argument("--disturbance-ut", nargs="+", type=float, default=list(DISTURBANCES_UT), help="µT")
    arguments = parser.parse_args()
    folder = arguments.datasets / "broad"
    plain = broad_configuration()
    heading = "trial  inside %  unconditional %  error °  heading: at rest  moving"
    print(f"no calibration\n{heading}", flush=True)
    for trial in arguments.trials:
        print(line(folder, trial, plain), flush=True)
    for all_sensors, of in ((False, "the magnetometer alone"), (True, "all three sensors")):
        print(f"\nif a calibration of {of} left noise and nothing else\n{heading}", flush=True)
        for trial in arguments.trials:
            print(line(folder, trial, perfect(plain, all_sensors=all_sensors)), flush=True)
    for disturbance in arguments.disturbance_ut:
        print(f"\ncalibrated on {arguments.on}, the field there within {disturbance:g} µT")
        try:
            found = calibration_of(folder, arguments.on, disturbance)
        except ValueError as error:
            print(f"  {error}")
            continue
        configuration = plain.model_copy(update={"calibration": found})
        print(heading, flush=True)
        for trial in arguments.trials:
            print(line(folder, trial, configuration), flush=True)


if __name__ == "__main__":
    main()
