"""Opens a log in the format that its name ends in."""

import os
from pathlib import Path
from typing import TypeAlias

from elliptude.io.files import FileError, as_path
from elliptude.io.readers.arrays import Hdf5File, NpzFile, open_matlab
from elliptude.io.readers.base import LogFile
from elliptude.io.readers.counted import CountedRows
from elliptude.io.readers.parquet import ParquetTable
from elliptude.io.readers.rosbag import BagFile
from elliptude.io.readers.text.dialect import ALL_FOUND_OUT, Stated
from elliptude.io.readers.text.folder import csv_files, open_folder
from elliptude.io.readers.text.xsens import open_table
from elliptude.io.readers.ulog import UlogFile

LogSource: TypeAlias = str | os.PathLike[str] | LogFile
"""A log: the path of a file, or what is open already, such as arrays in memory."""


def open_log(
    path: LogSource,
    stated: Stated = ALL_FOUND_OUT,
    *,
    lenient: bool = False,
) -> LogFile:
    """Open a file in the format that its name ends in.

    Parameters
    ----------
    path : path-like or LogFile
        What is open already stays as it is. Of a file:
        ``.parquet``; ``.npz``; ``.mat``; ``.h5`` or ``.hdf5``; ``.ulg``; ``.bag``, ``.mcap``, ``.db3`` or the folder of
        a ROS 2 bag; ``.zip`` or a folder of CSV files, as phone apps export them; anything else is CSV, which may be
        compressed (``.gz``, ``.bz2``, ``.zst``).
    stated : Stated
        How a CSV file is written, and how many rows of a file without times there are in a second; what is not stated
        is found out.
    lenient : bool
        As in `elliptude.io.readers.text.csv.CsvTable`.

    Returns
    -------
    LogFile

    Raises
    ------
    FileError
        If there is no such file, it is of another format, or what reads the format is not installed.
    """
    if not isinstance(path, str | os.PathLike):
        return path
    file = _opened(as_path(path), stated, lenient=lenient)
    return file if stated.row_rate_hz is None else CountedRows(file, stated.row_rate_hz)


def _opened(path: os.PathLike[str], stated: Stated, *, lenient: bool) -> LogFile:
    place = Path(path)
    if place.is_dir() and (place / "metadata.yaml").is_file():
        return BagFile(path)
    if place.is_dir() and csv_files(place):
        return open_folder(path, stated, lenient=lenient)
    if not place.is_file():
        fault = "a folder without CSV files, and no ROS 2 bag" if place.is_dir() else "not a regular file"
        raise FileError(f"{path}: {fault if place.exists() else 'no such file'}")
    match place.suffix:
        case ".parquet":
            return ParquetTable(path)
        case ".zip":
            return open_folder(path, stated, lenient=lenient)
        case ".npz":
            return NpzFile(path)
        case ".mat":
            return open_matlab(path)
        case ".h5" | ".hdf5":
            return Hdf5File(path)
        case ".ulg":
            return UlogFile(path)
        case ".bag" | ".mcap" | ".db3":
            return BagFile(path)
        case ".json" | ".jsonl" | ".ndjson":
            raise FileError(
                f"{path}: JSON is not read, but CSV, Parquet, NPZ, MATLAB's files, HDF5, ULogs and ROS bags are; "
                "pandas writes CSV: pandas.read_json(...).to_csv(..., index=False)"
            )
        case _:
            return open_table(path, stated, lenient=lenient)
