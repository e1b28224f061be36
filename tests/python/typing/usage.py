"""How the package is used, for mypy: nothing of this is run."""

from typing import assert_type

import elliptude
import numpy as np
from elliptude import Ellipsoid, Integrator, Quadric, RigidBody, SumPotential, UniformGravity
from elliptude.typing import PotentialLike
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]


def rotations() -> None:
    assert_type(elliptude.exp([0.1, 0.2, 0.3]), Floats)
    assert_type(elliptude.log(Rotation.identity()), Floats)
    assert_type(elliptude.quaternion_from_rotation(np.eye(3)), Floats)
    assert_type(elliptude.to_scipy(np.eye(3)), Rotation)
    if elliptude.is_rotation(np.eye(3), tolerance=1e-9):
        elliptude.log("not a rotation")  # taken, for text is an ArrayLike; refused when it runs
    elliptude.exp(rotation_vector=None)  # type: ignore[arg-type]
    elliptude.exp([0.1, 0.2, 0.3], 1)  # type: ignore[call-arg]


def ellipsoids(rng: np.random.Generator) -> None:
    ball = Ellipsoid([0.0, 0.0], np.eye(2))
    slab = Quadric.slab([1.0, 0.0], 0.0, 0.5)
    assert_type(ball.center, Floats)
    ellipsoid, share = elliptude.minimal_intersection(ball, slab, criterion="volume")
    assert_type(ellipsoid, Ellipsoid)
    assert_type(share, float)
    elliptude.minimal_sum([ball, ball], weight=np.eye(2))
    elliptude.minimal_sum([ball, ball], criterion="size")  # type: ignore[arg-type]
    elliptude.minimal_intersection(slab, ball)  # type: ignore[arg-type]
    ball.center = np.zeros(2)  # type: ignore[misc]
    lengths, _ = ball.principal_axes()
    assert_type(lengths, Floats)
    assert_type(float(ball.support([1.0, 0.0])), float)
    assert_type(ball.sample(10, rng, surface=True), Floats)


def sets_of_attitudes() -> None:
    found = elliptude.wahba_set(np.eye(3), np.eye(3), 0.1, chart="gibbs")
    assert_type(found, elliptude.WahbaSet)
    assert_type(found.shape, Floats)
    assert_type(found.largest_angle(), np.float64 | Floats)
    assert_type(found.contains(Rotation.identity()), np.bool_ | NDArray[np.bool_])
    elliptude.wahba_set(np.eye(3), np.eye(3), [0.1, 0.1, 0.2], weights=np.ones(3), criterion="volume")
    elliptude.wahba_set(np.eye(3), np.eye(3))  # type: ignore[call-arg]
    elliptude.wahba_set(np.eye(3), np.eye(3), 0.1, chart="quaternion")  # type: ignore[arg-type]
    found.margin = np.float64(0.5)  # type: ignore[misc]


def attitudes_from_arrays(samples: Floats) -> None:
    found = elliptude.ahrs(samples[0], samples[1:4].T, samples[4:7].T, statements="recording", acc_unit="g")
    assert_type(found, elliptude.AhrsResult)
    assert_type(found.most_roll_pitch_yaw, Floats)
    assert_type(found.claim_shares, dict[str, float])
    assert_type(len(found), int)
    elliptude.ahrs(samples[0], samples[1:4].T)  # type: ignore[call-arg]
    found.to_frame("excel")  # type: ignore[arg-type]


class Spring:
    """A potential of one's own."""

    def energy(self, attitude: Floats, time: float) -> float:
        return -float(np.trace(attitude))

    def torque(self, attitude: Floats, time: float) -> list[float]:
        x, y, z = elliptude.vee(attitude)
        return [-2.0 * x, -2.0 * y, -2.0 * z]

    def torque_jacobian(self, attitude: Floats, time: float) -> Floats:
        return attitude - float(np.trace(attitude)) * np.eye(3)


class NoPotential:
    """Lacks two methods."""

    def energy(self, attitude: Floats, time: float) -> float:
        return 0.0


def dynamics() -> None:
    body = RigidBody([0.13, 0.28, 0.17])
    mine: PotentialLike = Spring()
    integrator = Integrator(body, SumPotential([mine, UniformGravity(1.0, 9.81, [0.0, 0.0, 0.3])]), step=0.01, order=4)
    Integrator(body, NoPotential(), step=0.01)  # type: ignore[arg-type]
    Integrator(body, step=0.01, order=3)  # type: ignore[arg-type]
    Integrator(body)  # type: ignore[call-arg]
    attitude, angular_velocity = integrator.step(Rotation.identity(), [0.1, 0.2, 0.3])
    assert_type(attitude, Floats)
    trajectory = integrator.trajectory(attitude, angular_velocity, steps=100, every=10)
    assert_type(trajectory.times, Floats)
    assert_type(integrator.linearize(attitude, angular_velocity).state, Floats)
    assert_type(mine.torque(attitude, 0.0) is None, bool)


def directions() -> None:
    solution = elliptude.wahba(np.eye(3), np.eye(3), method="davenport")
    assert_type(solution.attitude, Floats)
    elliptude.wahba(np.eye(3), np.eye(3), method="quest")  # type: ignore[arg-type]
