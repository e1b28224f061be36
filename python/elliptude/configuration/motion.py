"""How the body moves, as a configuration states it: a rigid body under torques, or a gyro."""

import math
from dataclasses import replace
from typing import Annotated, Literal, Self, TypeAlias

import numpy as np
from pydantic import Field, model_validator

import elliptude
from elliptude import units
from elliptude.bounds.gyro import GyroBounds
from elliptude.configuration.potentials import FreeBody, Potential
from elliptude.configuration.sensors import (
    Axes,
    Timed,
)
from elliptude.io.toml import (
    Columns,
    Count,
    Matrix,
    Model,
    NotNegative,
    NotNegativeBound,
    NotNegativeSizedBound,
    Positive,
    PositiveSize,
    SignedSize,
    Size,
    SizedBound,
    Vector,
)
from elliptude.typing import FloatArray

EARTH_RATE_DEG_PER_S = 0.0042
"""How fast the Earth turns, 360 degrees in 86164 s, rounded up."""
EARTHS_FRAMES = frozenset({"ENU", "NED", "NWU"})
"""Reference frames that turn with it."""
EarthRate: TypeAlias = Literal["removed"]
"""That the Earth's turn was taken off the rates."""


def require_earth_rate(
    earth_rate: EarthRate | None, gyro: GyroBounds, longest_window: float, *, place: str, since_rest: bool
) -> None:
    """Refuse bounds of a gyro that the Earth's turn alone breaks, (18.62): bias and noise have to leave room for it.

    Parameters
    ----------
    earth_rate : "removed", optional
    gyro : GyroBounds
    longest_window : float
        Over which what is said of turns by the noise holds, s; for bounds without such, any.
    place : str
        The table, for the message.
    since_rest : bool
        Whether what the gyro showed in a rest was taken off, and the Earth's turn as it was there with it.

    Raises
    ------
    ValueError
    """
    room = math.degrees(gyro.bias + gyro.lasting_noise(longest_window))
    # Turned over, a body sees the Earth turn the other way.
    needed = (2.0 if since_rest else 1.0) * (1.0 + gyro.scale_error) * EARTH_RATE_DEG_PER_S
    # What is stated as this very number has room, whatever its conversion is rounded to.
    if earth_rate is None and room < (1.0 - 1e-12) * needed:
        adds_up = np.isfinite(min(gyro.increment, gyro.noise_turn))
        over = f" over windows of {longest_window:g} s" if adds_up else ""
        rest = ", and turned over since its rest by as much again" if since_rest else ""
        scale = f"; with the scale error {needed:.4g}" if gyro.scale_error > 0.0 else ""
        raise ValueError(
            f"{place}: in axes of the Earth a gyro shows that these turn, by {EARTH_RATE_DEG_PER_S} deg/s{rest}{scale}"
            f", for which its bounds leave no room ({room:.4g}{over}): add it to bias_deg_per_s, or to the noise where "
            "the bias is estimated, or state earth_rate = 'removed' if it was taken off"
        )
    # Of the part that is no noise, as much changes while the body turns over as is not in the noise.
    change, turned = math.degrees(gyro.bias_change), 2.0 * (1.0 + gyro.scale_error) * EARTH_RATE_DEG_PER_S
    left = turned - 2.0 * math.degrees(gyro.lasting_noise(longest_window))
    if earth_rate is None and gyro.is_steady and change < (1.0 - 1e-12) * left:
        raise ValueError(
            f"{place}: in axes of the Earth a gyro shows that these turn, and turned over it shows the opposite: "
            f"{left:.4g} deg/s of that are not in the noise, but bias_change_deg_per_s is {change:.4g}: add it there, "
            "or state earth_rate = 'removed' if it was taken off"
        )


