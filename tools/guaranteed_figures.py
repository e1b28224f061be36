"""Sizes of guaranteed sets against the paper's: `python tools/guaranteed_figures.py`, with `elliptude[cli]`.

Mean trace of P from the 6th update on, guaranteed over paper, on the same measurements of the scenarios `orbit` and
`pendulum`; how often the prediction was used, the worst value of the form, and the size against that of sets from the
measurements of each moment alone. The criterion is the trace, as it is the paper's.
"""

import argparse

import elliptude as el
import numpy as np
from elliptude import estimation, logs
from elliptude.configuration import Configuration
from elliptude.estimation import summary
from elliptude.simulation import scenarios
from elliptude.simulation import simulated as simulation
from elliptude.simulation.configured import configuration_tables

NOISES: tuple[simulation.Noise, ...] = ("inside", "perpendicular", "common")


def guaranteed_flow(scenario: scenarios.Scenario, potential: el.Potential, substeps: int) -> el.GuaranteedRigidBodyFlow:
    """The flow of a scenario, with a part of its step."""
    return el.GuaranteedRigidBodyFlow(el.RigidBody(scenario.inertia_matrix), potential, step=scenario.step / substeps)


def rows_of(simulated: simulation.Simulation) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Measurements from the first one on, as a filter's run takes them, and the truth beside them."""
    measured = simulated.measurements
    rows = slice(int(np.isfinite(measured.directions[:, 0, 0]).argmax()), None)
    given = {
        "times": measured.times[rows],
        "directions": measured.directions[rows],
        "reference": measured.references[rows],
        "angular_velocity": measured.angular_velocities[rows],
    }
    return given, el.rotation_from_quaternion(measured.true_quaternions[rows]), measured.true_angular_velocities[rows]


def shapes_alone(
    flow: el.GuaranteedRigidBodyFlow, given: dict[str, np.ndarray], bounds: dict[str, float], criterion: str
) -> np.ndarray:
    """What the measurements of each moment say without a prediction."""
    shapes = []
    for k, time in enumerate(given["times"]):
        alone = el.GuaranteedFilter(flow, time=time, criterion=criterion)
        row = {key: values[k : k + 1] for key, values in given.items()}
        shapes.append(alone.run(**row, **bounds).shapes[0])
    return np.array(shapes)


def table(name: str, seeds: int, criterion: str, substeps: int, only: list[str] | None) -> None:
    """One scenario, all of its directions and bounds."""
    scenario = scenarios.load(name)
    truth = simulation.truth(scenario)
    settings = Configuration.model_validate(configuration_tables(scenario, simulation.measure(scenario, truth)))
    potential = settings.flow.build().potential
    flow = guaranteed_flow(scenario, potential, substeps)
    settled = slice(summary.SETTLED_UPDATE - 1, None)
    print(f"\n{name}, {seeds} seeds, criterion {criterion}; mean trace of P, guaranteed over paper")
    print(
        f"{'directions, bound':<20}{'noise':<15}{'ratio':>8}{'scatter':>9}"
        f"{'alone':>7}{'used':>7}{'no set':>8}{'worst form':>12}"
    )
    for directions in only or scenario.directions:
        for bound in scenario.bound_deg:
            for noise in NOISES:
                ratios, alone, used, updates, unknown, worst = [], [], 0, 0, 0, 0.0
                guaranteed_sum = paper_sum = 0.0
                for seed in range(seeds):
                    simulated = simulation.measure(
                        scenario, truth, seed=seed, directions=directions, bound_deg=bound, noise=noise
                    )
                    given, attitudes, rates = rows_of(simulated)
                    bounds = {"bounds": simulated.direction_bound, "rate_bound": simulated.rate_bound}
                    guaranteed = el.GuaranteedFilter(flow, time=given["times"][0], criterion=criterion)
                    log = guaranteed.run(**given, **bounds)
                    forms = log.forms(attitudes, rates)
                    single = shapes_alone(flow, given, bounds, criterion)
                    tables = configuration_tables(scenario, simulated)
                    tables["estimator"] = {"mode": "paper", "when_sets_do_not_meet": "skip"}
                    paper = estimation.estimate(
                        logs.log_of(simulated.measurements), Configuration.model_validate(tables)
                    ).result
                    traces = np.trace(log.shapes, axis1=1, axis2=2)[settled]
                    paper_traces = np.trace(paper.shapes, axis1=1, axis2=2)[-len(log.shapes) :][settled]
                    guaranteed_sum += np.nansum(traces)
                    paper_sum += np.nansum(paper_traces)
                    ratios.append(np.nanmean(traces) / np.nanmean(paper_traces))
                    alone.append(np.nanmean(traces) / np.nanmean(np.trace(single, axis1=1, axis2=2)[settled]))
                    used += int(log.prediction_used[1:].sum())
                    updates += len(log.shapes) - 1
                    unknown += int(np.isnan(log.shapes[:, 0, 0]).sum())
                    worst = max(worst, float(np.nanmax(forms)))
                scatter = np.std(ratios) / np.sqrt(len(ratios))
                print(
                    f"{directions + f', {bound:g}°':<20}{noise:<15}{guaranteed_sum / paper_sum:>8.3g}{scatter:>9.2g}"
                    f"{np.mean(alone):>7.2g}{100 * used / updates:>6.0f}%{unknown:>8}{worst:>12.6f}",
                    flush=True,
                )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--criterion", choices=["trace", "volume"], default="trace")
    parser.add_argument("--substeps", type=int, default=1, help="guaranteed steps in each step of the scenario")
    parser.add_argument("--directions", choices=["two", "three", "five"], action="append")
    parser.add_argument("--scenario", choices=["orbit", "pendulum"], action="append")
    given = parser.parse_args()
    for one_scenario in given.scenario or ["orbit", "pendulum"]:
        table(one_scenario, given.seeds, given.criterion, given.substeps, given.directions)
