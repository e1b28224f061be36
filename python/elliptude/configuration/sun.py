"""Where the Sun is: its direction in J2000 axes from an almanac formula good to 0.01 degrees.

The formula is the low-precision one of the Astronomical Almanac in the form of J. Meeus, *Astronomical Algorithms*,
second edition, chapter 25: the Earth on a Kepler ellipse, referred to the mean ecliptic and equinox of date. IAU 2006
precession (Capitaine et al., *Astronomy & Astrophysics* 412, 2003) takes it to the mean equator and equinox of J2000.
Neither frame has nutation; the Sun's ecliptic latitude, below 0.0004 degrees, is left out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

J2000_JD = 2_451_545.0  # TT
_DAYS_PER_CENTURY = 36_525.0
_SECONDS_PER_DAY = 86_400.0
_ARCSECOND_DEG = 1.0 / 3600.0

# Fermi's mission elapsed time counts SI seconds since 2001-01-01 00:00:00 UTC, which is this in TT. The FITS header has
# TIMESYS = TT, MJDREFI = 51910 and MJDREFF = 7.428703703703703e-4, which is 64.184 s.
FERMI_MET_ORIGIN_JD = 2_400_000.5 + 51_910 + 64.184 / _SECONDS_PER_DAY


def julian_centuries(jd_tt: ArrayLike) -> NDArray[np.float64]:
    """Julian centuries since J2000 of Julian dates in terrestrial time (TT)."""
    return (np.asarray(jd_tt, dtype=np.float64) - J2000_JD) / _DAYS_PER_CENTURY


def fermi_julian_date(met_s: ArrayLike) -> NDArray[np.float64]:
    """Julian date (TT) of Fermi's mission elapsed time in seconds."""
    return FERMI_MET_ORIGIN_JD + np.asarray(met_s, dtype=np.float64) / _SECONDS_PER_DAY


def sun_longitude_of_date(jd_tt: ArrayLike) -> NDArray[np.float64]:
    """The Sun's longitude (rad) on the mean ecliptic, from the mean equinox of date, with aberration; any turns added.

    Aberration (20.5 arcseconds) belongs to it: a Sun sensor in orbit about the Earth sees the Sun there.
    """
    t = julian_centuries(jd_tt)
    mean_longitude_deg = 280.46646 + t * (36_000.76983 + t * 0.0003032)
    anomaly = np.deg2rad(357.52911 + t * (35_999.05029 - t * 0.0001537))
    centre_deg = (
        (1.914602 - t * (0.004817 + t * 0.000014)) * np.sin(anomaly)
        + (0.019993 - t * 0.000101) * np.sin(2.0 * anomaly)
        + 0.000289 * np.sin(3.0 * anomaly)
    )
    aberration_deg = -0.00569
    return np.deg2rad(mean_longitude_deg + centre_deg + aberration_deg)


def mean_obliquity(jd_tt: ArrayLike) -> NDArray[np.float64]:
    """The mean obliquity of the ecliptic of date (rad), IAU 2006."""
    t = julian_centuries(jd_tt)
    return np.deg2rad((84_381.406 - t * (46.836769 + t * (0.0001831 - t * 0.0020034))) * _ARCSECOND_DEG)


def precession_to_j2000(jd_tt: ArrayLike) -> Rotation:
    """Rotation that takes vectors from the mean equator and equinox of date to those of J2000."""
    t = julian_centuries(jd_tt)
    zeta = 2.650545 + t * (2306.083227 + t * (0.2988499 + t * 0.01801828))
    z = -2.650545 + t * (2306.077181 + t * (1.0927348 + t * 0.01826837))
    theta = t * (2004.191903 - t * (0.4294934 + t * 0.04182264))
    # From J2000 to date the axes turn by -zeta about z, theta about y, -z about z: so do vectors from date to J2000.
    angles_deg = np.stack([-zeta, theta, -z], axis=-1) * _ARCSECOND_DEG
    return scipy.spatial.transform.Rotation.from_euler("ZYZ", angles_deg, degrees=True)


def sun_direction_j2000(jd_tt: ArrayLike) -> NDArray[np.float64]:
    """Unit vector (..., 3) from the Earth to the Sun in J2000 axes, at Julian dates (TT) of shape ``(...)``.

    Good to 0.01 degrees between 1950 and 2050. A low Earth orbit adds less than 0.003 degrees of parallax.
    """
    dates = np.asarray(jd_tt, dtype=np.float64)
    flat = dates.ravel()
    longitude, obliquity = sun_longitude_of_date(flat), mean_obliquity(flat)
    of_date = np.stack(
        [np.cos(longitude), np.cos(obliquity) * np.sin(longitude), np.sin(obliquity) * np.sin(longitude)], axis=-1
    )
    return np.asarray(precession_to_j2000(flat).apply(of_date), dtype=np.float64).reshape(*dates.shape, 3)
