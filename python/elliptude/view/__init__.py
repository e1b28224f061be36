"""A run as a recording for Rerun, the viewer of robotics, in which one can go through it in time."""

from elliptude.view.directions import MeasuredDirections, measured_directions
from elliptude.view.recording import Drawn, in_words, show, to_rerun, write_view
from elliptude.view.stream import sdk

__all__ = ["Drawn", "MeasuredDirections", "in_words", "measured_directions", "sdk", "show", "to_rerun", "write_view"]
