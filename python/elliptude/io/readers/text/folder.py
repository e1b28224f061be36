"""The CSV files of one recording in a folder or a ZIP archive, as phone apps export them: phyphox, Sensor Logger."""

import csv
import os
import shutil
import tempfile
import weakref
import zipfile
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path, PurePosixPath

import numpy as np

from elliptude import units
from elliptude.io.files import FileError, as_path, system_fault
from elliptude.io.readers.base import Batch, Cells
from elliptude.io.readers.text.csv import CsvTable
from elliptude.io.readers.text.dialect import ALL_FOUND_OUT, TIME_HEADER, Stated
from elliptude.io.spool import NamedFile

SUM = "Accelerometer+Gravity"
"""The stream of `SensorLogger` in which two files of an iPhone are what its accelerometer measured."""
# At least this share of the rows of Accelerometer.csv has a stamp of another file where sensors are sampled together,
# as those of an iPhone are.
_SHARED = 0.9


class CsvFolder:
    """CSV files in a folder or a ZIP archive. Column ``x`` of ``Gyroscope.csv`` is ``Gyroscope.x``.

    Each file is a stream. Its stamps are the column whose header is a time with a unit, such as ``Time (s)``. Empty
    files, and files that are no CSV, have no columns.

    Parameters
    ----------
    path : path-like
    stated : Stated
        How the files are written, as far as that is not to be found out.
    lenient : bool
        As in `CsvTable`.

    Raises
    ------
    FileError
        If no file can be read, or phyphox was paused while it recorded.
    """

    def __init__(self, path: str | os.PathLike[str], stated: Stated = ALL_FOUND_OUT, *, lenient: bool = False) -> None:
        self.path = as_path(path)
        self._folder = _folder_of(self.path)
        self.tables: dict[str, CsvTable] = {}
        faults: list[str] = []
        stems: dict[str, str] = {}
        for file in csv_files(self._folder):
            if file.stem in stems:
                raise FileError(
                    f"{path}: {stems[file.stem]} and {file.name}: two files of one sensor; take one of the two out"
                )
            stems[file.stem] = file.name
            try:
                self.tables[file.stem] = CsvTable(NamedFile(file, f"{path}/{file.name}"), stated, lenient=lenient)
            except FileError as error:
                faults.append(str(error))
        if not self.tables:
            raise FileError(faults[0] if faults else f"{path}: no CSV file in it")
        self._require_no_pause()
        self.columns = tuple(f"{stem}.{name}" for stem, table in self.tables.items() for name in table.columns)

    def _require_no_pause(self) -> None:
        """phyphox's stamps go on after a pause as if no time had gone by, but the body may have turned."""
        events = rows_of(self._folder / "meta" / "time.csv")
        starts = [row.get("experiment time", "") for row in events if row.get("event") == "START"]
        if len(starts) > 1:
            raise FileError(
                f"{self.path}: it was paused at {_number(starts[1])} s (meta/time.csv), and the stamps go on as if no "
                "time had gone by. Record without a pause, or cut each file there and leave meta/time.csv out"
            )

    def stream(self, column: str) -> str:
        """The file, without its ending."""
        return max((stem for stem in self.tables if column.startswith(f"{stem}.")), key=len, default="")

    def files_of(self, stream: str) -> tuple[str, ...]:
        """The files that a stream is read from, without their ending."""
        return (stream,)

    def table_of(self, column: str) -> tuple[CsvTable, str]:
        """The file that has a column, and what the column is called there."""
        stem = self.stream(column)
        return self.tables[stem], column.removeprefix(f"{stem}.")

    def holds_numbers(self, column: str) -> bool:
        """See `LogFile`."""
        table, name = self.table_of(column)
        return table.holds_numbers(name)

    def time_unit(self, column: str) -> str | None:
        """See `LogFile`."""
        table, name = self.table_of(column)
        return table.time_unit(name)

    def stamps(self, stream: str) -> tuple[str, str] | None:
        """The only column whose header is a time with a unit, or else the only one whose cells are times of day."""
        if stream not in self.tables:
            return None
        table = self.tables[stream]
        found = {name: match["unit"].lower() for name in table.columns if (match := TIME_HEADER.fullmatch(name))}
        found = {name: units.unit_of(unit) for name, unit in found.items()}
        if not found:
            found = {name: unit for name in table.columns if (unit := table.time_unit(name)) is not None}
        return (f"{stream}.{next(iter(found))}", next(iter(found.values()))) if len(found) == 1 else None

    def batches(self, columns: Sequence[str]) -> Iterator[Batch]:
        """See `LogFile`."""
        table, _ = self.table_of(columns[0])
        names = {column: self.table_of(column)[1] for column in columns}
        for batch in table.batches(list(dict.fromkeys(names.values()))):
            yield {column: batch[name] for column, name in names.items()}

    def place(self, column: str, row: int) -> str:
        """The file, and the place in it."""
        table, name = self.table_of(column)
        return f"{self.stream(column)}.csv, {table.place(name, row)}"

    def about(self, column: str) -> str:
        """Nothing."""
        return ""

    def places_of_rows(self, rows: Sequence[int]) -> list[str]:
        """Empty: files do not share their rows."""
        return [""] * len(rows)


