"""Attitude estimation with ellipsoidal bounds.

It computes the attitude and angular velocity of a rigid body, and a set that contains the truth, from measurements
whose errors are bounded. This package is a thin layer over a C++ core: arrays in, arrays out, whole batches in one
call, without the interpreter's lock.

An attitude C takes body vectors to the reference frame, C in SO(3); errors are on the body side, C = Ĉ exp(S(ζ)).
Units are SI and radians, quaternions are (qw, qx, qy, qz), directions are rows. The last dimensions of an argument are
one item; those before them, if any, are a batch and broadcast as in NumPy.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from importlib import import_module
from typing import TYPE_CHECKING, Any

from elliptude._arrays import to_scipy
from elliptude._core import (
    DirectionFilter,
    Ellipsoid,
    FreeBody,
    GradientPotential,
    GravityGradient,
    GuaranteedGyroFlow,
    GuaranteedRigidBodyFlow,
    GyroFlow,
    Integrator,
    LinearPotential,
    Potential,
    QuadraticPotential,
    Quadric,
    RigidBody,
    RigidBodyFlow,
    StatedTorque,
    StateEllipsoid,
    SumPotential,
    UniformGravity,
    __version__,
    add_cross_product,
    cayley,
    cayley_inverse,
    exp,
    hat,
    is_rotation,
    left_jacobian,
    left_jacobian_inverse,
    log,
    measured_attitude,
    measured_state,
    minimal_intersection,
    minimal_sum,
    overlap_margin,
    project_to_rotation,
    quaternion_from_rotation,
    relative_attitude,
    renormalized,
    right_jacobian,
    right_jacobian_inverse,
    rotation_from_quaternion,
    vee,
    wahba,
    wahba_set,
)
from elliptude.errors import InconsistentMeasurement, RowError
from elliptude.filter import AttitudeFilter, AttitudeFilters
from elliptude.guaranteed import GuaranteedFilter
from elliptude.results import (
    AhrsResult,
    AttitudeBounds,
    AttitudeSet,
    Convergence,
    DirectionLog,
    DirectionUpdate,
    Extent,
    Extents,
    FilterLog,
    FlowLinearization,
    GuaranteedLog,
    GuaranteedUpdate,
    Intersection,
    Interval,
    PrincipalAxes,
    Trajectory,
    Update,
    Updates,
    WahbaSet,
    WahbaSolution,
)

if TYPE_CHECKING:
    import distributed

__all__ = [
    "AhrsResult",
    "AttitudeBounds",
    "AttitudeFilter",
    "AttitudeFilters",
    "AttitudeSet",
    "Convergence",
    "DirectionFilter",
    "DirectionLog",
    "DirectionUpdate",
    "Ellipsoid",
    "Extent",
    "Extents",
    "FilterLog",
    "FlowLinearization",
    "FreeBody",
    "GradientPotential",
    "GravityGradient",
    "GuaranteedFilter",
    "GuaranteedGyroFlow",
    "GuaranteedLog",
    "GuaranteedRigidBodyFlow",
    "GuaranteedUpdate",
    "GyroFlow",
    "InconsistentMeasurement",
    "Integrator",
    "Intersection",
    "Interval",
    "LinearPotential",
    "Potential",
    "PrincipalAxes",
    "QuadraticPotential",
    "Quadric",
    "RigidBody",
    "RigidBodyFlow",
    "RowError",
    "StateEllipsoid",
    "StatedTorque",
    "SumPotential",
    "Trajectory",
    "UniformGravity",
    "Update",
    "Updates",
    "WahbaSet",
    "WahbaSolution",
    "__version__",
    "add_cross_product",
    "ahrs",
    "campaign",
    "cayley",
    "cayley_inverse",
    "exp",
    "hat",
    "is_rotation",
    "left_jacobian",
    "left_jacobian_inverse",
    "log",
    "measured_attitude",
    "measured_state",
    "minimal_intersection",
    "minimal_sum",
    "overlap_margin",
    "project_to_rotation",
    "quaternion_from_rotation",
    "relative_attitude",
    "renormalized",
    "right_jacobian",
    "right_jacobian_inverse",
    "rotation_from_quaternion",
    "to_scipy",
    "vee",
    "wahba",
    "wahba_set",
]


def ahrs(
    time: Any,
    gyr: Any,
    acc: Any,
    mag: Any = None,
    *,
    statements: str | os.PathLike[str] = "hand",
    gyr_unit: str = "rad/s",
    acc_unit: str = "m/s^2",
    mag_unit: str = "T",
    implausible: str = "refuse",
    questions: Sequence[str] = (),
) -> AhrsResult:
    """Attitudes of an inertial sensor, with bounds that hold if what is stated about it does.

    The numbers are those of ``elliptude bounds`` and ``elliptude estimate`` for the same recording. It needs what the
    command line needs: ``pip install 'elliptude[cli]'``.

    Parameters
    ----------
    time : (N,) array_like
        In s, increasing; or time stamps of dates.
    gyr, acc : (N, 3) array_like
        Angular velocity and specific force, body axes; at rest the force points up. Rows of NaN in ``acc`` and ``mag``
        were not measured. Columns of pandas and Polars are arrays, too.
    mag : (N, 3) array_like, optional
        The magnetic field, body axes. Without it yaw counts from the first row.
    statements : "hand", "person", "drone", "car", "boat", "recording" or path-like
        What is stated about the sensors' errors. "hand" and the like: the rule for a small sensor that is carried so,
        and begins at rest; the field at that rest is the reference. "recording": what `elliptude bounds` proposes from
        the recording itself, which is no guarantee. A path: a rule in a TOML file, as `elliptude bounds --rule` writes
        one.
    gyr_unit : "rad/s" or "deg/s"
    acc_unit : "m/s^2", "g" or "mg"
    mag_unit : "T", "mT", "G", "mG", "uT" or "nT"
    implausible : "refuse" or "ignore"
        What to do if the sensors contradict one another, as with a wrong unit or axis.
    questions : sequence of "reference_turns", "body_turns" and "attitude"
        What to ask each row by itself, for more of `AhrsResult.columns`, as `elliptude estimate --questions` does.

    Returns
    -------
    AhrsResult

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it should be, or contradicts the others; the message names it and the place.
    ModuleNotFoundError
        If what it needs besides NumPy is not installed.
    """
    call = _from_command_line("elliptude.from_arrays.ahrs", "ahrs")
    stated_units = {"gyr": gyr_unit, "acc": acc_unit, "mag": mag_unit}
    result: AhrsResult = call(time, gyr, acc, mag, statements, stated_units, implausible, questions)
    return result


def campaign(
    settings: str | os.PathLike[str] | Mapping[str, Any],
    out: str | os.PathLike[str],
    *,
    executor: "Executor | distributed.Client | None" = None,
    processes: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Many simulated runs with many settings, stored as Parquet; or the rest of a campaign that was interrupted.

    It is what ``elliptude campaign`` does (docs/campaigns.md), and needs what the command line needs. A script calls it
    below ``if __name__ == "__main__"``, as the processes that work import the script, too.

    Parameters
    ----------
    settings : path-like or mapping
        A TOML file, or what would be in one.
    out : path-like
        Folder of the results, made if it is missing.
    executor : concurrent.futures.Executor or distributed.Client, optional
        Who works: a Dask cluster by its client, for one. If left out, processes of this machine.
    processes : int, optional
        How many of these; one for each core if left out.
    progress : callable, optional
        Called with how many runs of cases are done, and how many there are.

    Returns
    -------
    dict
        What is in ``summary.json``.

    Raises
    ------
    elliptude.io.files.FileError
        If the settings or the folder are at fault, or parts of the work failed; what is done is kept.
    TypeError, ValueError
        If ``executor`` is neither, or ``processes`` is not at least 1.
    ModuleNotFoundError
        If what it needs besides NumPy is not installed.
    """
    call = _from_command_line("elliptude.campaigns.campaign", "campaign")
    options = {"executor": executor, "processes": processes, "progress": progress}
    summary: dict[str, Any] = call(settings, out, **options)
    return summary


def _from_command_line(module: str, name: str) -> Any:
    """A function that needs what the command line needs; the library needs NumPy alone."""
    try:
        return getattr(import_module(module), name)
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"elliptude.{name} needs {error.name}: pip install 'elliptude[cli]'", name=error.name
        ) from error
