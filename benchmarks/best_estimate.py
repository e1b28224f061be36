"""The best estimate beside the guaranteed set: how good it is, and how far it may be off.

    python benchmarks/best_estimate.py --datasets ../shared/datasets
    python benchmarks/best_estimate.py --of kalman

The first is of real recordings, BROAD: a sensor in the hand, bounds by the rule `hand_held` as it stands. The best
estimate is VQF's (the extra `best`), put back into the set where it leaves it. Beside it are VQF as it comes, from the
same samples, and the center of the set. The optical attitude says how far each is off, within 0.5°; an error above its
guaranteed bound by more than that would be a broken promise.

The second is of the Kalman filter, which has the logs of other sensors: the scenarios of `elliptude simulate`, the gyro
and the disturbed body of `elliptude validate`, and Fermi's recording. Errors are uniform within the bounds (`inside`),
on their spheres (`perpendicular`, `common`, `alternating`), or the same in every row (`constant`). Means are over rows
where the filter has an estimate; beside the best stands the filter alone, before it is drawn to the center.
"""

import argparse
import dataclasses
import math
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from elliptude import estimation, logs
from elliptude.configuration import Configuration
from elliptude.estimation.best.choice import best_estimate
from elliptude.estimation.best.kalman import kalman_log
from elliptude.estimation.guaranteed_run import run_guaranteed
from elliptude.logs.log import Log, log_of
from elliptude.logs.reference_attitudes import Reference, read_reference
from elliptude.simulation import fermi, scenarios, simulated
from elliptude.simulation.configured import configuration_tables
from elliptude.smoothing.smoother import smoothed_run
from elliptude.typing import FloatArray
from elliptude.validation import adversary, plants
from elliptude.validation.adversary import Case, Errors, Noise
from elliptude.validation.plants import GyroPlant, RigidBodyPlant
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
    truth: Reference = read_reference(path, configuration, origin=0)
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


# --- the Kalman filter ------------------------------------------------------------------------------------------------

UPDATES = 60
"""Updates of a trial of gyro or disturbed body."""
KINDS: dict[str, tuple[str, ...]] = {
    "orbit": ("inside", "perpendicular", "common"),
    "pendulum": ("inside", "perpendicular", "common"),
    "free": ("inside", "perpendicular", "common"),
    "gyro": ("inside", "perpendicular", "common", "alternating", "constant"),
    "disturbed": ("inside", "perpendicular", "common", "alternating", "constant"),
}
LoggedRun = tuple[Log, Configuration]


def of_scenario(name: str, directions: str, bound_deg: float, noise: Any, seeds: int) -> Iterator[LoggedRun]:
    """Measurements of a scenario of `elliptude simulate`, and the configuration of the guaranteed mode for them."""
    scenario = scenarios.load(name)
    truth = simulated.truth(scenario)
    for seed in range(seeds):
        made = simulated.measure(scenario, truth, seed=seed, directions=directions, bound_deg=bound_deg, noise=noise)
        tables = configuration_tables(scenario, made) | {"estimator": {"mode": "guaranteed"}}
        if scenario.estimate0.attitude == "first measurement":
            del tables["start"]  # the guaranteed mode begins so by itself
        yield log_of(made.measurements), Configuration.model_validate(tables)


def of_trials(name: str, directions: str, bound_deg: float, noise: str, trials: int) -> Iterator[LoggedRun]:
    """Trials of `elliptude validate`: a gyro whose rate changes slowly, or a body under an unknown torque."""
    kind: Noise = "inside" if noise == "constant" else noise  # type: ignore[assignment]
    of = plants.plant(Case(name, directions, bound_deg, kind))
    if isinstance(of, GyroPlant):
        of = dataclasses.replace(of, angular_acceleration=0.02)
    draws = np.random.default_rng(0)
    starts = adversary.draw_starts(of, trials, draws)
    errors = adversary.draw_errors(of, kind, starts, UPDATES, draws)
    if noise == "constant":
        first = {
            part: np.repeat(getattr(errors, part)[:, :1], UPDATES, 1) for part in ("directions", "rates", "inputs")
        }
        errors = Errors(**first, start=errors.start)
    motion = of.motion(starts, errors)
    measured = adversary.measure(of, motion, errors)
    for i in range(trials):
        tables = _configured(of)
        if not starts.from_measurement[i]:
            attitude = Rotation.from_matrix(starts.attitudes[i]).as_quat(scalar_first=True)
            tables["start"] = {
                "kind": "given",
                "attitude_qw_qx_qy_qz": attitude.tolist(),
                "rate_rad_per_s": starts.vectors[i].tolist(),
                "P": starts.shapes[i].tolist(),
            }
        times = of.interval * np.arange(UPDATES + 1)
        references = np.tile(of.reference, (len(times), 1, 1))
        log = Log(times, measured.directions[i], references, measured.rates[i], true_attitudes=motion.attitudes[i])
        yield log, Configuration.model_validate(tables)


