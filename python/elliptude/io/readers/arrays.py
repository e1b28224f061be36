"""Named arrays: NumPy's archives, MATLAB's and HDF5 files, and arrays in memory, read as a file is."""

import os
import zipfile
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elliptude.io.files import FileError, as_path, system_fault
from elliptude.io.readers.base import Batch, NumbersAlone, numbered
from elliptude.typing import FloatArray

MOST_COLUMNS = 10_000
"""The widest array that is read as columns."""

# What a MATLAB file since version 7.3 has behind its first 512 bytes, and an HDF5 file at its beginning.
_HDF5 = b"\x89HDF\r\n\x1a\n"
# What arrays of other kinds hold, by `numpy.dtype.kind`.
_OTHER_KINDS = {
    "O": "objects",
    "c": "complex numbers",
    "U": "text",
    "S": "text",
    "M": "dates",
    "m": "times",
    "V": "records",
}
LABEL = "elliptude"
"""The array of text in which an NPZ file of elliptude says what it is, and from which second its times count."""
# A matrix of so few rows, and more columns, has its samples side by side.
_MOST_COMPONENTS = 9


class _NamedArrays(NumbersAlone):
    """A file of arrays. One ``t`` (N,) is the column ``t``, one ``gyr`` (N, 3) the columns ``gyr[0]`` to ``gyr[2]``.

    Arrays of other shapes, and what is neither number nor boolean, are no columns. Arrays of the same length make a
    stream, named by its length. NaN is what was not measured.
    """

    KIND: str
    """What messages call such a file."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = as_path(path)
        self._lengths: dict[str, int] = {}
        self._all: dict[str, tuple[tuple[int, ...], str]] = {}
        """Shape and kind of each array, also of those that are no columns."""
        self._sources: dict[str, tuple[str, int | None]] = {}
        """The array that a column is in, and which column of it."""
        self._all |= self._read(self._shapes)
        for name, (shape, kind) in self._all.items():
            if kind in "biuf" and len(shape) in {1, 2} and all(n <= MOST_COLUMNS for n in shape[1:]):
                found = {name: None} if len(shape) == 1 else {f"{name}[{i}]": i for i in range(shape[1])}
                self._sources |= {column: (name, i) for column, i in found.items()}
                self._lengths |= dict.fromkeys(found, shape[0])
        self.columns = tuple(self._lengths)

    @abstractmethod
    def _shapes(self) -> Mapping[str, tuple[tuple[int, ...], str]]:
        """The shape of each array, and the letter of its kind, `numpy.dtype.kind`."""

    @abstractmethod
    def _arrays(self, names: Sequence[str]) -> Mapping[str, NDArray[np.generic]]:
        """Some arrays, by their names."""

    def _read(self, read: Any, *arguments: Any) -> Any:
        try:
            return read(*arguments)
        except FileError:
            raise
        except zipfile.BadZipFile as error:
            raise FileError(f"{self.path}: not {self.KIND}, or cut off: copy it again") from error
        except OSError as error:
            fault = system_fault(error) if error.errno else f"not {self.KIND}"
            raise FileError(f"{self.path}: {fault}") from error
        except NotImplementedError as error:
            raise FileError(f"{self.path}: {self.KIND}, but of a kind or compression that is not read") from error
        except MemoryError as error:
            raise FileError(f"{self.path}: {self.KIND} that is larger than the memory, or damaged") from error
        except Exception as error:  # what reads the format raises what its parsing happens to meet, in its own words
            raise FileError(f"{self.path}: not {self.KIND}, or damaged: copy it again") from error

    def stream(self, column: str) -> str:
        """See `LogFile`."""
        return str(self._lengths[column])

    def batches(self, columns: Sequence[str]) -> Iterator[Batch]:
        """All rows in one batch; an array is taken from the file once."""
        sources = {column: self._sources[column] for column in columns}
        arrays = self._read(self._arrays, list(dict.fromkeys(name for name, _ in sources.values())))
        yield {
            column: numbered(arrays[name] if i is None else arrays[name][:, i]) for column, (name, i) in sources.items()
        }

    def about(self, column: str) -> str:
        """See `LogFile`: what the array is that would have the column."""
        name = column if column in self._all else column.rpartition("[")[0]
        if name not in self._all:
            return ""
        shape, kind = self._all[name]
        if kind not in "biuf":
            return f"array {name} holds {_OTHER_KINDS.get(kind, 'something else')}, not numbers"
        lies = len(shape) == 2 and shape[0] <= _MOST_COMPONENTS < shape[1]
        return f"array {name} has the shape {shape}{': transpose it, so that a row is a sample' if lies else ''}"

    def place(self, column: str, row: int) -> str:
        """See `LogFile`."""
        return f"row {row + 1}, column {column!r}"

    def places_of_rows(self, rows: Sequence[int]) -> list[str]:
        """See `LogFile`."""
        return [f"row {row + 1}" for row in rows]


class NpzFile(_NamedArrays):
    """A NumPy archive, ``.npz``."""

    KIND = "an NPZ file"

    @cached_property
    def label(self) -> str:
        """What a file of elliptude says of itself, as a comment of a CSV file does; else empty."""
        is_text = self._all.get(LABEL) is not None and self._all[LABEL][0] == () and self._all[LABEL][1] == "U"
        return str(self._read(self._arrays, [LABEL])[LABEL]) if is_text else ""

    def _shapes(self) -> Mapping[str, tuple[tuple[int, ...], str]]:
        found = {}
        with zipfile.ZipFile(self.path) as archive:
            for member in archive.namelist():
                with archive.open(member) as file:
                    version = np.lib.format.read_magic(file)
                    read_header = (
                        np.lib.format.read_array_header_1_0
                        if version == (1, 0)
                        else np.lib.format.read_array_header_2_0
                    )
                    shape, _, dtype = read_header(file)
                found[member.removesuffix(".npy")] = shape, dtype.kind
        return found

    def _arrays(self, names: Sequence[str]) -> Mapping[str, NDArray[np.generic]]:
        with np.load(self.path, allow_pickle=False) as archive:
            return {name: archive[name] for name in names}


class Hdf5File(_NamedArrays):
    """An HDF5 file, or one of MATLAB since version 7.3, by way of h5py: the extra ``elliptude[hdf5]``.

    An array in a group is ``group.array``. MATLAB keeps matrices column by column, so that they are turned, and a row
    or a column of a matrix is an array of one dimension.
    """

    KIND = "an HDF5 file"

    def _shapes(self) -> Mapping[str, tuple[tuple[int, ...], str]]:
        h5py, found = self._library(), {}
        with h5py.File(self.path, "r") as file:
            self._is_matlab = any("MATLAB_class" in item.attrs for item in file.values())

            def look(name: str, item: Any) -> None:
                if isinstance(item, h5py.Dataset) and not name.startswith("#"):
                    found[name.replace("/", ".")] = self._shape_of(item), item.dtype.kind

            file.visititems(look)
        return found

    def _shape_of(self, item: Any) -> tuple[int, ...]:
        shape: tuple[int, ...] = tuple(item.shape or ())
        if self._is_matlab and len(shape) == 2:
            return (max(shape),) if 1 in shape else shape[::-1]
        return shape

    def _arrays(self, names: Sequence[str]) -> Mapping[str, NDArray[np.generic]]:
        with self._library().File(self.path, "r") as file:
            items = {name: file[name.replace(".", "/")] for name in names}
            return {
                name: (item[()].T if self._is_matlab else item[()]).reshape(self._shape_of(item))
                for name, item in items.items()
            }

    def _library(self) -> Any:
        try:
            import h5py
        except ModuleNotFoundError as error:
            raise FileError(f"{self.path}: reading HDF5 needs h5py: pip install 'elliptude[hdf5]'") from error
        return h5py


class MatlabFile(_NamedArrays):
    """A file of MATLAB up to version 7.2, ``.mat``, whole in memory; a newer one is an `Hdf5File`.

    A field of a structure is ``structure.field``. A row or a column of a matrix is an array of one dimension.
    """

    KIND = "a MAT file"

    def _shapes(self) -> Mapping[str, tuple[tuple[int, ...], str]]:
        import scipy.io

        self._values: dict[str, NDArray[np.generic]] = {}
        content = scipy.io.loadmat(os.fspath(self.path), squeeze_me=False, struct_as_record=True)
        self._take({name: value for name, value in content.items() if not name.startswith("__")}, "")
        return {name: (value.shape, value.dtype.kind) for name, value in self._values.items()}

    def _take(self, values: Mapping[str, Any], above: str) -> None:
        for name, value in values.items():
            array = np.asarray(value)
            if array.dtype.names is not None and array.size == 1:
                self._take({field: array[field].item() for field in array.dtype.names}, f"{above}{name}.")
            elif array.ndim == 2 and 1 in array.shape:
                self._values[above + name] = array.reshape(-1)
            else:
                self._values[above + name] = array

    def _arrays(self, names: Sequence[str]) -> Mapping[str, NDArray[np.generic]]:
        return {name: self._values[name] for name in names}


def open_matlab(path: str | os.PathLike[str]) -> MatlabFile | Hdf5File:
    """Open a ``.mat`` file of any version.

    Parameters
    ----------
    path : path-like

    Raises
    ------
    FileError
        If it cannot be read, or what reads it is not installed.
    """
    try:
        with Path(path).open("rb") as file:
            beginning = file.read(512 + len(_HDF5))
    except OSError as error:
        raise FileError(f"{path}: {system_fault(error)}") from error
    return Hdf5File(path) if beginning.endswith(_HDF5) or beginning.startswith(_HDF5) else MatlabFile(path)


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
