"""What a step costs for one of many first-order filters that go together, beside the step of a filter alone.

    python benchmarks/filter_ensemble.py

Times of the processor, the least of several runs, on one thread: the spacecraft of docs/performance.md with three
stars and its angular velocity, and a gyro with three stars.
"""

import time
from collections.abc import Callable
from typing import Any

import elliptude as el
import numpy as np

FILTERS, STEPS, RUNS, BOUND = 640, 50, 7, 0.02


def microseconds(work: Callable[[], object], steps: int) -> float:
    """The least time of the processor for a step."""
    taken = []
    for _ in range(RUNS):
        began = time.process_time()
        work()
        taken.append(time.process_time() - began)
    return 1e6 * min(taken) / steps


def recorded(flow: el.RigidBodyFlow | el.GyroFlow) -> tuple[np.ndarray, list[dict[str, Any]]]:
    """Rates at the start, and for each step what all filters are told."""
    generator = np.random.default_rng(0)

    def errors(*shape: int) -> np.ndarray:
        v = generator.normal(size=(*shape, 3))
        return np.asarray(0.98 * BOUND * v / np.linalg.norm(v, axis=-1, keepdims=True))

    attitudes = np.broadcast_to(np.eye(3), (FILTERS, 3, 3))
    start = rates = generator.normal(scale=0.5, size=(FILTERS, 3))
    rows = []
    for step in range(STEPS):
        told: dict[str, Any] = {"reference": np.eye(3), "bounds": BOUND}
        if isinstance(flow, el.RigidBodyFlow):
            motion = el.Integrator(flow.body, flow.potential, step=0.05)
            attitudes, rates = motion.advance(attitudes, rates, 1, time=0.05 * step)
            told |= {"angular_velocity": rates + errors(FILTERS), "rate_bound": BOUND}
        told["directions"] = np.einsum("nkij,nkj->nki", el.exp(errors(FILTERS, 3)), attitudes)
        rows.append(told)
    return start, rows


def row(name: str, flow: el.RigidBodyFlow | el.GyroFlow, **options: Any) -> str:
    """A row of docs/performance.md."""
    start, told = recorded(flow)
    inputs: dict[str, Any] = {} if isinstance(flow, el.RigidBodyFlow) else {"gyro": np.zeros(3)}
    vectors = start if isinstance(flow, el.RigidBodyFlow) else 0.0 * start
    shape = 0.02 * np.eye(6)

    def together() -> None:
        filters = el.AttitudeFilters(flow, np.eye(3), vectors, shape, **options)
        for step, given in enumerate(told):
            filters.predict(0.05 * (step + 1), **inputs, threads=1)
            filters.update(**given, threads=1)

    def predicted() -> None:
        filters = el.AttitudeFilters(flow, np.eye(3), vectors, shape, **options)
        for step in range(STEPS):
            filters.predict(0.05 * (step + 1), **inputs, threads=1)

    log: dict[str, Any] = {
        "directions": np.array([given["directions"][0] for given in told]),
        "reference": np.eye(3),
        "bounds": BOUND,
    }
    times = 0.05 * np.arange(1, STEPS + 1)
    if isinstance(flow, el.RigidBodyFlow):
        log |= {"angular_velocity": np.array([g["angular_velocity"][0] for g in told]), "rate_bound": BOUND}
    else:
        log["gyro"], times = np.zeros((STEPS, 3)), times - times[0]

    def alone() -> None:
        for _ in range(20):
            el.AttitudeFilter(flow, el.StateEllipsoid(np.eye(3), vectors[0], shape), **options).run(times, **log)

    one, many = microseconds(alone, 20 * STEPS), microseconds(together, FILTERS * STEPS)
    return f"| {name} | {one:.2f} | {many:.2f} | {many / one:.2f} | {microseconds(predicted, FILTERS * STEPS):.2f} |"


def main() -> None:
    """Print the table."""
    body = el.RigidBody([1.0, 2.8, 2.0])
    spacecraft = el.RigidBodyFlow(body, el.GravityGradient(body, 1.0, np.eye(3)), step=0.05)
    print(row("spacecraft, first_order, trace", spacecraft))
    print(row("spacecraft, first_order, volume", spacecraft, criterion="volume"))
    print(row("spacecraft, paper, trace", spacecraft, mode="paper"))
    print(row("gyro, first_order, trace", el.GyroFlow(1e-3, 1e-5)))


if __name__ == "__main__":
    main()
