"""Each term of the bounds of measured directions, alone: the truth comes to the edge, so that no term can be lost.

Theory, sections 18.1 and 18.2. One source of error acts at its bound; a bound that leaves it out, or counts half of it,
is smaller than the error (`tests/mutations`).
"""

import numpy as np
import pytest
from elliptude.bounds.gyro import GyroBounds
from elliptude.bounds.samples import (
    DirectionBounds,
    VectorSensorBounds,
    accelerometer_bounds,
    angle_excess,
    magnetometer_bounds,
)
from elliptude.bounds.windows import (
    MotionBounds,
    WindowBounds,
    cross_bounds,
    field_bounds_over_windows,
    gravity_bounds_over_windows,
)
from inputs import angle_between
from scipy.spatial.transform import Rotation

G = 9.80665
UP = np.array([0.0, 0.0, 1.0])
STILL = MotionBounds(acceleration=0.0)
EXACT_GYRO = GyroBounds(0.0)


def tangent(radius, length=G):
    """The vector within the radius of (0, 0, length) that is furthest from it in direction."""
    angle = np.arcsin(radius / length)
    return np.sqrt(length**2 - radius**2) * np.array([np.sin(angle), 0.0, np.cos(angle)])


def windows(forces, *, times=None, rates=None, durations=(1.0,), motion=STILL, gyro=EXACT_GYRO, **others):
    count = len(forces)
    times = 0.01 * np.arange(count) if times is None else times
    rates = np.zeros((count, 3)) if rates is None else rates
    return gravity_bounds_over_windows(times, forces, rates, durations, motion=motion, gyro=gyro, **others)


def assert_reached(bounds, up=UP, row=-1, share=0.99):
    error = angle_between(bounds.directions[row], up)
    assert not bounds.contradicted[row]
    assert error <= bounds.angles[row] * (1.0 + 1e-9)
    assert error >= share * bounds.angles[row]


# --- one sample -------------------------------------------------------------------------------------------------------


def test_a_scale_error_across():
    """The ball of Apollonius: ‖y - z‖ = k ‖z‖, and arcsin k at most between them."""
    k = 0.3
    row = np.sqrt(1.0 - k * k) * G * np.array([[k, 0.0, np.sqrt(1.0 - k * k)]])
    bounds = accelerometer_bounds(row, 0.0, sensor=VectorSensorBounds(scale_error=k))
    assert_reached(bounds, share=0.999999)


@pytest.mark.parametrize("of_windows", [False, True])
def test_a_scale_error_and_an_offset_along(of_windows):
    """All that is shown is too short: (1 - k) g - e. A little less is a contradiction, for the samples and the mean."""
    k, error = 0.2, 0.3
    sensor = VectorSensorBounds(error=error, scale_error=k)
    shortest = (1.0 - k) * G - error
    for length, contradicted in ((shortest + 1e-9, False), (shortest - 1e-6, True)):
        rows = np.tile([0.0, 0.0, length], (101, 1))
        bounds = windows(rows, sensor=sensor) if of_windows else accelerometer_bounds(rows, 0.0, sensor=sensor)
        assert bounds.contradicted[-1] == contradicted


@pytest.mark.parametrize("of_windows", [False, True])
def test_a_sensor_that_sits_askew(of_windows):
    sensor = VectorSensorBounds(misalignment=0.02)
    rows = np.tile(Rotation.from_rotvec([0.02, 0.0, 0.0]).apply(G * UP), (101, 1))
    bounds = windows(rows, sensor=sensor) if of_windows else accelerometer_bounds(rows, 0.0, sensor=sensor)
    assert_reached(bounds, share=0.97)


@pytest.mark.parametrize("sensor", [VectorSensorBounds(0.5), VectorSensorBounds(3.0, averaged_error=0.5)])
def test_the_mean_of_a_sensors_error(sensor):
    assert_reached(windows(np.tile(tangent(0.5), (101, 1)), sensor=sensor), share=0.999999)


