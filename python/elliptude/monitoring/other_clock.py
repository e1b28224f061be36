"""Attitudes whose stamps are of a clock that the sets' own may be off against: theory, section 18.8."""

from dataclasses import replace

import numpy as np

from elliptude.monitoring import arcs
from elliptude.monitoring.error_angles import ANGLE_ROUNDING
from elliptude.monitoring.monitor import Monitored
from elliptude.typing import FloatArray


def widened(monitored: Monitored, turns: FloatArray) -> Monitored:
    """Bounds that also hold if the body has turned between the set's moment and that of the attitude's stamp.

    Parameters
    ----------
    monitored : Monitored
        Of attitudes taken as of the very moments of the sets.
    turns : (n,) array
        How far the body may turn between both moments, rad, such as `elliptude.bounds.stamps.time_offset_angles` of
        the largest offset; NaN where nothing is known of it.

    Returns
    -------
    Monitored
    """
    turned = np.minimum(np.where(np.isfinite(turns), turns, np.pi), np.pi)
    turned = np.where(turned > 0.0, turned + ANGLE_ROUNDING, 0.0)
    # A turn moves the heading the more the further up is off.
    tilt = monitored.bounds[:, 1]
    is_bounded = tilt + turned < np.pi
    sine = np.sin(0.5 * turned) / np.cos(0.5 * np.where(is_bounded, tilt, 0.0))
    of_heading = np.where(is_bounded, 2.0 * np.arcsin(np.minimum(sine, 1.0)), 2.0 * np.pi)
    of_heading = np.where(turned > 0.0, of_heading + ANGLE_ROUNDING, 0.0)
    more = np.column_stack([turned, turned, of_heading])
    headings = arcs.arc(
        0.5 * monitored.headings.sum(axis=1), 0.5 * np.diff(monitored.headings, axis=1)[:, 0] + of_heading
    )
    # NaN stays where nothing was known.
    return replace(
        monitored,
        bounds=np.minimum(monitored.bounds + more, np.pi),
        least=np.maximum(monitored.least - more, np.minimum(monitored.least, 0.0)),
        headings=np.where(np.isnan(monitored.headings), np.nan, headings),
    )
