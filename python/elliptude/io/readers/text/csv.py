"""CSV files, read batch by batch, so that memory does not grow with the file."""

import csv
import io
import os
import re
import textwrap
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from itertools import islice
from typing import BinaryIO, NoReturn

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

from elliptude.io.files import FileError, as_path, system_fault
from elliptude.io.readers.base import Batch, NumbersAlone, cells_of
from elliptude.io.readers.text.dialect import (
    ALL_FOUND_OUT,
    CELL_WITHOUT_END,
    CLOCK,
    DELIMITERS,
    ISO_STAMP,
    MISSING,
    NUMBER,
    STAMP,
    Dialect,
    Stated,
    cells_of_line,
    commented_header,
    encoding_of,
    find_dialect,
)
from elliptude.io.readers.text.translated import BLANKS, tabbed, translated, without_lines

BATCH_BYTES = 1 << 22
"""Bytes of the text that are read at a time."""


# What compressed files begin with, and what their names must end in.
_COMPRESSED = {b"\x1f\x8b": ".csv.gz", b"\x28\xb5\x2f\xfd": ".csv.zst"}
_ENDINGS = (".gz", ".bz2", ".zst")
_BEGINNING = 1 << 18
"""Bytes of the text that show how the file is written."""


class CsvTable(NumbersAlone):
    """A CSV file. Arrow reads it; a slow second reading finds what is at fault, and in which line.

    Parameters
    ----------
    path : path-like
    stated : Stated
        How it is written, as far as that is not to be found out.
    lenient : bool
        Lines with more or fewer columns than the header are left out, as is the header where it stands again; words
        such as ``NaN`` and ``null`` are empty cells.
    """

    # From 16 digits on a double may not hold a whole number.
    _LARGE = re.compile(r"[+-]?\d{16,18}|[+-]?[0-8]\d{18}", re.ASCII)

    def __init__(
        self,
        path: str | os.PathLike[str],
        stated: Stated = ALL_FOUND_OUT,
        *,
        lenient: bool = False,
    ) -> None:
        self.path = as_path(path)
        self.label = ""
        self.comments: list[str] = []
        """The lines above the header that begin with # or //."""
        self.lenient = lenient
        self._heading: tuple[str, ...] = ()
        """The header, and the row of units below it if there is one, as they are read."""
        self.units: tuple[str, ...] = ()
        """What a row below the header says, a unit for each column."""
        with self._bytes() as stream:
            beginning = stream.read(_BEGINNING)
        for mark, ending in _COMPRESSED.items():
            if beginning.startswith(mark):
                raise FileError(f"{path}: compressed: give it a name that ends in {ending}")
        self.dialect = Dialect(encoding=stated.encoding or encoding_of(beginning))
        with self._text() as text:
            for self._header_line, line in enumerate(text, start=1):
                if line.startswith(("#", "//")):
                    self.label = self.label or line.removeprefix("#").strip()
                    self.comments.append(line)
                elif match := re.fullmatch(r'"?sep=([,;\t|])"?\s*', line):  # what Excel writes
                    stated = replace(
                        stated, delimiter=stated.delimiter or next(mark for mark in DELIMITERS if mark == match[1])
                    )
                elif line.strip():
                    if self.comments and (header := commented_header(self.comments[-1], line)):
                        self._header_line -= 1
                        self.comments.pop()
                        self.label = self.label if self.comments else ""
                        self._begin(header, text, stated, first_row=line)
                    else:
                        self._begin(line, text, stated)
                    return
        raise FileError(f"{path}: empty, not even a header")

    def _begin(self, header: str, text: io.TextIOWrapper, stated: Stated, *, first_row: str = "") -> None:
        """Look at the header and the rows below it, of which the first may have been read."""
        if any(unicodedata.category(letter) == "Cc" for letter in header.rstrip("\r\n").replace("\t", "")):
            raise FileError(f"{self.path}: not text, but its name is not that of another format that is read")
        beginning = first_row + text.read(_BEGINNING)
        lines = beginning.splitlines()
        rows = [line for line in (lines if len(beginning) < _BEGINNING else lines[:-1]) if line.strip()]
        self.dialect = find_dialect(self.path, header, rows, self.dialect.encoding, stated)
        mark = self.dialect.delimiter
        self.written = tuple(cells_of_line(header, mark))
        self.columns = self.written
        if self.dialect.units_row:
            self.units = tuple(cell.strip("[]() ") for cell in cells_of_line(rows[0], mark))
        heading = [header, *rows[: self._units_lines]]
        if mark == " ":
            heading = [tabbed(line.encode()).decode() for line in heading]
        self._heading = tuple(line.strip(BLANKS) for line in heading)

    def stream(self, column: str) -> str:
        """The only one."""
        return ""

    def holds_numbers(self, column: str) -> bool:
        """Whether its first cell is a number or empty."""
        cell = self._first_cells.get(column, "")
        return not cell or self._is_number(cell) or STAMP.fullmatch(cell) is not None

    def time_unit(self, column: str) -> str | None:
        """Nanoseconds since 1970, if it has times of day."""
        return "ns" if STAMP.fullmatch(self._first_cells.get(column, "")) else None

    def _is_number(self, cell: str) -> bool:
        if self.dialect.decimal == ",":
            cell = "?" if "." in cell else cell.replace(",", ".")
        return NUMBER.fullmatch(cell) is not None

    @cached_property
    def _first_cells(self) -> dict[str, str]:
        """The first cell of each column that is not empty, or a word for that."""
        found: dict[str, str] = {}
        for _, cells in islice(self._rows(), 1000):
            for name, cell in zip(self.written, cells, strict=False):
                if name not in found and cell.strip(" \t") not in ("", *MISSING):
                    found[name] = cell.strip(" \t")
            if len(found) == len(set(self.written)):
                break
        return found

    def batches(self, columns: Sequence[str]) -> Iterator[Batch]:
        """See `LogFile`."""
        cells = self._first_cells
        large = {name for name in columns if self._LARGE.fullmatch(cells.get(name, ""))}
        types = {name: pa.int64() if name in large else pa.float64() for name in columns}
        for name in columns:
            if match := STAMP.fullmatch(cells.get(name, "")):
                types[name] = pa.timestamp("ns", tz="UTC" if match["zone"] else None)
                large.add(name)
        for batch in self._batches(types):
            yield {name: cells_of(batch.column(name), name in large) for name in columns}

    def read(self, numbers: list[str], texts: list[str]) -> pa.Table:
        """See `Table`."""
        types = dict.fromkeys(numbers, pa.float64()) | dict.fromkeys(texts, pa.string())
        return pa.Table.from_batches(self._batches(types), schema=pa.schema(types))

    def _batches(self, types: Mapping[str, pa.DataType]) -> Iterator[pa.RecordBatch]:
        try:
            with self._bytes() as stream:
                yield from pa.csv.open_csv(
                    stream,
                    read_options=pa.csv.ReadOptions(
                        column_names=self.written,
                        skip_rows=self._header_line + self._units_lines,
                        block_size=BATCH_BYTES,
                    ),
                    parse_options=pa.csv.ParseOptions(
                        delimiter=self._mark, invalid_row_handler=(lambda _: "skip") if self.lenient else None
                    ),
                    convert_options=pa.csv.ConvertOptions(
                        column_types=types,
                        include_columns=list(types),
                        null_values=["", *MISSING] if self.lenient else [""],
                        strings_can_be_null=False,
                        decimal_point=self.dialect.decimal,
                    ),
                )
        except (pa.ArrowException, OSError) as error:
            self._find_fault(types)
            if next(self._all_rows(), None) is None:  # the header is all, and its line does not end
                return
            raise FileError(f"{self.path}: it cannot be read as CSV") from error

    def refuse(self, bad: NDArray[np.bool_], name: str, fault: str) -> None:
        """See `Table`."""
        if bad.any():
            line, cells = next(islice(self._rows(), int(np.argmax(bad)), None))
            self._fail(line, name, fault, cells[self.written.index(name)])

    def place(self, column: str, row: int) -> str:
        """See `LogFile`."""
        return f"{self.places_of_rows([row])[0]}, column {self.written.index(column) + 1} ({column})"

    def places_of_rows(self, rows: Sequence[int]) -> list[str]:
        """See `LogFile`."""
        wanted = sorted(set(rows))
        lines: dict[int, int] = {}
        read = self._rows()
        for row, before in zip(wanted, [-1, *wanted], strict=False):
            lines[row], _ = next(islice(read, row - before - 1, None))
        return [f"line {lines[row]}" for row in rows]

    def odd_lines(self) -> tuple[list[int], list[int]]:
        """Lines with more or fewer columns than the header, and lines with words for nothing; read to the end."""
        uneven: list[int] = []
        worded: list[int] = []
        words = set(MISSING)
        for line, cells in self._all_rows():
            if len(cells) != len(self.written):
                uneven.append(line)
            elif not words.isdisjoint(cells):
                worded.append(line)
        return uneven, worded

    def repeated_headings(self) -> list[int]:
        """Lines at which the header, or the row of units below it, stands again; read to the end."""
        first = self._header_line + self._units_lines
        with self._text(as_it_is=True) as text:
            below = islice(enumerate(text, start=1), first, None)
            return [number for number, line in below if line.removeprefix("\ufeff").strip(BLANKS) in self._heading]

    def _find_fault(self, types: Mapping[str, pa.DataType]) -> None:
        for line, cells in self._rows():
            if len(cells) != len(self.written):
                mark = DELIMITERS[self.dialect.delimiter]
                raise FileError(
                    f"{self.path}: line {line}: {len(cells)} columns, but the header has {len(self.written)}, "
                    f"separated by {mark}"
                )
            if cells == list(self.written):
                raise FileError(
                    f"{self.path}: line {line}: the header again: delete this line or, if another recording begins "
                    "here, cut the file"
                )
            for name, kind in types.items():
                cell = cells[self.written.index(name)].strip(" \t")
                if not cell or kind == pa.string() or (self.lenient and cell in MISSING):
                    continue
                if pa.types.is_timestamp(kind):
                    match = STAMP.fullmatch(cell)
                    if match is None or (match["zone"] is None) != (kind.tz is None):
                        self._fail(line, name, "not a time of day as the first one in the column is", cell)
                    continue
                if not self._is_number(cell):
                    fault, remedy = "not a number", "; empty the cell, or delete the line"
                    if CLOCK.search(cell):
                        remedy = f"; of dates and times those of ISO 8601 are read, such as {ISO_STAMP}"
                    if NUMBER.fullmatch(cell.replace(",", ".")):
                        mark, called = (",", "comma") if self.dialect.decimal == "." else (".", "point")
                        fault += f"; [csv] decimal = {mark!r} in a configuration reads a decimal {called}"
                        remedy = ""
                    self._fail(line, name, fault, cells[self.written.index(name)], remedy)
                if kind == pa.int64() and not re.fullmatch(r"[+-]?\d{1,18}|[+-]?[0-8]\d{18}", cell, re.ASCII):
                    self._fail(line, name, "not a whole number, as the first one in the column is", cell)

    def _fail(self, line: int, name: str, fault: str, cell: str, remedy: str = "") -> NoReturn:
        content = textwrap.shorten(cell, 40, placeholder="...")
        place = f"line {line}, column {self.written.index(name) + 1} ({name})"
        raise FileError(f"{self.path}: {place}: {fault}" + (f": {content!r}" if content else "") + remedy)

    @property
    def _mark(self) -> str:
        """What separates columns in what is read."""
        return "\t" if self.dialect.delimiter == " " else self.dialect.delimiter

    @property
    def _units_lines(self) -> int:
        return int(self.dialect.units_row)

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        """The rows below the header, each with the number of its last line, without those that are left out."""
        return (row for row in self._all_rows() if not self.lenient or len(row[1]) == len(self.written))

    def _all_rows(self) -> Iterator[tuple[int, list[str]]]:
        """All rows below the header; no empty lines, as Arrow skips them."""
        first = self._header_line + self._units_lines
        with self._text() as text:
            reader = csv.reader(islice(text, first, None), delimiter=self._mark)
            begin = first + 1
            try:
                for cells in reader:
                    line = first + reader.line_num
                    if line > begin and cells and len(cells) != len(self.written):
                        # What is left out as one broken line would be all lines of the text.
                        raise FileError(
                            f"{self.path}: line {begin}: text in quotes that goes on to line {line}, and leaves "
                            f"{len(cells)} columns of {len(self.written)}: close it, or delete the quotation mark"
                        )
                    if cells:
                        yield line, cells
                    begin = line + 1
            except csv.Error as error:
                raise FileError(f"{self.path}: line {begin}: {CELL_WITHOUT_END}") from error

    @contextmanager
    def _text(self, *, as_it_is: bool = False) -> Iterator[io.TextIOWrapper]:
        with (
            self._bytes(as_it_is=as_it_is) as stream,
            io.TextIOWrapper(stream, encoding="utf-8-sig", errors="replace", newline="") as text,
        ):
            yield text

    @contextmanager
    def _bytes(self, *, as_it_is: bool = False) -> Iterator[BinaryIO]:
        """The file without its compression; once its dialect is known, in UTF-8 and without blanks between columns.

        Where it is read leniently, the header is empty wherever it stands again, unless the file is wanted as it is.
        """
        try:
            with pa.input_stream(os.fspath(self.path), compression="detect") as stream:
                dialect = getattr(self, "dialect", None)
                read: BinaryIO = stream
                if dialect is not None and (dialect.encoding != "utf-8" or dialect.delimiter == " "):
                    read = io.BufferedReader(translated(stream, dialect.encoding, blanks=dialect.delimiter == " "))
                if self.lenient and self._heading and not as_it_is:
                    read = io.BufferedReader(without_lines(read, self._heading))
                yield read
        except OSError as error:
            damaged = not error.errno and os.fspath(self.path).endswith(_ENDINGS)
            fault = "its compressed content is damaged, or cut off: copy it again" if damaged else system_fault(error)
            raise FileError(f"{self.path}: {fault}") from error