class RigidBodyFlow(Model):
    """The body's inertia and the torques on it are known; angular velocity is part of the state."""

    kind: Literal["rigid_body"]
    inertia_kg_m2: Vector | Matrix
    step_s: Positive
    order: Literal[2, 4, 6, 8] = 2
    potential: Potential = FreeBody()
    unknown_torque_n_m: NotNegativeBound = 0.0
    control_torque_columns: Columns | None = None
    # For the guaranteed mode: how far the inertia may be off (spectral norm), and the momentum of wheels within the
    # body, N m s, body axes, at each row; between two rows each component is between its two values.
    inertia_error_kg_m2: NotNegative = 0.0
    # For the guaranteed mode: the angular velocity is never larger. Without it and without a measured rate a log of
    # directions alone starts no set.
    largest_rate_deg_per_s: PositiveSize | None = None
    # A prediction over more steps is refused: such a time is more likely an error than intended.
    most_steps: Count = 1_000_000
    wheel_momentum_columns: Columns | None = None

    @model_validator(mode="after")
    def _is_a_body(self) -> Self:
        self.build()
        return self

    def guaranteed(self, of_wheels: float = 0.0, origin: int = 0) -> elliptude.GuaranteedRigidBodyFlow:
        """The core's guaranteed flow, of which the file's second ``origin`` is time 0.

        `of_wheels` is a torque, N m, that is not in the wheels' momentum.
        """
        inertia = np.asarray(self.inertia_kg_m2)
        body = elliptude.RigidBody(np.diag(inertia) if inertia.ndim == 1 else inertia)
        return elliptude.GuaranteedRigidBodyFlow(
            body,
            self.potential.build(body, origin),
            step=self.step_s,
            unknown_torque=self.unknown_torque_n_m + of_wheels or None,
            inertia_error=self.inertia_error_kg_m2,
            most_steps=self.most_steps,
        )

    def build(self, origin: int = 0) -> elliptude.RigidBodyFlow:
        """The core's flow, of which the file's second ``origin`` is time 0."""
        inertia = np.asarray(self.inertia_kg_m2)
        body = elliptude.RigidBody(np.diag(inertia) if inertia.ndim == 1 else inertia)
        potential = self.potential.build(body, origin)
        unknown_torque = self.unknown_torque_n_m or None
        return elliptude.RigidBodyFlow(
            body,
            potential,
            step=self.step_s,
            order=self.order,
            unknown_torque=unknown_torque,
            most_steps=self.most_steps,
        )


