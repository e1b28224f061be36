"""A guaranteed filter as a module of a simulation in Basilisk."""

import copy
import math
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from Basilisk.architecture import messaging, sysModel
from numpy.typing import ArrayLike

from elliptude._core import GuaranteedGyroFlow, StateEllipsoid, is_rotation, rotation_from_quaternion
from elliptude.basilisk.conversion import mrp_from_attitude
from elliptude.basilisk.sun_sensors import SunSensors
from elliptude.bounds.arguments import require_not_negative
from elliptude.guaranteed import GuaranteedFilter
from elliptude.typing import FloatArray

_NANOSECONDS = 1e9
"""In a second: Basilisk counts these."""
_UNKNOWN = np.full(3, np.nan)


@dataclass(kw_only=True)
class _Sensor:
    """What a sensor writes, and when that was last read."""

    name: str
    message: Any
    read_at: int = -1

    def is_new(self) -> bool:
        """Whether it has written since it was last asked."""
        written = self.message.timeWritten()
        if written == self.read_at or not self.message.isWritten():
            return False
        self.read_at = written
        return True


@dataclass(kw_only=True)
class _StarTracker(_Sensor):
    bound: FloatArray | float
    largest_angle: float
    """The largest angle that the bound allows, rad."""
    dcm_cb: FloatArray | None
    """From the body's axes to the case's; None if they are the same."""


@dataclass(kw_only=True)
class _SunSensors(_Sensor):
    sensors: SunSensors
    ephemeris: _Sensor
    ephemeris_bound: float


