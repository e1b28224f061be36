"""The exceptions that elliptude raises besides Python's own."""

from math import nan


class RowError(ValueError):
    """Something is wrong in one row of a log.

    Parameters
    ----------
    message : str
        What is wrong.
    row : int
        The row of the given arrays, from 0.
    place : str
        What a message calls the row: its line in a file, if known.
    """

    def __init__(self, message: str, row: int, place: str = "") -> None:
        super().__init__(message, row, place)
        self.row = row
        self.place = place

    def __str__(self) -> str:
        """The place and the message."""
        return f"{self.place or f'row {self.row}'}: {self.args[0]}"

    def at(self, place: str) -> "RowError":
        """The same error with a place that a person can find."""
        return RowError(self.args[0], self.row, place)


class InconsistentMeasurement(ValueError):
    """Sets that must meet have no common point: some bound is wrong.

    Parameters
    ----------
    message : str
        What does not meet.
    margin : float
        How far the sets are from meeting: negative, see `elliptude.overlap_margin`; NaN if unknown.
    time : float
        The filter's time, s; NaN if no filter is involved.
    sensor : str
        The sensor's name, as it was given to the update.
    row : int, optional
        The row of the given arrays, from 0, if these were a whole log.
    place : str
        What a message calls the row: its line in a file, if known.
    """

    def __init__(
        self,
        message: str,
        margin: float,
        time: float = nan,
        sensor: str = "",
        row: int | None = None,
        place: str = "",
    ) -> None:
        super().__init__(message, margin, time, sensor, row, place)
        self.margin = margin
        self.time = time
        self.sensor = sensor
        self.row = row
        self.place = place

    def __str__(self) -> str:
        """The place, where there is one, and the message."""
        place = self.place or ("" if self.row is None else f"row {self.row}")
        return f"{place}: {self.args[0]}" if place else str(self.args[0])

    def at(self, place: str) -> "InconsistentMeasurement":
        """The same error with a place that a person can find."""
        return InconsistentMeasurement(self.args[0], self.margin, self.time, self.sensor, self.row, place)
