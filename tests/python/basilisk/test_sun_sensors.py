"""The Sun's direction is within its bound, whatever the errors, the brightness and the place of the Sun."""

import itertools
import re

import numpy as np
import pytest
from elliptude.basilisk import SunSensors

CORNERS = np.array(list(itertools.product([1.0, -1.0], repeat=3))) / np.sqrt(3.0)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def shown(normals, sun, brightness, errors):
    """What sensors that see half of the sky show."""
    return brightness * np.maximum(normals @ sun, 0.0) + errors


def angle(first, second):
    return np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second)


@pytest.mark.parametrize("bound", [1e-12, 0.003, 0.05])
@pytest.mark.parametrize("corners", [True, False])
def test_the_sun_is_within_the_bound(bound, corners):
    """Errors at the corners of their box, and any within; normals as of a cube's corners, and any."""
    random = np.random.default_rng(7)
    closest, found = 0.0, 0
    for trial in range(600):
        normals = CORNERS if trial % 2 else unit(random.normal(size=(random.integers(3, 12), 3)))
        sun, brightness = unit(random.normal(size=3)), random.uniform(0.05, 1.2)
        errors = random.uniform(-1.0, 1.0, len(normals))
        seen = SunSensors(normals, bound).direction(
            shown(normals, sun, brightness, bound * (np.sign(errors) if corners else errors))
        )
        if seen is not None:
            found += 1
            assert angle(seen[0], sun) <= seen[1]
            assert np.linalg.norm(seen[0]) == pytest.approx(1.0, abs=1e-14)
            closest = max(closest, angle(seen[0], sun) / seen[1])
    assert found > 300
    assert closest > 0.5  # the bound is not much larger than what can happen


def test_the_worst_errors_reach_the_bound():
    """Three sensors at right angles, all off by the bound so that the direction turns most: √3 bound / ‖d‖."""
    normals, sun, bound = np.eye(3), unit(np.array([1.0, 1.0, 1.0])), 0.01
    direction, limit = SunSensors(normals, bound).direction(normals @ sun + bound * np.array([1.0, -1.0, -1.0]))
    turned = angle(direction, sun)
    assert 0.9 * limit < turned <= limit


def test_there_is_no_direction_where_nothing_is_seen():
    sensors = SunSensors(CORNERS, 0.01)
    assert sensors.direction(np.full(8, 0.01)) is None  # eclipse: all show errors alone
    assert sensors.direction([0.5, 0.5, 0, 0, 0, 0, 0, 0]) is None  # two sensors
    plane = SunSensors([[1, 0, 0], [0, 1, 0], np.sqrt([0.5, 0.5, 0])], 0.01)
    assert plane.direction([0.5, 0.5, 0.7]) is None
    assert sensors.direction([0.012, 0.011, 0.011, 0, 0, 0, 0, 0]) is None  # errors as long as what is seen


@pytest.mark.parametrize(
    ("normals", "bound", "says"),
    [
        ([[1, 0, 0], [0, 2, 0], [0, 0, 1]], 0.1, "normals must be unit vectors within 1e-6; row 1 has the length 2"),
        ([[1, 0, 0], [0, np.nan, 0]], 0.1, "row 1 has the length nan"),
        ([1, 0, 0], 0.1, "normals must have shape (N, 3), not (3,)"),
        (np.eye(3), -0.1, "bound must be finite and at least 0, not -0.1"),
        (np.eye(3), np.nan, "bound must be finite and at least 0, not nan"),
    ],
)
def test_what_is_wrong_is_named(normals, bound, says):
    with pytest.raises(ValueError, match=re.escape(says)):
        SunSensors(normals, bound)


@pytest.mark.parametrize("cosines", [[1, 0], [1, 0, np.nan], 1.0])
def test_there_is_one_finite_cosine_for_each(cosines):
    with pytest.raises(ValueError, match="cosines must be 3 finite numbers, one for each normal"):
        SunSensors(np.eye(3), 0.1).direction(cosines)