def test_an_offset_of_time_of_one_sample():
    turned = Rotation.from_rotvec([0.03, 0.0, 0.0]).apply(G * UP)[None]
    assert_reached(accelerometer_bounds(turned, 0.0, time_offset=0.03), share=0.999999)


def test_an_acceleration_across():
    assert_reached(accelerometer_bounds(tangent(2.0)[None], 2.0), share=0.999999)
    assert_reached(windows(np.tile(tangent(2.0), (101, 1)), motion=MotionBounds(acceleration=2.0)), share=0.999999)


@pytest.mark.parametrize("error", [-0.05, 0.05])
def test_gravity_itself_may_be_off(error):
    """Neither a shorter nor a longer vector than gravity is a contradiction, and a tangent one is wider."""
    radius = 1.0
    for rows in (np.tile((G + error) * UP, (101, 1)), np.tile(tangent(radius, G + error), (101, 1))):
        acceleration = 0.0 if rows[0, 0] == 0.0 else radius
        for bounds in (
            accelerometer_bounds(rows, acceleration, gravity_error=0.05),
            windows(rows, motion=MotionBounds(acceleration=acceleration), gravity_error=0.05),
        ):
            assert not bounds.contradicted[-1]
            assert angle_between(bounds.directions[-1], UP) <= bounds.angles[-1] * (1.0 + 1e-12)
    longer = accelerometer_bounds((G + 2.0 * error) * UP[None], 0.0, gravity_error=0.05)
    assert longer.contradicted[0]


def test_rounding_proves_nothing():
    """Lengths that are gravity but for rounding are no contradiction, whatever the direction."""
    draws = np.random.default_rng(0)
    vectors = draws.standard_normal((100_000, 3))
    rows = G * vectors / np.linalg.norm(vectors, axis=1)[:, None]
    bounds = accelerometer_bounds(rows, 0.0)
    assert not bounds.contradicted.any()
    assert (np.linalg.norm(rows, axis=1) != G).any()


@pytest.mark.parametrize("which", ["first", "second", "reference"])
def test_the_dip_is_off_by_each_bound_alone(which):
    true, off = np.deg2rad(150.0), 0.1
    fields = np.array([[np.sin(true + off), 0.0, np.cos(true + off)]])
    exact, wide = np.zeros(1), np.array([off])
    first = DirectionBounds(UP[None], wide if which == "first" else exact, exact)
    second = DirectionBounds(fields, wide if which == "second" else exact, exact)
    allowed = off if which == "reference" else 0.0
    assert angle_excess(first, second, true, allowed)[0] <= 1e-12
    assert angle_excess(first, second, true - 0.01, allowed)[0] == pytest.approx(0.01)


# --- windows: the gyro ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("at", ["end", "middle"])
@pytest.mark.parametrize("error", ["noise", "bias", "scale_error", "drift"])
def test_a_still_frame_that_the_gyro_carries_away(error, at):
    """With equal weights the mean turns by half the turn of the window; about the row's middle it cancels in truth."""
    times = 0.01 * np.arange(201)
    k = 0.01
    rate, size = np.zeros((201, 3)), 0.02
    if error == "scale_error":
        rate[:, 0] = 2.0
        gyro, shown = GyroBounds(0.0, scale_error=k), (1.0 - k) * rate
    elif error == "drift":
        gyro = GyroBounds(0.0, drift=size)
        shown = np.outer(size * times, [1.0, 0.0, 0.0])
    else:
        gyro = GyroBounds(**({"noise": 0.0} | {error: size}))
        shown = np.tile([size, 0.0, 0.0], (201, 1))
    angles = np.concatenate([[0.0], np.cumsum(0.5 * 0.01 * (rate[1:, 0] + rate[:-1, 0]))])
    attitudes = Rotation.from_rotvec(np.outer(angles, [1.0, 0.0, 0.0]))
    up = attitudes.inv().apply(UP)
    bounds = windows(G * up, times=times, rates=shown, durations=[2.0], gyro=gyro, at=at)
    error_of = angle_between(bounds.directions, up)
    whole = np.isfinite(bounds.angles)
    assert (error_of <= bounds.angles * (1.0 + 1e-9))[whole].all()
    if at == "end":
        assert_reached(bounds, up[-1], share=0.95)