class SensorLogger(CsvFolder):
    """A recording of the app Sensor Logger. Each file has ``time`` in ns since 1970, ``seconds_elapsed``, z, y, x.

    Accelerometer.csv is the acceleration without gravity, which does not show up. TotalAcceleration.csv has what an
    accelerometer measures, but iPhones do not write it. For them the stream `SUM` is the sum of Accelerometer.csv and
    Gravity.csv at the stamps of both (the app's documentation, UNITS.md): the app has both from one sample, which iOS
    divides into these two.
    """

    def __init__(self, path: str | os.PathLike[str], stated: Stated = ALL_FOUND_OUT, *, lenient: bool = False) -> None:
        super().__init__(path, stated, lenient=lenient)
        metadata = [file for file in csv_files(self._folder) if file.stem.lower() == "metadata"]
        rows = rows_of(metadata[0]) if metadata else []
        self.metadata = rows[0] if rows else {}
        """What Metadata.csv says, by its columns; empty without it."""
        if {"Accelerometer", "Gravity"} <= self.tables.keys():
            self.columns += tuple(f"{SUM}.{name}" for name in ("time", "x", "y", "z"))

    def stream(self, column: str) -> str:
        """See `CsvFolder`; or the sum."""
        return SUM if column.startswith(f"{SUM}.") else super().stream(column)

    def files_of(self, stream: str) -> tuple[str, ...]:
        """See `CsvFolder`."""
        return ("Accelerometer", "Gravity") if stream == SUM else (stream,)

    def table_of(self, column: str) -> tuple[CsvTable, str]:
        """See `CsvFolder`; the sum is at the rows of Accelerometer.csv."""
        if column.startswith(f"{SUM}."):
            return self.tables["Accelerometer"], column.removeprefix(f"{SUM}.")
        return super().table_of(column)

    def stamps(self, stream: str) -> tuple[str, str] | None:
        """``time``, ns."""
        known = stream == SUM or (stream in self.tables and "time" in self.tables[stream].columns)
        return (f"{stream}.time", "ns") if known else None

    def batches(self, columns: Sequence[str]) -> Iterator[Batch]:
        """See `LogFile`; the sum comes in one batch."""
        if self.stream(columns[0]) != SUM:
            yield from super().batches(columns)
            return
        names = [column.removeprefix(f"{SUM}.") for column in columns]
        first, second = (self._whole(stem, names) for stem in ("Accelerometer", "Gravity"))
        at, in_first, in_second = np.intersect1d(
            first["time"].values, second["time"].values, assume_unique=True, return_indices=True
        )
        count = len(first["time"].values)
        if len(at) < _SHARED * count:
            raise FileError(
                f"{self.path}: Gravity.csv has the stamps of {len(at)} of the {count} rows of Accelerometer.csv; what "
                "is not sampled together cannot be added. Record TotalAcceleration.csv"
            )
        found = {"time": Cells(at, np.zeros(len(at), bool))}
        for name in names:
            if name != "time":
                values = first[name].values[in_first] + second[name].values[in_second]
                found[name] = Cells(values, first[name].empty[in_first] | second[name].empty[in_second])
        yield {column: found[name] for column, name in zip(columns, names, strict=True)}

    def _whole(self, stem: str, names: Sequence[str]) -> dict[str, Cells]:
        """Columns of a file with its times, which must increase."""
        wanted = list(dict.fromkeys(["time", *names]))
        parts = list(self.tables[stem].batches(wanted))
        if not parts:
            raise FileError(f"{self.path}: {stem}.csv: a header, but no rows below it")
        whole = {
            name: Cells(
                np.concatenate([part[name].values for part in parts]),
                np.concatenate([part[name].empty for part in parts]),
            )
            for name in wanted
        }
        wrong = whole["time"].empty.copy()
        wrong[1:] |= np.diff(whole["time"].values) <= 0
        if wrong.any():
            place = self.tables[stem].place("time", int(np.argmax(wrong)))
            raise FileError(f"{self.path}: {stem}.csv, {place}: not after the time of the row before")
        return whole

    def place(self, column: str, row: int) -> str:
        """See `CsvFolder`."""
        return f"sample {row + 1} of {column}" if self.stream(column) == SUM else super().place(column, row)


