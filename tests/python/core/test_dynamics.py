"""Rigid body, potentials, integrator, linearization: against the NumPy reference; potentials written in Python."""

import _thread
import gc
import pickle
import sys
import threading
import time
import tracemalloc
import weakref

import elliptude
import numpy as np
import pytest
from elliptude import (
    FreeBody,
    GradientPotential,
    GravityGradient,
    Integrator,
    RigidBody,
    SumPotential,
    UniformGravity,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from inputs import assert_close, generators, inertia, rotation
from reference import integrator as reference
from reference import linearization
from reference import rigid_body as bodies
from scipy.spatial.transform import Rotation

ORDERS = (2, 4, 6, 8)
ZERO = np.zeros(3)


class Both:
    """The reference's sum of two potentials."""

    def __init__(self, *potentials):
        self.potentials = potentials

    def energy(self, attitude, at):
        return sum(p.energy(attitude, at) for p in self.potentials)

    def gradient(self, attitude, at):
        return sum(p.gradient(attitude, at) for p in self.potentials)

    def torque(self, attitude, at):
        return sum(p.torque(attitude, at) for p in self.potentials)

    def torque_jacobian(self, attitude, at):
        return sum(p.torque_jacobian(attitude, at) for p in self.potentials)


def potential_of(rng, kind, body):
    """A potential and the reference's own."""
    mass, gravity, rho, rate = rng.uniform(0.1, 2.0), 9.81, rng.uniform(-0.2, 0.2, 3), rng.uniform(0.1, 0.5)
    pendulum = UniformGravity(mass, gravity, rho), bodies.UniformGravity(mass, gravity, rho)
    tide = GravityGradient(body, rate), bodies.GravityGradient(body.inertia, rate)
    if kind == "free":
        return FreeBody(), bodies.Free()
    if kind == "uniform gravity":
        return pendulum
    if kind == "gravity gradient":
        return tide
    if kind == "sum":
        return SumPotential([pendulum[0], tide[0]]), Both(pendulum[1], tide[1])
    if kind == "written in Python":
        return tide[1], tide[1]
    return GradientPotential(tide[1].energy, tide[1].gradient), tide[1]


KINDS = ["free", "uniform gravity", "gravity gradient", "sum", "written in Python", "gradient"]


@given(rng=generators)
def test_rigid_body(rng):
    matrix = inertia(rng)
    body = RigidBody(matrix)
    assert_close(body.inertia, matrix)
    # The smallest of the principal moments may be a hundredth of the largest.
    assert_close(body.inertia_inverse, np.linalg.inv(matrix), relative=1e-11)
    assert_close(body.nonstandard_inertia, bodies.nonstandard_inertia(matrix))
    assert_close(body.principal_moments, np.linalg.eigvalsh(matrix)[::-1])
    attitude, rates = rotation(rng), rng.standard_normal((4, 3))
    assert_close(body.kinetic_energy(rates), [bodies.kinetic_energy(matrix, rate) for rate in rates])
    expected = [bodies.spatial_angular_momentum(matrix, bodies.State(attitude, rate, 0.0)) for rate in rates]
    assert_close(body.angular_momentum(attitude, rates), expected)
    assert_close(body.angular_momentum(Rotation.from_matrix(attitude), rates), expected)


def test_principal_moments_make_a_body():
    assert RigidBody([0.13, 0.28, 0.17]) == RigidBody(np.diag([0.13, 0.28, 0.17]))
    # A flat body, on the edge of the triangle inequality.
    np.testing.assert_allclose(RigidBody([1.0, 2.0, 3.0]).principal_moments, [3.0, 2.0, 1.0], rtol=1e-15)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "written in Python"])
@given(rng=generators)
def test_potentials(kind, rng):
    body = RigidBody(inertia(rng))
    potential, expected = potential_of(rng, kind, body)
    attitude, at = rotation(rng), rng.uniform(0.0, 100.0)
    size = 30.0  # of m g ρ at most, and of 3n²; both cancel within
    assert_close(potential.energy(attitude, at), expected.energy(attitude, at), size=size)
    assert_close(potential.torque(attitude, at), expected.torque(attitude, at), size=size)
    by_gradient = bodies.torque_from_gradient(attitude, expected.gradient(attitude, at))
    assert_close(potential.torque(attitude, at), by_gradient, size=size)
    jacobian = expected.torque_jacobian(attitude, at)
    # That of a gradient is by fourth-order differences.
    relative = 1e-11 if kind == "gradient" else 1e-12
    assert_close(potential.torque_jacobian(attitude, at), jacobian, relative=relative, size=size)


