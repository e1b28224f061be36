"""Smoothing: guaranteed sets that use a whole recording, its future as well as its past; a fixed lag, for streams."""

from elliptude.smoothing.fixed_lag import FixedLagSmoother, SmoothedSet
from elliptude.smoothing.smoother import SmoothedRun, figures, require_guaranteed, smooth, smoothed_run, summarize

__all__ = [
    "FixedLagSmoother",
    "SmoothedRun",
    "SmoothedSet",
    "figures",
    "require_guaranteed",
    "smooth",
    "smoothed_run",
    "summarize",
]
