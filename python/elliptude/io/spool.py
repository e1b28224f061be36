"""Recordings as commands name them: a file, or what standard input or a named pipe gives, kept in a temporary file.

A command reads a log several times: for its header, for each sensor, for a fault's line. A pipe can be read once. So
what it gives is copied to a temporary file when somebody first asks for it, and the file is removed in the end.
"""

import os
import shutil
import sys
import tempfile
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import IO, BinaryIO

from elliptude.io.files import FileError, system_fault

STANDARD_INPUT = "-"
"""How a command line names standard input."""

# What files of a format begin with. A pipe has no name whose ending could say it.
_BEGINNINGS = (
    (b"PAR1", ".parquet"),
    (b"PK\x03\x04", ".zip"),
    (b"ULog\x01\x12\x35", ".ulg"),
    (b"#ROSBAG V", ".bag"),
    (b"\x89MCAP0\r\n", ".mcap"),
    (b"SQLite format 3\x00", ".db3"),
    (b"\x1f\x8b", ".csv.gz"),
    (b"BZh", ".csv.bz2"),
    (b"\x28\xb5\x2f\xfd", ".csv.zst"),
)
_MOST_OF_A_BEGINNING = max(len(beginning) for beginning, _ in _BEGINNINGS)


class NamedFile(os.PathLike[str]):
    """A file that messages call by another name than that of its path: ``str`` gives the name, ``os.fspath`` the path.

    Parameters
    ----------
    path : path-like
    name : str, optional
        The path if left out.
    """

    def __init__(self, path: str | os.PathLike[str], name: str | None = None) -> None:
        self._path = os.fspath(path)
        self._name = self._path if name is None else name

    def __str__(self) -> str:
        """The name for messages."""
        return self._name

    def __fspath__(self) -> str:
        """Where the file is."""
        return self._path

    @property
    def name(self) -> str:
        """The last part of the name."""
        return Path(self._name).name

    @property
    def argument(self) -> str:
        """What a command line says to read it again."""
        return self._name


class Spooled(NamedFile):
    """What standard input or a named pipe gives. It is read to its end when somebody first asks where the file is.

    Parameters
    ----------
    source : pathlib.Path or None
        The pipe; None is standard input.
    """

    def __init__(self, source: Path | None) -> None:
        self._source = source
        self._name = "standard input" if source is None else str(source)

    def __fspath__(self) -> str:
        """Where the copy is.

        Raises
        ------
        FileError
            If it cannot be read, or the copy cannot be written.
        """
        return str(self._copy)

    @property
    def argument(self) -> str:
        """A pipe has been read; another one has another name."""
        return STANDARD_INPUT

    @cached_property
    def _copy(self) -> Path:
        """It is removed, with its folder, when nothing refers to this any more."""
        if self._source is None and sys.stdin is None:
            raise FileError("standard input is closed; pipe a recording into the command, or name a file")
        if self._source is None and sys.stdin.isatty():
            raise FileError("standard input is a terminal; pipe a recording into the command, or name a file")
        try:
            folder = tempfile.mkdtemp(prefix="elliptude-")
        except OSError as error:
            raise FileError(f"{self}: no folder to keep it in: {system_fault(error)}; TMPDIR names another") from error
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        try:
            with self._opened() as stream:
                beginning = stream.read(_MOST_OF_A_BEGINNING)
                copy = Path(folder) / f"recording{_suffix(beginning)}"
                with copy.open("wb") as file:
                    file.write(beginning)
                    shutil.copyfileobj(stream, file, 1 << 20)
        except OSError as error:
            fault = f"{self}: not kept in {folder}: {system_fault(error)}; TMPDIR names another folder"
            raise FileError(fault) from error
        if copy.suffix == ".zip" and _is_npz(copy):
            copy = copy.rename(copy.with_suffix(".npz"))
        return copy

    @contextmanager
    def _opened(self) -> Iterator[BinaryIO | IO[bytes]]:
        if self._source is None:
            yield sys.stdin.buffer
            return
        with self._source.open("rb") as stream:
            yield stream


def recording(path: Path) -> NamedFile:
    """The recording that an argument names.

    Parameters
    ----------
    path : pathlib.Path
        ``-`` is standard input.

    Returns
    -------
    NamedFile
        Nothing is read yet.
    """
    if str(path) == STANDARD_INPUT:
        return Spooled(None)
    return Spooled(path) if path.is_fifo() else NamedFile(path)


def _suffix(beginning: bytes) -> str:
    return next((suffix for known, suffix in _BEGINNINGS if beginning.startswith(known)), ".csv")


def _is_npz(path: Path) -> bool:
    """Whether an archive holds arrays of NumPy, and nothing else: other archives may have some beside their files."""
    import zipfile

    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.namelist()
            return bool(members) and all(member.endswith(".npy") for member in members)
    except zipfile.BadZipFile:
        return False
