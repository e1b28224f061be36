"""The Sun's direction against published values, and astropy where it is installed."""

import warnings

import numpy as np
import pytest
from elliptude.configuration import sun
from elliptude.configuration.statements import SUN_ERROR_DEG
from elliptude.simulation import fermi
from scipy.spatial.transform import Rotation

# Equinoxes and solstices of 2015 as the US Naval Observatory publishes them, UTC to the minute: the Sun's apparent
# longitude is a multiple of 90 degrees then. TT is 67 s ahead of UTC, 68 s from July on.
SEASONS = [
    (2457102, 22 + 45 / 60, 67, 0.0),  # 20 March; Julian day number of the noon that ends at its date's start
    (2457195, 16 + 38 / 60, 67, 90.0),  # 21 June
    (2457289, 8 + 21 / 60, 68, 180.0),  # 23 September
    (2457379, 4 + 48 / 60, 68, 270.0),  # 22 December
]


@pytest.mark.parametrize(("midnight", "hours", "ahead", "longitude"), SEASONS)
def test_equinoxes_and_solstices(midnight, hours, ahead, longitude):
    jd = midnight - 0.5 + hours / 24 + ahead / 86400
    found = np.rad2deg(sun.sun_longitude_of_date(jd))
    # Published longitudes are from the true equinox, which nutation moves by up to 0.005 degrees.
    assert abs((found - longitude + 180) % 360 - 180) < 0.01 + 0.005


def test_example_of_the_formula():
    # Meeus, Astronomical Algorithms, example 25.a: 1992 October 13.0 TD; its longitude is without aberration.
    jd = 2448908.5
    assert np.rad2deg(sun.sun_longitude_of_date(jd)) % 360 == pytest.approx(199.90988 - 0.00569, abs=1e-5)
    assert np.rad2deg(sun.mean_obliquity(jd)) == pytest.approx(23.44023, abs=2e-5)


def test_direction_in_j2000():
    # Apparent, from astropy 7 with its built-in ephemeris (ERFA's epv00, a few kilometres from JPL's).
    table = {
        2448908.5: [-0.93967825, -0.31383222, -0.13606662],
        2457309.125: [-0.94126431, -0.30981395, -0.13430125],
    }
    for jd, expected in table.items():
        found = sun.sun_direction_j2000(jd)
        assert np.linalg.norm(found) == pytest.approx(1, abs=1e-15)
        assert np.linalg.norm(found - expected) < np.deg2rad(0.01)


def test_shapes_and_precession():
    jd = sun.J2000_JD + np.arange(6.0).reshape(2, 3)
    many = sun.sun_direction_j2000(jd)
    assert many.shape == (2, 3, 3)
    np.testing.assert_allclose(many[1, 2], sun.sun_direction_j2000(jd[1, 2]), atol=1e-15)
    # General precession in longitude, 50.29 arcseconds a year: the equinox of date, seen in J2000 axes, goes back.
    century = sun.precession_to_j2000(sun.J2000_JD + 36525.0)
    obliquity = Rotation.from_euler("x", -sun.mean_obliquity(sun.J2000_JD))
    equinox = (obliquity * century).apply([1.0, 0.0, 0.0])
    longitude = np.rad2deg(np.arctan2(equinox[1], equinox[0]))
    assert longitude == pytest.approx(-5028.8 / 3600 - 1.1 / 3600, abs=2e-4)


def test_against_astropy():
    coordinates = pytest.importorskip("astropy.coordinates")
    from astropy.time import Time

    jd = sun.J2000_JD + np.linspace(-50, 50, 501) * 365.25
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of dates for which leap seconds are not known yet
        expected = coordinates.get_sun(Time(jd, format="jd", scale="tt")).cartesian.xyz.value.T
    expected /= np.linalg.norm(expected, axis=1)[:, None]
    errors = np.linalg.norm(sun.sun_direction_j2000(jd) - expected, axis=1)
    almanac, parallax, aberration = np.rad2deg([errors.max(), 42164.0 / 147.09e6, 7.9 / 299792.458])
    assert almanac < 0.01
    # The parallax of a geostationary orbit and the aberration of a low one are not there at once.
    assert almanac + parallax + aberration < SUN_ERROR_DEG


def test_time_of_fermi():
    # 2001-01-01 00:00:00 UTC is 00:01:04.184 TT; Julian day number 2451911 begins at noon of that day.
    assert sun.fermi_julian_date(0.0) == pytest.approx(2451910.5 + 64.184 / 86400, abs=1e-9)
    # Four leap seconds lie between 2001 and October 2015.
    seconds = (2457308.5 - 2451910.5) * 86400 + 4
    assert sun.fermi_julian_date(seconds) == pytest.approx(2457308.5 + 68.184 / 86400, abs=1e-9)


def test_solar_array_of_fermi():
    """The data's README: the +Y array is off by at most 1.3 degrees in this stretch."""
    recorded = fermi.telemetry()
    expected = sun.sun_direction_j2000(sun.fermi_julian_date(recorded.met))
    attitudes = Rotation.from_quat(recorded.quaternions, scalar_first=True)
    measured = attitudes.apply(fermi.sun_in_body(recorded.array_angles))
    angles = np.rad2deg(np.arctan2(np.linalg.norm(np.cross(measured, expected), axis=1), (measured * expected).sum(1)))
    assert 1.0 < angles.max() < 1.3