def open_folder(path: os.PathLike[str], stated: Stated = ALL_FOUND_OUT, *, lenient: bool = False) -> CsvFolder:
    """Open a folder or ZIP archive of CSV files as what it is: Sensor Logger's have ``time`` and ``seconds_elapsed``.

    Raises
    ------
    FileError
        If it cannot be read.
    """
    found = CsvFolder(path, stated, lenient=lenient)
    if any({"time", "seconds_elapsed"} <= set(table.columns) for table in found.tables.values()):
        return SensorLogger(path, stated, lenient=lenient)
    return found


def csv_files(folder: Path) -> list[Path]:
    """The CSV files in a folder that are not empty, in the order of their names."""
    return sorted(file for file in folder.iterdir() if file.suffix.lower() == ".csv" and file.stat().st_size)


def _number(text: str) -> str:
    """A number as people write it; what is none stays."""
    try:
        return f"{float(text):g}"
    except ValueError:
        return text


def rows_of(path: Path) -> list[dict[str, str]]:
    """A small table of words, separated by commas, semicolons or tabs; empty if there is none."""
    if not path.is_file():
        return []
    text = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    mark = max(",;\t", key=text[0].count) if text else ","
    return [dict(row) for row in csv.DictReader(text, delimiter=mark, restkey="", restval="")]


# --- archives ---------------------------------------------------------------------------------------------------------


class _Unpacked:
    """The CSV files of a ZIP archive in a temporary folder, which is removed when nothing refers to this any more."""

    def __init__(self, path: str) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="elliptude-"))
        weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)
        with zipfile.ZipFile(path) as archive:
            # The archive's own names: of "./Gyroscope.csv" a path keeps less. Some programs write backslashes.
            names: dict[PurePosixPath, str] = {}
            for name in archive.namelist():
                member = PurePosixPath(name.replace("\\", "/"))
                if member.suffix.lower() != ".csv":
                    continue
                if member in names:
                    raise FileError(f"{path}: {member} is in it twice; pack it again with one of the two")
                names[member] = name
            members = [one for one in names if one.parts[0] != "__MACOSX" and not one.name.startswith("._")]
            if not members:
                return
            top = min(members, key=lambda one: len(one.parts)).parent
            for member in members:
                if member.parent == top or member == top / "meta" / "time.csv":
                    # By their last names alone: nothing is written outside the folder, whatever the archive says.
                    place = self.folder / ("meta" if member.parent != top else "") / member.name
                    place.parent.mkdir(exist_ok=True)
                    with archive.open(names[member]) as packed, place.open("wb") as file:
                        shutil.copyfileobj(packed, file, 1 << 20)


@lru_cache(maxsize=4)
def _unpacked(path: str, _size: int, _changed: int) -> _Unpacked:
    """Commands open a log several times."""
    return _Unpacked(path)


def _folder_of(path: os.PathLike[str]) -> Path:
    place = Path(path)
    if place.is_dir():
        return place
    try:
        state = place.stat()
        return _unpacked(os.fspath(path), state.st_size, state.st_mtime_ns).folder
    except FileError:
        raise
    except OSError as error:
        raise FileError(f"{path}: {system_fault(error)}") from error
    except zipfile.BadZipFile as error:
        raise FileError(f"{path}: not a ZIP archive, or cut off: copy it again") from error
    except Exception as error:  # zipfile and what it unpacks with raise what they happen to meet
        raise FileError(f"{path}: not a ZIP archive that can be read: {error}") from error
