"""How a CSV file is written: what separates columns, the decimal mark, the encoding, a row of units below the header.

Found from the beginning of the file where only one reading fits. Where two fit, the file is refused with both of them:
a configuration then says which (``[csv]``, docs/logs.md).
"""

import codecs
import csv
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from elliptude import units
from elliptude.io.files import FileError

Delimiter: TypeAlias = Literal[",", ";", "\t", " ", "|"]
Decimal: TypeAlias = Literal[".", ","]
DELIMITERS: dict[Delimiter, str] = {",": "','", ";": "';'", "\t": "tabs", " ": "blanks", "|": "'|'"}
"""What separates columns, and what messages call it; " " is one or more blanks or tabs."""

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE | re.ASCII)
STAMP = re.compile(
    r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(\.\d{1,9})?(?P<zone>Z|[+-]\d\d(:?\d\d)?)?", re.IGNORECASE | re.ASCII
)
"""A time of day in ISO 8601: 2024-05-01T12:00:00.25Z."""
CLOCK = re.compile(r"\d{1,2}:\d\d:\d\d", re.ASCII)
"""What a time of day has, in whatever order its date is."""
ISO_STAMP = "2026-03-29T23:59:50.000"
"""One that is read, for messages."""
TIME_HEADER = re.compile(r"(t|time(stamp)?)\s*[(\[](?P<unit>s|sec|seconds|ms|[uµμ]s|ns)[)\]]", re.IGNORECASE)
"""The header of a column of times that states its unit."""
_DECIMAL_COMMA = re.compile(r"[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?", re.ASCII)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+", re.ASCII)
MISSING = (
    "nan",
    "NaN",
    "NAN",
    "null",
    "NULL",
    "Null",
    "none",
    "None",
    "NONE",
    "NA",
    "N/A",
    "n/a",
    "#N/A",
    "-",
    "--",
    "?",
)
"""Words that programs write where nothing was measured."""
_UNITS = {
    *units.SPELLINGS,
    *units.TICKS_PER_SECOND,
    *units.ANGULAR_VELOCITY,
    *units.ACCELERATION,
    *units.FIELD,
}
_MOST_ROWS = 1000
CELL_WITHOUT_END = "text in quotes that does not end, or a cell of more than 131072 letters"
"""What is at fault where Python's reader gives up."""


@dataclass(frozen=True)
class Dialect:
    """How a CSV file is written."""

    delimiter: Delimiter = ","
    decimal: Decimal = "."
    encoding: str = "utf-8"
    units_row: bool = False
    """Whether the row below the header has units."""
    packet_rate_hz: float | None = None
    """What ``Stated`` says of it."""


@dataclass(frozen=True)
class Stated:
    """What a user says about that, and about the rows of any file; None is found out."""

    delimiter: Delimiter | None = None
    decimal: Decimal | None = None
    encoding: str | None = None
    units_row: bool | None = None
    packet_rate_hz: float | None = None
    """How many packets of Xsens there are in a second, if the file does not say it, or says it wrongly."""
    row_rate_hz: float | None = None
    """How many rows there are in a second, of a file of any format that has no times."""


ALL_FOUND_OUT = Stated()


def encoding_of(beginning: bytes) -> str:
    """The encoding of a text by its first bytes: by a byte order mark, else UTF-8 if it is that, else Latin-1."""
    if beginning.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    if len(beginning) >= 4 and not any(beginning[1:200:2]):
        return "utf-16-le"
    if len(beginning) >= 4 and not any(beginning[0:200:2]):
        return "utf-16-be"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(beginning)
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"


def cells_of_line(line: str, delimiter: Delimiter) -> list[str]:
    """The cells of a line; blanks beside them do not count."""
    if delimiter == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]


def commented_header(comment: str, line: str) -> str | None:
    """The header in the last comment above a line of numbers, as NumPy and the EuRoC recordings write it; else None.

    It has as many columns as the numbers, and is no row of numbers that was commented out.
    """
    header = comment.lstrip("#/").strip()
    for mark in DELIMITERS:
        try:
            names, cells = cells_of_line(header, mark), cells_of_line(line, mark)
        except csv.Error:
            continue
        if 1 < len(names) == len(cells) and _all_numbers(cells) and not _all_numbers(names):
            return header
    return None