@given(rng=generators)
def test_orbit_in_any_plane(rng):
    """Turning the orbit and the attitude alike changes nothing."""
    body = RigidBody(inertia(rng))
    orbit, attitude = rotation(rng), rotation(rng)
    turned = GravityGradient(body, 0.3, orbit=Rotation.from_matrix(orbit))
    assert_close(turned.torque(orbit @ attitude, 5.0), GravityGradient(body, 0.3).torque(attitude, 5.0), size=1.0)


@given(rng=generators, kind=st.sampled_from(["uniform gravity", "gravity gradient", "sum"]))
def test_torque_curvature_bound(rng, kind):
    body = RigidBody(inertia(rng))
    potential, _ = potential_of(rng, kind, body)
    attitude, zeta = rotation(rng), rng.uniform(-2.0, 2.0, 3)
    left_out = (
        potential.torque(attitude @ elliptude.exp(zeta))
        - potential.torque(attitude)
        - potential.torque_jacobian(attitude) @ zeta
    )
    assert np.linalg.norm(left_out) <= potential.torque_curvature_bound() * (zeta @ zeta) + 1e-14


def test_torque_curvature_bounds_known():
    body = RigidBody([1.0, 2.8, 2.0])
    gravity = UniformGravity(2.0, 9.81, [0.0, 0.3, 0.4])
    assert gravity.torque_curvature_bound() == pytest.approx(0.5 * 2.0 * 9.81 * 0.5)
    assert GravityGradient(body, 0.1).torque_curvature_bound() == pytest.approx(3.0 * 0.01 * 1.8)
    assert FreeBody().torque_curvature_bound() == 0.0
    unknown = GradientPotential(lambda c, t: 0.0, lambda c, t: np.zeros((3, 3)))
    assert unknown.torque_curvature_bound() is None
    assert SumPotential([gravity, unknown]).torque_curvature_bound() is None
    known = GradientPotential(unknown.energy, lambda c, t: np.zeros((3, 3)), torque_curvature_bound=0.5)
    assert SumPotential([gravity, known]).torque_curvature_bound() == gravity.torque_curvature_bound() + 0.5


@given(rng=generators)
def test_relative_attitude(rng):
    body = RigidBody(inertia(rng))
    h, momentum = rng.uniform(0.01, 0.1), body.inertia @ rng.uniform(-2.0, 2.0, 3)
    expected = reference.relative_attitude_cayley(body.inertia, momentum, h)
    assert_close(elliptude.relative_attitude(body, h, momentum), expected)
    assert_close(elliptude.relative_attitude(body, h, momentum, form="exponential"), expected)
    backward = reference.relative_attitude_cayley(body.inertia, momentum, -h)
    assert_close(elliptude.relative_attitude(body, -h, [momentum, -momentum]), [backward, expected])


def start(rng):
    return rotation(rng), rng.uniform(-1.0, 1.0, 3), rng.uniform(0.0, 10.0), rng.uniform(-0.2, 0.2, 3)


@settings(max_examples=30, deadline=None)
@pytest.mark.parametrize("kind", KINDS)
@given(rng=generators, order=st.sampled_from(ORDERS))
def test_step(kind, rng, order):
    body = RigidBody(inertia(rng))
    potential, its_reference = potential_of(rng, kind, body)
    attitude, rate, at, control = start(rng)
    h = 0.02
    integrator = Integrator(body, potential, step=h, order=order)
    found = integrator.step(attitude, rate, time=at, control_torque=control)
    model = bodies.RigidBody(body.inertia, its_reference)
    expected = reference.step(model, bodies.State(attitude, rate, at), h, order, control)
    # The smallest principal moment may be a hundredth of the largest, and the kick is divided by it.
    assert_close(found[0], expected.attitude)
    assert_close(found[1], expected.angular_velocity, relative=1e-11)