class AttitudeEstimator(sysModel.SysModel):  # type: ignore[misc]
    """A `GuaranteedFilter` that reads Basilisk's sensors and writes a navigation message for its controllers.

    Each time it is called, it predicts to the newest gyro sample (`imuInMsg`), fuses what star trackers and Sun sensors
    have written since, and writes attitude and rate to `navAttOutMsg` (`NavAttMsgPayload`: `sigma_BN`, `omega_BN_B`,
    `vehSunPntBdy`, and as `timeTag` the time of the set). It writes nothing while it knows no attitude or no
    rate. The set is in
    `ellipsoid`; ``estimator.logger(["attitude", "bias", "shape"])`` keeps the sets of a run.

    Sensors must run after the spacecraft's dynamics in a step, and this module after them: Basilisk stamps a message
    when it writes it, and a sensor that ran first would show the state of the step before.

    Parameters
    ----------
    estimator : GuaranteedFilter
        With a `GuaranteedGyroFlow`. If its `interval_rate` is 'mean_of_ends', the module uses Basilisk's
        `AngVelPlatform`, the angular velocity at one instant, and the flow's `angular_acceleration` bounds what it does
        between two. If it is 'mean', it uses `DRFramePlatform`, the turn since the IMU's last call, as of a gyro that
        integrates; the flow's `noise` then includes `turn_rate_error`, and its `longest_interval` is the IMU's step.
        The flow's `largest_rate` bounds how far the body turns where samples are missing or stamps differ. The module
        uses a copy, and begins with one again after each reset.
    dcm_PB : (3, 3) array_like, optional
        From the body's to the platform's axes, of the gyro; the identity if omitted.

    Raises
    ------
    TypeError, ValueError
        If the filter is not one of a gyro as above, or the matrix is not a rotation.
    """

    def __init__(self, estimator: GuaranteedFilter, dcm_PB: ArrayLike | None = None) -> None:
        super().__init__()
        self.imuInMsg = messaging.IMUSensorMsgReader()
        self.navAttOutMsg = messaging.NavAttMsg()
        self._payload = messaging.NavAttMsgPayload()
        self._given = copy.deepcopy(estimator)
        self._integrates, self._largest_rate = _gyro_of(estimator)
        self._to_body = None if dcm_PB is None else _rotation("dcm_PB", dcm_PB).T
        self._trackers: list[_StarTracker] = []
        self._sun: list[_SunSensors] = []
        self._begin()

    def add_star_tracker(
        self, message: Any, bound: ArrayLike, dcm_CB: ArrayLike | None = None, name: str | None = None
    ) -> None:
        """Subscribe to a star tracker.

        Parameters
        ----------
        message : STSensorMsg
            Basilisk's `starTracker.sensorOutMsg`.
        bound : float or (3, 3) array_like
            How far the attitude may be off: an angle, rad, or the shape of an ellipsoid, rad², body axes.
        dcm_CB : (3, 3) array_like, optional
            From the body's to the case's axes; the identity if omitted.
        name : str, optional
            In messages and in `dropped`; "star_tracker_1" and so on if omitted.

        Raises
        ------
        ValueError
            If the bound or the matrix is not one.
        """
        stated = np.asarray(bound, dtype=np.float64)
        if stated.shape not in ((), (3, 3)) or not np.isfinite(stated).all() or not np.array_equal(stated, stated.T):
            raise ValueError(f"bound must be a finite angle or a symmetric shape (3, 3), not {bound!r}")
        least, *_, most = (
            [float(stated)] * 2 if stated.shape == () else np.sqrt(np.maximum(np.linalg.eigvalsh(stated), 0.0))
        )
        if not 0.0 < least <= most < np.pi:
            raise ValueError(f"bound must be above 0 and below pi, in all directions if it is a shape, not {bound!r}")
        reader = messaging.STSensorMsgReader()
        reader.subscribeTo(message)
        self._trackers.append(
            _StarTracker(
                name=name or f"star_tracker_{len(self._trackers) + 1}",
                message=reader,
                bound=stated if stated.shape else float(stated),
                largest_angle=float(most),
                dcm_cb=None if dcm_CB is None else _rotation("dcm_CB", dcm_CB),
            )
        )

    def add_sun_sensors(
        self, message: Any, sensors: SunSensors, sun: Any, sun_bound: float = 0.0, name: str | None = None
    ) -> None:
        """Subscribe to coarse Sun sensors.

        Parameters
        ----------
        message : CSSArraySensorMsg
            Basilisk's `CSSConstellation.constellationOutMsg`.
        sensors : SunSensors
            Their normals, in the constellation's order, and the bound of their errors.
        sun : SpicePlanetStateMsg
            Where the Sun is (`PositionVector`), from the origin of N.
        sun_bound : float
            How far the direction from the spacecraft to the Sun may be off from that, rad: at 7000 km from the Earth's
            center 4.7e-5 rad, and the error of the ephemeris.
        name : str, optional
            In messages and in `dropped`; "sun_1" and so on if omitted.

        Raises
        ------
        ValueError
            If `sun_bound` is negative or not finite.
        """
        require_not_negative("sun_bound", sun_bound)
        reader, ephemeris = messaging.CSSArraySensorMsgReader(), messaging.SpicePlanetStateMsgReader()
        reader.subscribeTo(message)
        ephemeris.subscribeTo(sun)
        self._sun.append(
            _SunSensors(
                name=name or f"sun_{len(self._sun) + 1}",
                message=reader,
                sensors=sensors,
                ephemeris=_Sensor(name="sun", message=ephemeris),
                ephemeris_bound=sun_bound,
            )
        )

    @property
    def ellipsoid(self) -> StateEllipsoid | None:
        """The set that holds attitude and gyro bias at `time`, or None if the attitude is not known."""
        return self._filter.ellipsoid

    @property
    def time(self) -> float:
        """When the set holds, s: the stamp of the last gyro sample."""
        return self._filter.time

    @property
    def claim(self) -> str:
        """What the set rests on: 'unconditional', 'conditional', or 'none' if there is no set."""
        return self._filter.claim

    @property
    def attitude(self) -> FloatArray:
        """Center of the set, body to N, shape (3, 3); NaN without a set, as the next three."""
        return np.full((3, 3), np.nan) if self.ellipsoid is None else self.ellipsoid.attitude

    @property
    def bias(self) -> FloatArray:
        """Center of the set, the gyro's bias, rad/s, body axes, shape (3,)."""
        return _UNKNOWN if self.ellipsoid is None else self.ellipsoid.vector

    @property
    def shape(self) -> FloatArray:
        """Shape of the set in the Gibbs chart, rad² and rad²/s², shape (6, 6)."""
        return np.full((6, 6), np.nan) if self.ellipsoid is None else self.ellipsoid.shape

    @property
    def largest_angle(self) -> float:
        """How far the attitude may be off from the center at most, rad."""
        return np.nan if self.ellipsoid is None else self.ellipsoid.extent().largest_angle

    def Reset(self, CurrentSimNanos: int) -> None:
        """What Basilisk calls before a run: forgets all that was measured."""
        if not self.imuInMsg.isLinked():
            raise ValueError("AttitudeEstimator.imuInMsg is not linked: imuInMsg.subscribeTo(imu.sensorOutMsg)")
        self._begin()

    def UpdateState(self, CurrentSimNanos: int) -> None:
        """What Basilisk calls at the rate of the module's task."""
        stamp = self.imuInMsg.timeWritten()
        if stamp > self._stamp and self.imuInMsg.isWritten():
            self._predict(stamp)
        if self._stamp < 0:
            return
        self._fuse()
        self._write(CurrentSimNanos)

    def _begin(self) -> None:
        """As before the first message."""
        self._filter = copy.deepcopy(self._given)
        self._stamp = -1
        self._platform_rate = _UNKNOWN
        self._sun_direction: FloatArray | None = None
        self.dropped: Counter[str | int] = Counter()
        """How many measurements of each sensor contradicted the others and were left out."""
        for sensor in [*self._trackers, *self._sun, *(one.ephemeris for one in self._sun)]:
            sensor.read_at = -1

    def _predict(self, stamp: int) -> None:
        """To the gyro's newest sample."""
        sample = self.imuInMsg()
        rate = np.array(sample.AngVelPlatform)
        if not rate.any():
            rate = given = _UNKNOWN  # what Basilisk's IMU writes at its first call; to call it missing is always safe
        elif self._integrates:
            # Before the first sample nothing is known.
            seconds = (stamp - self._stamp) / _NANOSECONDS if self._stamp >= 0 else np.nan
            given = np.array(sample.DRFramePlatform) / seconds
        else:
            given = 0.5 * (self._platform_rate + rate)
        self._filter.predict(stamp / _NANOSECONDS, gyro=given if self._to_body is None else self._to_body @ given)
        self._stamp, self._platform_rate = stamp, rate

    def _fuse(self) -> None:
        """What sensors have written since the last call; all directions with the first attitude."""
        attitudes = [seen for one in self._trackers if one.is_new() and (seen := self._attitude(one)) is not None]
        directions = [found for one in self._sun if one.is_new() and (found := self._direction(one)) is not None]
        while attitudes or directions:
            names = [one[0] for one in directions]
            given: dict[str, Any] = {}
            if directions:
                _, given["directions"], given["reference"], given["bounds"] = zip(*directions, strict=True)
            if attitudes:
                name, given["attitude"], given["attitude_bound"] = attitudes.pop(0)
                names.append(name)
            self.dropped.update(self._filter.update(**given, sensors=names).dropped)
            directions = []

    def _attitude(self, tracker: _StarTracker) -> tuple[str, FloatArray, FloatArray | float] | None:
        """What a star tracker shows: its name, the attitude, and how far that may be off."""
        seen = tracker.message()
        attitude = rotation_from_quaternion(seen.qInrtl2Case)  # case to N: Basilisk's parameters are those of [CN]
        if tracker.dcm_cb is not None:
            attitude = attitude @ tracker.dcm_cb
        turned = self._turn_since(seen.timeTag)
        if turned == 0.0:
            return tracker.name, attitude, tracker.bound
        angle = tracker.largest_angle + turned
        return (tracker.name, attitude, angle) if angle < np.pi else None

    def _direction(self, sun: _SunSensors) -> tuple[str, FloatArray, FloatArray, float] | None:
        """What Sun sensors show: their name, the direction in both axes, and how far it may be off."""
        if sun.ephemeris.is_new():
            position = np.array(sun.ephemeris.message().PositionVector)
            self._sun_direction = position / np.linalg.norm(position)
        if self._sun_direction is None:
            return None
        found = sun.sensors.direction(sun.message().CosValue[: len(sun.sensors.normals)])
        if found is None:
            return None
        direction, angle = found
        angle += sun.ephemeris_bound + self._turn_since(sun.read_at)
        return (sun.name, direction, self._sun_direction, angle) if angle < np.pi else None

    def _turn_since(self, stamp: int) -> float:
        """How far the body may turn between a stamp and the time of the set, rad."""
        apart = abs(self._stamp - stamp) / _NANOSECONDS
        return apart * self._largest_rate if apart > 0.0 else 0.0

    def _write(self, now: int) -> None:
        """The center of the set, for whoever navigates by it."""
        known = self._filter.ellipsoid
        if known is None or math.isnan(self._platform_rate[0]):
            return
        rate = self._platform_rate if self._to_body is None else self._to_body @ self._platform_rate
        attitude = known.attitude
        fields = {
            "timeTag": self._stamp / _NANOSECONDS,
            "sigma_BN": mrp_from_attitude(attitude).tolist(),
            "omega_BN_B": (rate - known.vector).tolist(),
        }
        if self._sun_direction is not None:
            fields["vehSunPntBdy"] = (self._sun_direction @ attitude).tolist()
        for name, value in fields.items():
            object.__setattr__(self._payload, name, value)  # without a check of the name, which takes longer
        self.navAttOutMsg.write(self._payload, now, self.moduleID)


