"""How sharp tilt and heading are on real recordings, and what no sharper filter of the same rows could do better.

    python benchmarks/sharpness.py --datasets ../shared/datasets

BROAD by the rule `hand_held` as it stands, alone and with `elliptude calibrate` on trial 02. For each trial: shares of
unconditional rows with the truth inside (set, tilt, heading, up), shares of rows that claim unconditionally (set, up),
mean bounds of heading and tilt at rest and moving.

The last columns are of some rows in motion: the bound over the sampled exact extent of what that row's constraints
leave, which are the set of its anchor carried by the gyro, and the row's own cones; and that extent, for tilt and
heading. With attitudes of that intersection in hand no filter that is told the same could say less of the row.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import elliptude as el
import numpy as np
from calibrated_recordings import calibration_of
from elliptude import estimation, logs
from elliptude.configuration import Configuration
from elliptude.estimation.guaranteed_result import resting_rows
from elliptude.estimation.guaranteed_run import GuaranteedRun
from elliptude.typing import FloatArray
from real_recordings import TRIALS, broad_configuration, inside_by_question
from scipy.spatial.transform import Rotation

# Samples of heading, of how far and of which way up is tilted; and how often the best are looked at more closely.
HEADINGS, TILTS, AZIMUTHS, ZOOMS, NEAR = 61, 16, 24, 4, 20_000


@dataclass(frozen=True, eq=False)
class Constraints:
    """What bounds the attitude of a row, in one update."""

    center: Rotation
    """Of the row's set: tilt and heading are counted from it."""
    prior: el.StateEllipsoid | None
    """The anchor's set, carried; None where it has grown to half turns."""
    references: FloatArray
    """(m, 3)."""
    directions: FloatArray
    """Body axes, (m, 3)."""
    angles: FloatArray
    """rad, (m,)."""

    def hold(self, points: FloatArray) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """Whether attitudes, given by heading, and tilt times cosine and sine of its azimuth (n, 3), obey them."""
        tilts = np.column_stack([points[:, 1], points[:, 2], np.zeros(len(points))])
        attitudes = (
            Rotation.from_rotvec(points[:, :1] * np.array([0.0, 0.0, 1.0])) * Rotation.from_rotvec(tilts) * self.center
        ).as_matrix()
        seen = np.einsum("nji,mj->nmi", attitudes, self.references)
        away = np.arctan2(
            np.linalg.norm(np.cross(seen, self.directions), axis=2), np.einsum("nmi,mi->nm", seen, self.directions)
        )
        obeyed: np.ndarray[Any, np.dtype[np.bool_]] = (away <= self.angles).all(axis=1)
        if self.prior is None:
            return obeyed
        errors = Rotation.from_matrix(self.prior.attitude).inv() * Rotation.from_matrix(attitudes)
        x, y, z, w = errors.as_quat(canonical=True).T
        gibbs = 2.0 * np.column_stack([x, y, z]) / np.maximum(w, 1e-9)[:, None]
        forms = np.einsum("ni,ij,nj->n", gibbs, np.linalg.inv(self.prior.shape[:3, :3]), gibbs)
        obeyed &= forms <= 1.0
        return obeyed


def constraints(run: GuaranteedRun, row: int) -> Constraints:
    """What the filter was told at a row, from its anchor's set on."""
    turns, sets, rows = run.given.turns, run.sets, run.rows
    assert turns is not None
    anchor = int(turns.anchors[row])
    start = el.StateEllipsoid(sets.attitudes[anchor], sets.vectors[anchor], sets.shapes[anchor], chart="gibbs")
    carried = el.GuaranteedFilter(run.given.flow, start, vector_bound=run.given.vector_bound, estimate_vector=False)
    carried.predict_turn(1.0, turns.vectors[row], float(turns.angles[row]))
    told = np.isfinite(run.given.measured["bounds"][row])
    center = Rotation.from_matrix(sets.attitudes[row])
    angles = rows.angles[row, told]
    return Constraints(center, carried.ellipsoid, rows.references[row, told], rows.directions[row, told], angles)


def _tilts(points: FloatArray) -> FloatArray:
    tilts: FloatArray = np.hypot(points[:, 1], points[:, 2])
    return tilts


def _headings(points: FloatArray) -> FloatArray:
    return points[:, 0]


def _headings_back(points: FloatArray) -> FloatArray:
    return -points[:, 0]