@settings(max_examples=20, deadline=None)
@pytest.mark.parametrize("kind", KINDS)
@given(rng=generators, order=st.sampled_from(ORDERS))
def test_linearization(kind, rng, order):
    body = RigidBody(inertia(rng))
    potential, its_reference = potential_of(rng, kind, body)
    attitude, rate, at, control = start(rng)
    h, steps = 0.02, 3
    integrator = Integrator(body, potential, step=h, order=order)
    found = integrator.linearize(attitude, rate, steps=steps, time=at, control_torque=control)
    model = bodies.RigidBody(body.inertia, its_reference)
    expected = linearization.linearize_flow(model, bodies.State(attitude, rate, at), h, steps, order, control)
    # As above; the gradient's Jacobian is by differences.
    relative = 1e-10 if kind == "gradient" else 1e-11
    assert_close(found.attitude, expected.state.attitude, relative=relative)
    assert_close(found.angular_velocity, expected.state.angular_velocity, relative=relative)
    assert_close(found.state, expected.transition, relative=relative)
    assert_close(found.control, expected.control_effect, relative=relative)
    assert abs(np.linalg.det(found.state) - 1.0) < 1e-10


@settings(max_examples=10, deadline=None)
@given(rng=generators, order=st.sampled_from(ORDERS), kind=st.sampled_from(KINDS))
def test_trajectory(rng, order, kind):
    body = RigidBody(inertia(rng))
    potential, its_reference = potential_of(rng, kind, body)
    attitude, rate, at, _ = start(rng)
    h, steps = 0.01, 12
    integrator = Integrator(body, potential, step=h, order=order)
    controls = rng.uniform(-0.2, 0.2, (steps, 3))
    times, attitudes, rates = integrator.trajectory(attitude, rate, steps, time=at, control_torque=controls)
    assert (times.shape, attitudes.shape, rates.shape) == ((steps + 1,), (steps + 1, 3, 3), (steps + 1, 3))
    assert_close(times, at + h * np.arange(steps + 1))
    model = bodies.RigidBody(body.inertia, its_reference)
    state = bodies.State(attitude, rate, at)
    for k in range(steps):
        assert_close(attitudes[k], state.attitude, relative=1e-11)
        assert_close(rates[k], state.angular_velocity, relative=1e-10)
        state = reference.step(model, state, h, order, controls[k])

    # A constant control torque, and fewer states kept.
    whole = integrator.trajectory(attitude, rate, steps, time=at, control_torque=controls[0])
    same = integrator.trajectory(attitude, rate, steps, time=at, control_torque=np.tile(controls[0], (steps, 1)))
    assert_close(whole.attitudes, same.attitudes)
    sparse = integrator.trajectory(attitude, rate, steps, time=at, control_torque=controls[0], every=4)
    for kept, all_of_them in zip(sparse, whole, strict=True):
        np.testing.assert_array_equal(kept, all_of_them[::4])


def test_batches_of_states_are_the_loop():
    rng = np.random.default_rng(1)
    body = RigidBody([0.13, 0.28, 0.17])
    integrator = Integrator(body, SumPotential([UniformGravity(1.0, 9.81, [0.0, 0.0, 0.3])]), step=0.01, order=4)
    attitudes, rates = elliptude.exp(rng.standard_normal((2, 3, 3))), rng.standard_normal((2, 1, 3))
    times, controls = rng.uniform(0.0, 1.0, 3), 0.1 * rng.standard_normal(3)
    found = integrator.step(attitudes, rates, time=times, control_torque=controls)
    linear = integrator.linearize(attitudes, rates, steps=2, time=times, control_torque=controls)
    momenta = body.angular_momentum(attitudes, rates)
    torques = integrator.potential.torque(attitudes, times)
    for i, j in np.ndindex(2, 3):
        one = integrator.step(attitudes[i, j], rates[i, 0], time=times[j], control_torque=controls)
        np.testing.assert_array_equal(found[0][i, j], one[0])
        np.testing.assert_array_equal(found[1][i, j], one[1])
        one = integrator.linearize(attitudes[i, j], rates[i, 0], steps=2, time=times[j], control_torque=controls)
        for batch, single in zip(linear, one, strict=True):
            np.testing.assert_array_equal(batch[i, j], single)
        np.testing.assert_array_equal(momenta[i, j], body.angular_momentum(attitudes[i, j], rates[i, 0]))
        np.testing.assert_array_equal(torques[i, j], integrator.potential.torque(attitudes[i, j], times[j]))


