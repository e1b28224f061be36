"""A pass of the guaranteed filter backward in time, as a pass over a mirrored log: theory, section 20.1.

With the time s = −t attitudes stay as they are and angular velocities change their sign. What else changes its sign or
its row is said here, and nowhere else.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

import elliptude
from elliptude._potentials import backward, names
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.motion import GyroFlow
from elliptude.estimation import gaps
from elliptude.estimation.direction_rows import DirectionRows
from elliptude.estimation.given.filter_input import FilterInput, turns_of
from elliptude.estimation.guaranteed_run import GuaranteedRun
from elliptude.estimation.vertical import Turns
from elliptude.results import DirectionLog, GuaranteedLog
from elliptude.typing import FloatArray, TorqueLike

_SIGNS = np.array([1.0, 1.0, 1.0, -1.0, -1.0, -1.0])


@dataclass(frozen=True, eq=False)
class Mirrored:
    """A run's input backward in time."""

    given: FilterInput
    rows: DirectionRows
    turns: Turns | None
    """Each row's turn from a later one, as `turns_of`."""


def mirrored(run: GuaranteedRun, configuration: Configuration) -> Mirrored:
    """What the filter was given in a run, backward in time, (20.1) to (20.3).

    Parameters
    ----------
    run : GuaranteedRun
    configuration : Configuration

    Returns
    -------
    Mirrored

    Raises
    ------
    ValueError
        If the motion cannot be mirrored: a potential of which nothing is stated.
    """
    given, rows = run.given, run.rows
    measured = dict(given.measured)
    for name in ("directions", "reference", "bounds"):
        if name in measured:
            measured[name] = measured[name][::-1]
    if "angular_velocity" in measured:
        measured["angular_velocity"] = -measured["angular_velocity"][::-1]
    motion = {}
    if "gyro" in given.motion:
        # A step's rate stands in the row where the step begins; no step begins at the last.
        motion["gyro"] = -np.roll(given.motion["gyro"][::-1], -1, axis=0)
    if "control_torque" in given.motion:
        # This stands in the row where the step ends.
        motion["control_torque"] = np.roll(given.motion["control_torque"][::-1], 1, axis=0)
    if "wheel_momentum" in given.motion:
        motion["wheel_momentum"] = -np.roll(given.motion["wheel_momentum"][::-1], 1, axis=0)
    turns = _mirrored_turns(run, configuration)
    return Mirrored(
        given=replace(
            given,
            times=-given.times[::-1],
            flow=mirrored_flow(given.flow),
            motion=motion,
            measured=measured,
            turns=None if given.turns is None else turns,
        ),
        rows=replace(
            rows, directions=rows.directions[::-1], references=rows.references[::-1], angles=rows.angles[::-1]
        ),
        turns=turns,
    )


def _mirrored_turns(run: GuaranteedRun, configuration: Configuration) -> Turns | None:
    log = run.log
    if log.rates is None or not isinstance(configuration.flow, GyroFlow):
        return None
    log = gaps.without_rates_in_gaps(log, gaps.longest_interval(log, configuration))
    assert log.rates is not None
    # What is known of the bias is subtracted there; its sign changes as the rate's does.
    rows = replace(run.rows, bias=-run.rows.bias, angles=run.rows.angles[::-1])
    return turns_of(-log.times[::-1], -log.rates[::-1], configuration, rows, (log.times - log.times[0])[::-1])


def mirrored_flow(
    flow: elliptude.GuaranteedRigidBodyFlow | elliptude.GuaranteedGyroFlow,
) -> elliptude.GuaranteedRigidBodyFlow | elliptude.GuaranteedGyroFlow:
    """A flow backward in time, (20.1) to (20.3).

    Parameters
    ----------
    flow : GuaranteedRigidBodyFlow or GuaranteedGyroFlow

    Returns
    -------
    GuaranteedRigidBodyFlow or GuaranteedGyroFlow

    Raises
    ------
    ValueError
        If nothing is stated of a potential.
    """
    if isinstance(flow, elliptude.GuaranteedRigidBodyFlow):
        return elliptude.GuaranteedRigidBodyFlow(
            flow.body,
            mirrored_potential(flow.potential),
            step=flow.step,
            unknown_torque=flow.unknown_torque if np.any(flow.unknown_torque) else None,
            inertia_error=flow.inertia_error,
            most_steps=flow.most_steps,
        )
    other_end = {"first_sample": "last_sample", "last_sample": "first_sample"}
    return elliptude.GuaranteedGyroFlow(
        flow.noise,
        flow.drift,
        scale=flow.scale,
        angular_acceleration=flow.angular_acceleration,
        interval_rate=other_end.get(flow.interval_rate, flow.interval_rate),
        longest_interval=flow.longest_interval,
        largest_rate=flow.largest_rate,
    )


def mirrored_potential(potential: elliptude.Potential) -> elliptude.Potential:
    """The potential at the time −t.

    Parameters
    ----------
    potential : Potential

    Returns
    -------
    Potential

    Raises
    ------
    ValueError
        If nothing is stated of it.
    """
    if (found := backward(potential)) is not None:
        return found
    if isinstance(potential, elliptude.StatedTorque):
        return elliptude.StatedTorque(
            _Backward(potential.stated), rate=potential.rate, error=potential.error, curvature=potential.curvature
        )
    if isinstance(potential, elliptude.SumPotential):
        parts = [one for one in potential.potentials if isinstance(one, elliptude.Potential)]
        if len(parts) == len(potential.potentials):
            return elliptude.SumPotential([mirrored_potential(one) for one in parts])
    raise ValueError(
        f"smoothing goes backward in time, and {type(potential).__name__} does not say what its torque is then; "
        f"{names()}, StatedTorque and their sums do"
    )


@dataclass(frozen=True)
class _Backward:
    """A torque by functions at the time −t: what is stated of it says the same of both directions of time."""

    forward: elliptude.Potential | TorqueLike

    def torque(self, attitude: FloatArray, time: float) -> ArrayLike:
        return self.forward.torque(attitude, -time)

    def torque_jacobian(self, attitude: FloatArray, time: float) -> ArrayLike:
        return self.forward.torque_jacobian(attitude, -time)


def mirrored_set(found: GuaranteedLog, row: int, estimates_vector: bool) -> elliptude.StateEllipsoid | None:
    """A row's set as the start of a pass in the other direction of time; None if there is none."""
    shape = found.shapes[row]
    if not np.isfinite(shape).all():
        return None
    vector = -found.vectors[row] if estimates_vector else np.zeros(3)
    return elliptude.StateEllipsoid(found.attitudes[row], vector, shape * np.outer(_SIGNS, _SIGNS), chart="gibbs")


def turned_round(found: GuaranteedLog, times: FloatArray) -> GuaranteedLog:
    """The sets of a pass over a mirrored log, in the order and with the signs of the log itself."""
    return GuaranteedLog(
        times=times,
        attitudes=found.attitudes[::-1],
        vectors=-found.vectors[::-1],
        shapes=found.shapes[::-1] * np.outer(_SIGNS, _SIGNS),
        claims=found.claims[::-1],
        prediction_used=found.prediction_used[::-1],
        updated=found.updated[::-1],
        dropped=found.dropped[::-1],
        margins=found.margins[::-1],
        question_bounds=None if found.question_bounds is None else found.question_bounds[::-1],
    )


def caps_turned_round(found: DirectionLog) -> DirectionLog:
    """Caps of a pass over a mirrored log, in the order of the log itself: a direction has no sign to change."""
    return DirectionLog(found.directions[::-1], found.angles[::-1], found.claims[::-1], found.dropped[::-1])
