"""PX4's ULog files (``.ulg``), by way of pyulog: the extra ``elliptude[ulog]``."""

import errno
import io
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from elliptude.io.files import FileError, as_path, system_fault
from elliptude.io.readers.base import Batch, NumbersAlone, numbered

# The first bytes of any ULog; a version follows.
_MAGIC = b"ULog\x01\x12\x35"


class UlogFile(NumbersAlone):
    """A ULog, whole in memory. A column is ``topic.field``, or ``topic:1.field`` of the topic's second instance.

    Each topic is a stream with the column ``timestamp`` in µs. Fields have pyulog's names, such as
    ``sensor_combined.gyro_rad[0]``. NaN is what was not measured.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = as_path(path)
        try:
            import pyulog
        except ModuleNotFoundError as error:
            raise FileError(f"{path}: reading a ULog needs pyulog: pip install 'elliptude[ulog]'") from error
        reached = 0
        try:
            with _Bounded(Path(self.path)) as content:
                try:
                    log = pyulog.ULog(content)
                except Exception:
                    reached = content.tell()
                    raise
        except OSError as error:
            # A damaged file also makes pyulog go to a place that no file has.
            fault = self._damage(reached) if error.errno == errno.EINVAL else system_fault(error)
            raise FileError(f"{path}: {fault}") from error
        except Exception as error:  # pyulog raises what its parsing happens to meet, in words for nobody
            raise FileError(f"{path}: {self._damage(reached)}") from error
        self._arrays: dict[str, NDArray[np.generic]] = {
            f"{_topic(data.name, data.multi_id)}.{field}": values
            for data in log.data_list
            for field, values in data.data.items()
            if values.dtype.kind in "biuf"
        }
        self.columns = tuple(self._arrays)

    def _damage(self, reached: int) -> str:
        """Why it cannot be read, where, and what may be done."""
        path = Path(self.path)
        with path.open("rb") as file:
            begins = file.read(len(_MAGIC))
        if len(begins) < len(_MAGIC) and _MAGIC.startswith(begins):
            return f"not a whole ULog: it ends after {len(begins)} bytes; copy it from the vehicle again"
        if begins != _MAGIC:
            return f"not a ULog: it begins with {begins[:4]!r} where b'ULog' must stand; a CSV file's name ends in .csv"
        return (
            f"a damaged ULog: it cannot be read beyond byte {reached} of {path.stat().st_size}; copy it from the "
            "vehicle again"
        )

    def stream(self, column: str) -> str:
        """The topic."""
        return column.partition(".")[0]

    def stamps(self, stream: str) -> tuple[str, str]:
        """The topic's own, µs."""
        return f"{stream}.timestamp", "us"

    def batches(self, columns: Sequence[str]) -> Iterator[Batch]:
        """All rows in one batch."""
        yield {name: numbered(self._arrays[name]) for name in columns}

    def place(self, column: str, row: int) -> str:
        """See `elliptude.io.readers.base.LogFile`."""
        return f"sample {row + 1} of {column}"

    def about(self, column: str) -> str:
        """See `LogFile`: whether anything was recorded."""
        return "" if self.columns else "no topic has a sample: the log ends before the first one"

    def places_of_rows(self, rows: Sequence[int]) -> list[str]:
        """Empty: topics do not share their rows."""
        return [""] * len(rows)


class _Bounded(io.BufferedReader):
    """A file whose reading always ends: in a damaged log pyulog may go back to the same place for ever.

    A message that it keeps, skips or searches through takes two reads and is at least a byte long, up to three times if
    data were appended.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self._reads_left = 8 * path.stat().st_size + 10_000

    def read(self, size: int | None = -1, /) -> bytes:
        """Read as from any file; raises EOFError if it has gone on for too long."""
        self._reads_left -= 1
        if self._reads_left < 0:
            raise EOFError("damaged so that reading it does not end")
        return super().read(size)


def _topic(name: str, instance: int) -> str:
    return name if instance == 0 else f"{name}:{instance}"
