"""The module by itself: messages with a known motion and bounded errors go in, sets that hold the truth come out."""

import copy
import re

import numpy as np
import pytest

pytest.importorskip("Basilisk", reason="no Basilisk: pip install 'elliptude[basilisk]'")

import elliptude as el
from Basilisk.architecture import messaging
from Basilisk.utilities import RigidBodyKinematics, SimulationBaseClass
from elliptude.basilisk import AttitudeEstimator, SunSensors, attitude_from_mrp, mrp_from_attitude, turn_rate_error
from scipy.spatial.transform import Rotation

SECOND = 10**9
RATE, ACCELERATION = 0.06, 0.012
BIAS, BIAS_BOUND, NOISE = np.array([1e-4, -2e-4, 1e-4]), 3e-4, 1e-4
TRACKER, COSINE = 2e-3, 0.01
NORMALS = np.array([[x, y, z] for x in (1, -1) for y in (1, -1) for z in (1, -1)]) / np.sqrt(3.0)
SUN = np.array([0.6, 0.0, -0.8])
ALIGNED = np.eye(3)
DCM_PB = Rotation.from_euler("xyz", [0.4, -1.1, 2.0]).as_matrix()
DCM_CB = Rotation.from_euler("zyx", [-2.5, 0.7, 1.3]).as_matrix()


def motion(times):
    """A tumble: attitudes by SciPy from a rate with a bounded derivative, and that rate."""
    fine = np.arange(0.0, times[-1] + 1e-3, 1e-3)
    rates = np.stack([0.03 * np.cos(0.3 * fine), 0.03 * np.sin(0.3 * fine), np.full_like(fine, 0.04)], axis=1)
    attitude, attitudes = Rotation.from_rotvec([0.3, 2.0, -1.0]), []
    wanted = set(np.rint(times / 1e-3).astype(int))
    for k, rate in enumerate(rates):
        if k in wanted:
            attitudes.append(attitude.as_matrix())
        middle = 0.5 * (rate + rates[min(k + 1, len(rates) - 1)])
        attitude = attitude * Rotation.from_rotvec(middle * 1e-3)
    return np.array(attitudes), rates[np.rint(times / 1e-3).astype(int)]


TIMES = np.round(np.arange(0.0, 60.0, 0.1), 10)
ATTITUDES, RATES = motion(TIMES)


def flow(kind="mean", step=1.0, **options):
    noise = NOISE + (turn_rate_error(step, RATE, ACCELERATION) if kind == "mean" else 0.0)
    options = {
        "angular_acceleration": ACCELERATION,
        "largest_rate": RATE,
        "longest_interval": step * 1.000001,
    } | options
    return el.GuaranteedGyroFlow(noise, interval_rate=kind, **options)


class Sensors:
    """Writes what gyro, star tracker and Sun sensors see at TIMES[row]; their errors are anywhere in their bounds."""

    def __init__(self, dcm_PB=ALIGNED, dcm_CB=ALIGNED, seed=1):
        self.random = np.random.default_rng(seed)
        self.dcm_pb, self.dcm_cb, self.before = dcm_PB, dcm_CB, None
        self.imu, self.tracker, self.cosines = (
            messaging.IMUSensorMsg(), messaging.STSensorMsg(), messaging.CSSArraySensorMsg()
        )  # fmt: skip
        sun = messaging.SpicePlanetStateMsgPayload()
        sun.PositionVector = (SUN * 1.5e11).tolist()
        self.sun = messaging.SpicePlanetStateMsg().write(sun)

    def error(self, bound):
        vector = self.random.normal(size=3)
        return bound * vector / np.linalg.norm(vector) * self.random.choice([1.0, self.random.uniform()])

    def gyro(self, row):
        payload = messaging.IMUSensorMsgPayload()
        if self.before is not None:  # as Basilisk's: its first message is empty
            seconds = TIMES[row] - TIMES[self.before]
            turn = Rotation.from_matrix(ATTITUDES[self.before].T @ ATTITUDES[row]).as_rotvec()
            error = BIAS + self.error(NOISE)
            payload.DRFramePlatform = (self.dcm_pb @ (turn + error * seconds)).tolist()
            payload.AngVelPlatform = (self.dcm_pb @ (RATES[row] + error)).tolist()
        self.before = row
        self.imu.write(payload, round(TIMES[row] * SECOND))

    def star_tracker(self, row, seen=None):
        payload = messaging.STSensorMsgPayload()
        attitude = (
            Rotation.from_matrix(ATTITUDES[row]) * Rotation.from_rotvec(self.error(TRACKER)) if seen is None else seen
        )
        # By Basilisk's own functions: sigma_BN, [BN], then [CN] = [CB][BN], then its Euler parameters.
        dcm_bn = RigidBodyKinematics.MRP2C(mrp_from_attitude(attitude))
        payload.qInrtl2Case = RigidBodyKinematics.C2EP(self.dcm_cb @ dcm_bn).tolist()
        payload.timeTag = round(TIMES[row] * SECOND)
        self.tracker.write(payload, payload.timeTag)

    def sun_sensors(self, row):
        payload = messaging.CSSArraySensorMsgPayload()
        seen = np.maximum(NORMALS @ ATTITUDES[row].T @ SUN, 0.0) + self.random.uniform(-COSINE, COSINE, 8)
        payload.CosValue = np.maximum(seen, 0.0).tolist() + [0.0] * 24
        self.cosines.write(payload, round(TIMES[row] * SECOND))