def test_scipy_rotations_go_in():
    integrator = Integrator(RigidBody([0.13, 0.28, 0.17]), step=0.01)
    attitude = Rotation.from_rotvec([0.1, 0.2, 0.3])
    rate = [0.3, 0.2, 0.1]
    np.testing.assert_array_equal(integrator.step(attitude, rate)[0], integrator.step(attitude.as_matrix(), rate)[0])
    integrator.trajectory(attitude, rate, 2)
    integrator.linearize(attitude, rate)


def test_free_body_keeps_its_momentum():
    body = RigidBody([1.0, 2.8, 2.0])
    trajectory = Integrator(body, step=0.01, order=4).trajectory(np.eye(3), [0.01, 0.01, 1.0], 100_000, every=1000)
    momenta = body.angular_momentum(trajectory.attitudes, trajectory.angular_velocities)
    energies = body.kinetic_energy(trajectory.angular_velocities)
    assert_close(momenta, np.tile(momenta[0], (101, 1)), relative=1e-11)
    assert_close(energies, np.full(101, energies[0]), relative=1e-11)


@pytest.mark.parametrize(
    "thing",
    [
        RigidBody([[1.0, 0.1, 0.0], [0.1, 1.2, 0.0], [0.0, 0.0, 1.3]]),
        FreeBody(),
        UniformGravity(1.0, 9.81, [0.0, 0.0, 0.3]),
        GravityGradient(RigidBody([1.0, 2.0, 2.5]), 0.1, orbit=np.diag([1.0, -1.0, -1.0])),
        SumPotential([FreeBody(), UniformGravity(1.0, 9.81, [0.0, 0.0, 0.3])]),
        Integrator(RigidBody([1.0, 2.0, 2.5]), UniformGravity(1.0, 9.81, [0.0, 0.0, 0.3]), step=0.1, order=6),
    ],
    ids=lambda thing: type(thing).__name__,
)
def test_pickle(thing):
    other = pickle.loads(pickle.dumps(thing))
    assert repr(other) == repr(thing)
    if isinstance(thing, Integrator):
        after, expected = other.step(np.eye(3), [0.1, 0.2, 0.3]), thing.step(np.eye(3), [0.1, 0.2, 0.3])
        np.testing.assert_array_equal(after[0], expected[0])
        np.testing.assert_array_equal(after[1], expected[1])


# --- potentials written in Python -----------------------------------------------------------------------------------


class Faulty:
    """A potential that does what it is told in the call of a function after `after` good ones."""

    def __init__(self, fault, function, after=0):
        self.fault, self.function, self.left = fault, function, after

    def answer(self, function, good):
        if function == self.function:
            if self.left == 0:
                return self.fault()
            self.left -= 1
        return good

    def energy(self, attitude, at):
        return self.answer("energy", 0.0)

    def torque(self, attitude, at):
        return self.answer("torque", ZERO)

    def torque_jacobian(self, attitude, at):
        return self.answer("torque_jacobian", np.zeros((3, 3)))


def raising(exception):
    def fault():
        raise exception

    return fault


def integrated(potential, how):
    integrator = Integrator(RigidBody([1.0, 2.0, 2.5]), potential, step=0.1, order=4)
    if how == "step":
        return integrator.step(np.tile(np.eye(3), (5, 1, 1)), [0.1, 0.2, 0.3])
    if how == "trajectory":
        return integrator.trajectory(np.eye(3), [0.1, 0.2, 0.3], 10)
    return integrator.linearize(np.eye(3), [0.1, 0.2, 0.3], steps=3)


@pytest.mark.parametrize("exception", [ZeroDivisionError("mine"), KeyboardInterrupt(), SystemExit(3)], ids=repr)
@pytest.mark.parametrize(
    ("how", "function"),
    [("step", "torque"), ("trajectory", "torque"), ("linearize", "torque"), ("linearize", "torque_jacobian")],
)
@pytest.mark.parametrize("after", [0, 1, 7])
def test_what_a_potential_raises_comes_out(exception, how, function, after):
    with pytest.raises(type(exception)) as caught:
        integrated(Faulty(raising(exception), function, after), how)
    assert caught.value is exception
    # With the traceback into the user's own function.
    assert caught.traceback[-1].name == "fault"


