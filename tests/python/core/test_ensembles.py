"""Many bodies moved at a time: the numbers are those of each alone, and do not depend on who moves them."""

import multiprocessing
import signal
import subprocess
import sys
import textwrap

import elliptude as el
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

BODY = el.RigidBody([[2.0, 0.1, 0.0], [0.1, 3.0, 0.05], [0.0, 0.05, 4.0]])


def potentials():
    return {
        "free": el.FreeBody(),
        "gravity": el.UniformGravity(1.0, 9.81, [0.0, 0.02, 0.3]),
        "gradient": el.GravityGradient(BODY, 0.2, np.eye(3)),
        "sum": el.SumPotential([el.FreeBody(), el.UniformGravity(1.0, 9.81, [0.0, 0.02, 0.3])]),  # not in the kernels
    }


def initial(count, seed=1):
    generator = np.random.default_rng(seed)
    return {
        "attitude": Rotation.random(count, rng=generator).as_matrix(),
        "angular_velocity": generator.normal(size=(count, 3)) * 10.0 ** -generator.integers(0, 4, size=(count, 1)),
        "time": generator.uniform(0.0, 10.0, size=count),
        "control_torque": generator.normal(size=(count, 3)) * 0.1,
    }


@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("name", potentials())
def test_bodies_end_where_each_alone_does(name, order):
    integrator = el.Integrator(BODY, potentials()[name], step=0.01, order=order)
    start = initial(13)
    attitudes, rates = integrator.advance(**start, steps=100)
    linearized = integrator.advance_linearized(**start, steps=100)
    np.testing.assert_array_equal(linearized.attitude, attitudes)
    for i in range(13):
        alone = {key: value[i] for key, value in start.items()}
        expected = integrator.linearize(**alone, steps=100)
        np.testing.assert_allclose(attitudes[i], expected.attitude, rtol=0, atol=1e-13)
        np.testing.assert_allclose(rates[i], expected.angular_velocity, rtol=1e-13, atol=1e-14)
        np.testing.assert_allclose(linearized.state[i], expected.state, rtol=0, atol=1e-12 * abs(expected.state).max())
        np.testing.assert_allclose(
            linearized.control[i], expected.control, rtol=0, atol=1e-12 * abs(expected.control).max()
        )


@pytest.mark.parametrize("name", ["free", "gravity", "gradient"])
def test_numbers_depend_neither_on_threads_nor_on_neighbours(name):
    """To the last bit."""
    integrator = el.Integrator(BODY, potentials()[name], step=0.02)
    start = initial(331)
    one = integrator.advance_linearized(**start, steps=40, threads=1)
    many = integrator.advance_linearized(**start, steps=40, threads=7)
    order = np.random.default_rng(2).permutation(331)
    mixed = integrator.advance_linearized(**{key: value[order] for key, value in start.items()}, steps=40)
    alone = integrator.advance_linearized(**{key: value[17] for key, value in start.items()}, steps=40)
    for field in ("attitude", "angular_velocity", "state", "control"):
        np.testing.assert_array_equal(getattr(many, field), getattr(one, field))
        np.testing.assert_array_equal(getattr(mixed, field), getattr(one, field)[order])
        np.testing.assert_array_equal(getattr(alone, field), getattr(one, field)[17])


def test_many_steps_are_as_many_as_trajectory_has():
    """More than the steps after which Ctrl-C is looked for."""
    integrator = el.Integrator(BODY, potentials()["gradient"], step=1e-4)
    start = initial(3)
    del start["control_torque"]
    attitudes, rates = integrator.advance(**start, steps=70_000)
    for i in range(3):
        alone = {key: value[i] for key, value in start.items()}
        trajectory = integrator.trajectory(**alone, steps=70_000, every=70_000)
        np.testing.assert_allclose(attitudes[i], trajectory.attitudes[-1], rtol=0, atol=1e-11)
        np.testing.assert_allclose(rates[i], trajectory.angular_velocities[-1], rtol=0, atol=1e-11)


def test_shapes_broadcast():
    integrator = el.Integrator(BODY, step=0.01)
    attitudes, rates = integrator.advance(np.eye(3), np.ones((4, 1, 3)), 2, time=np.zeros(5))
    assert attitudes.shape == (4, 5, 3, 3)
    assert rates.shape == (4, 5, 3)
    linearized = integrator.advance_linearized(np.eye(3), np.ones((0, 3)))
    assert linearized.state.shape == (0, 6, 6)
    attitude, rate = integrator.advance(np.eye(3), [0.1, 0.2, 0.3], 1)
    expected = integrator.step(np.eye(3), [0.1, 0.2, 0.3])
    np.testing.assert_allclose(attitude, expected[0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(rate, expected[1], rtol=0, atol=1e-15)


@pytest.mark.parametrize("method", ["advance", "advance_linearized"])
@pytest.mark.parametrize("potential", ["free", "sum"])
def test_the_first_body_that_cannot_move_is_named(method, potential):
    integrator = el.Integrator(BODY, potentials()[potential], step=0.1)
    rates = np.full((2, 100, 3), 0.1)
    rates[1, 3] = rates[1, 90] = rates[1, 2] = 100.0
    with pytest.raises(ValueError, match=r"step 0.1 s is too long for item \[1, 2\].* angular velocity is 173"):
        getattr(integrator, method)(np.eye(3), rates, steps=4, threads=3)


def test_a_potential_in_python_may_fail():
    class Failing:
        def energy(self, attitude, time):
            return 0.0

        def torque(self, attitude, time):
            if time > 0.05:
                raise ArithmeticError("no more")
            return np.zeros(3)

        def torque_jacobian(self, attitude, time):
            return np.zeros((3, 3))

    integrator = el.Integrator(BODY, Failing(), step=0.01)
    integrator.advance(np.eye(3), np.ones((3, 3)), 4)
    with pytest.raises(ArithmeticError, match="no more"):
        integrator.advance(np.eye(3), np.ones((3, 3)), 9)


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"steps": 0}, ValueError, "steps must be at least 1, but is 0"),
        ({"steps": 2.5}, TypeError, "steps must be an integer"),
        ({"threads": 0}, ValueError, "threads must be at least 1, but is 0"),
        ({"attitude": 2.0 * np.eye(3)}, ValueError, "attitude"),
        ({"angular_velocity": [np.nan, 0.0, 0.0]}, ValueError, "angular_velocity"),
    ],
)
def test_bad_arguments(options, error, words):
    integrator = el.Integrator(BODY, step=0.01)
    arguments = {"attitude": np.eye(3), "angular_velocity": np.zeros(3), "steps": 1} | options
    with pytest.raises(error, match=words):
        integrator.advance(**arguments)


@pytest.mark.parametrize("method", ["advance", "advance_linearized"])
def test_control_c_ends_it(method):
    program = f"""
        import numpy as np
        import elliptude as el

        integrator = el.Integrator(el.RigidBody([1.0, 2.0, 2.5]), step=1e-3)
        print("ready", flush=True)
        integrator.{method}(np.eye(3), np.ones((1000, 3)), 10_000_000)
    """
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(program)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=300)
    assert errors.rstrip().endswith("KeyboardInterrupt")


def _advance(_):
    return el.Integrator(BODY, step=0.01).advance(np.eye(3), np.ones((200, 3)), 10)


def test_a_forked_process_moves_bodies_too():
    """Threads do not outlive a call: nothing is lost in a fork."""
    expected = _advance(0)
    with multiprocessing.get_context("fork").Pool(1) as pool:
        found = pool.apply_async(_advance, (0,)).get(timeout=300)
    np.testing.assert_array_equal(found[0], expected[0])
