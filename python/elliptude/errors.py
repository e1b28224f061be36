"""What is raised beside Python's own exceptions."""

from math import nan


class InconsistentMeasurement(ValueError):
    """Sets that must meet have no common point: some bound is wrong.

    Parameters
    ----------
    message : str
        What does not meet.
    margin : float
        By how much: negative, see `elliptude.overlap_margin`; NaN where it is not known.
    time : float
        Of the filter, s; NaN where no filter is involved.
    sensor : str
        As the update was told.
    """

    def __init__(self, message: str, margin: float, time: float = nan, sensor: str = "") -> None:
        super().__init__(message, margin, time, sensor)
        self.margin = margin
        self.time = time
        self.sensor = sensor

    def __str__(self) -> str:
        """The message alone."""
        return str(self.args[0])
