"""NumPy's masked arrays: what is masked is missing where NaN is, and refused elsewhere; never the number below."""

import elliptude as el
import numpy as np
import pytest
from elliptude._arrays import unmasked
from elliptude.bounds.arguments import increasing_times, vector_rows
from elliptude.from_arrays.inputs import times_of
from elliptude.monitoring import monitor

SEEN = np.array([[0.01, 0.0, 1.0], [0.02, 1.0, 0.0]])
REFERENCES = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
BOUNDS = np.array([0.05, 0.1])
FIRST = [[True] * 3, [False] * 3]


def gyro_filter():
    return el.GuaranteedFilter(el.GuaranteedGyroFlow(noise=0.01), vector_bound=0.002)


def masked(values, mask):
    return np.ma.array(values, mask=mask)


@pytest.mark.parametrize("place", range(3))
@pytest.mark.parametrize("nested", [lambda one: one, list, lambda one: [*one.filled(9.0)[:0], *one]])
def test_an_update_refuses_what_is_masked(place, nested):
    given = [SEEN, REFERENCES, BOUNDS]
    given[place] = nested(masked(given[place], [True, False] if place == 2 else FIRST))
    one = gyro_filter()
    with pytest.raises(ValueError, match="nan"):
        one.update(*given)
    assert one.ellipsoid is None
    # Without anything masked it is an array like others.
    given[place] = masked([SEEN, REFERENCES, BOUNDS][place], False)
    one.update(*given)
    other = gyro_filter()
    other.update(SEEN, REFERENCES, BOUNDS)
    np.testing.assert_array_equal(one.ellipsoid.shape, other.ellipsoid.shape)


def test_a_masked_argument_by_name_and_a_masked_number():
    one = gyro_filter()
    one.update(SEEN, REFERENCES, BOUNDS)
    with pytest.raises(ValueError, match=r"nan|finite"):
        one.predict(0.5, gyro=masked([0.0, 0.0, 0.1], [False, False, True]))
    with pytest.raises(ValueError, match=r"nan|finite"):
        el.GuaranteedGyroFlow(noise=masked([0.01, 0.01, 0.01], [False, True, False]))


def test_a_log_takes_masked_rows_for_missing_ones():
    times = 0.1 * np.arange(30)
    directions, rates = np.tile(SEEN, (30, 1, 1)), np.zeros((30, 3))
    where = np.zeros((30, 2, 3), bool)
    where[7:12, 0] = where[20] = True
    wrong = np.where(where, 0.5, directions)  # what stands below the mask must not count
    arguments = {"reference": REFERENCES, "bounds": BOUNDS}
    try_run = {"gyro": rates}
    runs = [
        gyro_filter().run(times, directions=given, **arguments, **try_run)
        for given in (masked(wrong, where), np.where(where, np.nan, directions))
    ]
    np.testing.assert_array_equal(runs[0].shapes, runs[1].shapes)
    assert not np.array_equal(
        runs[0].shapes, gyro_filter().run(times, directions=directions, **arguments, **try_run).shapes
    )


def test_ahrs():
    time, rest = np.arange(0.0, 10.0, 0.01), np.ones((1000, 1))
    field = rest * [0.0, 20e-6, -45e-6]
    where = np.zeros((1000, 3), bool)
    where[400:420] = True
    wrong = np.where(where, 1e-3, field)
    rates, forces = rest * [0.0, 0.0, 0.0], rest * [0.0, 0.0, 9.81]
    one, other = (
        el.ahrs(time, rates, forces, given) for given in (masked(wrong, where), np.where(where, np.nan, field))
    )
    np.testing.assert_array_equal(one.largest_angles, other.largest_angles)
    with pytest.raises(ValueError, match=r"gyr\[400, 0\] is nan, but the gyro is needed in every row"):
        el.ahrs(time, masked(rates, where), forces, field)
    with pytest.raises(ValueError, match=r"time\[3\] is nan, not finite"):
        times_of(masked(time, np.arange(1000) == 3))
    stamps = np.datetime64("2026-01-01", "ns") + np.arange(5) * np.timedelta64(10, "ms")
    with pytest.raises(ValueError, match=r"time\[3\] is NaT, not a time"):
        times_of(masked(stamps, np.arange(5) == 3))


def test_friends():
    """Other filters, functions of one call, and Python's own."""
    up = el.DirectionFilter()
    with pytest.raises(ValueError, match=r"nan|finite"):
        up.update(masked([0.0, 0.0, 1.0], [False, True, False]), 0.1)
    with pytest.raises(ValueError, match=r"nan|finite"):
        el.wahba(masked(SEEN, FIRST), REFERENCES)
    with pytest.raises(ValueError, match=r"rotation_vector\[0\] is nan"):
        el.exp(masked([0.1, 0.2, 0.3], [True, False, False]))
    rows = vector_rows("rates", masked(SEEN, FIRST))
    assert np.isnan(rows[0]).all()
    assert np.isfinite(rows[1]).all()
    with pytest.raises(ValueError, match="finite"):
        increasing_times(masked([0.0, 1.0, 2.0], [False, True, False]))
    log = gyro_filter().run(
        0.1 * np.arange(3),
        directions=np.tile(SEEN, (3, 1, 1)),
        reference=REFERENCES,
        bounds=BOUNDS,
        gyro=np.zeros((3, 3)),
    )
    attitudes = np.tile([1.0, 0.0, 0.0, 0.0], (3, 1))
    judged = monitor(log, masked(attitudes, [[False] * 4, [True] * 4, [False] * 4]))
    assert judged.judged.tolist() == [True, False, True]
    matrices = masked(np.tile(np.eye(3), (3, 1, 1)), False)
    matrices[1] = np.ma.masked
    assert np.isnan(log.forms(matrices)).tolist() == [False, True, False]


def test_what_has_no_nan():
    with pytest.raises(TypeError, match="a masked array of bool: something is masked, and has no NaN"):
        unmasked(masked([True, False], [True, False]))
    assert unmasked(masked([True, False], False)).tolist() == [True, False]
    assert np.isnan(unmasked(masked([1, 2], [True, False]))).tolist() == [True, False]
    given = [1.0, 2.0], "word", None
    assert unmasked(given[0]) is given[0]
    assert unmasked(given[1]) is given[1]
