"""Arrays of NumPy: archives (``.npz``), and arrays in memory, read as a file is."""

import os
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from elliptude.io.files import FileError, as_path, system_fault
from elliptude.io.readers.base import Batch, Cells, NumbersAlone, numbered
from elliptude.typing import FloatArray

MOST_COLUMNS = 10_000
"""The widest array that is read as columns."""


class NpzFile(NumbersAlone):
    """A NumPy archive. Array ``t`` (N,) is the column ``t``, array ``gyr`` (N, 3) the columns ``gyr[0]`` to ``gyr[2]``.

    Arrays of other shapes, and what is neither number nor boolean, are no columns. Arrays of the same length make a
    stream, named by its length. NaN is what was not measured.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = as_path(path)
        self._lengths: dict[str, int] = {}
        try:
            with zipfile.ZipFile(path) as archive:
                for member in archive.namelist():
                    with archive.open(member) as file:
                        version = np.lib.format.read_magic(file)
                        read_header = (
                            np.lib.format.read_array_header_1_0
                            if version == (1, 0)
                            else np.lib.format.read_array_header_2_0
                        )
                        shape, _, dtype = read_header(file)
                    name = member.removesuffix(".npy")
                    if dtype.kind in "biuf" and len(shape) in {1, 2} and all(n <= MOST_COLUMNS for n in shape[1:]):
                        names = [name] if len(shape) == 1 else [f"{name}[{i}]" for i in range(shape[1])]
                        self._lengths |= dict.fromkeys(names, shape[0])
        except OSError as error:
            raise FileError(f"{path}: {system_fault(error)}") from error
        except Exception as error:  # zipfile and NumPy raise what their parsing happens to meet
            raise FileError(f"{path}: not an NPZ file: {error}") from error
        self.columns = tuple(self._lengths)

    def stream(self, column: str) -> str:
        """See `LogFile`."""
        return str(self._lengths[column])

    def batches(self, columns: Sequence[str]) -> Iterator[Batch]:
        """All rows in one batch; an array is taken from the archive once."""
        arrays: dict[str, NDArray[np.generic]] = {}
        batch: dict[str, Cells] = {}
        try:
            with np.load(self.path, allow_pickle=False) as archive:
                for column in columns:
                    name, _, index = column.partition("[") if column not in archive.files else (column, "", "")
                    if name not in arrays:
                        arrays[name] = archive[name]
                    values = arrays[name]
                    batch[column] = numbered(values[:, int(index[:-1])] if index else values)
        except OSError as error:
            raise FileError(f"{self.path}: {system_fault(error)}") from error
        except Exception as error:  # as above
            raise FileError(f"{self.path}: not an NPZ file: {error}") from error
        yield batch

    def place(self, column: str, row: int) -> str:
        """See `LogFile`."""
        return f"row {row + 1}, column {column!r}"

    def places_of_rows(self, rows: Sequence[int]) -> list[str]:
        """See `LogFile`."""
        return [f"row {row + 1}" for row in rows]


class ArrayLog(NumbersAlone):
    """Columns in memory. Their names are those of a slice, such as ``gyr[:, 0]``; NaN is what was not measured."""

    def __init__(self, columns: Mapping[str, FloatArray], name: str) -> None:
        self.path: os.PathLike[str] = Path(name)
        self._values = dict(columns)
        self.columns = tuple(columns)

    def stream(self, column: str) -> str:
        """All columns share their rows."""
        return ""

    def batches(self, columns: Sequence[str]) -> Iterator[Batch]:
        """All rows in one batch."""
        yield {column: numbered(self._values[column]) for column in columns}

    def place(self, column: str, row: int) -> str:
        """As a program writes it: ``gyr[812, 0]``."""
        return column.replace(":", str(row))

    def places_of_rows(self, rows: Sequence[int]) -> list[str]:
        """Rows from 0."""
        return [f"row {row}" for row in rows]