def _gyro_of(estimator: GuaranteedFilter) -> tuple[bool, float]:
    """Whether the filter takes what a gyro integrated, and its largest rate, if it is one for Basilisk's gyro."""
    flow = getattr(estimator, "flow", None)
    if not isinstance(flow, GuaranteedGyroFlow):
        raise TypeError(f"estimator must be a GuaranteedFilter with a GuaranteedGyroFlow, not {estimator!r}")
    if flow.interval_rate not in ("mean", "mean_of_ends"):
        raise ValueError(f"estimator.flow.interval_rate must be 'mean' or 'mean_of_ends', not {flow.interval_rate!r}")
    if flow.interval_rate == "mean" and flow.longest_interval is None:
        raise ValueError(
            "estimator.flow.longest_interval must be stated if interval_rate is 'mean': the IMU's own step, s, as its "
            "turns are those since its last call"
        )
    if flow.largest_rate is None:
        raise ValueError("estimator.flow.largest_rate must be stated, rad/s")
    return flow.interval_rate == "mean", flow.largest_rate


def _rotation(name: str, matrix: ArrayLike) -> FloatArray:
    """A direction cosine matrix, checked."""
    array = np.asarray(matrix, dtype=np.float64)
    if array.shape != (3, 3) or not is_rotation(array):
        raise ValueError(f"{name} must be a rotation matrix (3, 3), not {matrix!r}")
    return array
