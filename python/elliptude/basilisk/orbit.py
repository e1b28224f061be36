"""A spacecraft in Basilisk that points to the Earth for one orbit, with elliptude in its loop: docs/basilisk.md."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from Basilisk.architecture import messaging
from Basilisk.fswAlgorithms import attTrackingError, hillPoint, mrpFeedback, rwMotorTorque
from Basilisk.simulation import (
    GravityGradientEffector,
    coarseSunSensor,
    eclipse,
    imuSensor,
    reactionWheelStateEffector,
    simpleNav,
    spacecraft,
    starTracker,
)
from Basilisk.utilities import SimulationBaseClass, macros, orbitalMotion, simIncludeGravBody, simIncludeRW
from numpy.typing import NDArray

from elliptude._core import GuaranteedGyroFlow, StateEllipsoid, log
from elliptude.basilisk.conversion import attitude_from_mrp
from elliptude.basilisk.estimator import AttitudeEstimator
from elliptude.basilisk.gyro import turn_rate_error
from elliptude.basilisk.sun_sensors import SunSensors
from elliptude.guaranteed import GuaranteedFilter
from elliptude.typing import FloatArray

INERTIA = np.diag([900.0, 800.0, 600.0])
"""The spacecraft with its wheels, kg m²."""
WHEEL_TORQUE = 0.2
"""The most that each of the three wheels can give, N m."""
WHEEL_MOMENTUM = 12.0
"""What a wheel holds at most, N m s."""
OTHER_TORQUE = 1e-3
"""Bound of the gravity gradient, N m: the only other torque."""
LARGEST_RATE = 0.015
"""The body turns no faster, rad/s."""
GYRO_BIAS = np.deg2rad([3e-4, -4e-4, 2e-4])
"""rad/s, body axes; the estimator only knows that it is within BIAS_BOUND."""
BIAS_BOUND = math.radians(1e-3)
GYRO_ERROR = math.radians(2e-5)
"""Bound of each axis' noise, rad/s."""
TRACKER_ERROR = np.deg2rad(np.array([10.0, 10.0, 60.0]) / 3600.0)
"""Bound of each component of the star tracker's error, rad, body axes: it looks along z."""
COSINE_ERROR = 0.003
"""Bound of each cosine of the Sun sensors."""
SUN_NORMALS = np.array([[x, y, z] for x in (1, -1) for y in (1, -1) for z in (1, -1)]) / math.sqrt(3.0)
"""Where eight Sun sensors look, body axes."""
SUN = np.array([-0.3, 0.9, 0.2]) / np.linalg.norm([-0.3, 0.9, 0.2])
"""Direction from the Earth's center to the Sun, axes of N."""
SUN_DISTANCE = orbitalMotion.AU * 1000.0
ORBIT_RADIUS = 7.0e6
"""m."""
ORBIT = 5829.0
"""s, one turn about the Earth."""
STEP = 0.01
"""A step of the dynamics, s."""
GYRO_STEP, TRACKER_STEP, SUN_STEP = 1.0, 2.0, 10.0
"""s."""
BLIND_FROM, BLIND_TO = 2400.0, 3000.0
"""The star tracker is off, s."""


def wheel_inertia() -> float:
    """The inertia of a wheel about its axis, kg m²: it holds WHEEL_MOMENTUM at 6000 turns a minute."""
    return float(WHEEL_MOMENTUM / (6000.0 * macros.RPM))


def largest_acceleration() -> float:
    """Bound of the angular acceleration, rad/s²: Euler's equation with what is stated above.

    J ω' = −ω × (I ω + h) − u + L, where J is the inertia I less the wheels' own about their axes. A multiple of the
    identity has no part in ω × I ω, which is at most half of the difference between the largest and the least moment
    times the square of the rate.
    """
    moments = np.linalg.eigvalsh(INERTIA)
    wheels = wheel_inertia()
    torques = math.sqrt(3.0) * WHEEL_TORQUE + OTHER_TORQUE
    gyroscopic = LARGEST_RATE * (math.sqrt(3.0) * WHEEL_MOMENTUM + 0.5 * (moments[-1] - moments[0]) * LARGEST_RATE)
    return float((torques + gyroscopic) / (moments[0] - wheels))


