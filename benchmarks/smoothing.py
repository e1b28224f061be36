"""Smoothing: real recordings forward and smoothed, and a search for a truth outside.

    python benchmarks/smoothing.py --datasets ../shared/datasets
    python benchmarks/smoothing.py --logs 200 --pairs 1000000

BROAD by the rule `hand_held` as it stands. The made logs have errors at their bounds, about axes that change or stay as
in `questions.py`; a pair is two sets with a common state at the edge of one, the other or both.
"""

import argparse
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import elliptude as el
import numpy as np
import questions
from elliptude import estimation, logs, smoothing
from elliptude.configuration.estimator import Estimator
from elliptude.estimation.guaranteed_result import resting_rows
from elliptude.estimation.vertical import vertical_of
from elliptude.smoothing.both import Passes, both_passes
from elliptude.smoothing.fusion import StateSets, common
from elliptude.smoothing.mirror import caps_turned_round, turned_round
from elliptude.typing import FloatArray
from real_recordings import TRIALS, broad_configuration, inside_by_question
from scipy.spatial.transform import Rotation


def recordings(folder: Path, criterion: str) -> None:
    """Print a line for each of the BROAD excerpts: moving rows, means in degrees."""
    print(
        f"\nBROAD, rule hand_held, criterion {criterion}; inside: share of unconditional rows; bounds: moving, means, °"
    )
    print(
        "trial  inside: set tilt heading up; heading: forward smoothed share; tilt: both; up: both; rows that are wider"
    )
    for trial in TRIALS:
        (path,) = folder.glob(f"{trial}_*.npz")
        configuration = broad_configuration(criterion)
        estimated = smoothing.smooth(logs.read_log(path, configuration), configuration)
        run: Any = estimated.guaranteed
        shares = [
            estimation.summarize(estimated, configuration)["inside_share_of_unconditional_rows"],
            *inside_by_question(estimated).values(),
        ]
        resting = resting_rows(run.log, configuration)
        assert resting is not None
        answers = [
            (of.sets.attitude_bounds.heading, of.vertical.tilt_bounds, of.vertical.angles) for of in (run.forward, run)
        ]
        stronger = run.sets.claims < run.forward.sets.claims
        wider, means = 0, []
        for before, after in zip(*answers, strict=True):
            both = np.isfinite(before) & np.isfinite(after)
            wider += int((both & ~stronger & (after > before + 1e-12)).sum())
            means.append([float(np.rad2deg(of[both & ~resting].mean())) for of in (before, after)])
        (heading, tilt, up) = means
        print(
            f"{trial}   {' '.join(f'{100.0 * share:8.4f}' for share in shares)}   "
            f"{heading[0]:6.1f} {heading[1]:6.1f} {heading[1] / heading[0]:6.3f}   {tilt[0]:6.2f} {tilt[1]:6.2f}   "
            f"{up[0]:6.2f} {up[1]:6.2f}   {wider}",
            flush=True,
        )


