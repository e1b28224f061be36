"""Parquet files, read batch by batch, so that memory does not grow with the file."""

import os
from collections.abc import Iterator, Sequence

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray

from elliptude.io.files import FileError, as_path
from elliptude.io.readers.base import BATCH_ROWS, Batch, NumbersAlone, cells_of


class ParquetTable(NumbersAlone):
    """A Parquet file."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = as_path(path)
        try:
            schema = pa.parquet.read_schema(path)
        except (pa.ArrowException, OSError) as error:
            raise FileError(f"{path}: not a Parquet file, or damaged") from error
        self.columns = tuple(schema.names)
        self.label = (schema.metadata or {}).get(b"elliptude", b"").decode()
        self._types = {field.name: field.type for field in schema}

    def stream(self, column: str) -> str:
        """The only one."""
        return ""

    def time_unit(self, column: str) -> str | None:
        """Nanoseconds since 1970, if it has time stamps."""
        return "ns" if pa.types.is_timestamp(self._types[column]) else None

    def holds_numbers(self, column: str) -> bool:
        """See `LogFile`."""
        kind = self._types[column]
        return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_timestamp(kind))

    def batches(self, columns: Sequence[str]) -> Iterator[Batch]:
        """See `LogFile`."""
        self._require_numbers(columns)
        large = {name for name in columns if self._types[name] in (pa.int64(), pa.uint64()) or self.time_unit(name)}
        try:
            # Arrow would read all of these columns beforehand.
            with pa.parquet.ParquetFile(self.path, pre_buffer=False) as file:
                for batch in file.iter_batches(BATCH_ROWS, columns=list(columns)):
                    yield {name: cells_of(self._counted(batch.column(name)), name in large) for name in columns}
        except (pa.ArrowException, OSError) as error:
            raise FileError(f"{self.path}: damaged: its rows cannot be read") from error

    @staticmethod
    def _counted(column: pa.Array) -> pa.Array:
        """Time stamps as nanoseconds, other columns as they are."""
        if not pa.types.is_timestamp(column.type):
            return column
        return column.cast(pa.timestamp("ns", tz=column.type.tz)).cast(pa.int64())

    def read(self, numbers: list[str], texts: list[str]) -> pa.Table:
        """See `Table`."""
        self._require_numbers(numbers)
        schema = pa.schema([(name, pa.float64()) for name in numbers] + [(name, pa.string()) for name in texts])
        try:
            with pa.parquet.ParquetFile(self.path) as file:
                return file.read(columns=schema.names).select(schema.names).cast(schema)
        except (pa.ArrowException, OSError) as error:
            raise FileError(f"{self.path}: damaged: its rows cannot be read") from error

    def refuse(self, bad: NDArray[np.bool_], name: str, fault: str) -> None:
        """See `Table`."""
        if bad.any():
            raise FileError(f"{self.path}: {self.place(name, int(np.argmax(bad)))}: {fault}")

    def place(self, column: str, row: int) -> str:
        """See `LogFile`."""
        return f"row {row + 1}, column {column!r}"

    def places_of_rows(self, rows: Sequence[int]) -> list[str]:
        """See `LogFile`."""
        return [f"row {row + 1}" for row in rows]

    def _require_numbers(self, names: Sequence[str]) -> None:
        for name in names:
            if not self.holds_numbers(name):
                raise FileError(f"{self.path}: column {name!r} is of type {self._types[name]}, not of numbers")
