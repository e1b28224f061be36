"""Monitoring of another filter: how far its attitudes can be off, by guaranteed sets. Needs only NumPy."""

from elliptude.monitoring.error_angles import ErrorAngles, error_angles
from elliptude.monitoring.monitor import Limits, Monitored, Sets, UpCaps, monitor
from elliptude.monitoring.other_clock import widened
from elliptude.monitoring.put_back import put_back

__all__ = ["ErrorAngles", "Limits", "Monitored", "Sets", "UpCaps", "error_angles", "monitor", "put_back", "widened"]