@pytest.mark.parametrize("before", [True, False])
def test_a_gyro_that_errs_on_one_side_of_the_row(before):
    """About the row's middle one half of the window turns, and the other does not: half of what the bound allows."""
    times = 0.01 * np.arange(201)
    shown = np.zeros((201, 3))
    shown[slice(0, 100) if before else slice(101, 201), 0] = 0.02
    bounds = windows(np.tile(G * UP, (201, 1)), times=times, rates=shown, durations=[2.0], gyro=GyroBounds(0.02),
                     at="middle")  # fmt: skip
    error = angle_between(bounds.directions[100], UP)
    assert 0.48 * bounds.angles[100] <= error <= bounds.angles[100]


def test_an_increment_just_before_the_row():
    """The whole increment stands between the row and all the samples of its window."""
    times = 0.01 * np.arange(401)
    increment, noise = 1e-3, 0.02
    shown = np.zeros((401, 3))
    shown[-6:, 0] = [0.5 * noise, noise, noise, noise, noise, noise]
    bounds = windows(
        np.tile(G * UP, (401, 1)),
        times=times,
        rates=shown,
        durations=[4.0],
        gyro=GyroBounds(noise, increment=increment),
    )
    assert_reached(bounds, share=0.94)


def test_an_increment_while_the_body_turns():
    """Noise that is fixed in space adds up in space: 1 + Θ. The vector is one across it."""
    speed, radius = 10.0, 1e-4
    times = 0.001 * np.arange(3001)
    attitudes = Rotation.from_rotvec(np.outer(speed * times, UP))
    shown = speed * UP + attitudes.inv().apply([speed * radius, 0.0, 0.0])
    up = attitudes.inv().apply(UP)
    bounds = windows(
        G * up, times=times, rates=shown, durations=[3.0], gyro=GyroBounds(speed * radius, increment=2.0 * radius)
    )
    assert_reached(bounds, up[-1], share=0.9)


def test_an_increment_to_second_order():
    """The body cones while the gyro shows nothing: the mean goes away by areas, far beyond the increment."""
    frequency, noise, length = 100.0, 5.0, 4.0
    times = np.linspace(0.0, length, 8001)
    rates = noise * np.column_stack([np.zeros_like(times), np.cos(frequency * times), np.sin(frequency * times)])
    attitude = Rotation.identity()
    up = [UP]
    for step in Rotation.from_rotvec(0.5 * np.diff(times)[:, None] * (rates[1:] + rates[:-1])):
        attitude = attitude * step
        up.append(attitude.inv().apply(UP))
    up = np.array(up)
    gyro = GyroBounds(noise, increment=2.0 * noise / frequency)
    bounds = windows(G * up, times=times, durations=[length], gyro=gyro)
    assert not bounds.contradicted[-1]
    error = angle_between(bounds.directions[-1], up[-1])
    assert 1.5 * gyro.increment < error <= bounds.angles[-1]


def test_a_late_vector_in_a_turning_body():
    """Stamps are off by τ, the gyro shows less than the body turns: ωτ with the true rate, whatever the window."""
    times = 0.01 * np.arange(101)
    true, offset, k = 1.0, 0.1, 0.2
    attitudes = Rotation.from_rotvec(np.outer(true * times, [1.0, 0.0, 0.0]))
    late = Rotation.from_rotvec(np.outer(true * (times - offset), [1.0, 0.0, 0.0])).inv().apply(G * UP)
    shown = np.tile([(1.0 - k) * true, 0.0, 0.0], (101, 1))
    bounds = windows(
        late,
        times=times,
        rates=shown,
        durations=[0.01],
        gyro=GyroBounds(0.0, scale_error=k, largest_rate=true),  # which counts behind the last sample
        time_offset=offset,
    )
    assert_reached(bounds, attitudes.inv().apply(UP)[-1], share=0.97)