def module(sensors, guaranteed, tracker=TRACKER, sun=True, **mounted):
    made = AttitudeEstimator(guaranteed, mounted.get("dcm_PB"))
    made.imuInMsg.subscribeTo(sensors.imu)
    if tracker is not None:
        made.add_star_tracker(sensors.tracker, tracker, mounted.get("dcm_CB"))
    if sun:
        made.add_sun_sensors(sensors.cosines, SunSensors(NORMALS, COSINE), sensors.sun)
    made.Reset(0)
    return made


def call(made, row):
    made.UpdateState(round(TIMES[row] * SECOND))


def fly(made, sensors):
    """Half a minute with all sensors."""
    for row in range(0, 300, 10):
        sensors.gyro(row)
        sensors.sun_sensors(row)
        sensors.star_tracker(row)
        call(made, row)


def is_inside(made, row):
    return made.ellipsoid is not None and bool(made.ellipsoid.contains(ATTITUDES[row], BIAS))


def test_conversions_are_those_of_basilisk():
    for attitude in ATTITUDES[::50]:
        sigma = mrp_from_attitude(attitude)
        np.testing.assert_allclose(RigidBodyKinematics.MRP2C(sigma), attitude.T, atol=1e-14)
        np.testing.assert_allclose(RigidBodyKinematics.C2MRP(attitude.T), sigma, atol=1e-14)
        np.testing.assert_allclose(attitude_from_mrp(sigma), attitude, atol=1e-14)


@pytest.mark.parametrize("kind", ["mean", "mean_of_ends"])
@pytest.mark.parametrize("mounted", [{}, {"dcm_PB": DCM_PB, "dcm_CB": DCM_CB}])
def test_the_truth_is_in_every_set(kind, mounted):
    sensors = Sensors(**mounted)
    made = module(sensors, el.GuaranteedFilter(flow(kind), vector_bound=BIAS_BOUND), **mounted)
    for row in range(0, len(TIMES), 10):
        sensors.gyro(row)
        sensors.sun_sensors(row)
        if row % 30 == 0:
            sensors.star_tracker(row)
        call(made, row)
        assert is_inside(made, row)
        assert made.claim == "unconditional"
        assert made.time == pytest.approx(TIMES[row], abs=1e-12)
        if row:
            told = made.navAttOutMsg.read()
            assert told.timeTag == made.time
            center = attitude_from_mrp(told.sigma_BN)
            np.testing.assert_allclose(center, made.attitude, atol=1e-14)
            off = Rotation.from_matrix(center.T @ ATTITUDES[row]).magnitude()
            assert off <= made.largest_angle
            # Between two samples of the rate the body may do more than an integrated turn leaves open.
            assert row < 30 or made.largest_angle < np.deg2rad(0.5 if kind == "mean" else 1.5)
            rate = sensors.dcm_pb.T @ sensors.imu.read().AngVelPlatform
            np.testing.assert_allclose(told.omega_BN_B, rate - made.bias, atol=1e-15)
            assert np.linalg.norm(np.array(told.omega_BN_B) - RATES[row]) <= NOISE + 2 * BIAS_BOUND
            np.testing.assert_allclose(told.vehSunPntBdy, center.T @ SUN, atol=1e-14)


