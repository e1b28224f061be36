"""Stands in for the guaranteed mode where the harness is tested, not the estimator.

Its sets are those of the first order, scaled; so a test knows what the harness has to find.
"""

from dataclasses import replace

import elliptude as el
import numpy as np
from elliptude.results import GuaranteedLog


class Flow:
    def __init__(self, *arguments, **options):
        self.options = options
        if "step" in options:
            body, potential = arguments
            self.flow = el.RigidBodyFlow(
                body, potential, step=options["step"], order=4, unknown_torque=options["unknown_torque"]
            )
        else:
            change = 0.05 * (options["angular_acceleration"] + options["drift"])
            self.flow = el.GyroFlow(options["noise"] + change, options["drift"])


class Filter:
    """Mode first_order with its sets scaled, in the Gibbs chart as if there were no other."""

    scale = 9.0
    claim = "unconditional"

    def __init__(self, flow, start=None, *, time=0.0, policy="raise"):
        self.flow, self.start, self.time, self.policy = flow.flow, start, time, policy

    def run(self, times, *, directions, reference, bounds, vertical=None, **rates):
        start, first = self.start, 0
        if start is None:
            first = next(i for i in range(len(times)) if np.isfinite(directions[i]).all())
            start = el.measured_state(
                directions[first], reference, bounds, rates["angular_velocity"][first], rates["rate_bound"]
            )
            directions, rates = directions.copy(), dict(rates, angular_velocity=rates["angular_velocity"].copy())
            directions[: first + 1] = rates["angular_velocity"][: first + 1] = np.nan
        log = el.AttitudeFilter(self.flow, start, time=times[0] if self.start is None else self.time).run(
            times, directions=directions, reference=reference, bounds=bounds, on_inconsistent="skip", **rates
        )
        found = GuaranteedLog(
            times=times,
            attitudes=log.attitudes,
            vectors=log.vectors,
            shapes=self.scale * log.shapes,
            claims=np.full(len(times), self.claim),
            prediction_used=log.shares > 0.0,
            updated=np.ones(len(times), bool),
            dropped=log.used[:, :0],
            margins=log.margins,
        )
        angle = found.extents().largest_angles  # answers all questions of the attitude
        return replace(found, question_bounds=np.column_stack([angle, -angle, angle, angle]))


def install(monkeypatch, **settings):
    """Put it where `elliptude` has, or will have, its own."""
    monkeypatch.setattr(el, "GuaranteedFilter", type("Filter", (Filter,), settings), raising=False)
    monkeypatch.setattr(el, "GuaranteedRigidBodyFlow", Flow, raising=False)
    monkeypatch.setattr(el, "GuaranteedGyroFlow", Flow, raising=False)
