"""The guaranteed filter, and how to store it."""

from typing import Any, Self

import numpy as np

from elliptude import _core
from elliptude._potentials import potential_from_dict, potential_to_dict
from elliptude._stored import Stored

_Flow = _core.GuaranteedRigidBodyFlow | _core.GuaranteedGyroFlow


def _flow_to_dict(flow: _Flow) -> dict[str, Any]:
    if isinstance(flow, _core.GuaranteedGyroFlow):
        return {
            "kind": "guaranteed_gyro",
            "noise": flow.noise.tolist(),
            "drift": flow.drift.tolist(),
            "scale": flow.scale,
            "angular_acceleration": flow.angular_acceleration,
            "interval_rate": flow.interval_rate,
            "longest_interval": flow.longest_interval,
            "largest_rate": flow.largest_rate,
        }
    return {
        "kind": "guaranteed_rigid_body",
        "inertia": flow.body.inertia.tolist(),
        "potential": potential_to_dict(flow.potential),
        "step": flow.step,
        "unknown_torque": flow.unknown_torque.tolist(),
        "inertia_error": flow.inertia_error,
        "most_steps": flow.most_steps,
    }


def _flow_from_dict(fields: dict[str, Any]) -> _Flow:
    match fields["kind"]:
        case "guaranteed_gyro":
            return _core.GuaranteedGyroFlow(
                np.asarray(fields["noise"]),
                np.asarray(fields["drift"]),
                scale=fields["scale"],
                angular_acceleration=fields["angular_acceleration"],
                interval_rate=fields["interval_rate"],
                longest_interval=fields.get("longest_interval"),  # older ones have neither
                largest_rate=fields.get("largest_rate"),
            )
        case "guaranteed_rigid_body":
            return _core.GuaranteedRigidBodyFlow(
                _core.RigidBody(fields["inertia"]),
                potential_from_dict(fields["potential"]),
                step=fields["step"],
                unknown_torque=np.asarray(fields["unknown_torque"]),
                inertia_error=fields["inertia_error"],
                most_steps=fields.get("most_steps", 1_000_000),
            )
    raise ValueError(f"flow.kind is {fields['kind']!r}, which is neither guaranteed_gyro nor guaranteed_rigid_body")


def _pair_to_lists(pair: tuple[Any, Any] | None) -> list[Any] | None:
    return None if pair is None else [part.tolist() for part in pair]


class GuaranteedFilter(_core.GuaranteedFilter, Stored):  # noqa: D101
    __doc__ = _core.GuaranteedFilter.__doc__
    FORMAT_VERSION = 1

    def __repr__(self) -> str:
        """One line: time, claim, and how far the attitude may be off."""
        known = self.ellipsoid
        size = "" if known is None else f", within {np.rad2deg(known.extent().largest_angle):.3g}°"
        return f"<GuaranteedFilter: time {self.time:.6g} s, claim {self.claim!r}{size}>"

    @property
    def why_no_set(self) -> str | None:
        """In words, why `claim` is 'none' and there is no set; None if there is one.

        A set holds the attitude and the vector, which is a body's angular velocity or a gyro's bias. Directions and
        attitudes say nothing of the vector: a star tracker alone starts no set.
        """
        if self.knows_attitude:
            return None
        if self._vector is None and self.vector_bound is None:
            vector, also = (
                ("the gyro's bias", "")
                if isinstance(self.flow, _core.GuaranteedGyroFlow)
                else ("the angular velocity", "measure it (update with angular_velocity and rate_bound), or ")
            )
            return (
                f"nothing bounds {vector}, which the set holds beside the attitude, and directions and attitudes say "
                f"nothing of it: {also}state vector_bound or a start"
            )
        return (
            "no update has determined the attitude since the filter began or last forgot it: that takes two directions "
            "that are not parallel, or an attitude, in one update"
        )

    def to_dict(self) -> dict[str, Any]:
        """The whole state of the filter, as numbers, strings, lists and dictionaries.

        Raises
        ------
        TypeError
            If the flow has a torque by functions, which only pickle can store.
        """
        return self._fields(_flow_to_dict(self.flow))

    def _fields(self, flow: _Flow | dict[str, Any]) -> dict[str, Any]:
        return {
            "format": self.FORMAT_VERSION,
            "flow": flow,
            "time": self.time,
            "criterion": self.criterion,
            "weight": None if self.weight is None else self.weight.tolist(),
            "policy": self.policy,
            "most_wrong": self.most_wrong,
            "regain_after": self.regain_after,
            "vector_bound": _pair_to_lists(self.vector_bound),
            "estimate_vector": self.estimate_vector,
            **self._knowledge(),
        }

    def _knowledge(self) -> dict[str, Any]:
        """What predictions, updates and `forget` change, but for the time."""
        return {
            "ellipsoid": None if self.ellipsoid is None else self.ellipsoid.to_dict(),
            "vector": _pair_to_lists(self._vector),
            "rests_on_drops": self._rests_on_drops,
            "agreeing_updates": self._agreeing_updates,
            "disputed_updates": self._disputed_updates,
            "contradictions": self._contradictions,
        }

    @classmethod
    def _made_from(cls, fields: dict[str, Any]) -> Self:
        ellipsoid, bound, vector = fields["ellipsoid"], fields["vector_bound"], fields["vector"]
        flow = fields["flow"]
        stored = cls(
            flow if isinstance(flow, _Flow) else _flow_from_dict(flow),  # pickle keeps the flow itself
            time=fields["time"],
            criterion=fields["criterion"],
            weight=fields["weight"],
            policy=fields["policy"],
            most_wrong=fields["most_wrong"],
            regain_after=fields["regain_after"],
            vector_bound=None if bound is None else tuple(bound),
            estimate_vector=fields["estimate_vector"],
        )
        stored._resume(
            None if ellipsoid is None else _core.StateEllipsoid.from_dict(ellipsoid),
            None if vector is None else tuple(vector),
            fields["rests_on_drops"],
            fields["agreeing_updates"],
            fields.get("disputed_updates", 0),  # not in what older versions stored
            fields.get("contradictions", 0),  # nor is this
        )
        return stored

    def __getstate__(self) -> dict[str, Any]:
        """What pickle keeps; the flow is pickled, so a torque by functions must be picklable."""
        return self._fields(self.flow)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restores what `__getstate__` kept."""
        other = type(self).from_dict(state)
        self.__init__(  # type: ignore[misc]
            other.flow,
            time=other.time,
            criterion=other.criterion,
            weight=other.weight,
            policy=other.policy,
            most_wrong=other.most_wrong,
            regain_after=other.regain_after,
            vector_bound=other.vector_bound,
            estimate_vector=other.estimate_vector,
        )
        self._resume(
            other.ellipsoid,
            other._vector,
            other._rests_on_drops,
            other._agreeing_updates,
            other._disputed_updates,
            other._contradictions,
        )
