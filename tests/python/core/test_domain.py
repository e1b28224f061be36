"""What docs/domain.md says of the guaranteed gyro flow and of the filter, tried from Python."""

import elliptude as el
import numpy as np
import pytest


def filtered(radius=0.1, noise=1.0, bias=0.1, **flow):
    start = el.StateEllipsoid(np.eye(3), np.zeros(3), np.diag([radius**2] * 3 + [bias**2] * 3), "gibbs")
    return el.GuaranteedFilter(el.GuaranteedGyroFlow(noise, **flow), start)


@pytest.mark.parametrize("radius", [1e-12, 0.1, 2.0, 10.0])
@pytest.mark.parametrize("is_measured", [True, False])
def test_a_gyro_set_is_bounded_up_to_an_angle(radius, is_measured):
    """While atan(‖γ‖/2) and half of what the errors of the rate may turn make less than 1.5 rad."""
    gyro = np.zeros(3) if is_measured else np.full(3, np.nan)
    longest = 2.0 * (1.5 - np.arctan(0.5 * radius)) / 1.1
    for duration, knows in ((0.999 * longest, True), (1.001 * longest, False)):
        estimator = filtered(radius, largest_rate=1.1)
        try:
            estimator.predict(duration, gyro=gyro)
        except ValueError:  # under the policy "raise" what cannot be predicted is left as it was
            assert not knows
        else:
            assert estimator.knows_attitude == knows


def test_what_a_filter_keeps_has_a_largest_size():
    assert filtered(bias=5e8).knows_attitude
    with pytest.raises(ValueError, match=r"half-widths of at most 1e\+09 rad/s"):
        filtered(bias=2e9)
    with pytest.raises(ValueError, match="a turn of 1e"):
        filtered().predict(1.0, gyro=[1e15, 0.0, 0.0])
    for width in (1e-170, 1e150):
        with pytest.raises(ValueError, match="too large or too small"):
            el.GuaranteedGyroFlow(width)
