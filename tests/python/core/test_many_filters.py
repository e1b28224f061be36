"""Filters run over their logs on several threads of Python: the numbers are those of one after the other."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import elliptude as el
import numpy as np
import pytest

BODY, BOUND = el.RigidBody([1.0, 2.8, 2.0]), float(np.radians(3.0))
TIMES = 0.05 * np.arange(60)


def log_of(seed):
    """Directions and rates of a free body within their bounds."""
    rng = np.random.default_rng(seed)
    path = el.Integrator(BODY, step=0.05, order=4).trajectory(
        el.exp(rng.normal(size=3)), 0.5 * rng.normal(size=3), steps=len(TIMES) - 1
    )
    errors = rng.uniform(-1.0, 1.0, (2, len(TIMES), 3)) * BOUND / np.sqrt(3.0)
    return path.attitudes @ el.exp(errors[0]), path.angular_velocities + errors[1]


def measurements():
    return {"reference": np.eye(3), "bounds": BOUND, "rate_bound": BOUND}


def guaranteed(seed):
    directions, rates = log_of(seed)
    estimator = el.GuaranteedFilter(el.GuaranteedRigidBodyFlow(BODY, step=0.05))
    log = estimator.run(TIMES, directions=directions, angular_velocity=rates, **measurements())
    return log.attitudes, log.vectors, log.shapes


def first_order(seed):
    directions, rates = log_of(seed)
    start = el.measured_state(directions[0], np.eye(3), BOUND, rates[0], rate_bound=BOUND)
    estimator = el.AttitudeFilter(el.RigidBodyFlow(BODY, step=0.05), start)
    log = estimator.run(TIMES, directions=directions, angular_velocity=rates, on_inconsistent="skip", **measurements())
    return log.attitudes, log.vectors, log.shapes


@pytest.mark.parametrize("run", [guaranteed, first_order])
def test_any_number_of_threads_gives_the_same_numbers(run):
    seeds = range(12)
    one_by_one = [run(seed) for seed in seeds]
    assert not np.array_equal(one_by_one[0][0], one_by_one[1][0])  # or this test shows nothing
    for threads in (1, 2, 5):
        with ThreadPoolExecutor(threads) as pool:
            for found, expected in zip(pool.map(run, seeds), one_by_one, strict=True):
                for one, other in zip(found, expected, strict=True):
                    np.testing.assert_array_equal(one, other)


def test_other_threads_of_python_go_on_while_a_log_runs():
    """The lock is free while a log runs: a thread that notes the time in Python does so in the middle of it."""
    rows = 10_000  # of a body at rest
    estimator = el.GuaranteedFilter(el.GuaranteedRigidBodyFlow(BODY, step=0.05))
    directions, rates = np.broadcast_to(np.eye(3), (rows, 3, 3)), np.zeros((rows, 3))
    ended, stamps = threading.Event(), []

    def note():
        while not ended.is_set():
            stamps.append(time.perf_counter())
            time.sleep(1e-4)

    noting = threading.Thread(target=note)
    noting.start()
    begin = time.perf_counter()
    estimator.run(0.05 * np.arange(rows), directions=directions, angular_velocity=rates, **measurements())
    end = time.perf_counter()
    ended.set()
    noting.join()
    middle = [stamp for stamp in stamps if 0.75 * begin + 0.25 * end < stamp < 0.25 * begin + 0.75 * end]
    assert len(middle) > 5
