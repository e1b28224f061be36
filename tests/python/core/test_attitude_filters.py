"""Many first-order filters at a time: each holds what it holds alone, with any neighbours and on any thread."""

import copy
import pickle
import signal
import subprocess
import sys
import textwrap

import elliptude as el
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

BODY = el.RigidBody([[2.0, 0.1, 0.0], [0.1, 3.0, 0.05], [0.0, 0.05, 4.0]])
GRAVITY = el.UniformGravity(1.0, 9.81, [0.0, 0.02, 0.3])
POTENTIALS = {
    "free": el.FreeBody(),
    "gravity": GRAVITY,
    "gradient": el.GravityGradient(BODY, 0.2, np.eye(3)),
    "sum": el.SumPotential([el.FreeBody(), GRAVITY]),  # not in the kernels
}
BOUND = 0.01


def in_ball(generator, count, radius):
    v = generator.normal(size=(count, 3))
    return v * radius * generator.uniform(size=(count, 1)) ** (1 / 3) / np.linalg.norm(v, axis=1, keepdims=True)


class Scene:
    """Bodies with three stars each that are measured with bounded errors, and filters of them."""

    def __init__(self, count, flow, seed=1, **options):
        self.generator = np.random.default_rng(seed)
        self.count, self.flow = count, flow
        self.truth = Rotation.random(count, rng=self.generator).as_matrix()
        self.rate = self.generator.normal(size=(count, 3)) * 0.1
        self.stars = self.generator.normal(size=(count, 3, 3))
        self.has_gyro = isinstance(flow, el.GyroFlow)
        if self.has_gyro:
            self.rate[:] = 0.0
        start = self.truth @ el.exp(in_ball(self.generator, count, 0.05))
        shapes = np.diag([0.01] * 3 + [0.02] * 3) * self.generator.uniform(1.0, 3.0, size=(count, 1, 1))
        self.filters = el.AttitudeFilters(flow, start, self.rate, shapes, time=0.5, **options)
        self.alone = [
            el.AttitudeFilter(flow, el.StateEllipsoid(start[i], self.rate[i], shapes[i]), time=0.5, **options)
            for i in range(count)
        ]

    def inputs(self):
        noise = in_ball(self.generator, self.count, 1e-3)
        return {"gyro": noise} if self.has_gyro else {"control_torque": noise}

    def measurements(self):
        seen = el.exp(in_ball(self.generator, 3 * self.count, 0.99 * BOUND)).reshape(self.count, 3, 3, 3)
        body = np.einsum("nmij,nki,nmk->nmj", seen, self.truth, self.stars)
        given = {"directions": body, "reference": self.stars, "bounds": BOUND, "weights": [1.0, 2.0, 3.0]}
        if not self.has_gyro:
            given["angular_velocity"] = self.rate + in_ball(self.generator, self.count, 0.99 * BOUND)
            given["rate_bound"] = 3 * BOUND
        return given

    def move(self, time):
        """The truth moves, too."""
        inputs = self.inputs()
        if not self.has_gyro:
            integrator = el.Integrator(BODY, self.flow.potential, step=(time - self.filters.time) / 4)
            self.truth, self.rate = integrator.advance(
                self.truth, self.rate, 4, time=self.filters.time, control_torque=inputs["control_torque"]
            )
        return inputs


def of_one(arguments, i):
    """What one filter is told of arguments for all."""
    for_all = {"bounds", "weights", "rate_bound"}
    return {key: value if key in for_all or value is None else value[i] for key, value in arguments.items()}


def close(filters, alone):
    for i, single in enumerate(alone):
        np.testing.assert_allclose(filters.attitude[i], single.attitude, rtol=0, atol=1e-9)
        np.testing.assert_allclose(filters.vector[i], single.vector, rtol=0, atol=1e-9)
        # The least size is stationary: rounding may move the shape by half of the digits (theory, section 10).
        for field in ("shape", "transition", "prior_shape"):
            expected = getattr(single, field)
            np.testing.assert_allclose(getattr(filters, field)[i], expected, rtol=0, atol=1e-8 * abs(expected).max())