def test_what_a_gradient_potential_raises_comes_out():
    mine = ZeroDivisionError("mine")

    def gradient(attitude, at):
        raise mine

    potential = GradientPotential(lambda attitude, at: 0.0, gradient)
    for call in (potential.torque, potential.torque_jacobian, lambda c: integrated(potential, "trajectory")):
        with pytest.raises(ZeroDivisionError) as caught:
            call(np.eye(3))
        assert caught.value is mine
    assert potential.energy(np.eye(3)) == 0.0


def test_what_a_term_of_a_sum_raises_comes_out():
    mine = ZeroDivisionError("mine")
    potential = SumPotential([FreeBody(), Faulty(raising(mine), "energy")])
    with pytest.raises(ZeroDivisionError) as caught:
        potential.energy(np.eye(3))
    assert caught.value is mine
    np.testing.assert_array_equal(potential.torque(np.eye(3)), ZERO)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (np.zeros(4), r"torque\(attitude, time\) must have the shape \(3,\), not \(4,\)"),
        (np.zeros((1, 3)), r"torque\(attitude, time\) must have the shape \(3,\), not \(1, 3\)"),
        ([0.0, np.nan, 0.0], r"torque\(attitude, time\) must be finite, but torque\(attitude, time\)\[1\] is nan"),
    ],
)
def test_wrong_torques(answer, message):
    for how in ("step", "trajectory", "linearize"):
        with pytest.raises(ValueError, match=message):
            integrated(Faulty(lambda: answer, "torque", 3), how)


@pytest.mark.parametrize("answer", [None, "torque", [1j, 0.0, 0.0]])
def test_torques_that_are_no_numbers(answer):
    with pytest.raises(TypeError, match=r"torque\(attitude, time\) must hold real numbers"):
        integrated(Faulty(lambda: answer, "torque"), "step")


def test_wrong_jacobian():
    with pytest.raises(ValueError, match=r"torque_jacobian\(attitude, time\) must have the shape \(3, 3\), not \(3,\)"):
        integrated(Faulty(lambda: ZERO, "torque_jacobian"), "linearize")


def test_a_potential_is_asked_with_attitude_and_time():
    seen = []

    class Listening(Faulty):
        def torque(self, attitude, at):
            seen.append((attitude.copy(), at))
            attitude[:] = np.nan  # it is the potential's own copy
            return ZERO

    integrator = Integrator(RigidBody([1.0, 2.0, 2.5]), Listening(None, None), step=0.5)
    trajectory = integrator.trajectory(np.eye(3), [0.1, 0.2, 0.3], 3, time=2.0)
    assert [at for _, at in seen] == [2.0, 2.5, 3.0, 3.5]
    np.testing.assert_array_equal([attitude for attitude, _ in seen], trajectory.attitudes)
    assert isinstance(integrator.potential, Listening)


def test_python_potentials_leak_nothing():
    potential = Faulty(raising(ZeroDivisionError()), "torque", after=10**9)
    failing = Faulty(lambda: np.zeros(4), "torque")

    def work():
        for _ in range(200):
            integrated(potential, "trajectory")
            integrated(SumPotential([potential]), "linearize")
            with pytest.raises(ValueError, match="torque"):
                integrated(failing, "step")

    work()
    gc.collect()
    references = sys.getrefcount(potential), sys.getrefcount(failing), sys.getrefcount(ZERO)
    tracemalloc.start()
    work()
    gc.collect()
    grown = []
    for _ in range(3):  # a leak shows each time, a cache that grows now and then does not
        before = tracemalloc.get_traced_memory()[0]
        work()
        gc.collect()
        grown.append(tracemalloc.get_traced_memory()[0] - before)
    tracemalloc.stop()
    assert references == (sys.getrefcount(potential), sys.getrefcount(failing), sys.getrefcount(ZERO))
    # 200 rounds with one leaked 3-vector each would be 20 kB.
    assert min(grown) < 10_000


