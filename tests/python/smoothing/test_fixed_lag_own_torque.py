"""A smoother of fixed lag whose torque a user has written: what it raises comes out. Copies, which share nothing."""

import copy
import dataclasses
import pickle

import elliptude as el
import numpy as np
import pytest
from elliptude.errors import PredictionError
from elliptude.smoothing import FixedLagSmoother
from reference import so3

ATTITUDE = so3.exp(np.array([0.1, 0.0, 0.0]))


class Panel:
    """A torque about x, until a fault is put into it."""

    fault = None

    def torque(self, attitude, time):
        return np.array([0.01, 0.0, 0.0]) if self.fault is None else self.fault()

    def torque_jacobian(self, attitude, time):
        return np.zeros((3, 3))


def of_panel(step=0.05):
    """A smoother that was predicted over half a second and has measured an attitude then."""
    panel = Panel()
    body = el.RigidBody(np.diag([1.0, 2.0, 2.5]))
    torque = el.StatedTorque(panel, rate=0.0, error=1e-6, curvature=0.0)
    start = el.StateEllipsoid(np.eye(3), np.array([0.2, 0.0, 0.0]), 1e-4 * np.eye(6), chart="gibbs")
    flow = el.GuaranteedRigidBodyFlow(body, el.SumPotential([torque]), step=step)
    smoother = FixedLagSmoother(el.GuaranteedFilter(flow, start), 3)
    smoother.predict(0.5)
    smoother.update(attitude=smoother.filter.ellipsoid.attitude, attitude_bound=1e-3)
    return smoother, panel


def raises():
    raise ValueError("the panel is stowed")


@pytest.mark.parametrize(
    ("fault", "kind", "message"),
    [
        (raises, ValueError, "the panel is stowed"),
        (lambda: np.zeros(2), ValueError, r"torque\(attitude, time\)"),
        (lambda: np.array([np.nan, 0.0, 0.0]), ValueError, "torque"),
        (lambda: {}["attitude"], KeyError, "attitude"),
    ],
)
def test_what_a_torque_raises_comes_out(fault, kind, message):
    smoother, panel = of_panel()
    before = smoother.smoothed(1)
    assert before.uses_future
    panel.fault = fault
    with pytest.raises(kind, match=message):
        smoother.smoothed(1)
    panel.fault = None
    after = smoother.smoothed(1)  # the same may be asked again
    np.testing.assert_array_equal(after.ellipsoid.shape, before.ellipsoid.shape)


def test_a_motion_that_cannot_be_followed_is_no_set():
    """A rate too high for the step of the flow: the moment before keeps what the filter knew."""
    flow = el.GuaranteedRigidBodyFlow(el.RigidBody(np.diag([1.0, 2.0, 2.5])), step=0.5)
    slow = el.StateEllipsoid(np.eye(3), np.zeros(3), 1e-4 * np.eye(6), chart="gibbs")
    smoother = FixedLagSmoother(el.GuaranteedFilter(flow, slow), 3)
    smoother.predict(0.5)
    fast = np.array([40.0, 12.0, 40.0])
    last = smoother._moments.pop()
    far = el.StateEllipsoid(np.eye(3), fast, last.known.ellipsoid.shape, chart="gibbs")
    with pytest.raises(PredictionError, match="step of the flow is too long"):
        el.GuaranteedFilter(flow, far).predict(0.5)
    smoother._moments.append(dataclasses.replace(last, known=dataclasses.replace(last.known, ellipsoid=far)))
    found = smoother.smoothed(1)
    assert not found.uses_future
    np.testing.assert_array_equal(found.ellipsoid.shape, slow.shape)


def test_predictions_that_fail_are_told_from_arguments_that_are_wrong():
    flow = el.GuaranteedGyroFlow(0.01)
    start = el.StateEllipsoid(np.eye(3), np.zeros(3), 1e-4 * np.eye(6), chart="gibbs")
    with pytest.raises(PredictionError, match="gyro makes a turn of"):
        el.GuaranteedFilter(flow, start, policy="raise").predict(1.0, gyro=[1e15, 0.0, 0.0])
    for time, gyro in ((-1.0, [0.0, 0.0, 0.1]), (1.0, [0.0, 0.1]), (1.0, [np.inf, 0.0, 0.0])):
        with pytest.raises(ValueError, match=r"gyro|time") as caught:
            el.GuaranteedFilter(flow, start).predict(time, gyro=gyro)
        assert not isinstance(caught.value, PredictionError)


def of_gyro():
    """A smoother with a prediction by a rate and an increment, a turn, and an attitude."""
    flow = el.GuaranteedGyroFlow(1e-3, 1e-5, interval_rate="mean")
    start = el.StateEllipsoid(np.eye(3), np.zeros(3), 1e-4 * np.eye(6), chart="gibbs")
    smoother = FixedLagSmoother(el.GuaranteedFilter(flow, start, vector_bound=0.01), 4)
    smoother.predict(1.0, gyro=[0.1, 0.0, 0.0], increment=1e-3)
    smoother.predict_turn(2.0, [0.0, 0.0, 0.2], 1e-3)
    smoother.update(attitude=ATTITUDE @ so3.exp(np.array([0.0, 0.0, 0.2])), attitude_bound=1e-3)
    return smoother


@pytest.mark.parametrize("made", [of_gyro, lambda: of_panel()[0]])
@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_a_copy_goes_on_by_itself(made, copied):
    """It gives the same sets to the bit, and what is done to one does nothing to the other."""
    smoother = made()
    other = copied(smoother)
    assert (other.moments, other.has_contradicted) == (smoother.moments, False)
    present = smoother.filter.time

    def sets(one):
        return [one.smoothed(age).ellipsoid.shape for age in range(one.moments)]

    np.testing.assert_array_equal(sets(other), sets(smoother))
    motion = {"gyro": [0.0, 0.1, 0.0]} if made is of_gyro else {}
    other.predict(present + 1.0, **motion)
    assert (smoother.filter.time, other.filter.time) == (present, present + 1.0)
    assert other.moments == smoother.moments + 1
    smoother.predict(present + 1.0, **motion)
    np.testing.assert_array_equal(sets(other), sets(smoother))
    smoother.forget()
    assert (smoother.moments, smoother.filter.claim) == (1, "none")
    assert other.filter.claim == "unconditional"