@pytest.mark.parametrize("wrong", [{"dcm_PB": DCM_PB.T}, {"dcm_CB": DCM_CB.T}])
def test_a_mount_the_wrong_way_round_is_contradicted(wrong):
    sensors = Sensors(DCM_PB, DCM_CB)
    mounted = {"dcm_PB": DCM_PB, "dcm_CB": DCM_CB} | wrong
    made = module(sensors, el.GuaranteedFilter(flow(), vector_bound=BIAS_BOUND), **mounted)
    with pytest.raises(el.InconsistentMeasurement):
        fly(made, sensors)


@pytest.mark.parametrize("kind", ["mean", "mean_of_ends"])
def test_a_gyro_that_is_faster_than_the_module(kind):
    """Turns of the samples that were not read are lost: the set grows by all that the body may have turned."""
    sensors = Sensors()
    made = module(sensors, el.GuaranteedFilter(flow(kind, step=0.2), vector_bound=BIAS_BOUND))
    sizes = []
    for row in range(0, 300, 2):
        sensors.gyro(row)
        if row % 20 == 0:
            sensors.star_tracker(row)
        if row % 10 == 0:
            call(made, row)
            assert is_inside(made, row)
            sizes.append(made.largest_angle)
    assert max(sizes) > RATE  # in a second


def test_measurements_of_other_instants_count_for_less():
    """The star tracker's stamp is 0.3 s before the gyro's, the Sun sensors' 0.2 s behind it."""
    sensors = Sensors()
    made = module(sensors, el.GuaranteedFilter(flow(), vector_bound=BIAS_BOUND))
    for row in range(10, 500, 10):
        sensors.star_tracker(row - 3)
        sensors.gyro(row)
        sensors.sun_sensors(row + 2)
        call(made, row)
        assert is_inside(made, row)
    assert np.sqrt(2.0) * TRACKER < made.largest_angle < 1.5 * (TRACKER + 0.3 * RATE)


def test_nothing_is_fused_twice():
    """One measurement, and then the gyro alone: the filter by itself does the same."""
    sensors = Sensors()
    made = module(sensors, el.GuaranteedFilter(flow(), vector_bound=BIAS_BOUND))
    sensors.star_tracker(0)
    sensors.sun_sensors(0)
    sensors.gyro(0)
    call(made, 0)
    alone = copy.deepcopy(made._filter)
    for row in range(10, 100, 10):
        sensors.gyro(row)
        call(made, row)
        alone.predict(TIMES[row], gyro=np.array(sensors.imu.read().DRFramePlatform))
        np.testing.assert_allclose(made.shape, alone.ellipsoid.shape, rtol=1e-9, atol=1e-20)


def test_a_tracker_that_lies_is_dropped_and_counted():
    sensors = Sensors()
    guaranteed = el.GuaranteedFilter(flow(), vector_bound=BIAS_BOUND, policy="drop_measurement")
    made = module(sensors, guaranteed)
    for row in range(0, 400, 10):
        sensors.gyro(row)
        sensors.sun_sensors(row)
        lie = Rotation.from_matrix(ATTITUDES[row]) * Rotation.from_rotvec([0.2, 0.0, 0.0])
        sensors.star_tracker(row, lie if 200 <= row < 230 else None)
        call(made, row)
        assert is_inside(made, row)
    assert made.dropped == {"star_tracker_1": 3}
    made.Reset(0)
    assert not made.dropped


def test_a_shape_bounds_each_axis():
    """The second tracker knows the turn about its axis ten times worse."""
    sensors = Sensors()
    shape = np.diag([TRACKER, TRACKER, 10 * TRACKER]) ** 2
    made = module(sensors, el.GuaranteedFilter(flow(), vector_bound=BIAS_BOUND), shape, sun=False)
    sensors.gyro(0)
    sensors.star_tracker(0)
    call(made, 0)
    widths = made.ellipsoid.extent().half_widths_body[:3]
    # The set of attitude and bias in one ellipsoid holds the product of both, which takes √2.
    np.testing.assert_allclose(widths, np.sqrt(2.0) * np.array([TRACKER, TRACKER, 10 * TRACKER]), rtol=0.01)