@dataclass(frozen=True)
class Flight:
    """What was recorded at each update of the estimator."""

    times: FloatArray
    """s, shape (N,)."""
    true_attitudes: FloatArray
    """Body to N, shape (N, 3, 3)."""
    attitudes: FloatArray
    """Centers of the sets, shape (N, 3, 3); NaN without a set."""
    biases: FloatArray
    """The gyro's bias, centers of the sets, rad/s, shape (N, 3)."""
    shapes: FloatArray
    """P of the sets in the Gibbs chart, shape (N, 6, 6)."""
    angles: FloatArray
    """How far the attitude may be off from the center, rad, shape (N,)."""
    claims: list[str]
    """What each set rests on, N of them."""
    pointing: FloatArray
    """Angle between the body and where it should point, rad, shape (M, 2): the time, s, beside it."""
    sunlight: FloatArray
    """Share of the Sun that the spacecraft sees, shape (N,)."""

    def errors(self) -> FloatArray:
        """The error of each center as a rotation vector, rad, body axes, shape (N, 3); NaN without a set."""
        known = np.array([claim != "none" for claim in self.claims])
        errors = np.full((len(known), 3), np.nan)
        errors[known] = log(np.swapaxes(self.attitudes[known], 1, 2) @ self.true_attitudes[known])
        return errors

    def forms(self) -> FloatArray:
        """Where true attitude and true bias are in each set: the form, at most 1 inside; NaN without a set."""
        return np.array([np.nan if one is None else one.quadratic_form(*truth) for one, truth in self._sets()])

    def inside(self) -> NDArray[np.bool_]:
        """Whether true attitude and true bias are in each set, shape (N,); False where there is none."""
        return np.array([one is not None and one.contains(*truth) for one, truth in self._sets()])

    def _sets(self) -> Iterator[tuple[StateEllipsoid | None, tuple[FloatArray, FloatArray]]]:
        """Each set, or None, and the true state."""
        rows = zip(self.claims, self.attitudes, self.biases, self.shapes, self.true_attitudes, strict=True)
        for claim, attitude, bias, shape, truth in rows:
            known = None if claim == "none" else StateEllipsoid(attitude, bias, shape, "gibbs")
            yield known, (truth, GYRO_BIAS)