def extents(of: Constraints, most: FloatArray, random: np.random.Generator) -> FloatArray:
    """The largest tilt and the largest heading to both sides that samples find, rad: (3,); `most` bounds them."""
    tilt, least, greatest = most
    headings, radii = np.linspace(least, greatest, HEADINGS), np.linspace(0.0, tilt, TILTS)
    azimuths = np.linspace(0.0, 2.0 * np.pi, AZIMUTHS, endpoint=False)
    psi, alpha, beta = (grid.ravel() for grid in np.meshgrid(headings, radii, azimuths, indexing="ij"))
    points = np.column_stack([psi, alpha * np.cos(beta), alpha * np.sin(beta)])
    inside = np.concatenate([np.zeros((1, 3)), points])
    inside = inside[of.hold(inside)]
    steps = np.array([(greatest - least) / HEADINGS, 2.0 * tilt / TILTS, 2.0 * tilt / TILTS])
    found = []
    for how_far in (_tilts, _headings, _headings_back):
        best, size = inside[np.argsort(how_far(inside))[-8:]], steps
        for _ in range(ZOOMS):
            near = best[random.integers(len(best), size=NEAR)] + random.uniform(-1.5, 1.5, (NEAR, 3)) * size
            near = np.concatenate([best, near[of.hold(near)]])
            best, size = near[np.argsort(how_far(near))[-8:]], 0.5 * size
        found.append(how_far(best[-1:])[0])
    return np.array(found)


def against_samples(run: GuaranteedRun, rows: Any) -> FloatArray:
    """Of some rows the bounds of tilt and heading over what samples find, and that: mean, (4,)."""
    random, bounds = np.random.default_rng(1), run.sets.attitude_bounds
    assert bounds is not None
    assert run.vertical is not None
    figures = []
    for row in rows:
        most = np.array([bounds.tilt[row], bounds.heading_from[row], bounds.heading_to[row]])
        tilt, after, before = extents(constraints(run, row), most, random)
        heading = max(after, before)
        figures.append(
            [min(most[0], run.vertical.tilt_bounds[row]) / tilt, bounds.heading[row] / heading, tilt, heading]
        )
    means: FloatArray = np.mean(figures, axis=0)
    return means


def line(folder: Path, trial: str, configuration: Configuration, count: int) -> str:
    """One line of the table."""
    (path,) = folder.glob(f"{trial}_*.npz")
    estimated = estimation.estimate(logs.read_log(path, configuration), configuration)
    run: Any = estimated.guaranteed
    summary = estimation.summarize(estimated, configuration)
    inside = [summary["inside_share_of_unconditional_rows"], *inside_by_question(estimated).values()]
    claims = [summary[of]["unconditional"] for of in ("claim_share_of_rows", "up_claim_share_of_rows")]
    parts = [summary["sizes"][part] for part in ("at_rest", "moving")]
    resting = resting_rows(run.log, configuration)
    assert resting is not None
    there = np.flatnonzero(~resting & np.isfinite(run.sets.attitude_bounds.heading))
    sharp = against_samples(run, there[:: max(len(there) // count, 1)])
    return (
        f"{trial}   {' '.join(f'{100.0 * share:7.3f}' for share in inside)}   "
        f"{' '.join(f'{100.0 * share:6.2f}' for share in claims)}   "
        + "   ".join(
            " ".join(f"{part[of]['mean']:6.2f}" for part in parts) for of in ("heading_bound_deg", "tilt_bound_deg")
        )
        + f"   {parts[1]['up_bound_deg']['mean']:6.2f}   {sharp[0]:5.3f} {sharp[1]:5.3f}   "
        + " ".join(f"{np.rad2deg(value):6.2f}" for value in sharp[2:])
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--datasets", type=Path, default=Path("../shared/datasets"), help="the recordings' folder")
    parser.add_argument("--criterion", default="trace", help="what the filter makes small")
    parser.add_argument("--trials", nargs="+", default=TRIALS, help="which excerpts")
    parser.add_argument("--rows", type=int, default=24, help="of each trial, to be sampled")
    parser.add_argument("--disturbance-ut", nargs="*", type=float, default=[0.5, 0.3], help="µT, while 02 was recorded")
    arguments = parser.parse_args()
    folder, plain = arguments.datasets / "broad", broad_configuration(arguments.criterion)
    heading = (
        "trial inside %: set tilt heading up   claims %: set up   heading: rest moving   tilt: rest moving   up: moving"
        "   bound over sampled: tilt heading   sampled: tilt heading"
    )
    print(f"no calibration\n{heading}", flush=True)
    for trial in arguments.trials:
        print(line(folder, trial, plain, arguments.rows), flush=True)
    for disturbance in arguments.disturbance_ut:
        print(f"\ncalibrated on 02, the field there within {disturbance:g} uT", flush=True)
        calibrated = plain.model_copy(update={"calibration": calibration_of(folder, "02", disturbance)})
        print(heading, flush=True)
        for trial in arguments.trials:
            print(line(folder, trial, calibrated, arguments.rows), flush=True)


if __name__ == "__main__":
    main()