FLOWS = {name: el.RigidBodyFlow(BODY, potential, step=0.05) for name, potential in POTENTIALS.items()} | {
    "pushed": el.RigidBodyFlow(BODY, step=0.05, order=4, unknown_torque=1e-3),
    "gyro": el.GyroFlow(1.1e-3, 1e-4),
}
WEIGHT = np.diag([1.0, 2.0, 3.0, 0.5, 0.6, 0.7])


@pytest.mark.parametrize("options", [{}, {"mode": "paper", "criterion": "volume"}, {"criterion": "weighted_trace"}])
@pytest.mark.parametrize("name", FLOWS)
def test_filters_hold_what_each_holds_alone(name, options):
    options = options | ({"weight": WEIGHT} if options.get("criterion") == "weighted_trace" else {})
    scene = Scene(11, FLOWS[name], **options)
    for time in (0.6, 0.7, 0.95, 1.0):
        inputs = scene.move(time)
        scene.filters.predict(time, **inputs)
        for i, single in enumerate(scene.alone):
            single.predict(time, **of_one(inputs, i))
        assert scene.filters.time == time
        close(scene.filters, scene.alone)
        measured = scene.measurements()
        updates = scene.filters.update(**measured)
        assert updates.used.all()
        for i, single in enumerate(scene.alone):
            update = single.update(**of_one(measured, i))
            assert abs(updates.share[i] - update.share) < 1e-6
            assert abs(updates.margin[i] - update.margin) < 1e-9
        close(scene.filters, scene.alone)


def test_measurements_of_one_kind():
    scene = Scene(5, FLOWS["free"])
    measured = scene.measurements()
    rate = {key: measured.pop(key) for key in ("angular_velocity", "rate_bound")}
    one = {**measured, "directions": measured["directions"][:, :1], "reference": measured["reference"][:, :1]}
    one["weights"] = None
    for given in (rate, measured, one):
        scene.filters.update(**given)
        for i, single in enumerate(scene.alone):
            single.update(**of_one(given, i))
        close(scene.filters, scene.alone)


@pytest.mark.parametrize("name", ["gravity", "pushed", "gyro"])
def test_numbers_depend_neither_on_threads_nor_on_neighbours(name):
    """To the last bit."""
    scene = Scene(331, FLOWS[name])
    order = np.random.default_rng(2).permutation(331)
    start = [getattr(scene.filters, field) for field in ("attitude", "vector", "shape")]
    many = copy.deepcopy(scene.filters)
    mixed = el.AttitudeFilters(scene.flow, *(value[order] for value in start), time=0.5)
    lone = el.AttitudeFilters(scene.flow, *(value[17:18] for value in start), time=0.5)
    for time in (0.6, 0.8):
        inputs = scene.move(time)
        scene.filters.predict(time, **inputs, threads=1)
        many.predict(time, **inputs, threads=7)
        mixed.predict(time, **{key: value[order] for key, value in inputs.items()})
        lone.predict(time, **{key: value[17:18] for key, value in inputs.items()})
        measured = scene.measurements()
        one = scene.filters.update(**measured, threads=1)
        np.testing.assert_array_equal(many.update(**measured, threads=7).margin, one.margin)
        mixed.update(**of_one(measured, order))
        lone.update(**of_one(measured, slice(17, 18)))
    for field in ("attitude", "vector", "shape", "transition", "prior_shape"):
        expected = getattr(scene.filters, field)
        np.testing.assert_array_equal(getattr(many, field), expected)
        np.testing.assert_array_equal(getattr(mixed, field), expected[order])
        np.testing.assert_array_equal(getattr(lone, field), expected[17:18])


def contradicting(scene):
    measured = scene.measurements()
    measured["angular_velocity"][[3, 9]] += 5.0
    return measured


def test_a_contradiction_leaves_all_filters_as_they_were():
    scene = Scene(12, FLOWS["free"])
    scene.filters.predict(0.6)
    before = scene.filters.shape
    with pytest.raises(el.InconsistentMeasurement, match=r"measurement of filter 3 at 0.6 s contradicts") as error:
        scene.filters.update(**contradicting(scene))
    assert error.value.margin < 0
    assert error.value.time == 0.6
    np.testing.assert_array_equal(scene.filters.shape, before)