# --- windows: which rows, which window --------------------------------------------------------------------------------


@pytest.mark.parametrize("missing", ["force", "rate"])
@pytest.mark.parametrize("at", ["end", "middle"])
def test_no_window_reaches_across_a_missing_row(at, missing):
    """If nothing is stated of gaps; and any other has a bound."""
    forces, rates = np.tile(G * UP, (401, 1)), np.zeros((401, 3))
    (forces if missing == "force" else rates)[200] = np.nan
    bounds = windows(forces, rates=rates, durations=[1.0], at=at)
    assert not bounds.contradicted.any()
    without = np.flatnonzero(np.isnan(bounds.angles))
    # Windows begin and end at rows that are there.
    expected = np.arange(200, 300) if at == "end" else np.arange(151, 250)
    # At the recording's ends windows are shorter; one row is no window.
    np.testing.assert_array_equal(np.setdiff1d(without, [0, 400]), expected)


@pytest.mark.parametrize("at", ["end", "middle"])
def test_no_window_reaches_across_a_long_step(at):
    times = 0.01 * np.arange(401)
    times[200:] += 0.2
    bounds = windows(np.tile(G * UP, (401, 1)), times=times, durations=[1.0], at=at, maximum_step=0.1)
    assert not bounds.contradicted.any()
    without = np.setdiff1d(np.flatnonzero(np.isnan(bounds.angles)), [0, 400])
    # Rows whose window holds both ends of the step, at 1.99 s and 2.2 s.
    expected = np.arange(200, 280) if at == "end" else np.arange(170, 230)
    np.testing.assert_array_equal(without, expected)


def test_no_window_reaches_across_a_step_that_the_gyro_does_not_cover():
    """The body turns in a gap that the gyro's bounds say nothing of, whatever the longest step between rows is."""
    times = np.concatenate([0.01 * np.arange(201), 2.5 + 0.01 * np.arange(201)])
    up = np.where((times > 2.2)[:, None], [0.0, np.sin(np.deg2rad(10.0)), np.cos(np.deg2rad(10.0))], UP)
    motion = MotionBounds(velocity=0.02, position=0.05, jerk=10.0)
    gyro = GyroBounds(1e-4, longest_interval=0.015, largest_rate=10.0)
    for at in ("middle", "end"):
        bounds = windows(G * up, times=times, durations=[2.0], motion=motion, gyro=gyro, at=at)
        errors = np.array([angle_between(*pair) for pair in zip(bounds.directions, up, strict=True)])
        known = np.isfinite(bounds.angles)
        assert known.mean() > 0.4
        assert (errors <= bounds.angles)[known].all()
        assert not bounds.contradicted.any()


def test_a_contradiction_of_any_window_counts():
    """A push of 0.1 s is more than the speed allows in 0.1 s; over 3 s the gyro's error allows as much."""
    forces = np.tile(G * UP, (401, 1))
    forces[300:310, 2] += 25.0
    arguments = {"motion": MotionBounds(velocity=1.0), "gyro": GyroBounds(0.05)}
    for durations in ([0.1, 3.0], [3.0, 0.1]):
        assert windows(forces, durations=durations, **arguments).contradicted[309]
    assert not windows(forces, durations=[3.0], **arguments).contradicted[309]


