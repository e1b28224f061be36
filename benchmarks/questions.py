"""Bounds of tilt and heading, and up by itself, against true motions whose errors are as large as they may be.

    python benchmarks/questions.py --logs 1000 --rows 1000

A gyro's turns and one to three measured directions, each wrong by its bound or nearly so, in directions that change or
stay; rows are predicted from the row before or from anchors. No bound may be broken. How near the truth comes to one
says whether it could have been.
"""

import argparse
from dataclasses import dataclass

import elliptude as el
import numpy as np
from elliptude.typing import FloatArray
from scipy.spatial.transform import Rotation

UP = np.array([0.0, 0.0, 1.0])


@dataclass
class Log:
    """One log, with its truth."""

    turns: FloatArray
    turn_bounds: FloatArray
    anchors: FloatArray
    directions: FloatArray
    references: FloatArray
    bounds: FloatArray
    attitudes: FloatArray


def _unit(random: np.random.Generator, *shape: int) -> FloatArray:
    vectors = random.normal(size=(*shape, 3))
    units: FloatArray = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return units


def make_log(random: np.random.Generator, rows: int) -> Log:
    """Turns, measurements and the true attitudes; the first row is where the filter begins."""
    every = int(random.choice([1, 1, 10]))
    anchors = np.array([max(every * ((i - 1) // every), 0) if i else -1 for i in range(rows)])
    steps = Rotation.from_rotvec(
        random.choice([0.01, 0.2, 1.0]) * random.uniform(0, 1, (rows, 1)) * _unit(random, rows)
    )
    true = [Rotation.random(random_state=int(random.integers(2**31)))]
    for i in range(1, rows):
        true.append(true[-1] * steps[i])
    bound_of_turn = 10.0 ** random.uniform(-5, -2)
    axis = _unit(random)
    turns, turn_bounds = np.zeros((rows, 3)), np.zeros(rows)
    for i in range(1, rows):
        whole = true[anchors[i]].inv() * true[i]
        turn_bounds[i] = bound_of_turn * (i - anchors[i])
        # Always about one axis of the body, or about any.
        along = axis if random.integers(2) else _unit(random)
        error = Rotation.from_rotvec(random.choice([0.999, 0.999, 0.3]) * turn_bounds[i] * along)
        turns[i] = (whole * error).as_rotvec()
    count = int(random.integers(1, 4))
    references = np.vstack([UP, _unit(random, 2)])[:count]
    bounds = 10.0 ** random.uniform(-3, -0.3, (1, count)) * np.ones((rows, 1))
    bounds[random.uniform(size=bounds.shape) < 0.2] = np.nan
    bounds[0] = np.where(np.isnan(bounds[0]), 0.1, bounds[0])
    directions = np.empty((rows, count, 3))
    for i in range(rows):
        for k in range(count):
            seen = true[i].inv().apply(references[k])
            across = np.cross(seen, axis if random.integers(2) else _unit(random))
            across /= np.linalg.norm(across)
            size = 0.0 if np.isnan(bounds[i, k]) else random.choice([0.999, 0.999, 0.5]) * bounds[i, k]
            directions[i, k] = Rotation.from_rotvec(size * across).apply(seen)
    return Log(turns, turn_bounds, anchors, directions, references, bounds, Rotation.concatenate(true).as_matrix())


def judge(log: Log, criterion: str) -> tuple[int, int, FloatArray]:
    """How many rows have bounds, how many are broken, and how near the truth comes: tilt, heading, angle, up."""
    flow = el.GuaranteedGyroFlow(0.0, 0.0)
    times = np.arange(len(log.turns), dtype=np.float64)
    attitude_filter = el.GuaranteedFilter(flow, criterion=criterion, vector_bound=1e-9, estimate_vector=False)
    sets = attitude_filter.run_turns(
        times,
        log.turns,
        log.turn_bounds,
        anchors=log.anchors,
        directions=log.directions,
        reference=log.references,
        bounds=log.bounds,
        vertical=UP,
    )
    up = el.DirectionFilter().run_turns(
        log.turns, log.turn_bounds, anchors=log.anchors, directions=log.directions[:, 0], bounds=log.bounds[:, 0]
    )
    bounds = sets.attitude_bounds
    assert bounds is not None
    true_up = np.einsum("nji,j->ni", log.attitudes, UP)

    def angle(first: FloatArray, second: FloatArray) -> FloatArray:
        return np.arctan2(np.linalg.norm(np.cross(first, second), axis=1), np.einsum("ni,ni->n", first, second))

    known = np.isfinite(bounds.tilt)
    difference = Rotation.from_matrix(log.attitudes[known] @ sets.attitudes[known].transpose(0, 2, 1))
    _, _, z, w = difference.as_quat(canonical=True).T
    heading = 2.0 * np.arctan2(z, w)
    heading = np.where(heading > np.pi, heading - 2.0 * np.pi, heading)
    shares = np.full((len(times), 4), np.nan)
    shares[known, 0] = angle(np.einsum("nji,j->ni", sets.attitudes[known], UP), true_up[known]) / bounds.tilt[known]
    side = np.where(heading > 0.0, bounds.heading_to[known], bounds.heading_from[known])
    shares[known, 1] = heading / side
    shares[known, 2] = difference.magnitude() / bounds.angle[known]
    shares[:, 3] = angle(up.directions, true_up) / up.angles
    # A side that is negative is one that the truth may not be on at all.
    shares[known, 1] = np.where(side * heading < 0.0, np.inf, shares[known, 1])
    nearest: FloatArray = np.fmax.reduce(shares, axis=0, initial=0.0)
    return int(np.isfinite(shares).any(axis=1).sum()), int((shares > 1.0).any(axis=1).sum()), nearest


def main() -> None:
    """Make the logs, and judge each by both criteria."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", type=int, default=100)
    parser.add_argument("--rows", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    random = np.random.default_rng(arguments.seed)
    rows = broken = 0
    nearest = np.zeros(4)
    for i in range(arguments.logs):
        log = make_log(random, arguments.rows)
        found, outside, near = judge(log, "trace" if i % 2 else "volume")
        rows, broken, nearest = rows + found, broken + outside, np.fmax(nearest, near)
    print(f"{rows} rows with bounds, {broken} of them broken")
    print(
        "nearest: "
        + ", ".join(
            f"{name} {share:.4f}" for name, share in zip(("tilt", "heading", "angle", "up"), nearest, strict=True)
        )
    )


if __name__ == "__main__":
    main()
