"""What is raised beside Python's own exceptions."""

from math import nan


class RowError(ValueError):
    """Something is wrong in one row of a log.

    Parameters
    ----------
    message : str
        What is wrong.
    row : int
        Of the arrays that were given, from 0.
    place : str
        What a message calls the row: its line in a file, where that is known.
    """

    def __init__(self, message: str, row: int, place: str = "") -> None:
        super().__init__(message, row, place)
        self.row = row
        self.place = place

    def __str__(self) -> str:
        """The place and the message."""
        return f"{self.place or f'row {self.row}'}: {self.args[0]}"

    def at(self, place: str) -> "RowError":
        """The same with what a person calls the row."""
        return RowError(self.args[0], self.row, place)


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
    row : int, optional
        Of the arrays that were given, from 0, where these were of a whole log.
    place : str
        What a message calls the row: its line in a file, where that is known.
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
        """The same with what a person calls the row."""
        return InconsistentMeasurement(self.args[0], self.margin, self.time, self.sensor, self.row, place)