def test_a_contradiction_may_be_skipped():
    scene = Scene(12, FLOWS["free"])
    before = scene.filters.shape
    updates = scene.filters.update(**contradicting(scene), on_inconsistent="skip")
    assert np.flatnonzero(~updates.used).tolist() == [3, 9]
    assert (updates.margin[[3, 9]] < 0).all()
    assert (updates.share[[3, 9]] == 1).all()
    np.testing.assert_array_equal(scene.filters.shape[[3, 9]], before[[3, 9]])
    assert (np.linalg.det(scene.filters.shape[updates.used]) < np.linalg.det(before[updates.used])).all()


@pytest.mark.parametrize("name", ["free", "sum"])
def test_the_first_filter_that_cannot_move_is_named(name):
    rates = np.full((9, 3), 0.1)
    rates[[4, 7]] = 100.0
    filters = el.AttitudeFilters(FLOWS[name], np.eye(3), rates, 0.01 * np.eye(6))
    with pytest.raises(ValueError, match=r"step of the flow is too long: .* angular velocity of filter 4 is 173"):
        filters.predict(1.0)
    assert filters.time == 0
    np.testing.assert_array_equal(filters.vector, rates)


def test_truths_are_in_the_sets():
    """To first order: the errors of these sets are small."""
    scene = Scene(200, FLOWS["gravity"])
    for time in (0.55, 0.6, 0.65):
        scene.filters.predict(time, **scene.move(time))
        scene.filters.update(**scene.measurements())
    error = np.concatenate(
        [el.log(np.swapaxes(scene.filters.attitude, 1, 2) @ scene.truth), scene.rate - scene.filters.vector], axis=1
    )
    forms = np.einsum("ni,nij,nj->n", error, np.linalg.inv(scene.filters.shape), error)
    assert forms.max() < 1.05
    assert np.sqrt(np.trace(scene.filters.shape[:, :3, :3], axis1=1, axis2=2)).max() < 0.1


def test_one_filter_goes_on_by_itself():
    scene = Scene(4, FLOWS["gyro"], mode="paper")
    inputs = scene.inputs()
    scene.filters.predict(0.7, **inputs)
    single = scene.filters[-1]
    assert isinstance(single, el.AttitudeFilter)
    assert single.mode == "paper"
    assert single.time == 0.7
    np.testing.assert_array_equal(single.transition, scene.filters.transition[3])
    np.testing.assert_array_equal(single.prior_shape, scene.filters.prior_shape[3])
    single.predict(0.8, gyro=[0, 0, 0.1])
    assert scene.filters.time == 0.7
    with pytest.raises(IndexError, match="there are 4 filters, so that there is none at 4"):
        scene.filters[4]
    with pytest.raises(TypeError):
        scene.filters["1"]
    assert len(list(scene.filters)) == len(scene.filters) == 4


def test_filters_are_stored_by_pickle():
    scene = Scene(5, FLOWS["sum"], criterion="weighted_trace", weight=WEIGHT)
    scene.filters.predict(0.7)
    stored = pickle.loads(pickle.dumps(scene.filters))
    assert repr(stored) == "<AttitudeFilters: 5, time 0.7 s, mode 'first_order'>"
    for each in (stored, scene.filters):
        each.predict(0.8)
    for field in ("attitude", "vector", "shape", "transition", "prior_shape", "weight"):
        np.testing.assert_array_equal(getattr(stored, field), getattr(scene.filters, field))


def test_arguments_may_be_of_all_filters():
    filters = el.AttitudeFilters(FLOWS["gyro"], Rotation.from_matrix(np.eye(3)), np.zeros((6, 3)), 0.01 * np.eye(6))
    filters.predict(0.1, gyro=[0.1, 0.2, 0.3])
    filters.update(directions=np.eye(3), reference=np.eye(3), bounds=0.1)
    np.testing.assert_array_equal(filters.shape, np.broadcast_to(filters.shape[0], (6, 6, 6)))
    none = el.AttitudeFilters(FLOWS["free"], np.zeros((0, 3, 3)), np.zeros(3), 0.01 * np.eye(6))
    none.predict(1.0)
    updates = none.update(angular_velocity=[0, 0, 0], rate_bound=0.1)
    assert len(none) == len(updates.used) == 0


