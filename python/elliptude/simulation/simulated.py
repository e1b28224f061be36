"""Simulated measurements: a true motion and bounded errors.

The motion solves the continuous equations, by an integrator that is not the filter's and with torques that are not
the core's, so that no estimate is judged by its own model. Errors are as in the paper: b = exp(S(ν)) b̃, ω = ω̃ + v,
where b and ω are true, b̃ and ω̃ measured, all in body axes.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, TypeAlias, assert_never, get_args

import numpy as np
import scipy

from elliptude.io.tables import Measurements, quaternions_from_attitudes
from elliptude.simulation.potentials import cross
from elliptude.simulation.scenarios import Scenario
from elliptude.typing import FloatArray

Noise: TypeAlias = Literal["inside", "perpendicular", "common"]
"""How errors are drawn.

``inside``: ν of each direction uniform in the ball of the bound, v uniform in its ball.
``perpendicular``: ν of each direction perpendicular to it, of random azimuth and as long as the bound; v on its sphere.
``common``: one ν on the sphere of the bound, shared by all directions of a time; v on its sphere.
"""
NOISES: tuple[Noise, ...] = get_args(Noise)

# Tolerance of DOP853, relative and absolute.
_TOLERANCE = 1e-12


@dataclass(frozen=True, eq=False)
class Truth:
    """The true states of a scenario at time 0 and when it is measured."""

    times: FloatArray
    """0 and the times of measurement, s, shape (N + 1,)."""
    attitudes: FloatArray
    """From body to reference axes, shape (N + 1, 3, 3)."""
    angular_velocities: FloatArray
    """rad/s, body axes, shape (N + 1, 3)."""


@dataclass(frozen=True, eq=False)
class Simulation:
    """Measurements of a truth, and the bounds that their errors keep."""

    scenario: str
    directions: str
    """The name of the set of reference directions."""
    noise: Noise
    seed: int
    direction_bound: float
    """Bound of ‖ν‖, rad."""
    rate_bound: float
    """Bound of ‖v‖, rad/s."""
    measurements: Measurements
    """Measurements with their truth. If an estimator starts from a given set, the first row is at time 0 and empty."""


def truth(scenario: Scenario) -> Truth:
    """Integrate the motion of a scenario.

    SciPy's DOP853 on the nine entries of C and ω, tolerance 1e-12, relative and absolute. Only the results are made
    orthogonal.

    Parameters
    ----------
    scenario : Scenario

    Returns
    -------
    Truth

    Raises
    ------
    ArithmeticError
        If numbers overflow on the way.
    """
    inertia = scenario.inertia_matrix
    inverse = np.linalg.inv(inertia)
    torque = scenario.potential.torque(inertia)

    def motion(time: float, state: FloatArray) -> FloatArray:
        attitude, omega = state[:9].reshape(3, 3), state[9:]
        momentum_rate = torque(time, attitude) - cross(omega, inertia @ omega)
        return np.concatenate([_turning(attitude, omega).ravel(), inverse @ momentum_rate])

    times = scenario.interval * np.arange(scenario.measurements + 1, dtype=np.float64)
    states = np.empty((len(times), 12))
    states[0] = *scenario.attitude0.matrix().ravel(), *scenario.rate0
    # One call for each interval: at the end of a call the state has the full order, in between it is interpolated.
    for i, interval in enumerate(pairwise(times)):
        try:
            # SciPy would go on with NaN for ever.
            with np.errstate(over="raise", invalid="raise", divide="raise"):
                solution = scipy.integrate.solve_ivp(
                    motion, interval, states[i], method="DOP853", rtol=_TOLERANCE, atol=_TOLERANCE
                )
        except (ArithmeticError, ValueError) as error:
            raise ArithmeticError(f"{_not_integrated(scenario, interval)}: {error}") from error
        if not solution.success:
            raise ArithmeticError(f"{_not_integrated(scenario, interval)}: {solution.message}")
        states[i + 1] = solution.y[:, -1]
    u, _, v_transposed = np.linalg.svd(states[:, :9].reshape(-1, 3, 3))
    attitudes: FloatArray = u @ v_transposed
    return Truth(times, attitudes, states[:, 9:])


def _not_integrated(scenario: Scenario, interval: tuple[float, float]) -> str:
    begin, end = interval
    return f"scenario {scenario.name}: the truth could not be integrated from {begin:g} s to {end:g} s"


def measure(
    scenario: Scenario,
    truth: Truth,
    *,
    seed: int = 0,
    directions: str | None = None,
    bound_deg: float | None = None,
    noise: Noise = "inside",
) -> Simulation:
    """Measure a truth with errors within bounds.

    Every draw is a function of the scenario's name and the seed. The same unit errors are scaled to any bound, and
    those of the rate do not depend on the directions.

    Parameters
    ----------
    scenario : Scenario
    truth : Truth
        The scenario's truth. Many seeds share one.
    seed : int
        Not negative.
    directions : str, optional
        Which of the scenario's sets of reference directions; its first if left out.
    bound_deg : float, optional
        Bound of a direction's error in degrees and of the rate's in degrees per second; the scenario's first if left
        out.
    noise : {"inside", "perpendicular", "common"}
        See `Noise`.

    Returns
    -------
    Simulation

    Raises
    ------
    ValueError
        If the scenario has no such directions, or the bound is not above 0 and at most 90 degrees.
    """
    name = next(iter(scenario.directions)) if directions is None else directions
    if name not in scenario.directions:
        raise ValueError(f"directions: scenario {scenario.name} has {', '.join(scenario.directions)}, not {name!r}")
    degrees = scenario.bound_deg[0] if bound_deg is None else bound_deg
    if not 0.0 < degrees <= 90.0:
        raise ValueError(f"bound_deg: {degrees} is not above 0 and at most 90")
    bound = float(np.deg2rad(degrees))

    # An estimator that starts from a given set does so at time 0; otherwise the log begins with the first measurement.
    first = 1 if scenario.estimate0.attitude == "first measurement" else 0
    times, attitudes, rates = truth.times[first:], truth.attitudes[first:], truth.angular_velocities[first:]
    reference = np.array(scenario.directions[name])
    true_directions = np.einsum("nji,mj->nmi", attitudes[1 - first :], reference)
    streams = np.random.SeedSequence(seed, spawn_key=tuple(scenario.name.encode())).spawn(2)
    direction_errors, rate_errors = _unit_errors(noise, true_directions, *map(np.random.default_rng, streams))
    turned_back = scipy.spatial.transform.Rotation.from_rotvec(-bound * direction_errors.reshape(-1, 3))
    measured_directions = np.full((len(times), *reference.shape), np.nan)
    measured_directions[1 - first :] = turned_back.apply(true_directions.reshape(-1, 3)).reshape(true_directions.shape)
    measured_rates = np.full_like(rates, np.nan)
    measured_rates[1 - first :] = rates[1 - first :] - bound * rate_errors
    return Simulation(
        scenario=scenario.name,
        directions=name,
        noise=noise,
        seed=seed,
        direction_bound=bound,
        rate_bound=bound,
        measurements=Measurements(
            times=times,
            sensors=tuple(f"direction{i + 1}" for i in range(len(reference))),
            directions=measured_directions,
            references=np.broadcast_to(reference, measured_directions.shape),
            angular_velocities=measured_rates,
            true_quaternions=quaternions_from_attitudes(attitudes),
            true_angular_velocities=rates,
        ),
    )


def simulate(
    scenario: Scenario,
    *,
    seed: int = 0,
    directions: str | None = None,
    bound_deg: float | None = None,
    noise: Noise = "inside",
) -> Simulation:
    """Integrate the motion of a scenario and measure it: `measure` of `truth`.

    Examples
    --------
    >>> simulation = simulate(scenarios.load("orbit"), directions="three", bound_deg=7.0, seed=1)
    >>> simulation.measurements.directions.shape
    (20, 3, 3)
    """
    return measure(scenario, truth(scenario), seed=seed, directions=directions, bound_deg=bound_deg, noise=noise)


# --- the motion -------------------------------------------------------------------------------------------------------


def _turning(attitude: FloatArray, omega: FloatArray) -> FloatArray:
    """Ċ = C S(ω) (paper, Rdot)."""
    return cross(attitude.T, omega[:, None]).T


# --- the errors -------------------------------------------------------------------------------------------------------


def _unit_errors(
    noise: Noise, directions: FloatArray, direction_draws: np.random.Generator, rate_draws: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Errors ν of true directions (N, m, 3) and v (N, 3), both for bounds of 1."""
    count, sensors, _ = directions.shape
    match noise:
        case "inside":
            return in_ball(direction_draws, (count, sensors)), in_ball(rate_draws, (count,))
        case "perpendicular":
            around = np.cross(directions, on_sphere(direction_draws, (count, sensors)))
            return _normalized(around), on_sphere(rate_draws, (count,))
        case "common":
            shared = on_sphere(direction_draws, (count, 1))
            return np.broadcast_to(shared, directions.shape), on_sphere(rate_draws, (count,))
        case _:
            assert_never(noise)


def _normalized(vectors: FloatArray) -> FloatArray:
    normalized: FloatArray = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return normalized


def on_sphere(draws: np.random.Generator, shape: tuple[int, ...]) -> FloatArray:
    """Uniform on the unit sphere, shape (..., 3)."""
    return _normalized(draws.standard_normal((*shape, 3)))


def in_ball(draws: np.random.Generator, shape: tuple[int, ...]) -> FloatArray:
    """Uniform in the unit ball, shape (..., 3)."""
    return on_sphere(draws, shape) * np.cbrt(draws.random((*shape, 1)))
