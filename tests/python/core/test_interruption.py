"""A prediction of many steps ends when a signal's handler raises, as it does for Ctrl-C, and has changed nothing."""

import signal

import elliptude as el
import numpy as np
import pytest

STEP = 1e-6  # s; a million of them take from seconds to half a minute


class StopError(Exception):
    """What the handler raises here, as Python's own raises KeyboardInterrupt."""


@pytest.fixture
def stopped_after_a_moment():
    def stop(*_):
        raise StopError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, 0.02)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGALRM, before)


def start(chart):
    return el.StateEllipsoid(np.eye(3), [0.1, 0.2, 0.3], 1e-6 * np.eye(6), chart=chart)


def guaranteed():
    flow = el.GuaranteedRigidBodyFlow(el.RigidBody(np.diag([3.0, 2.0, 1.5])), step=STEP)
    return el.GuaranteedFilter(flow, start("gibbs"))


def first_order(**known):
    flow = el.RigidBodyFlow(el.RigidBody(np.diag([3.0, 2.0, 1.5])), el.FreeBody(), step=STEP, **known)
    return el.AttitudeFilter(flow, start("exponential"))


FILTERS = {
    "guaranteed": guaranteed,
    "first_order": first_order,
    "unknown_torque": lambda: first_order(unknown_torque=1e-12 * np.eye(3)),
}


@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("whole_log", [False, True])
@pytest.mark.usefixtures("stopped_after_a_moment")
def test_a_long_prediction_can_be_stopped(name, whole_log):
    filter_ = FILTERS[name]()
    before = filter_.to_dict()
    # The handler's error follows a prediction that goes on to its end just as well, but that one is then in the filter.
    with pytest.raises(StopError):
        filter_.run([0.0, 0.9]) if whole_log else filter_.predict(0.9)
    assert filter_.to_dict() == before