def test_cycles_through_a_potential_are_collected():
    class Owner(Faulty):
        pass

    def cycle(wrap):
        owner = Owner(None, None)
        owner.holder = wrap(owner)
        return weakref.ref(owner)

    body = RigidBody([1.0, 2.0, 2.5])
    wraps = [
        lambda owner: Integrator(body, owner, step=0.1),
        lambda owner: SumPotential([FreeBody(), owner]),
        lambda owner: GradientPotential(owner.energy, owner.torque_jacobian),
        lambda owner: Integrator(body, SumPotential([owner, owner]), step=0.1),
    ]
    for wrap in wraps:
        gone = cycle(wrap)
        gc.collect()
        assert gone() is None


def test_threads_may_share_a_potential():
    """Failures belong to the call in which they happen."""
    potential = Faulty(None, None)
    failing = Faulty(raising(ZeroDivisionError("mine")), "torque", after=50)
    shared = SumPotential([potential])
    results = []

    def good():
        results.append(integrated(shared, "trajectory"))

    def bad():
        failing.left = 50
        with pytest.raises(ZeroDivisionError, match="mine"):
            integrated(SumPotential([shared, failing]), "trajectory")
        results.append(None)

    for _ in range(20):
        threads = [threading.Thread(target=target) for target in (good, bad, good)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert len(results) == 60


# --- the interpreter's lock ----------------------------------------------------------------------------------------


def others_run_during(call):
    """Whether another thread gets to run Python in the middle of a call, well away from both of its ends."""
    window = []

    def work():
        window.append(time.perf_counter())
        call()
        window.append(time.perf_counter())

    thread = threading.Thread(target=work)
    ticks = []
    thread.start()
    while thread.is_alive():
        ticks.append(time.perf_counter())
        time.sleep(0.0)
    thread.join()
    begin, end = window
    assert end - begin > 0.02, "too short to tell"
    margin = 0.25 * (end - begin)
    return any(begin + margin < tick < end - margin for tick in ticks)


LONG_CALLS = {}


def long_call(function):
    LONG_CALLS[function.__name__] = function
    return function


@long_call
def trajectory():
    integrator = Integrator(RigidBody([1.0, 2.0, 2.5]), step=0.01)
    return lambda: integrator.trajectory(np.eye(3), [0.1, 0.2, 0.3], 2_000_000, every=1_000_000)


@long_call
def steps_of_a_batch():
    integrator = Integrator(RigidBody([1.0, 2.0, 2.5]), step=0.01, order=8)
    rates = np.full((50_000, 3), 0.1)
    return lambda: integrator.step(np.eye(3), rates)


@long_call
def linearization_of_many_steps():
    integrator = Integrator(RigidBody([1.0, 2.0, 2.5]), step=0.01)
    return lambda: integrator.linearize(np.eye(3), [0.1, 0.2, 0.3], steps=1_000_000)


@long_call
def rotation_vectors():
    rotations = elliptude.exp(np.full((1_000_000, 3), 0.1))
    return lambda: elliptude.log(rotations)


@long_call
def quadratic_forms():
    ellipsoid = elliptude.Ellipsoid(np.zeros(6), np.eye(6))
    points = np.full((1_000_000, 6), 0.1)
    return lambda: ellipsoid.quadratic_form(points)


@long_call
def many_attitudes():
    directions = np.tile(np.eye(3), (500_000, 1, 1))
    return lambda: elliptude.wahba(np.eye(3), directions)


@long_call
def many_torques():
    potential = UniformGravity(1.0, 9.81, [0.0, 0.0, 0.3])
    rotations = elliptude.exp(np.full((2_000_000, 3), 0.1))
    return lambda: potential.torque_jacobian(rotations)


@pytest.mark.parametrize("name", LONG_CALLS)
def test_other_threads_run_meanwhile(name):
    assert others_run_during(LONG_CALLS[name]())


def test_the_thread_test_can_fail():
    numbers = np.random.default_rng(0).random(1_000_000).tolist()
    assert not others_run_during(lambda: sorted(numbers))


def test_long_trajectories_can_be_interrupted():
    integrator = Integrator(RigidBody([1.0, 2.0, 2.5]), step=0.01)
    timer = threading.Timer(0.2, _thread.interrupt_main)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        integrator.trajectory(np.eye(3), [0.1, 0.2, 0.3], 10**9, every=10**9)
    timer.join()
