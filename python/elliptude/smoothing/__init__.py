"""Smoothing: guaranteed sets that use a whole recording, its future as well as its past."""

from elliptude.smoothing.smoother import SmoothedRun, figures, require_guaranteed, smooth, smoothed_run, summarize

__all__ = ["SmoothedRun", "figures", "require_guaranteed", "smooth", "smoothed_run", "summarize"]