class Orbit:
    """The simulation: `execute` runs it, `recorded` has what came of it.

    Parameters
    ----------
    step : float
        Of the dynamics, s.
    seed : int
        Of the sensors' errors.
    estimator : bool
        Whether the controller uses elliptude's estimate. If not it has the truth, and there is no estimator: what the
        simulation costs without.
    record : bool
        Whether the sets are recorded, for `recorded`.
    """

    def __init__(self, step: float = STEP, seed: int = 1, estimator: bool = True, record: bool = True) -> None:
        self._step = step
        self._seed = seed
        self.simulation = SimulationBaseClass.SimBaseClass()
        process = self.simulation.CreateNewProcess("process")
        # At one instant: first the dynamics, then sensors, then the estimator, then the controller.
        steps = {"dynamics": step, "gyro": GYRO_STEP, "tracker": TRACKER_STEP, "sun": SUN_STEP, "navigation": GYRO_STEP}
        for priority, (task, each) in enumerate(steps.items()):
            process.addTask(self.simulation.CreateNewTask(task, macros.sec2nano(each)), 50 - priority)
        # The gyro has no sample at time 0, so that the controller begins after that.
        first = macros.sec2nano(GYRO_STEP)
        process.addTask(self.simulation.CreateNewTask("control", first, FirstStart=first), 0)
        self._kept: list[Any] = []
        self._add_spacecraft()
        self._add_sun()
        self._add_sensors()
        self.estimator = self._add_estimator() if estimator else None
        self._add_controller()
        self._add_recorders(record)

    def execute(self, duration: float = ORBIT) -> None:
        """Run it; the star tracker sees nothing from BLIND_FROM to BLIND_TO."""
        self.simulation.InitializeSimulation()
        for until, sees in ((BLIND_FROM, True), (BLIND_TO, False), (duration, True)):
            (self.simulation.enableTask if sees else self.simulation.disableTask)("tracker")
            self.simulation.ConfigureStopTime(macros.sec2nano(min(until, duration)))
            self.simulation.ExecuteSimulation()

    def recorded(self) -> Flight:
        """What the recorders have."""
        sets, truth = self._sets, self._truth
        return Flight(
            times=truth.times() * macros.NANO2SEC,
            true_attitudes=attitude_from_mrp(truth.sigma_BN),
            attitudes=sets.attitude,
            biases=sets.bias,
            shapes=sets.shape,
            angles=sets.largest_angle,
            claims=sets.claim.tolist(),
            pointing=np.column_stack(
                [
                    self._guidance.times() * macros.NANO2SEC,
                    4.0 * np.arctan(np.linalg.norm(self._guidance.sigma_BR, axis=1)),
                ]
            ),
            sunlight=self._sunlight.shadowFactor,
        )

    def _add(self, task: str, module: Any, name: str, priority: int = -1) -> Any:
        """A module in a task; Basilisk does not keep what Python made."""
        module.ModelTag = name
        self.simulation.AddModelToTask(task, module, priority)
        self._kept.append(module)
        return module

    def _add_spacecraft(self) -> None:
        """The body, its wheels, and gravity with its gradient."""
        body = spacecraft.Spacecraft()
        body.hub.mHub = 750.0
        body.hub.r_BcB_B = [[0.0], [0.0], [0.0]]
        body.hub.IHubPntBc_B = INERTIA.tolist()
        bodies = simIncludeGravBody.gravBodyFactory()
        earth = bodies.createEarth()
        earth.isCentralBody = True
        bodies.addBodiesTo(body)
        elements = orbitalMotion.ClassicElements()
        elements.a, elements.e, elements.i = ORBIT_RADIUS, 0.001, 0.9
        elements.Omega, elements.omega, elements.f = 0.3, 0.2, 0.1
        body.hub.r_CN_NInit, body.hub.v_CN_NInit = orbitalMotion.elem2rv(earth.mu, elements)
        body.hub.sigma_BNInit = [[0.1], [0.2], [-0.3]]
        body.hub.omega_BN_BInit = [[0.001], [-0.002], [0.001]]
        self._wheel_factory = simIncludeRW.rwFactory()
        for axis, speed in zip(np.eye(3).tolist(), (100.0, 200.0, 300.0), strict=True):
            self._wheel_factory.create("Honeywell_HR12", axis, maxMomentum=WHEEL_MOMENTUM, Omega=speed)
        self._wheels = reactionWheelStateEffector.ReactionWheelStateEffector()
        self._wheel_factory.addToSpacecraft("spacecraft", self._wheels, body)
        gradient = GravityGradientEffector.GravityGradientEffector()
        gradient.addPlanetName(earth.planetName)
        body.addDynamicEffector(gradient)
        self._add("dynamics", self._wheels, "wheels", 3)
        self._add("dynamics", gradient, "gradient", 2)
        self._spacecraft = self._add("dynamics", body, "spacecraft", 1)
        self._kept += [bodies, earth]

    def _add_sun(self) -> None:
        """The Sun's place, the Earth's shadow, and eight Sun sensors."""
        self._sun = _message(messaging.SpicePlanetStateMsg, PositionVector=(SUN * SUN_DISTANCE).tolist())
        earth = _message(messaging.SpicePlanetStateMsg, PlanetName="earth")
        shadow = eclipse.Eclipse()
        shadow.sunInMsg.subscribeTo(self._sun)
        shadow.addPlanetToModel(earth)
        shadow.addSpacecraftToModel(self._spacecraft.scStateOutMsg)
        self._add("sun", shadow, "eclipse", 3)
        self._shadow = shadow.eclipseOutMsgs[0]
        constellation = coarseSunSensor.CSSConstellation()
        for number, normal in enumerate(SUN_NORMALS):
            sensor = coarseSunSensor.CoarseSunSensor()
            sensor.nHat_B = normal.tolist()
            sensor.fov = 0.5 * math.pi
            sensor.senNoiseStd, sensor.walkBounds = COSINE_ERROR, COSINE_ERROR
            sensor.RNGSeed = 100 * self._seed + number
            sensor.sunInMsg.subscribeTo(self._sun)
            sensor.stateInMsg.subscribeTo(self._spacecraft.scStateOutMsg)
            sensor.sunEclipseInMsg.subscribeTo(self._shadow)
            constellation.appendCSS(sensor)
            self._kept.append(sensor)
        self._sun_sensors = self._add("sun", constellation, "sun_sensors", 2)
        self._kept.append(earth)

    def _add_sensors(self) -> None:
        """Gyro and star tracker: white noise that ends at its bounds."""
        self._gyro = self._add("gyro", imuSensor.ImuSensor(), "gyro")
        self._gyro.scStateInMsg.subscribeTo(self._spacecraft.scStateOutMsg)
        self._gyro.senRotBias = GYRO_BIAS.tolist()
        self._gyro.PMatrixGyro = (GYRO_ERROR * np.eye(3)).tolist()
        self._gyro.setAMatrixGyro(np.zeros((3, 3)))
        self._gyro.setErrorBoundsGyro(np.full(3, GYRO_ERROR))
        self._gyro.RNGSeed = 100 * self._seed + 50
        self._tracker = self._add("tracker", starTracker.StarTracker(), "tracker")
        self._tracker.scStateInMsg.subscribeTo(self._spacecraft.scStateOutMsg)
        self._tracker.PMatrix = np.diag(TRACKER_ERROR).tolist()
        self._tracker.setAMatrix(np.zeros((3, 3)))
        self._tracker.setWalkBounds(TRACKER_ERROR)
        self._tracker.RNGSeed = 100 * self._seed + 51

    def _add_estimator(self) -> AttitudeEstimator:
        """elliptude, which is told the sensors' bounds, and nothing of the body but how fast it may turn."""
        acceleration = largest_acceleration()
        noise = math.sqrt(3.0) * GYRO_ERROR  # three components within GYRO_ERROR lie in this ball
        flow = GuaranteedGyroFlow(
            noise + turn_rate_error(GYRO_STEP, LARGEST_RATE, acceleration),
            angular_acceleration=acceleration,
            interval_rate="mean",
            longest_interval=GYRO_STEP * (1.0 + 1e-9),  # stamps are rounded
            largest_rate=LARGEST_RATE,
        )
        module = AttitudeEstimator(GuaranteedFilter(flow, vector_bound=BIAS_BOUND))
        module.imuInMsg.subscribeTo(self._gyro.sensorOutMsg)
        module.add_star_tracker(self._tracker.sensorOutMsg, np.diag(3.0 * TRACKER_ERROR**2))
        sensors = SunSensors(SUN_NORMALS, COSINE_ERROR)
        module.add_sun_sensors(
            self._sun_sensors.constellationOutMsg, sensors, self._sun, 1.1 * ORBIT_RADIUS / SUN_DISTANCE
        )
        self._add("navigation", module, "elliptude", 2)
        return module

    def _add_controller(self) -> None:
        """Basilisk's own: where to point, how far from that, what torque, for which wheel."""
        truth = self._add("navigation", simpleNav.SimpleNav(), "orbit_known", 3)
        truth.scStateInMsg.subscribeTo(self._spacecraft.scStateOutMsg)
        target = self._add("control", hillPoint.hillPoint(), "target", 4)
        target.transNavInMsg.subscribeTo(truth.transOutMsg)
        error = self._add("control", attTrackingError.attTrackingError(), "error", 3)
        error.attNavInMsg.subscribeTo(truth.attOutMsg if self.estimator is None else self.estimator.navAttOutMsg)
        error.attRefInMsg.subscribeTo(target.attRefOutMsg)
        wheels = self._wheel_factory.getConfigMessage()
        body = _message(messaging.VehicleConfigMsg, ISCPntB_B=INERTIA.ravel().tolist())
        control = self._add("control", mrpFeedback.mrpFeedback(), "control", 2)
        control.K, control.P, control.Ki, control.integralLimit = 1.0, 30.0, -1.0, 0.0
        control.guidInMsg.subscribeTo(error.attGuidOutMsg)
        control.vehConfigInMsg.subscribeTo(body)
        control.rwParamsInMsg.subscribeTo(wheels)
        control.rwSpeedsInMsg.subscribeTo(self._wheels.rwSpeedOutMsg)
        torque = self._add("control", rwMotorTorque.rwMotorTorque(), "torque", 1)
        torque.controlAxes_B = np.eye(3).ravel().tolist()
        torque.rwParamsInMsg.subscribeTo(wheels)
        torque.vehControlInMsg.subscribeTo(control.cmdTorqueOutMsg)
        self._wheels.rwMotorCmdInMsg.subscribeTo(torque.rwMotorTorqueOutMsg)
        # What would be the error if the truth was known: for the picture alone.
        true_error = self._add("control", attTrackingError.attTrackingError(), "true_error", 3)
        true_error.attNavInMsg.subscribeTo(truth.attOutMsg)
        true_error.attRefInMsg.subscribeTo(target.attRefOutMsg)
        self._true_error = true_error
        self._kept += [wheels, body]

    def _add_recorders(self, record: bool) -> None:
        """After the estimator, at its instants."""
        self._truth = self._add("navigation", self._spacecraft.scStateOutMsg.recorder(), "truth", 0)
        self._sunlight = self._add("navigation", self._shadow.recorder(), "sunlight", 0)
        self._guidance = self._add("control", self._true_error.attGuidOutMsg.recorder(), "guidance", 0)
        if record and self.estimator is not None:
            kept = ["attitude", "bias", "shape", "largest_angle", "claim"]
            self._sets = self._add("navigation", self.estimator.logger(kept), "sets", 0)


def _message(kind: Any, **fields: Any) -> Any:
    """A message that does not change."""
    payload = getattr(messaging, f"{kind.__name__}Payload")()
    for name, value in fields.items():
        setattr(payload, name, value)
    return kind().write(payload)