def _all_numbers(cells: Sequence[str]) -> bool:
    """Whether cells are numbers, with either decimal mark, times of day, or empty."""
    return all(not cell or NUMBER.fullmatch(cell.replace(",", ".")) or STAMP.fullmatch(cell) for cell in cells)


def find_dialect(path: os.PathLike[str], header: str, rows: Sequence[str], encoding: str, stated: Stated) -> Dialect:
    """How a file is written, by its header and the first rows below it.

    Parameters
    ----------
    path : path-like
        For messages.
    header : str
    rows : sequence of str
        Whole lines, none of them empty.
    encoding : str
    stated : Stated

    Returns
    -------
    Dialect

    Raises
    ------
    FileError
        If two readings fit, or the header has no names.
    """
    try:
        delimiter = stated.delimiter or _delimiter(path, header, rows[:_MOST_ROWS])
        names = cells_of_line(header, delimiter)
        cells = [cells_of_line(row, delimiter) for row in rows[:_MOST_ROWS]]
    except csv.Error as error:
        raise FileError(f"{path}: not CSV: {CELL_WITHOUT_END}") from error
    named = [name for name in names if name]
    counted = any(named == [str(first + i) for i in range(len(named))] for first in (0, 1))  # pandas does so
    if named and not counted and all(NUMBER.fullmatch(name.replace(",", ".")) for name in named):
        raise FileError(f"{path}: its first line has numbers; the names of the columns must stand there")
    units_row = stated.units_row
    if units_row is None:
        units_row = len(cells) > 0 and _has_units(cells[0], names)
    decimal = stated.decimal or _decimal(path, cells[1:] if units_row else cells, delimiter)
    return Dialect(delimiter, decimal, encoding, units_row, stated.packet_rate_hz)


def _delimiter(path: os.PathLike[str], header: str, rows: Sequence[str]) -> Delimiter:
    """What the header and most rows are divided by, into as many columns."""
    divides: list[tuple[Delimiter, int]] = []
    fits: list[tuple[Delimiter, int]] = []
    marks: tuple[Delimiter, ...] = (",", ";", "\t", "|")
    for mark in marks:
        count = len(cells_of_line(header, mark))
        if count > 1:
            divides.append((mark, count))
            if 2 * sum(len(cells_of_line(row, mark)) == count for row in rows) > len(rows):
                fits.append((mark, count))
    if len(fits) > 1:
        readings = " or ".join(f"{count} columns separated by {DELIMITERS[mark]}" for mark, count in fits)
        raise FileError(f"{path}: {readings}? Say which in a configuration: [csv] delimiter")
    if fits:
        return fits[0][0]
    count = len(header.split())
    if count > 1 and rows and all(len(row.split()) == count for row in rows):
        return " "
    return divides[0][0] if divides else ","


def _decimal(path: os.PathLike[str], rows: Sequence[Sequence[str]], delimiter: Delimiter) -> Decimal:
    cells = [cell for row in rows for cell in row]
    commas = [cell for cell in cells if _DECIMAL_COMMA.fullmatch(cell)]
    with_point = next((cell for cell in cells if "." in cell and NUMBER.fullmatch(cell)), None)
    if not commas or (delimiter == "," and with_point is not None):  # such cells are texts in quotes
        return "."
    if all(_THOUSANDS.fullmatch(cell) for cell in commas):
        raise FileError(
            f"{path}: does {commas[0]!r} mean {commas[0].replace(',', '.')} or {commas[0].replace(',', '')}? "
            "Say in a configuration: [csv] decimal = ',' or '.'; thousands must have no mark"
        )
    if with_point is not None:
        raise FileError(
            f"{path}: {commas[0]!r} has a decimal comma and {with_point!r} a decimal point; [csv] decimal in a "
            "configuration says which one numbers have"
        )
    return ","


def _has_units(first: Sequence[str], names: Sequence[str]) -> bool:
    """Whether a row below the header is one of units: one at least that is known, and no number in it."""
    plain = [cell.strip("[]() ") for cell in first]
    return (
        len(first) == len(names)
        and any(cell in _UNITS for cell in plain)
        and not any(NUMBER.fullmatch(cell.replace(",", ".")) or STAMP.fullmatch(cell) for cell in first)
    )
