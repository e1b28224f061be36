"""The guaranteed mode on real recordings: whether the reference attitude is in the sets, and how large they are.

    python benchmarks/real_recordings.py --datasets ../shared/datasets

BROAD: a sensor in the hand, bounds by the rule `hand_held` as it stands; the optical attitude counts as inside where
one within 0.5° of it is, which is its own uncertainty. Fermi: four hours, the Sun from a solar array within 2°, a
synthetic star in the first row alone, the rate within 0.005 °/s; with and without a bound of its integrated error.

The rule's numbers and those for Fermi are statements made beforehand. How often a prediction begins anew (`anchor_s`)
and what is minimised (`criterion`) change how large sets are, never whether they hold.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from elliptude import estimation, logs
from elliptude.configuration import Configuration
from elliptude.estimation import Estimation
from elliptude.io import column_files, tables
from elliptude.logs import Log
from elliptude.simulation import fermi
from elliptude.typing import FloatArray
from scipy.spatial.transform import Rotation

TRIALS = ("02", "05", "07", "24", "30")
BROAD_ANCHOR_S = 4.0
# °; how far the optical attitude may itself be off.
TRUTH_ERROR_DEG = 0.5
FERMI_ANCHOR_S = 1024.0
# °; what a rate's error within 0.005 °/s integrates to over any window. The data's description gives 0.4 over 1000 s.
FERMI_INCREMENT_DEG = 0.5


def broad_configuration(criterion: str = "volume", anchor_s: float | None = BROAD_ANCHOR_S) -> Configuration:
    """The configuration of any of the BROAD excerpts."""

    def columns(name: str, count: int = 3) -> list[str]:
        return [f"{name}[{i}]" for i in range(count)]

    rule: dict[str, Any] = {"kind": "hand_held"}
    return Configuration.model_validate(
        {
            "time_column": "t",
            "rule": rule if anchor_s is None else rule | {"anchor_s": anchor_s},
            "flow": {"kind": "gyro", "columns": columns("gyr"), "unit": "rad/s"},
            "directions": [
                {"name": "up", "kind": "accelerometer", "columns": columns("acc"), "unit": "m/s^2"},
                {"name": "field", "kind": "magnetometer", "columns": columns("mag"), "unit": "uT"},
            ],
            "estimator": {"mode": "guaranteed", "policy": "drop_measurement", "criterion": criterion},
            "truth": {
                "attitude_columns": columns("q_ref", 4),
                "error_deg": TRUTH_ERROR_DEG,
                "label": "the optical attitude",
            },
        }
    )


def broad(folder: Path, trial: str, criterion: str = "volume", anchor_s: float | None = BROAD_ANCHOR_S) -> Estimation:
    """Estimate one of the BROAD excerpts."""
    (path,) = folder.glob(f"{trial}_*.npz")
    configuration = broad_configuration(criterion, anchor_s)
    return estimation.estimate(logs.read_log(path, configuration), configuration)


def fermi_log(path: Path) -> tuple[Log, FloatArray]:
    """The four hours of Fermi, with the synthetic star in the first row alone; and the Sun in reference axes."""
    names = (*tables.QUATERNION, *tables.RATE, "sada_py_deg")
    columns = column_files.read_columns(path, time="met_s", numbers=names)
    recorded = fermi.Telemetry(
        met=columns["met_s"],
        quaternions=np.column_stack([columns[name] for name in tables.QUATERNION]),
        angular_velocities=np.column_stack([columns[name] for name in tables.RATE]),
        array_angles=np.deg2rad(columns["sada_py_deg"]),
    )
    measurements = fermi.measurements(recorded, star_until=1)
    return logs.log_of(measurements), measurements.references[:, 0]


def fermi_configuration(increment_deg: float | None, anchor_s: float | None = FERMI_ANCHOR_S) -> Configuration:
    """With or without an increment bound of the gyro; by anchors or row by row."""
    flow: dict[str, Any] = {"kind": "gyro", "columns": list(tables.MEASURED_RATE), "noise_deg_per_s": 0.005}
    # Two samples of one a second are missing; a spacecraft hardly changes its rate meanwhile, so the bound holds.
    flow["longest_interval_s"] = 2.5
    flow |= {} if anchor_s is None else {"anchor_s": anchor_s}
    flow |= {} if increment_deg is None else {"increment_deg": increment_deg}

    def direction(name: str, bound_deg: float) -> dict[str, Any]:
        columns, references = list(tables.measured(name)), list(tables.reference(name))
        return {"name": name, "columns": columns, "reference_columns": references, "bound_deg": bound_deg}

    return Configuration.model_validate(
        {
            "flow": flow,
            "directions": [direction("sun", 2.0), direction("star", fermi.STAR_BOUND_DEG)],
            "estimator": {"mode": "guaranteed", "criterion": "trace"},
            "truth": {"attitude_columns": list(tables.QUATERNION), "label": "the recorded attitude"},
        }
    )


def _list(values: list[float] | None) -> str:
    return "-" if values is None else " ".join(f"{value:5.1f}" for value in values)


def _broad_lines(folder: Path, criterion: str, anchor_s: float | None) -> list[dict[str, Any]]:
    lines = []
    anchors = "every row" if anchor_s is None else f"{anchor_s:g} s apart"
    print(f"\nBROAD, rule hand_held, criterion {criterion}, anchors {anchors}")
    print("half-widths of the set about reference x, y (horizontal), z; bounds of tilt and heading: means, degrees")
    print("inside %: of unconditional rows, the set, and its tilt, heading, and up by itself; claims: unconditional, %")
    print(
        "trial  inside: set tilt heading up   claims: set  up  dropped  error °   "
        "at rest: x y z   tilt heading    moving: x y z   tilt heading   s"
    )
    for trial in TRIALS:
        summary = estimation.summarize(
            estimated := broad(folder, trial, criterion, anchor_s), broad_configuration(criterion, anchor_s)
        )
        inside = inside_by_question(estimated)
        shares = [summary["inside_share_of_unconditional_rows"], *inside.values()]
        claims = [summary[of]["unconditional"] for of in ("claim_share_of_rows", "up_claim_share_of_rows")]
        print(
            f"{trial:5}  {' '.join(f'{100.0 * share:6.2f}' for share in shares)}  "
            f"{' '.join(f'{100.0 * share:6.2f}' for share in claims)}  {summary['dropped_measurements']:7}  "
            f"{summary['attitude_error_deg']['mean']:7.2f}  "
            + "  ".join(_sizes(summary["sizes"][part]) for part in ("at_rest", "moving"))
            + f"  {estimated.elapsed:4.1f}",
            flush=True,
        )
        lines.append({"trial": trial, "criterion": criterion, "anchor_s": anchor_s, "inside": inside} | summary)
    return lines


def _sizes(part: dict[str, Any]) -> str:
    widths = _list(part["half_width_reference_deg"]["mean"])
    return f"{widths:>18}  {part['tilt_bound_deg']['mean']:5.2f}  {part['heading_bound_deg']['mean']:5.1f}"


def inside_by_question(estimated: Estimation) -> dict[str, float]:
    """Shares of unconditional rows with the truth within the bound of the tilt, of the heading, and of up by itself.

    The optical attitude counts as inside where one within its own error is.
    """
    guaranteed, result = estimated.guaranteed, estimated.result
    assert guaranteed is not None
    true = guaranteed.log.true_attitudes
    headings, tilts, ups, up_bounds = result.headings, result.tilt_bounds, result.ups, result.up_bounds
    assert true is not None
    assert headings is not None
    assert tilts is not None
    assert ups is not None
    assert up_bounds is not None
    slack = np.deg2rad(TRUTH_ERROR_DEG)
    turn = (
        Rotation.from_matrix(np.where(np.isfinite(true), true, np.eye(3)))
        * Rotation.from_quat(
            np.where(np.isfinite(result.quaternions), result.quaternions, (1.0, 0.0, 0.0, 0.0)), scalar_first=True
        ).inv()
    )
    # The twist of the turn from the estimate to the truth about the vertical.
    _, _, z, w = turn.as_quat(canonical=True).T
    heading = 2.0 * np.arctan2(z, w)
    heading -= 2.0 * np.pi * np.round(heading / (2.0 * np.pi))
    estimated_up = result.attitudes[:, 2]

    def angle(first: FloatArray, second: FloatArray) -> FloatArray:
        return np.arctan2(np.linalg.norm(np.cross(first, second), axis=1), np.einsum("ni,ni->n", first, second))

    holds = {
        "tilt": (angle(estimated_up, true[:, 2]) <= tilts + slack, result.claims),
        "heading": ((heading >= headings[:, 0] - slack) & (heading <= headings[:, 1] + slack), result.claims),
        "up": (angle(ups, true[:, 2]) <= up_bounds + slack, result.up_claims),
    }
    known = np.isfinite(true[:, 0, 0])
    return {
        name: float(is_inside[known & (np.array(claims) == "unconditional")].mean())
        for name, (is_inside, claims) in holds.items()
    }


def _fermi_lines(path: Path) -> list[dict[str, Any]]:
    log, sun = fermi_log(path)
    print(f"\nFermi, four hours, predictions over {FERMI_ANCHOR_S:g} s, half-width about the Sun line, degrees")
    print("gyro bound                       inside %   mean  median    last   of the per-sample bound's mean   s")
    lines: list[dict[str, Any]] = []
    for name, increment in (("0.005 °/s per sample", None), ("and 0.5° over any window", FERMI_INCREMENT_DEG)):
        estimated = estimation.estimate(log, fermi_configuration(increment))
        about = np.rad2deg(fermi.half_widths_about(estimated.result, sun)[0])
        forms = estimated.result.forms
        assert forms is not None
        line = {
            "gyro": name,
            "inside": float(np.mean(forms <= 1.0)),
            "mean_deg": float(about.mean()),
            "median_deg": float(np.median(about)),
            "last_deg": float(about[-1]),
        }
        lines.append(line)
        print(
            f"{name:31}  {100.0 * line['inside']:8.3f}  {line['mean_deg']:5.1f}  {line['median_deg']:6.1f}  "
            f"{line['last_deg']:6.1f}  {line['mean_deg'] / lines[0]['mean_deg']:6.3f}  {estimated.elapsed:28.1f}",
            flush=True,
        )
    return lines


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--datasets", type=Path, default=Path("../shared/datasets"), help="the folder with the recordings"
    )
    parser.add_argument("--criterion", nargs="+", default=["volume", "trace"], help="for BROAD")
    parser.add_argument(
        "--anchor", nargs="+", type=float, default=[0.0, BROAD_ANCHOR_S], help="s, for BROAD; 0: every row"
    )
    parser.add_argument("--json", type=Path, help="write all figures to this file")
    arguments = parser.parse_args()
    figures: dict[str, Any] = {"broad": []}
    for criterion in arguments.criterion:
        for anchor in arguments.anchor:
            figures["broad"] += _broad_lines(arguments.datasets / "broad", criterion, anchor or None)
    (path,) = (arguments.datasets / "fermi-gbm-poshist").glob("*.csv.gz")
    figures["fermi"] = _fermi_lines(path)
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(figures, indent=2), encoding="utf-8")


if __name__ == "__main__":
    main()
