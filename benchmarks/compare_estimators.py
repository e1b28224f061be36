"""How often the truth is in the set of each estimator, and how large the sets are, on the same data.

    python benchmarks/compare_estimators.py --picture docs/images/estimators.png

Trials are those of `elliptude validate`. Against the modes of elliptude stands a multiplicative extended Kalman filter
that is told that each bound is three standard deviations of each component of a white noise. Its region is taken twice:
the one that holds 99.73 % of a normal distribution in six dimensions, xᵀP⁻¹x ≤ 20.06, and the ellipsoid of three
standard deviations, xᵀP⁻¹x ≤ 9, which holds 83 % of it.
"""

import argparse
import dataclasses
from pathlib import Path
from typing import Any

import elliptude as el
import numpy as np
from elliptude import _core
from elliptude.estimation.best.multiplicative_filter import MultiplicativeFilter
from elliptude.report import figures
from elliptude.typing import FloatArray
from elliptude.validation import adversary, filter_runs, judge, plants, tally
from elliptude.validation.adversary import Case, Measured, Plant, Starts
from elliptude.validation.filter_runs import Runs
from elliptude.validation.plants import GyroPlant, RigidBodyPlant
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.stats import chi2

UPDATES = 20
NOISES: tuple[adversary.Noise, ...] = ("inside", "perpendicular", "common", "alternating")
DEVIATIONS = 3.0
REGIONS = {"MEKF 99.73 %": float(chi2.ppf(chi2.cdf(9.0, 1), 6)), "MEKF 3σ": 9.0}
COLOURS = {
    "paper": "#E69F00",
    "first_order": figures.ORANGE,
    "MEKF 3σ": "#56B4E9",
    "MEKF 99.73 %": figures.BLUE,
    "guaranteed": "#009E73",
}


def kalman(of: Plant, starts: Starts, measured: Measured) -> Runs:
    """The multiplicative filter's estimates and covariances, from the sets that the other estimators begin with."""
    count, rows = measured.rates.shape[:2]
    deviation = of.bound / DEVIATIONS
    runs = Runs(
        attitudes=np.empty((count, rows - 1, 3, 3)),
        vectors=np.empty((count, rows - 1, 3)),
        shapes=np.empty((count, rows - 1, 6, 6)),
        used=np.ones((count, rows - 1), bool),
        claims=np.full((count, rows - 1), filter_runs.HOLDS, np.uint8),
        answers=np.empty((count, rows - 1, 0)),
    )
    if isinstance(of, GyroPlant):
        estimates = MultiplicativeFilter(starts.attitudes, starts.vectors, starts.shapes / DEVIATIONS**2)
    else:
        estimates = from_measurement(measured.directions[:, 1], of.reference, deviation, measured.rates[:, 1])
    weights = np.full(measured.directions.shape[2], deviation**-2)
    for row in range(1, rows):
        directions, rates = measured.directions[:, row], measured.rates[:, row]
        if isinstance(of, GyroPlant):
            noise = of.bound + 0.5 * of.interval * (of.angular_acceleration + of.drift)
            estimates.predict_gyro(measured.rates[:, row - 1], of.interval, noise / DEVIATIONS, of.drift / DEVIATIONS)
            estimates.update(directions, of.reference, weights)
        elif isinstance(of, RigidBodyPlant) and row > 1:
            flow, steps = of.flow(), of.scenario.steps_between_measurements
            integrator = _core.Integrator(
                flow.body, flow.potential, step=of.interval / steps, order=of.scenario.integrator_order
            )
            estimates.predict_rigid_body(integrator, steps, (row - 1) * of.interval)
            estimates.update(directions, of.reference, weights, rates, np.eye(3) / deviation**2)
        runs.attitudes[:, row - 1] = estimates.attitude
        runs.vectors[:, row - 1] = estimates.vector
        runs.shapes[:, row - 1] = estimates.covariance
    return runs


def from_measurement(
    directions: FloatArray, reference: FloatArray, deviation: float, rate: FloatArray
) -> MultiplicativeFilter:
    """Begin with what two or more directions (N, m, 3) and a rate (N, 3) say: Wahba's attitude and its covariance.

    The deviation is that of a direction about each axis across it (rad), and of each component of the rate (rad/s).
    """
    attitude = el.wahba(np.broadcast_to(reference, directions.shape), directions).attitude
    information = np.sum(np.eye(3) - directions[..., :, None] * directions[..., None, :], axis=1)
    covariance = np.zeros((len(rate), 6, 6))
    covariance[:, :3, :3] = deviation**2 * np.linalg.inv(information)
    covariance[:, 3:, 3:] = deviation**2 * np.eye(3)
    return MultiplicativeFilter(attitude, rate.copy(), covariance)


