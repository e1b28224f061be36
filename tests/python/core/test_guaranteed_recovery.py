"""The guaranteed filter after a wrong measurement: that it recovers, what it refuses, and how one goes on."""

import elliptude as el
import numpy as np
import pytest

RATE = np.array([0.1, -0.2, 0.15])
SPHERE = el.RigidBody([1.0, 1.0, 1.0])


def body_filter(**settings) -> el.GuaranteedFilter:
    return el.GuaranteedFilter(el.GuaranteedRigidBodyFlow(SPHERE, step=0.1), **settings)


def measured(time: float, rate: np.ndarray) -> dict[str, object]:
    """Exact directions of a body that turns about RATE, with bounds that allow for more, and a rate as it is given."""
    return {
        "directions": el.exp(RATE * time),
        "reference": np.eye(3),
        "bounds": 0.02,
        "angular_velocity": rate,
        "rate_bound": 0.02,
    }


def updated(filter_: el.GuaranteedFilter, time: float, rate: np.ndarray = RATE) -> object:
    return filter_.update(**measured(time, rate))


@pytest.mark.parametrize("policy", ["drop_measurement", "restart"])
@pytest.mark.parametrize("size", [1.0, 3.0, 20.0, 1e4, 1e160])
def test_one_wrong_first_rate(policy: str, size: float) -> None:
    filter_ = body_filter(policy=policy, regain_after=4)
    update = updated(filter_, 0.0, RATE + size)
    first = 0 if update.dropped else None
    for k in range(1, 20):
        filter_.predict(0.1 * k)
        update = updated(filter_, 0.1 * k)
        first = k if first is None and update.margin < 0 else first
        if k == 6:  # in the middle of a dispute
            filter_ = el.GuaranteedFilter.from_json(filter_.to_json())
        if first is not None and k >= first + 8:
            assert filter_.claim == "unconditional"
            assert filter_.ellipsoid.contains(el.exp(RATE * 0.1 * k), RATE)
    assert filter_.claim == "unconditional"
    assert filter_.ellipsoid.contains(el.exp(RATE * 1.9), RATE)


def test_a_set_that_cannot_be_predicted_is_forgotten_by_the_user() -> None:
    filter_ = body_filter()
    updated(filter_, 0.0, RATE + 1e4)
    before = filter_.to_dict()
    with pytest.raises(ValueError, match=r"predict|step of the flow"):
        filter_.predict(0.1)
    assert filter_.to_dict() == before
    filter_.forget()
    assert (filter_.claim, filter_.ellipsoid) == ("none", None)
    filter_.predict(0.1)
    assert updated(filter_, 0.1).claim == "unconditional"
    assert filter_.ellipsoid.contains(el.exp(RATE * 0.1), RATE)


def test_what_is_beyond_the_domain_is_refused_by_name() -> None:
    filter_ = body_filter()
    before = filter_.to_dict()
    with pytest.raises(ValueError, match=r"angular_velocity and rate_bound must be at most 1e\+09 rad/s, but are"):
        updated(filter_, 0.0, np.array([1e160, 0, 0]))
    assert filter_.to_dict() == before
    with pytest.raises(ValueError, match=r"vector_bound must have a center and half-widths of at most 1e\+09 rad/s"):
        body_filter(vector_bound=([1e160, 0, 0], 1.0))
    with pytest.raises(ValueError, match=r"start must have a vector and half-widths of at most 1e\+09 rad/s"):
        body_filter(start=el.StateEllipsoid(np.eye(3), [0, 1e80, 0], 1e-2 * np.eye(6)))


def test_what_older_versions_stored_is_read() -> None:
    filter_ = body_filter(policy="drop_measurement")
    updated(filter_, 0.0)
    updated(filter_, 0.0, RATE + 1)
    updated(filter_, 0.0)
    fields = filter_.to_dict()
    assert fields["disputed_updates"] == 1
    del fields["disputed_updates"]
    assert el.GuaranteedFilter.from_dict(fields).to_dict()["disputed_updates"] == 0
    with pytest.raises(ValueError, match="disputed_updates"):
        el.GuaranteedFilter.from_dict(fields | {"disputed_updates": -1})
    assert fields["contradictions"] == 1
    assert el.GuaranteedFilter.from_dict(fields).to_dict()["contradictions"] == 1
    with pytest.raises(ValueError, match="contradictions must not be negative, but is -1"):
        el.GuaranteedFilter.from_dict(fields | {"contradictions": -1})
    del fields["contradictions"]
    assert el.GuaranteedFilter.from_dict(fields).to_dict()["contradictions"] == 0


def test_a_bias_that_is_left_to_its_bound_widens_the_attitude_by_what_it_can_do() -> None:
    start = el.StateEllipsoid(np.eye(3), np.zeros(3), np.diag([np.radians(1.22) ** 2] * 3 + [1e-6] * 3), chart="gibbs")
    filter_ = el.GuaranteedFilter(el.GuaranteedGyroFlow(1e-9), start, vector_bound=1e-3, estimate_vector=False)
    for k in range(10):
        filter_.predict(0.1 * (k + 1), gyro=[0.3, 0.2, -0.1])
    shape = filter_.ellipsoid.shape
    angle = 2 * np.degrees(np.arctan(0.5 * np.sqrt(np.linalg.eigvalsh(shape[:3, :3])[-1])))
    assert 0.057 < angle - 1.22 < 0.09  # 1e-3 rad is 0.0573 degrees
    np.testing.assert_allclose(shape[3:, 3:], 1e-6 * np.eye(3), rtol=1e-12)
    assert not shape[:3, 3:].any()
