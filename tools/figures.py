"""Figures of the first-order modes, as a table: `python tools/figures.py`, in an environment with `elliptude[cli]`.

How often the truth is inside over many seeds of the scenarios, and how far the image of a predicted set's boundary
leaves the set that the linearization predicts.
"""

import argparse

import elliptude as el
import numpy as np
from elliptude import estimation, logs, simulation
from elliptude.configuration import Configuration
from elliptude.estimation import summary
from elliptude.simulation import scenarios
from elliptude.simulation.configured import configuration_tables


def scenario_figures(seeds: int) -> None:
    """Errors, shares inside and empty intersections of scenarios, noises and modes."""
    print(f"{seeds} seeds; error and bound are means from the {summary.SETTLED_UPDATE}th update on")
    print("scenario directions  bound noise         mode          error     set   inside  empty")
    for name in ("orbit", "pendulum"):
        scenario = scenarios.load(name)
        truth = simulation.truth(scenario)
        for directions in ("three", "two"):
            for bound in (7.0, 1.0):
                for noise in ("inside", "perpendicular", "common"):
                    measured = [
                        simulation.measure(
                            scenario, truth, seed=seed, directions=directions, bound_deg=bound, noise=noise
                        )
                        for seed in range(seeds)
                    ]
                    for mode in ("paper", "first_order"):
                        _print_case(scenario, measured, f"{name:<9}{directions:<11}{bound:>5g}° {noise:<14}", mode)


def _print_case(scenario: scenarios.Scenario, measured: list[simulation.Simulation], case: str, mode: str) -> None:
    errors, angles, forms, empty = [], [], [], 0
    for simulated in measured:
        tables = configuration_tables(scenario, simulated)
        tables["estimator"] = {"mode": mode, "when_sets_do_not_meet": "skip"}
        results = estimation.estimate(logs.log_of(simulated.measurements), Configuration.model_validate(tables)).result
        assert results.errors is not None
        assert results.forms is not None
        updated = np.flatnonzero([bool(used) for used in results.used])
        settled = updated[summary.SETTLED_UPDATE - 1 :]
        errors.append(np.linalg.norm(results.errors[settled, :3], axis=1))
        angles.append(results.largest_angles[settled])
        forms.append(results.forms[updated])
        empty += sum(bool(refused) for refused in results.refused)
    error, angle = (np.rad2deg(np.concatenate(values).mean()) for values in (errors, angles))
    inside = 100 * np.mean(np.concatenate(forms) <= 1)
    print(f"{case}{mode:<12}{error:>6.2f}°{angle:>7.2f}°{inside:>8.2f}%{empty:>7}")


def prediction_figures(samples: int) -> None:
    """The image of the boundary of a set under the flow, in the set that the linearization predicts.

    Scenario `orbit`, steps of order 4; a ball of the given radius in attitude and, per unit of time, in rate.
    """
    body = el.RigidBody([1.0, 2.8, 2.0])
    potential = el.GravityGradient(body, 1.0)
    step = 2 * np.pi / 300
    attitude, rate = el.exp([np.deg2rad(105.0), 0, 0]), np.array([2.316, 0.446, -0.591])
    direction = np.random.default_rng(0).standard_normal((samples, 6))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    print(f"{'radius':>7}{'steps':>7}{'largest form':>14}{'share outside':>15}   ({samples} points of the boundary)")
    for radius in (7.0, 1.0, 0.1):
        errors = np.deg2rad(radius) * direction
        for steps in (1, 10, 100):
            center = el.Integrator(body, potential, step=step, order=4).linearize(attitude, rate, steps=steps)
            image = el.Integrator(body, potential, step=step, order=4).linearize(
                attitude @ el.exp(errors[:, :3]), rate + errors[:, 3:], steps=steps
            )
            shape = np.deg2rad(radius) ** 2 * center.state @ center.state.T
            predicted = el.StateEllipsoid(center.attitude, center.angular_velocity, (shape + shape.T) / 2)
            forms = predicted.quadratic_form(image.attitude, image.angular_velocity)
            print(f"{radius:>6g}°{steps:>7}{forms.max():>14.4f}{100 * np.mean(forms > 1):>14.1f}%")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--samples", type=int, default=20000)
    arguments = parser.parse_args()
    prediction_figures(arguments.samples)
    print()
    scenario_figures(arguments.seeds)
