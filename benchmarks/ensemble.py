"""What a step costs for one of many bodies that are moved together, beside a step of a body alone.

    python benchmarks/ensemble.py

Times of the processor, the least of several runs, on one thread.
"""

import time
from collections.abc import Callable

import elliptude as el
import numpy as np

BODIES, RUNS = 640, 9


def nanoseconds(work: Callable[[], object], steps: int) -> float:
    """The least time of the processor for a step."""
    taken = []
    for _ in range(RUNS):
        began = time.process_time()
        work()
        taken.append(time.process_time() - began)
    return 1e9 * min(taken) / steps


def row(name: str, integrator: el.Integrator) -> str:
    """A row of docs/performance.md."""
    attitude, rates = np.eye(3), np.random.default_rng(0).normal(size=(BODIES, 3))
    alone = nanoseconds(lambda: integrator.trajectory(attitude, rates[0], 50_000, every=50_000), 50_000)
    many = nanoseconds(lambda: integrator.advance(attitude, rates, 250, threads=1), 250 * BODIES)
    linear = nanoseconds(lambda: integrator.linearize(attitude, rates[0], 20_000), 20_000)
    linears = nanoseconds(lambda: integrator.advance_linearized(attitude, rates, 100, threads=1), 100 * BODIES)
    figures = [f"{alone:.0f}", f"{many:.0f}", f"{many / alone:.2f}"]
    figures += [f"{linear:.0f}", f"{linears:.0f}", f"{linears / linear:.2f}"]
    return f"| {name} | {' | '.join(figures)} |"


def main() -> None:
    """Print the table."""
    body = el.RigidBody([[2.0, 0.1, 0.0], [0.1, 3.0, 0.05], [0.0, 0.05, 4.0]])
    potentials = {
        "free body": el.FreeBody(),
        "pendulum": el.UniformGravity(1.0, 9.81, [0.0, 0.02, 0.3]),
        "gravity gradient": el.GravityGradient(body, 0.001, np.eye(3)),
    }
    for name, potential in potentials.items():
        print(row(name, el.Integrator(body, potential, step=0.01)))


if __name__ == "__main__":
    main()
