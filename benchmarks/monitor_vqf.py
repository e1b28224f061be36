"""`elliptude monitor` on real recordings: how far VQF, another filter, can be off, and how far it is.

    python benchmarks/monitor_vqf.py --datasets ../shared/datasets

BROAD: a sensor in the hand, bounds by the rule `hand_held` as it stands. VQF (pip install vqf) estimates from the same
samples with its settings as they come. The optical attitude says how far it is off, within 0.5°; an error above the
guaranteed bound by more than that would be a broken promise. The heading of VQF counts from magnetic north, as that of
the rule; without its magnetometer it is free.

With --fault-deg a slow fault is added to VQF's attitude: a turn about a horizontal reference axis that begins after
half of the time and grows by 2°/s up to that angle. Then the table says when it is proved, and how large it is then.
With --picture the trial 24 is drawn.
"""

import argparse
from pathlib import Path

import numpy as np
from elliptude import estimation, logs
from elliptude.logs.reference_attitudes import Reference, read_reference
from elliptude.monitoring import Limits, Monitored
from elliptude.report import figures, monitored, run_figures
from elliptude.typing import FloatArray
from real_recordings import TRIALS, broad_configuration
from scipy.spatial.transform import Rotation
from vqf import VQF

REFERENCE_ERROR_DEG = 0.5
FAULT_DEG_PER_S = 2.0
PICTURE_TRIAL, PICTURE_TILT_LIMIT_DEG = "24", 20.0


def vqf_attitudes(path: Path, with_magnetometer: bool) -> Reference:
    """VQF's attitudes, from body to ENU, over one recording."""
    with np.load(path) as recording:
        times, gyro, acceleration, field = (
            np.asarray(recording[name], dtype=float) for name in ("t", "gyr", "acc", "mag")
        )
    vqf = VQF(float(np.median(np.diff(times))))
    found = vqf.updateBatch(*(np.ascontiguousarray(columns) for columns in (gyro, acceleration, field)))
    quaternions = found["quat9D" if with_magnetometer else "quat6D"]
    return Reference(times, Rotation.from_quat(quaternions, scalar_first=True))


def errors_deg(judged: Reference, true: Reference) -> FloatArray:
    """Total, tilt and heading error at the times of the truth, degrees, shape (n, 3)."""
    at = np.searchsorted(judged.times, true.times)
    difference = (true.attitudes * judged.attitudes[at].inv()).as_quat(scalar_first=True)
    w, z = difference[:, 0], difference[:, 3]
    tilt = 2.0 * np.arccos(np.minimum(np.hypot(w, z), 1.0))
    heading = np.abs(2.0 * np.arctan2(z * np.sign(w), np.abs(w)))
    return np.rad2deg(np.column_stack([2.0 * np.arccos(np.minimum(np.abs(w), 1.0)), tilt, heading]))


def line(name: str, found: Monitored, judged: Reference, true: Reference, questions: tuple[int, ...]) -> str:
    """One line of the table."""
    rows = np.searchsorted(found.times, true.times)
    errors = errors_deg(judged, true)
    text = f"{name:9} {100.0 * np.mean(found.claims[:, 1] == 0):6.1f} "
    for i in questions:
        unconditional = found.claims[rows, i] == 0
        bounds, error = np.rad2deg(found.bounds[rows, i][unconditional]), errors[unconditional, i]
        broken = int((error - REFERENCE_ERROR_DEG > bounds).sum())
        text += (
            f" | {error.mean():6.2f} {error.max():6.2f} {bounds.mean():6.1f} {np.max(error / bounds):5.2f} {broken:4d} "
            f"{int(found.alarms.proved[:, i].sum()):5d}"
        )
    return text


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--datasets", type=Path, default=Path("../shared/datasets"), help="the recordings' folder")
    parser.add_argument("--criterion", default="volume", help="what the filter makes small")
    parser.add_argument("--fault-deg", type=float, default=0.0, help="the fault that VQF's attitude ends with")
    parser.add_argument("--picture", type=Path, help="where to draw trial 24, PNG")
    arguments = parser.parse_args()
    heads = "   mean    max  bound  ratio  broken  proved"
    print(f"{'trial':9} {'claim %':>7} | total:{heads} | tilt | heading: alike; errors and bounds in degrees")
    configuration = broad_configuration(arguments.criterion)
    limits = Limits(tilt=np.deg2rad(PICTURE_TILT_LIMIT_DEG))
    for trial in TRIALS:
        (path,) = (arguments.datasets / "broad").glob(f"{trial}_*.npz")
        estimated = estimation.estimate(logs.read_log(path, configuration), configuration)
        assert estimated.guaranteed is not None
        run = monitored.run_of(estimated.result, heading_from_start=False, bounds_from_recording=None)
        true = read_reference(path, configuration, origin=0)
        for with_magnetometer in (True, False):
            judged = vqf_attitudes(path, with_magnetometer)
            begin = judged.times[0] + 0.5 * (judged.times[-1] - judged.times[0])
            growing = np.clip(FAULT_DEG_PER_S * (judged.times - begin), 0.0, arguments.fault_deg)
            fault = Rotation.from_rotvec(np.deg2rad(growing)[:, None] * [1.0, 0.0, 0.0])
            judged = Reference(judged.times, fault * judged.attitudes)
            heading = "same" if with_magnetometer else "free"
            found = monitored.judge(run, judged, has_vertical=True, heading=heading, limits=limits)
            name = trial if with_magnetometer else f"{trial} no mag"
            print(line(name, found, judged, true, (0, 1, 2) if with_magnetometer else (1,)), flush=True)
            if arguments.picture is not None and name == PICTURE_TRIAL:
                figures.save(
                    run_figures.monitor_figure(found, f"VQF judged by excerpt {trial} of BROAD"), arguments.picture
                )
            proofs = np.flatnonzero(found.alarms.proved.any(axis=1))
            if arguments.fault_deg and len(proofs):
                first = proofs[0]
                print(f"          proved {found.times[first] - begin:.2f} s after it began, at {growing[first]:.1f}°")


if __name__ == "__main__":
    main()