class GyroFlow(Timed):
    """The torques are not known, but a gyro measures the rate; its bias is part of the state."""

    kind: Literal["gyro"]
    columns: Columns
    unit: units.AngularVelocityUnit = "rad/s"
    axes: Axes = ("x", "y", "z")
    # The rate over an interval is the mean of the samples at its ends, or (for a gyro that integrates) the first one.
    # Between its samples, at another sensor's stamp, it is on the straight line, or still the one before.
    interval_rate: Literal["mean_of_ends", "first_sample"] = "mean_of_ends"
    noise_deg_per_s: SizedBound | None = None
    drift_deg_per_s2: NotNegativeSizedBound = 0.0
    # For the guaranteed mode.
    # A known bias is subtracted; what is left of it is at most the bias bound. It is an error like noise, or it
    # may be estimated if it moves no faster than the drift says (a bias that depends on the pose moves faster).
    known_bias_deg_per_s: tuple[SignedSize, SignedSize, SignedSize] = (0.0, 0.0, 0.0)
    bias_deg_per_s: Size = 0.0
    # How far it changes, beside the drift, within a window that an accelerometer or a magnetometer is averaged over.
    bias_change_deg_per_s: Size | None = None
    estimate_bias: bool = False
    scale_error: Annotated[Size, Field(lt=1)] = 0.0
    # How fast the rate changes between samples, if that is not part of the noise.
    angular_acceleration_deg_per_s2: Size = 0.0
    # The longest interval between samples that all of this covers; 1.5 times the usual one if left out. About a longer
    # one only the next two numbers are known, of the body; without them the attitude is forgotten.
    longest_interval_s: PositiveSize | None = None
    largest_rate_deg_per_s: PositiveSize | None = None
    largest_angular_acceleration_deg_per_s2: PositiveSize | None = None
    # Bound of the noise's integral over any window, and how far the noise by itself turns an integrated attitude away;
    # predictions span windows of this length, each from an anchor.
    increment_deg: PositiveSize | None = None
    noise_turn_deg: PositiveSize | None = None
    noise_turn_growth_deg_per_s: Size | None = None
    anchor_s: PositiveSize | None = None
    # Axes of the Earth turn with it, and a gyro shows that, unless it was taken off.
    earth_rate: EarthRate | None = None

    @model_validator(mode="after")
    def _predicts_over_windows(self) -> Self:
        for key in ("increment_deg", "noise_turn_deg"):
            if getattr(self, key) is not None and self.anchor_s is None:
                raise ValueError(f"{key} needs anchor_s, the length of the windows that a prediction spans")
        if self.noise_turn_growth_deg_per_s is not None and self.noise_turn_deg is None:
            raise ValueError("noise_turn_growth_deg_per_s needs noise_turn_deg, what it is added to")
        if self.anchor_s is not None and self.estimate_bias:
            raise ValueError("estimate_bias does not go with anchor_s: over a window the bias is an error of the turn")
        if self.anchor_s is not None and self.angular_acceleration_deg_per_s2:
            raise ValueError("angular_acceleration_deg_per_s2 does not go with anchor_s: take it into the noise")
        if self.anchor_s is not None and self.interval_rate != "mean_of_ends":
            raise ValueError("anchor_s needs interval_rate = 'mean_of_ends'")
        if self.estimate_bias and not self.bias_deg_per_s:
            raise ValueError("estimate_bias needs bias_deg_per_s, the bound of the bias")
        return self

    def bounds(self) -> GyroBounds:
        """Error bounds of the gyro, in SI units."""
        assert self.noise_deg_per_s is not None  # the configuration's check
        acceleration = self.largest_angular_acceleration_deg_per_s2 or self.angular_acceleration_deg_per_s2
        return GyroBounds(
            noise=math.radians(self.noise_deg_per_s),
            bias=math.radians(self.bias_deg_per_s),
            drift=math.radians(self.drift_deg_per_s2),
            scale_error=self.scale_error,
            increment=math.inf if self.increment_deg is None else math.radians(self.increment_deg),
            noise_turn=math.inf if self.noise_turn_deg is None else math.radians(self.noise_turn_deg),
            noise_turn_growth=math.radians(self.noise_turn_growth_deg_per_s or 0.0),
            longest_interval=math.inf if self.longest_interval_s is None else self.longest_interval_s,
            largest_rate=math.inf if self.largest_rate_deg_per_s is None else math.radians(self.largest_rate_deg_per_s),
            angular_acceleration=math.radians(acceleration) if acceleration else math.inf,
            bias_change=math.inf if self.bias_change_deg_per_s is None else math.radians(self.bias_change_deg_per_s),
        )

    def known_bias(self) -> FloatArray:
        """What is known of the gyro's bias, rad/s, shape (3,)."""
        return np.deg2rad(self.known_bias_deg_per_s)

    def require_earth_rate(self, longest_window: float) -> None:
        """Refuse bounds that the Earth's turn alone breaks; for axes that turn with it.

        `longest_window`, s, is that over which sensors are averaged, 0 if none is.
        """
        gyro, longest = self.bounds(), max(longest_window, self.anchor_s or 0.0)
        # A bias that is estimated is one of the body's axes, in which the Earth's turn changes with the attitude.
        gyro = replace(gyro, bias=0.0) if self.estimate_bias else gyro
        require_earth_rate(self.earth_rate, gyro, longest, place="flow", since_rest=False)

    def off_the_line(self, interval: float, drift: float = 0.0) -> float:
        """How far a rate between samples may be off because of the motion between them, rad/s; section 18.3.

        `drift`, rad/s², is of a bias that is followed from row to row; one that is in its bound at every time has none.
        """
        share = 0.5 if self.interval_rate == "mean_of_ends" else 1.0
        return share * (math.radians(self.angular_acceleration_deg_per_s2) + drift) * interval

    def build(self, origin: int = 0) -> elliptude.GyroFlow:
        """The core's flow, which no time matters to."""
        assert self.noise_deg_per_s is not None  # the configuration's check
        return elliptude.GyroFlow(math.radians(self.noise_deg_per_s), math.radians(self.drift_deg_per_s2))
