"""Samples in units of a field's strength, scaled by no more than it: bounds stated in µT hold (theory.md, 18.1)."""

import numpy as np
from elliptude.bounds.samples import VectorSensorBounds, magnetometer_bounds
from hypothesis import given
from hypothesis import strategies as st
from inputs import angle_between, direction, generators

STRENGTH, DISTURBANCE, ERROR, SCALE = 48.0, 6.0, 1.5, 0.02


def samples(rng, strength_of_unit, count=200):
    """What a sensor shows whose errors are as large as stated, and the true field, body axes, µT."""
    fields = STRENGTH * np.array([direction(rng) for _ in range(count)])
    disturbed = fields + DISTURBANCE * np.array([direction(rng) for _ in range(count)])
    scales = SCALE * np.array([np.linalg.qr(rng.standard_normal((3, 3)))[0] for _ in range(count)])
    shown = disturbed + np.einsum("nij,nj->ni", scales, disturbed)
    shown += ERROR * np.array([direction(rng) for _ in range(count)])
    return shown / strength_of_unit, fields


@given(generators, st.floats(20.0, 70.0), st.floats(0.2, 1.0))
def test_no_more_than_the_strength_covers_the_errors(rng, strength_of_unit, share):
    """The reference is the field as the sensor shows it, ``share`` times as long."""
    shown, fields = samples(rng, strength_of_unit)
    stated = share * strength_of_unit
    bounds = magnetometer_bounds(
        stated * shown, DISTURBANCE, strength=share * STRENGTH, sensor=VectorSensorBounds(ERROR, SCALE)
    )
    assert not np.isnan(bounds.angles).any(), "honest samples contradict nothing"
    assert (angle_between(shown, fields) <= bounds.angles * (1.0 + 1e-12)).all()


def test_more_than_the_strength_would_not():
    """The other way the same samples are outside: the condition is needed."""
    shown, fields = samples(np.random.default_rng(0), 40.0, count=2000)
    bounds = magnetometer_bounds(
        60.0 * shown, DISTURBANCE, strength=1.5 * STRENGTH, sensor=VectorSensorBounds(ERROR, SCALE)
    )
    outside = angle_between(shown, fields) > bounds.angles
    assert (outside | np.isnan(bounds.angles)).any()


@given(generators, st.floats(20.0, 70.0), st.floats(0.8, 1.0))
def test_a_reference_in_microtesla_needs_a_scale_error(rng, strength_of_unit, share):
    shown, fields = samples(rng, strength_of_unit)
    sensor = VectorSensorBounds(ERROR, 1.0 - share + share * SCALE)
    bounds = magnetometer_bounds(share * strength_of_unit * shown, DISTURBANCE, strength=STRENGTH, sensor=sensor)
    assert not np.isnan(bounds.angles).any()
    assert (angle_between(shown, fields) <= bounds.angles * (1.0 + 1e-12)).all()


def test_the_scale_error_is_needed():
    shown, _ = samples(np.random.default_rng(1), 40.0)
    bounds = magnetometer_bounds(28.0 * shown, DISTURBANCE, strength=STRENGTH, sensor=VectorSensorBounds(ERROR, SCALE))
    assert np.isnan(bounds.angles).any()
