"""The first-order filter, and how to store it."""

import operator
from typing import Any, Self

import numpy as np

from elliptude import _core
from elliptude._potentials import potential_from_dict, potential_to_dict
from elliptude._stored import Stored


def _flow_to_dict(flow: _core.RigidBodyFlow | _core.GyroFlow) -> dict[str, Any]:
    if isinstance(flow, _core.GyroFlow):
        return {"kind": "gyro", "noise": flow.noise.tolist(), "drift": flow.drift.tolist()}
    return {
        "kind": "rigid_body",
        "inertia": flow.body.inertia.tolist(),
        "potential": potential_to_dict(flow.potential),
        "step": flow.step,
        "order": flow.order,
        "unknown_torque": flow.unknown_torque.tolist(),
        "most_steps": flow.most_steps,
    }


def _flow_from_dict(fields: dict[str, Any]) -> _core.RigidBodyFlow | _core.GyroFlow:
    match fields["kind"]:
        case "gyro":
            return _core.GyroFlow(np.asarray(fields["noise"]), np.asarray(fields["drift"]))
        case "rigid_body":
            return _core.RigidBodyFlow(
                _core.RigidBody(fields["inertia"]),
                potential_from_dict(fields["potential"]),
                step=fields["step"],
                order=fields["order"],
                unknown_torque=np.asarray(fields["unknown_torque"]),
                most_steps=fields.get("most_steps", 1_000_000),
            )
    raise ValueError(f"flow.kind is {fields['kind']!r}, which is neither gyro nor rigid_body")


class AttitudeFilter(_core.AttitudeFilter, Stored):  # noqa: D101
    __doc__ = _core.AttitudeFilter.__doc__
    FORMAT_VERSION = 1

    def __repr__(self) -> str:
        """One line: time, mode, and how far the attitude may be off."""
        size = np.rad2deg(self.ellipsoid.extent().largest_angle)
        return f"<AttitudeFilter: time {self.time:.6g} s, mode {self.mode!r}, within {size:.3g}°>"

    def to_dict(self) -> dict[str, Any]:
        """The whole state of the filter, as numbers, strings, lists and dictionaries.

        Raises
        ------
        TypeError
            If the flow has a potential written in Python, which only pickle can store.
        """
        return {
            "format": self.FORMAT_VERSION,
            "flow": _flow_to_dict(self.flow),
            "ellipsoid": self.ellipsoid.to_dict(),
            "time": self.time,
            "mode": self.mode,
            "criterion": self.criterion,
            "weight": None if self.weight is None else self.weight.tolist(),
            "transition": self.transition.tolist(),
            "prior_shape": self.prior_shape.tolist(),
        }

    @classmethod
    def _made_from(cls, fields: dict[str, Any]) -> Self:
        stored = cls(
            _flow_from_dict(fields["flow"]),
            _core.StateEllipsoid.from_dict(fields["ellipsoid"]),
            time=fields["time"],
            mode=fields["mode"],
            criterion=fields["criterion"],
            weight=fields["weight"],
        )
        stored._resume(fields["transition"], fields["prior_shape"])
        return stored

    def __getstate__(self) -> tuple[Any, ...]:
        """What pickle keeps; the flow is pickled, so a potential written in Python must be picklable."""
        return (
            self.flow,
            self.ellipsoid,
            self.time,
            self.mode,
            self.criterion,
            self.weight,
            self.transition,
            self.prior_shape,
        )

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        """Restores what `__getstate__` kept."""
        flow, ellipsoid, time, mode, criterion, weight, transition, prior_shape = state
        self.__init__(flow, ellipsoid, time=time, mode=mode, criterion=criterion, weight=weight)  # type: ignore[misc]
        self._resume(transition, prior_shape)


class AttitudeFilters(_core.AttitudeFilters):  # noqa: D101
    __doc__ = _core.AttitudeFilters.__doc__

    def __repr__(self) -> str:
        """One line: how many, time and mode."""
        return f"<AttitudeFilters: {len(self)}, time {self.time:.6g} s, mode {self.mode!r}>"

    def __getitem__(self, index: int) -> AttitudeFilter:
        """A copy of one filter, which goes on by itself."""
        number = operator.index(index)
        if not -len(self) <= number < len(self):
            raise IndexError(f"there are {len(self)} filters, so that there is none at {number}")
        alone = AttitudeFilter(
            self.flow,
            _core.StateEllipsoid(self.attitude[number], self.vector[number], self.shape[number]),
            time=self.time,
            mode=self.mode,
            criterion=self.criterion,
            weight=self.weight,
        )
        alone._resume(self.transition[number], self.prior_shape[number])
        return alone

    def __getstate__(self) -> tuple[Any, ...]:
        """What pickle keeps; the flow is pickled, so a potential written in Python must be picklable."""
        start = (self.flow, self.attitude, self.vector, self.shape)
        return *start, self.time, self.mode, self.criterion, self.weight, self.transition, self.prior_shape

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        """Restores what `__getstate__` kept."""
        *start, time, mode, criterion, weight, transition, prior_shape = state
        self.__init__(*start, time=time, mode=mode, criterion=criterion, weight=weight)  # type: ignore[misc]
        self._resume(transition, prior_shape)
