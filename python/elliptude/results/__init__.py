"""The results that functions return: named tuples and classes of arrays."""

from elliptude.results.ahrs import AhrsResult
from elliptude.results.claims import CLAIMS, IF_PROPOSED_BOUNDS_HOLD, Claim
from elliptude.results.first_order import Convergence, FilterLog, Update, Updates
from elliptude.results.guaranteed import (
    AttitudeBounds,
    AttitudeSet,
    DirectionLog,
    DirectionUpdate,
    Extents,
    GuaranteedLog,
    GuaranteedUpdate,
    Interval,
)
from elliptude.results.values import (
    Extent,
    FlowLinearization,
    Intersection,
    PrincipalAxes,
    Trajectory,
    WahbaSet,
    WahbaSolution,
)

__all__ = [
    "CLAIMS",
    "IF_PROPOSED_BOUNDS_HOLD",
    "AhrsResult",
    "AttitudeBounds",
    "AttitudeSet",
    "Claim",
    "Convergence",
    "DirectionLog",
    "DirectionUpdate",
    "Extent",
    "Extents",
    "FilterLog",
    "FlowLinearization",
    "GuaranteedLog",
    "GuaranteedUpdate",
    "Intersection",
    "Interval",
    "PrincipalAxes",
    "Trajectory",
    "Update",
    "Updates",
    "WahbaSet",
    "WahbaSolution",
]