def backward_of(log: questions.Log, random: np.random.Generator) -> questions.Log:
    """What is measured of the same motion backward in time: turns have errors of their own, at their bounds."""
    true = Rotation.from_matrix(log.attitudes[::-1])
    rows = len(log.turns)
    anchors = np.array([max(10 * ((i - 1) // 10), 0) if i else -1 for i in range(rows)])
    turns, bounds = np.zeros((rows, 3)), np.zeros(rows)
    step = float(np.max(log.turn_bounds / np.maximum(np.arange(rows) - log.anchors, 1)))
    for i in range(1, rows):
        bounds[i] = step * (i - anchors[i])
        axis = random.standard_normal(3)
        error = Rotation.from_rotvec(random.choice([0.999, 0.3]) * bounds[i] * axis / np.linalg.norm(axis))
        turns[i] = (true[int(anchors[i])].inv() * true[i] * error).as_rotvec()
    return questions.Log(
        turns, bounds, anchors, log.directions[::-1], log.references, log.bounds[::-1], log.attitudes[::-1]
    )


def judge(log: questions.Log, random: np.random.Generator, criterion: Any) -> tuple[int, int, FloatArray]:
    """How many rows have bounds, how many are broken, and how near the truth comes: set, tilt, heading, angle, up."""
    passes = []
    for one in (log, backward_of(log, random)):
        attitude_filter = el.GuaranteedFilter(
            el.GuaranteedGyroFlow(0.0), criterion=criterion, vector_bound=1e-9, estimate_vector=False
        )
        times = np.arange(len(one.turns), dtype=np.float64)
        measured = {"directions": one.directions, "reference": one.references, "bounds": one.bounds}
        sets = attitude_filter.run_turns(
            times, one.turns, one.turn_bounds, anchors=one.anchors, vertical=questions.UP, **measured
        )
        caps = el.DirectionFilter().run_turns(
            one.turns, one.turn_bounds, anchors=one.anchors, directions=one.directions[:, 0], bounds=one.bounds[:, 0]
        )
        passes.append((sets, caps))
    (forward, caps), (backward, caps_backward) = passes
    run: Any = SimpleNamespace(
        sets=forward,
        starts_heading=False,
        caps=caps,
        rows=SimpleNamespace(up=questions.UP),
        vertical=vertical_of(forward, caps, questions.UP),
    )
    settings: Any = SimpleNamespace(estimates_vector=False, estimator=Estimator(mode="guaranteed", criterion=criterion))
    found = both_passes(Passes(run, turned_round(backward, forward.times), caps_turned_round(caps_backward)), settings)
    assert not len(found.disagreements)
    bounds, vertical = found.sets.attitude_bounds, found.vertical
    assert bounds is not None
    assert vertical is not None
    known = np.isfinite(bounds.tilt)
    difference = Rotation.from_matrix(log.attitudes[known] @ found.sets.attitudes[known].transpose(0, 2, 1))
    x, y, z, w = difference.as_quat(canonical=True).T
    heading = 2.0 * np.arctan2(z, w)
    shares = np.full((len(known), 5), np.nan)
    shares[:, 0] = np.sqrt(found.sets.forms(log.attitudes))
    shares[known, 1] = 2.0 * np.arcsin(np.minimum(np.hypot(x, y), 1.0)) / vertical.tilt_bounds[known]
    side = np.where(heading > 0.0, bounds.heading_to[known], bounds.heading_from[known])
    shares[known, 2] = np.where(side * heading < 0.0, np.inf, heading / side)
    shares[known, 3] = difference.magnitude() / bounds.angle[known]
    true_up = np.einsum("nji,j->ni", log.attitudes, questions.UP)
    away = np.arctan2(
        np.linalg.norm(np.cross(vertical.directions, true_up), axis=1), np.sum(vertical.directions * true_up, axis=1)
    )
    shares[:, 4] = away / vertical.angles
    return int(known.sum()), int((shares > 1.0).any(axis=1).sum()), np.fmax.reduce(shares, axis=0, initial=0.0)


def pairs(count: int, k: int, random: np.random.Generator) -> tuple[int, int, float]:
    """How many pairs have a common set, how many of these lack the common state, and the largest form."""
    truth = Rotation.random(count, rng=random).as_matrix()
    vectors = random.standard_normal((count, k - 3))
    sets = []
    for _ in range(2):
        half = random.standard_normal((count, k, k)) * 10.0 ** random.uniform(-2.0, 0.0, (count, 1, k))
        half *= 10.0 ** random.uniform(-6.0, 0.5, (count, 1, 1))
        u = random.standard_normal((count, k))
        u *= random.choice([0.99999999, 0.999, 0.3], (count, 1)) / np.linalg.norm(u, axis=1, keepdims=True)
        errors = np.einsum("nij,nj->ni", half, u)
        centers = truth @ el.cayley(0.5 * errors[:, :3]).swapaxes(1, 2)
        sets.append(StateSets(centers, vectors - errors[:, 3:], half @ half.swapaxes(1, 2)))
    found = common(sets[0], sets[1], np.eye(k) if random.integers(2) else None)
    rows = np.flatnonzero(np.isfinite(found.sets.shapes[:, 0, 0]))
    about = found.sets.take(rows)
    gibbs = 2.0 * el.cayley_inverse(el.renormalized(about.attitudes.swapaxes(1, 2) @ truth[rows]))
    y = np.concatenate([gibbs, vectors[rows] - about.vectors], axis=1)
    forms = np.einsum("ni,ni->n", y, np.linalg.solve(about.shapes, y[:, :, None])[..., 0])
    return len(rows), int((forms > 1.0).sum() + (~found.meet).sum()), float(forms.max(initial=0.0))


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--datasets", type=Path)
    parser.add_argument("--criterion", choices=["volume", "trace"], action="append")
    parser.add_argument("--logs", type=int, default=0)
    parser.add_argument("--rows", type=int, default=500)
    parser.add_argument("--pairs", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    for criterion in arguments.criterion or ("trace", "volume"):
        if arguments.datasets is not None:
            recordings(arguments.datasets / "broad", criterion)
    random = np.random.default_rng(arguments.seed)
    rows = broken = 0
    nearest = np.zeros(5)
    for i in range(arguments.logs):
        found, outside, near = judge(questions.make_log(random, arguments.rows), random, "trace" if i % 2 else "volume")
        rows, broken, nearest = rows + found, broken + outside, np.fmax(nearest, near)
    if arguments.logs:
        names = ("set", "tilt", "heading", "angle", "up")
        print(f"{rows} smoothed rows, {broken} of them broken; nearest: ", end="")
        print(", ".join(f"{name} {share:.4f}" for name, share in zip(names, nearest, strict=True)))
    for k in (3, 6):
        made = fused = outside = 0
        largest = 0.0
        while made < arguments.pairs:
            count = min(20000, arguments.pairs - made)
            of, out, form = pairs(count, k, random)
            made, fused, outside, largest = made + count, fused + of, outside + out, max(largest, form)
        if made:
            print(
                f"{made} pairs of sets of {k} numbers: {fused} common sets, {outside} wrong, largest form {largest:.6f}"
            )


if __name__ == "__main__":
    main()