def _configured(of: GyroPlant | RigidBodyPlant) -> dict[str, Any]:
    """What the filter is told, as a configuration; of the bias three times what the first set says."""
    degrees, columns = math.degrees(of.bound), ["x", "y", "z"]
    tables: dict[str, Any] = {
        "directions": [
            {"name": f"d{i}", "columns": [f"a{i}", f"b{i}", f"c{i}"], "reference": one.tolist(), "bound_deg": degrees}
            for i, one in enumerate(of.reference)
        ],
        "estimator": {"mode": "guaranteed", "best": "kalman"},
    }
    if isinstance(of, GyroPlant):
        flow = {"interval_rate": "first_sample", "noise_deg_per_s": math.degrees(of.noise), "estimate_bias": True}
        flow |= {"bias_deg_per_s": 3.0 * degrees, "drift_deg_per_s2": math.degrees(of.drift), "columns": columns}
        flow |= {"angular_acceleration_deg_per_s2": math.degrees(of.angular_acceleration)}
        return tables | {"flow": {"kind": "gyro"} | flow}
    scenario = of.scenario
    flow = {"inertia_kg_m2": scenario.inertia, "step_s": scenario.step, "unknown_torque_n_m": of.unknown_torque}
    flow |= {"potential": scenario.potential.configured().model_dump(), "order": scenario.integrator_order}
    return tables | {
        "flow": {"kind": "rigid_body"} | flow,
        "rate": {"columns": columns, "bound_deg_per_s": math.degrees(of.rate_bound)},
    }


def of_fermi(star_until: int | None) -> Iterator[LoggedRun]:
    """An hour of Fermi's telemetry; the star is measured in so many rows only."""
    tables = fermi.configuration().model_dump(mode="json", exclude_unset=True)
    tables["estimator"] = {"mode": "guaranteed", "best": "kalman"}
    del tables["start"]
    made = fermi.measurements(fermi.telemetry(), star_until=star_until)
    yield log_of(made), Configuration.model_validate(tables)


def figures(made: Iterable[LoggedRun], smooth: bool) -> str:
    """Of some logs: errors of center, filter alone and best; bounds of center and best; what it costs."""
    rows: list[FloatArray] = []
    put_back = count = 0
    spent = np.zeros(2)
    for log, configuration in made:
        begin = time.perf_counter()
        run = (smoothed_run if smooth else run_guaranteed)(log, configuration)
        spent[0] += time.perf_counter() - begin
        begin = time.perf_counter()
        best = best_estimate(run, configuration)
        spent[1] += time.perf_counter() - begin
        assert best is not None
        assert best.estimator == "kalman"
        assert log.true_attitudes is not None
        there, count = best.is_estimated, count + len(log.times)
        true = Rotation.from_matrix(log.true_attitudes[there])
        alone = Rotation.from_matrix(kalman_log(run.forward or run, configuration).attitudes[there])
        found = [errors_deg(q, true)[:, 0] for q in (_of(run.sets.attitudes[there]), _of(alone.as_matrix()))]
        found += [errors_deg(best.quaternions[there], true)[:, 0], np.rad2deg(best.errors.bounds[there, 0])]
        rows.append(np.column_stack([*found, np.rad2deg(run.sets.extents().largest_angles[there])]))
        put_back += int(best.put_back.sum())
    every = np.concatenate(rows)
    center, alone_error, error, bound, of_center = every.mean(axis=0)
    broken = int((every[:, 2] > every[:, 3] + 1e-9).sum())
    run_us, best_us = 1e6 * spent / count
    return (
        f"{center:8.4f} {alone_error:8.4f} {error:8.4f} {error / center:7.2f} | {of_center:7.3f} {bound:7.3f} | "
        f"{put_back:5d} {broken:5d} | {run_us:5.0f} {best_us:5.0f}"
    )


def _of(attitudes: FloatArray) -> FloatArray:
    quaternions: FloatArray = Rotation.from_matrix(attitudes).as_quat(scalar_first=True)
    return quaternions


def print_kalman(seeds: int, smooth: bool) -> None:
    """The table of the Kalman filter."""
    print("mean errors in degrees; bounds: means of the largest angle, degrees; µs a row")
    print(
        "scenario  dirs   bound errors        |  center   filter     best best/center | center  best | back broken | µs"
    )
    for name, kinds in KINDS.items():
        made = of_scenario if name in scenarios.names() else of_trials
        for directions in ("two", "three"):
            for bound in (7.0, 0.1):
                for kind in kinds:
                    line = figures(made(name, directions, bound, kind, seeds), smooth)
                    print(f"{name:<10}{directions:<7}{bound:<6g}{kind:<14}| {line}", flush=True)
    for until in (None, 600):
        print(f"fermi, star in {'all' if until is None else until} rows | {figures(of_fermi(until), smooth)}")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--datasets", type=Path, default=Path("../shared/datasets"), help="the recordings' folder")
    parser.add_argument("--criterion", nargs="+", default=["trace", "volume"], help="what the filter makes small")
    parser.add_argument("--trials", nargs="+", default=TRIALS, help="which excerpts")
    parser.add_argument("--of", choices=["vqf", "kalman"], default="vqf", help="whose estimate")
    parser.add_argument("--seeds", type=int, default=20, help="of each case of the Kalman filter")
    parser.add_argument("--smooth", action="store_true", help="the Kalman filter's with sets of the whole recording")
    arguments = parser.parse_args()
    if arguments.of == "kalman":
        print_kalman(arguments.seeds, arguments.smooth)
        return
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
