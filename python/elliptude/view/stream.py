"""What the SDK of Rerun is given: things that stay, and columns of things that change over time."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from elliptude.io.files import FileError
from elliptude.typing import FloatArray

OLDEST = (0, 41)
"""The oldest version of the SDK that was tried."""
TIMELINE = "time"

# s since 1970: later stamps are times of day.
_YEAR_2001 = 1e9


class Stream:
    """A recording of Rerun's that is being made.

    Parameters
    ----------
    title : str
        What the viewer calls it.
    first : float
        The first time, s; from 2001 on as seconds since 1970, the viewer shows dates.
    """

    def __init__(self, title: str, first: float) -> None:
        from uuid import uuid4

        self.rr = sdk()
        # An identity of its own: a process would give all its recordings the same one.
        self.recording = self.rr.RecordingStream("elliptude", recording_id=uuid4())
        if not self.rr.is_enabled(self.recording):
            raise FileError("the variable RERUN of the environment turns Rerun off")
        self.recording.send_recording_name(title)
        self._clock = "timestamp" if first >= _YEAR_2001 else "duration"

    def still(self, path: str, *parts: Any) -> None:
        """Say what does not change."""
        self.recording.log(path, *parts, static=True, strict=True)

    def moving(self, path: str, times: FloatArray, columns: Any) -> None:
        """Say what changes, all rows (s) at once."""
        if len(times):
            index = self.rr.TimeColumn(TIMELINE, **{self._clock: times})
            self.recording.send_columns(path, [index], columns, strict=True)

    def scalars(self, path: str, times: FloatArray, values: FloatArray) -> None:
        """Say several curves (n, k) of one plot; NaN makes a gap."""
        columns = self.rr.Scalars.columns(scalars=values.ravel())
        self.moving(path, times, columns.partition(lengths=np.full(len(times), values.shape[1])))

    def colours(self, colours: list[str]) -> NDArray[np.uint8]:
        """Colours as the SDK takes them, shape (n, 3)."""
        return np.array([list(bytes.fromhex(colour[1:])) for colour in colours], dtype=np.uint8)


def sdk() -> Any:
    """Rerun's SDK.

    Raises
    ------
    FileError
        If it is not installed, or too old.
    """
    remedy = "pip install --upgrade 'elliptude[rerun]'"
    try:
        import rerun
        import rerun.blueprint
    except ModuleNotFoundError as error:
        raise FileError(f"a view needs Rerun: {remedy}") from error
    version = str(getattr(rerun, "__version__", "of another project"))
    try:
        is_old = tuple(int(part) for part in version.split(".")[:2]) < OLDEST
    except ValueError:
        is_old = True
    if is_old:
        raise FileError(f"a view needs Rerun {'.'.join(map(str, OLDEST))} or newer, not {version}: {remedy}")
    return rerun


def there(values: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """Vectors (n, k, 3) one after the other, without those of rows with NaN, and how many are of each row."""
    known = np.isfinite(values).all(axis=(1, 2))
    return values[known].reshape(-1, values.shape[-1]), np.where(known, values.shape[1], 0)