def test_nothing_is_said_before_an_attitude_is_known():
    sensors = Sensors()
    made = module(sensors, el.GuaranteedFilter(flow(), vector_bound=BIAS_BOUND), sun=False)
    call(made, 0)  # no gyro yet
    for row in (0, 10, 20):
        sensors.gyro(row)
        call(made, row)
        assert (made.claim, made.ellipsoid) == ("none", None)
        assert np.isnan([*made.attitude.ravel(), *made.bias, *made.shape.ravel(), made.largest_angle]).all()
    reader = messaging.NavAttMsgReader()
    reader.subscribeTo(made.navAttOutMsg)
    assert not reader.isWritten()
    sensors.gyro(30)
    sensors.star_tracker(30)
    call(made, 30)
    assert reader.isWritten()


def test_a_reset_begins_again():
    sensors = Sensors()
    made = module(sensors, el.GuaranteedFilter(flow(), vector_bound=BIAS_BOUND))
    sensors.gyro(10)
    sensors.star_tracker(10)
    call(made, 10)
    assert made.claim == "unconditional"
    made.Reset(0)
    assert made.claim == "none"
    assert made.time == 0.0


@pytest.mark.parametrize(
    ("given", "error", "says"),
    [
        (3.0, TypeError, "estimator must be a GuaranteedFilter with a GuaranteedGyroFlow, not 3.0"),
        (el.GuaranteedFilter(flow("first_sample")), ValueError, "must be 'mean' or 'mean_of_ends', not 'first_sample'"),
        (el.GuaranteedFilter(flow(largest_rate=None)), ValueError, "flow.largest_rate must be stated, rad/s"),
        (el.GuaranteedFilter(flow(longest_interval=None)), ValueError, "flow.longest_interval must be stated"),
        (
            el.GuaranteedFilter(el.GuaranteedRigidBodyFlow(el.RigidBody([1, 2, 2]), step=0.1)),
            TypeError,
            "with a GuaranteedGyroFlow",
        ),
    ],
)
def test_a_filter_that_does_not_fit_is_refused(given, error, says):
    with pytest.raises(error, match=re.escape(says)):
        AttitudeEstimator(given)


def test_arguments_that_are_wrong_are_named():
    good = el.GuaranteedFilter(flow(), vector_bound=BIAS_BOUND)
    with pytest.raises(ValueError, match="dcm_PB must be a rotation matrix"):
        AttitudeEstimator(good, 2 * np.eye(3))
    made, sensors = AttitudeEstimator(good), Sensors()
    for bound in (0.0, -0.1, np.nan, 4.0, [0.1, 0.1], np.diag([1.0, 0.0, 1.0]), [[1, 1, 0], [0, 1, 0], [0, 0, 1]]):
        with pytest.raises(ValueError, match="bound must be"):
            made.add_star_tracker(sensors.tracker, bound)
    with pytest.raises(ValueError, match="dcm_CB must be a rotation matrix"):
        made.add_star_tracker(sensors.tracker, 0.1, np.ones((3, 3)))
    with pytest.raises(ValueError, match="sun_bound must be finite and at least 0, not -1"):
        made.add_sun_sensors(sensors.cosines, SunSensors(NORMALS, COSINE), sensors.sun, -1)


def test_what_is_not_linked_is_said_before_the_run(capfd):
    simulation = SimulationBaseClass.SimBaseClass()
    process = simulation.CreateNewProcess("process")
    process.addTask(simulation.CreateNewTask("task", SECOND))
    made = AttitudeEstimator(el.GuaranteedFilter(flow()))
    simulation.AddModelToTask("task", made)
    with pytest.raises(RuntimeError):
        simulation.InitializeSimulation()
    assert "imuInMsg is not linked: imuInMsg.subscribeTo(imu.sensorOutMsg)" in capfd.readouterr().err