DIRECTIONS = {"directions": np.eye(3), "reference": np.eye(3), "bounds": 0.1}


@pytest.mark.parametrize(
    ("name", "method", "arguments", "error", "words"),
    [
        ("free", "predict", {"time": -1.0}, ValueError, "time must not go backwards, but is -1 s after 0 s"),
        ("free", "predict", {"time": 1e9}, ValueError, "steps"),
        ("free", "predict", {"time": 1.0, "gyro": [0, 0, 0]}, TypeError, "gyro is the input of a GyroFlow"),
        ("free", "predict", {"time": 1.0, "threads": 0}, ValueError, "threads must be at least 1, but is 0"),
        ("free", "predict", {"time": 1.0, "control_torque": np.zeros((4, 3))}, ValueError, r"\(3,\) or \(3, 3\)"),
        ("gyro", "predict", {"time": 1.0}, TypeError, "needs gyro"),
        ("gyro", "predict", {"time": 1.0, "gyro": [0, 0, 0], "control_torque": [0, 0, 0]}, TypeError, "no torque"),
        ("free", "update", {}, ValueError, "update needs directions, angular_velocity or both"),
        ("free", "update", {"directions": np.eye(3)}, ValueError, "directions need reference and bounds"),
        ("free", "update", DIRECTIONS | {"directions": np.zeros((2, 3, 3))}, ValueError, r"or \(3, m, 3\)"),
        ("free", "update", DIRECTIONS | {"directions": np.ones((33, 3))}, ValueError, "at most 32"),
        ("free", "update", DIRECTIONS | {"bounds": -0.1}, ValueError, "bounds"),
        (
            "free",
            "update",
            DIRECTIONS | {"reference": np.zeros((3, 3))},
            ValueError,
            r"reference\[0, 0\] has no length",
        ),
        ("free", "update", {"angular_velocity": [0, 0, 0]}, ValueError, "angular_velocity needs rate_bound"),
        ("free", "update", DIRECTIONS | {"on_inconsistent": "ask"}, ValueError, "on_inconsistent must be"),
        ("gyro", "update", {"angular_velocity": [0, 0, 0], "rate_bound": 1}, TypeError, "cannot update a GyroFlow"),
    ],
)
def test_bad_arguments(name, method, arguments, error, words):
    filters = el.AttitudeFilters(FLOWS[name], np.eye(3), np.zeros((3, 3)), 0.01 * np.eye(6))
    with pytest.raises(error, match=words):
        getattr(filters, method)(**arguments)


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"flow": 3}, TypeError, "flow must be a RigidBodyFlow or a GyroFlow, not int"),
        ({"attitude": 2 * np.eye(3)}, ValueError, "attitude must be a rotation"),
        ({"shape": -np.eye(6)}, ValueError, r"shape\[0\]"),
        ({"vector": np.zeros(3)}, ValueError, "one dimension before that of each"),
        ({"mode": "exact"}, ValueError, "mode must be 'paper' or 'first_order', not 'exact'"),
        ({"criterion": "length"}, ValueError, "criterion must be"),
        ({"time": np.nan}, ValueError, "time"),
    ],
)
def test_filters_that_cannot_be(arguments, error, words):
    given = {"flow": FLOWS["free"], "attitude": np.eye(3), "vector": np.zeros((2, 3)), "shape": np.eye(6)} | arguments
    with pytest.raises(error, match=words):
        el.AttitudeFilters(**given)


def test_control_c_ends_a_long_prediction():
    program = """
        import numpy as np
        import elliptude as el

        flow = el.RigidBodyFlow(el.RigidBody([1.0, 2.0, 2.5]), step=1e-3, most_steps=10**9)
        filters = el.AttitudeFilters(flow, np.eye(3), np.ones((1000, 3)), 0.01 * np.eye(6))
        print("ready", flush=True)
        filters.predict(1e5)
    """
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(program)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=300)
    assert errors.rstrip().endswith("KeyboardInterrupt")