def compare(case: Case, trials: int, seed: int) -> dict[str, dict[str, float]]:
    """Share of the updates with the truth outside, and mean sizes, of each estimator in one case."""
    of, draws = plants.plant(case), np.random.default_rng(np.random.SeedSequence(seed))
    starts = adversary.draw_starts(of, trials, draws)
    # All begin with the first measurement, but where there is a bias that it says nothing of.
    starts = dataclasses.replace(starts, from_measurement=np.full(trials, not of.has_gyro))
    errors = adversary.draw_errors(of, case.noise, starts, UPDATES, draws)
    motion = of.motion(starts, errors)
    measured = adversary.measure(of, motion, errors)
    found = {}
    modes: list[judge.Mode] = ["paper", "first_order"]
    if hasattr(el, "GuaranteedFilter"):
        modes.append("guaranteed")
    for mode in modes:
        runs = filter_runs.run(of, mode, starts, measured)
        found[mode] = _figures(mode, runs, filter_runs.forms(mode, runs, motion))
    covariances = kalman(of, starts, measured)
    values = filter_runs.forms("first_order", covariances, motion)
    for name, level in REGIONS.items():
        region = dataclasses.replace(covariances, shapes=level * covariances.shapes)
        found[name] = _figures("first_order", region, values / level)
    return found


def _figures(mode: judge.Mode, runs: Runs, values: Any) -> dict[str, float]:
    trace, radius, angle = np.nanmean(judge.sizes(mode, runs.shapes[:, tally.SETTLED_UPDATE - 1 :]), axis=(0, 1))
    return {
        "outside": 100.0 * float(np.mean(~(values <= 1.0) & (runs.claims != filter_runs.WITHOUT_SET))),
        "worst": float(np.nanmax(values)),
        "trace": float(trace),
        "radius": float(radius),
        "angle": float(np.rad2deg(angle)),
    }


def picture(results: dict[Case, dict[str, dict[str, float]]], shown: list[tuple[str, str, float]]) -> Figure:
    """Bars for some cases (scenario, directions, bound), a column each."""
    figure = Figure(figsize=(10.0, 6.4), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(2, len(shown), sharex=True, sharey="row", squeeze=False)
    for column, (scenario, directions, bound) in enumerate(shown):
        of_noise = [results[Case(scenario, directions, bound, noise)] for noise in NOISES]
        estimators = [name for name in COLOURS if name in of_noise[0]]
        width = 0.84 / len(estimators)
        outside, size = panels[0][column], panels[1][column]
        for k, name in enumerate(estimators):
            at = np.arange(len(NOISES)) + width * (k - 0.5 * (len(estimators) - 1))
            shares = [found[name]["outside"] for found in of_noise]
            outside.bar(at, shares, width, color=COLOURS[name], label=name.replace("_", " "))
            size.bar(at, [found[name]["angle"] for found in of_noise], width, color=COLOURS[name])
            for x, share in zip(at, shares, strict=True):
                label = "0" if share == 0.0 else f"{share:.2g}"
                outside.annotate(
                    label, (x, share), xytext=(0, 1), textcoords="offset points", ha="center", va="bottom", fontsize=6.5
                )
        outside.set_title(f"{scenario}, {directions} directions within {bound:g}°", fontsize=10)
        size.set_xticks(range(len(NOISES)), NOISES)
        size.set_xlabel("errors")
    panels[0][0].set_ylabel("truth outside the set (% of updates)")
    panels[1][0].set_ylabel("mean largest angle in the set (deg)")
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(handles), frameon=False)
    return figure


def main() -> None:
    """Print the table and, if asked for, draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=200, help=f"of {UPDATES} updates, in each case")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--picture", type=Path, help="PNG to write")
    arguments = parser.parse_args()
    results = {}
    print(f"{arguments.trials} trials of {UPDATES} updates a case; sizes from update {tally.SETTLED_UPDATE} on")
    print("scenario  dirs   bound  errors        estimator     outside   worst form     trace    radius  largest angle")
    for scenario in ("orbit", "pendulum", "free", "gyro"):
        for directions in ("two", "three"):
            for bound in (1.0, 7.0):
                for noise in NOISES:
                    case = Case(scenario, directions, bound, noise)
                    results[case] = compare(case, arguments.trials, arguments.seed)
                    for name, found in results[case].items():
                        print(
                            f"{scenario:<10}{directions:<7}{bound:>4g}°  {noise:<14}{name:<13}"
                            f"{found['outside']:>7.2f} %{found['worst']:>13.4g}{found['trace']:>10.3g}"
                            f"{found['radius']:>10.3g}{found['angle']:>14.2f}°"
                        )
    if arguments.picture is not None:
        shown = [("orbit", "three", 7.0), ("gyro", "three", 7.0)]
        figures.save(picture(results, shown), arguments.picture)


if __name__ == "__main__":
    main()