def test_the_best_window_is_taken():
    motion, forces = MotionBounds(velocity=0.1), np.tile(G * UP, (401, 1))
    gyro = GyroBounds(0.05)
    alone = [windows(forces, durations=[length], motion=motion, gyro=gyro).angles for length in (0.2, 0.6, 2.0)]
    for durations in ([0.2, 0.6, 2.0], [2.0, 0.6, 0.2]):
        together = windows(forces, durations=durations, motion=motion, gyro=gyro)
        np.testing.assert_allclose(together.angles[1:], np.min(alone, axis=0)[1:], rtol=1e-12)


def test_a_disturbance_of_the_field():
    """It does not average out."""
    strength, disturbance = 40.0, 4.0
    fields = np.tile(tangent(disturbance, strength), (101, 1))
    bounds = field_bounds_over_windows(
        0.01 * np.arange(101), fields, np.zeros((101, 3)), [1.0], disturbance=disturbance, gyro=EXACT_GYRO,
        strength=strength,
    )  # fmt: skip
    assert_reached(bounds, share=0.999999)
    assert_reached(magnetometer_bounds(fields[:1], disturbance, strength=strength), share=0.999999)


# --- field × up -------------------------------------------------------------------------------------------------------


def crossed(field, up, *, shown, in_plane_error, radius, tilt):
    zero, length = np.zeros(1), np.array([np.linalg.norm(field)])
    return cross_bounds(
        DirectionBounds(np.array([up]), np.array([tilt]), zero),
        WindowBounds(
            np.array([field]) / length, np.array([0.5]), zero, zero + 1.0, length, np.array([radius + in_plane_error])
        ),
        shown,
        in_plane_error=in_plane_error,
    )


SHOWN = np.array([0.0, 16.0, -40.0])
EAST = np.array([1.0, 0.0, 0.0])


def test_east_by_an_up_that_is_tilted():
    """Towards east, and the field longer than it is taken for: the product turns in the plane across."""
    strength = np.linalg.norm(SHOWN)
    error = 0.1 * strength
    field = 1.1 * SHOWN
    up = np.array([np.sin(0.02), 0.0, np.cos(0.02)])
    bounds = crossed(field, up, shown=SHOWN, in_plane_error=error, radius=0.0, tilt=0.02)
    assert_reached(bounds, EAST, 0, share=0.999)


def test_east_by_an_up_that_is_tilted_and_a_field_that_is_off():
    """Both push it the same way in the plane across the measured up, where the horizontal field tells nothing."""
    radius, tilt = 2.0, 0.05
    up = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    # The search takes, of all fields within the radius, the one whose product with that up is furthest from east.
    draws = np.random.default_rng(0).standard_normal((20_000, 3))
    fields = SHOWN + radius * draws / np.linalg.norm(draws, axis=1)[:, None]
    products = np.cross(fields, up)
    worst = np.argmin(products @ EAST / np.linalg.norm(products, axis=1))
    bounds = crossed(fields[worst], up, shown=SHOWN, in_plane_error=0.0, radius=radius, tilt=tilt)
    assert_reached(bounds, EAST, 0, share=0.985)


def test_east_by_a_field_that_is_off():
    """The measured field is off by a radius across, so that the horizontal part of it is as wrong as it may be."""
    radius = 2.0
    horizontal = np.sqrt(16.0**2 - radius**2)
    angle = np.arcsin(radius / 16.0)
    field = np.array([-horizontal * np.sin(angle), horizontal * np.cos(angle), -40.0])
    assert np.linalg.norm(field - SHOWN) == pytest.approx(radius)
    bounds = crossed(field, UP, shown=SHOWN, in_plane_error=0.0, radius=radius, tilt=0.0)
    assert_reached(bounds, EAST, 0, share=0.999999)
    # The reference's error in the plane of up and the field moves nothing of it but the length.
    in_plane = crossed(field * [1.05, 1.05, 1.0], UP, shown=SHOWN, in_plane_error=0.8, radius=1.05 * radius, tilt=0.0)
    assert_reached(in_plane, EAST, 0, share=0.99)
