"""All that is wrong with the rows of a log, at once; and the log without it.

A repair only leaves out: rows, or samples of one sensor. What is left out of a gyro is a gap, about which its bounds
say nothing (docs/theory.md, section 17.6), and nothing is put in its place. The stamps that are kept are taken as
right. So a clock that was set back is no fault that can be left out: nothing says how much time went by.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain, pairwise
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from elliptude.io.files import FileError
from elliptude.io.readers.base import Batch, Cells, LogFile
from elliptude.io.readers.text.csv import CsvTable
from elliptude.io.readers.text.folder import CsvFolder
from elliptude.logs.alignment import LARGEST_VALUE, Channel, Clock
from elliptude.typing import FloatArray

# Two rows that are further apart than this share of the usual step may be neighbours, and have room for no other.
_A_STEP = 0.9
# The same where a stamp is far ahead, so that rows behind it that go on from the row before it are no chance.
_A_SHORT_STEP = 0.75
# Long steps that are far.
_FAR = 3.0
# A step that so many of all are shorter than is a long one, but no pause.
_NO_PAUSE = 0.95
# Rows of which each is earlier than the one above show that all are in reverse order; in fewer a clock may have jumped.
_LEAST_REVERSED = 3
# Ticks of a clock; stamps beyond it are none, and count as this.
_FARTHEST = 1e300
MOST_PLACES = 20
"""How many places of a fault are kept, the first ones."""
_MOST_SAID = 3
# Counters of time, and what one of their ticks may be in the unit of the column.
_COUNTER_BITS = (16, 24, 31, 32)
_COUNTER_TICKS = (1.0, 1e-3, 1e-6, 1e-9)
# Usual steps: a counter has so many at least, and a row or two may be lost where it begins anew.
_LEAST_OF_COUNTER = 100.0
_LOST_BESIDE = 3.0

_Rows = NDArray[np.intp]


@dataclass(frozen=True)
class Fault:
    """One kind of fault, and how often it occurs."""

    what: str
    count: int
    places: tuple[str, ...]
    """Where the first ones are: "line 812"."""
    done: str
    """What a repair does about it."""

    def __str__(self) -> str:
        """The kind, the number and the first places."""
        more = ", ..." if self.count > _MOST_SAID else ""
        where = f" ({', '.join(self.places[:_MOST_SAID])}{more})" if self.places else ""
        return f"{self.what}: {self.count}{where}"


Lost: TypeAlias = Literal["rows", "samples", "empty"]
"""How a sample is lost: rows or lines are left out, or samples; or cells are empty, which a user may have a word on."""


@dataclass(eq=False)
class Survey:
    """What is wrong in a log, and what a repair leaves out."""

    faults: list[Fault] = field(default_factory=list)
    hopeless: list[str] = field(default_factory=list)
    """What no repair mends."""
    ahead: list[str] = field(default_factory=list)
    """Where a stamp is after those of rows below, so that its own is wrong and not theirs."""
    rows: dict[str, _Rows] = field(default_factory=dict)
    """Rows of each stream that are left out, in order."""
    samples: dict[str, _Rows] = field(default_factory=dict)
    """Rows in which a column's cells are left out."""
    lost_torques: dict[Lost, list[Fault]] = field(default_factory=dict)
    """What is lost with them of torques and wheels' momenta, which act since the row before; of the faults."""

    def lines(self) -> list[str]:
        """What was left out, a line for each kind."""
        return [f"repaired: {fault}, {fault.done}" for fault in self.faults]

    def to_dict(self) -> list[dict[str, Any]]:
        """For JSON."""
        return [
            {
                "what": fault.what,
                "count": fault.count,
                "places": list(fault.places),
                "done": fault.done,
                "said": f"{fault}, {fault.done}",
            }
            for fault in self.faults
        ]


def survey(file: LogFile, clocks: Sequence[Clock]) -> Survey:
    """Read all of a log, and list what is wrong with its rows.

    Parameters
    ----------
    file : LogFile
        A CSV file is read leniently.
    clocks : sequence of Clock
        What is read of it.

    Returns
    -------
    Survey

    Raises
    ------
    FileError
        If it cannot be read at all.
    """
    found = Survey()
    if isinstance(file, CsvTable):
        _look_at_lines(file, found, has_torques=any(map(_has_torques, clocks)))
    if isinstance(file, CsvFolder):
        for stem in dict.fromkeys(stem for clock in clocks for stem in file.files_of(clock.stream)):
            there = any(_has_torques(clock) for clock in clocks if stem in file.files_of(clock.stream))
            _look_at_lines(file.tables[stem], found, f"{stem}.csv, ", has_torques=there)
    for stream in dict.fromkeys(clock.stream for clock in clocks):
        _look_at_stream(file, [clock for clock in clocks if clock.stream == stream], found)
    return found


def require_rows_in_time(file: LogFile, found: Survey) -> None:
    """Refuse a log in which leaving out rows that are late would leave stamps that are wrong.

    Where a clock was set back, the stamps before and after the rows that are late do not say how much time went by
    between them; where one stamp is ahead, it is the one that is wrong, and all that follows it would be late.

    Parameters
    ----------
    file : LogFile
    found : Survey
        Of it.

    Raises
    ------
    FileError
        If it is such a log.
    """
    if found.hopeless:
        raise FileError(f"{file.path}: {'; '.join(found.hopeless)}; timing.backward = 'drop' does not mend it either")
    if found.ahead:
        raise FileError(
            f"{file.path}: {found.ahead[0]}: after the time of rows below: timing.backward = 'drop' would keep this "
            "time, and leave out those. --repair leaves out the row whose time is wrong (timing.repair = true)"
        )


def require_torques(file: LogFile, found: Survey, kinds: Sequence[Lost], left_out_by: str) -> None:
    """Refuse a log of which torques are lost: the next one is no bound of what acted in their intervals.

    Parameters
    ----------
    file : LogFile
    found : Survey
        Of it.
    kinds : sequence of {"rows", "samples", "empty"}
        What counts.
    left_out_by : str
        The key that leaves them out, for the message.

    Raises
    ------
    FileError
        If there is one.
    """
    lost = [fault for kind in kinds for fault in found.lost_torques.get(kind, [])]
    if lost:
        raise FileError(
            f"{file.path}: {left_out_by} does not go with a control torque or a wheel's momentum in the guaranteed "
            f"mode: {'; '.join(map(str, lost))}. The torque in the interval that ends there is then unknown. Write "
            "into the file what it was, or cut the file there"
        )


def _has_torques(clock: Clock) -> bool:
    return any(channel.fill == "next" for channel in clock.channels)


def _fault(file: LogFile, rows: _Rows, what: str, done: str) -> Fault:
    first = [int(row) for row in rows[:MOST_PLACES]]
    places = [place or f"sample {row + 1}" for place, row in zip(file.places_of_rows(first), first, strict=True)]
    return Fault(what, len(rows), tuple(places), done)


def _add(found: Survey, file: LogFile, rows: _Rows, what: str, done: str) -> None:
    if len(rows):
        found.faults.append(_fault(file, rows, what, done))


def _look_at_lines(file: CsvTable, found: Survey, where: str = "", *, has_torques: bool) -> None:
    uneven, words = file.odd_lines()
    for lines, what, done in (
        (file.repeated_headings(), "lines that repeat the header", "left out"),
        (uneven, f"lines without the {len(file.written)} columns of the header", "left out"),
        (words, "lines with words such as NaN or null", "their cells are empty"),
    ):
        if lines:
            places = tuple(f"{where}line {line}" for line in lines[:MOST_PLACES])
            found.faults.append(Fault(what, len(lines), places, done))
            if has_torques and lines is uneven:
                found.lost_torques.setdefault("rows", []).append(found.faults[-1])


def _look_at_stream(file: LogFile, clocks: Sequence[Clock], found: Survey) -> None:
    """Faults of one stream: of its stamps first, then of the samples in the rows that are left."""
    channels = [channel for clock in clocks for channel in clock.channels]
    columns = list(dict.fromkeys(chain.from_iterable(clock.columns() for clock in clocks)))
    by_column = {clock.column: clock for clock in clocks}
    stamps: dict[str, list[FloatArray]] = {column: [] for column in by_column}
    marks: dict[str, list[NDArray[np.uint64]]] = {channel.name: [] for channel in channels}
    bad: dict[str, dict[str, list[_Rows]]] = {channel.name: {} for channel in channels}
    origins: dict[str, int] = {}
    first = 0
    for batch in file.batches(columns):
        for column in by_column:
            stamps[column].append(_times(batch[column], column, origins))
        for channel in channels:
            for what, rows in _bad_samples(batch, channel).items():
                bad[channel.name].setdefault(what, []).append(first + rows)
            marks[channel.name].append(_marks(batch, channel))
        first += len(batch[columns[0]].values)
    if not first:
        return
    times = {column: np.concatenate(parts) for column, parts in stamps.items()}
    samples = {name: np.concatenate(parts) for name, parts in marks.items()}
    left_out = np.zeros(first, bool)
    for column, clock in by_column.items():
        own = np.column_stack([samples[channel.name] for channel in clock.channels])
        measured = np.asarray(own.any(axis=1), dtype=np.bool_)
        _look_at_stamps(file, clock, times[column], np.column_stack(list(samples.values())), measured, left_out, found)
    found.rows[clocks[0].stream] = np.flatnonzero(left_out)
    for clock in clocks:
        for channel in clock.channels:
            own = samples[channel.name]
            for what, parts in bad[channel.name].items():
                rows = np.concatenate(parts)
                own[rows] = 0
                _leave_out(file, found, channel, rows[~left_out[rows]], what, "left out")
            if channel.fill != "none" and not clock.is_own:
                already = np.unique(np.concatenate([np.empty(0, np.intp), *chain(*bad[channel.name].values())]))
                without = np.setdiff1d(np.flatnonzero((own == 0) & ~left_out), already)
                _add(found, file, without, f"rows without {channel.name}", "a gap")
            rows = _contradicting(times[clock.column], own, left_out)
            _leave_out(file, found, channel, rows, "that differ at the same time", "all of them left out")
            if channel.fill == "next":
                _look_for_lost_torques(file, found, clock, channel, times[clock.column], own, left_out)


def _look_for_lost_torques(
    file: LogFile,
    found: Survey,
    clock: Clock,
    channel: Channel,
    times: FloatArray,
    own: NDArray[np.uint64],
    left_out: NDArray[np.bool_],
) -> None:
    """What is lost of a torque; ``own`` are its marks, 0 where there is none or it is left out."""
    kept = np.flatnonzero(~left_out & ~np.isnan(times))
    # A row that has the time and the torque of one that is kept is a repetition.
    rows = np.flatnonzero(left_out)
    begins, ends = (np.searchsorted(times[kept], times[rows], side) for side in ("left", "right"))
    again = [(own[kept[a:b]] == own[row]).any() for row, a, b in zip(rows, begins, ends, strict=True)]
    bad = np.setdiff1d(found.samples.get(channel.columns[0], np.empty(0, np.intp)), rows)
    empty = np.setdiff1d(kept[own[kept] == 0], bad)
    lost: dict[Lost, tuple[_Rows, str]] = {
        "rows": (rows[~np.array(again, dtype=np.bool_)], f"rows with {channel.name} that are left out"),
        "samples": (bad, f"samples of {channel.name} that are left out"),
        "empty": (empty, f"rows without {channel.name}"),
    }
    for kind, (where, what) in lost.items():
        if len(where):
            found.lost_torques.setdefault(kind, []).append(_fault(file, where, what, "lost"))


def _leave_out(file: LogFile, found: Survey, channel: Channel, rows: _Rows, what: str, done: str) -> None:
    _add(found, file, rows, f"samples of {channel.name} {what}", done)
    for column in channel.columns:
        found.samples[column] = np.union1d(found.samples.get(column, np.empty(0, np.intp)), rows).astype(np.intp)


def _times(cells: Cells, column: str, origins: dict[str, int]) -> FloatArray:
    """Stamps as numbers that keep their order and differences, NaN where there is none."""
    values = cells.values
    there = ~cells.empty & np.isfinite(values)
    if values.dtype == np.int64 and there.any():
        # Whole numbers since 1970 have more digits than a double.
        values = values - origins.setdefault(column, int(values[there][0]))
    # Bounded, so that there are numbers for all differences.
    return np.where(there, np.clip(values.astype(np.float64), -_FARTHEST, _FARTHEST), np.nan)


def _bad_samples(batch: Batch, channel: Channel) -> dict[str, _Rows]:
    """Rows with a sample that cannot be used, by what is wrong; a sample that is not there at all is not among them."""
    cells = [batch[column] for column in channel.columns]
    values = np.column_stack([one.values.astype(np.float64) for one in cells])
    empty = np.column_stack([one.empty for one in cells])
    there = ~empty
    some = there.any(axis=1)
    main = slice(0, len(channel.columns) - channel.companions)
    with np.errstate(invalid="ignore"):
        nan = (np.isnan(values) & there).any(axis=1)
        infinite = (np.isinf(values) & there).any(axis=1) & ~nan
        huge = ((np.abs(values) > LARGEST_VALUE) & there).any(axis=1) & ~nan & ~infinite
    partly = some & empty[:, main].any(axis=1) & there[:, main].any(axis=1) & ~nan & ~infinite & ~huge
    partly |= there[:, main].all(axis=1) & empty.any(axis=1) & ~nan & ~infinite & ~huge
    zero = np.zeros(len(values), bool)
    for i in range(channel.vectors):
        zero |= there.all(axis=1) & ~values[:, 3 * i : 3 * i + 3].any(axis=1)
    faults = {
        "with NaN": nan,
        "that are infinite": infinite,
        f"beyond {LARGEST_VALUE:g}": huge,
        "with empty components": partly,
        "that are zero": zero,
    }
    return {what: np.flatnonzero(rows) for what, rows in faults.items() if rows.any()}


def _marks(batch: Batch, channel: Channel) -> NDArray[np.uint64]:
    """A number for each sample that is the same for the same values; 0 if a component is not there."""
    cells = [batch[column] for column in channel.columns[: len(channel.columns) - channel.companions]]
    mark = np.full(len(cells[0].values), 0x9E3779B97F4A7C15, dtype=np.uint64)
    for one in cells:
        bits = np.ascontiguousarray(one.values.astype(np.float64)).view(np.uint64)
        mark = (mark ^ bits ^ (bits >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9) + np.uint64(0x94D049BB133111EB)
    there = ~np.any([one.empty for one in cells], axis=0)
    return np.where(there, mark | np.uint64(1), np.uint64(0))


# --- stamps -----------------------------------------------------------------------------------------------------------


def _look_at_stamps(
    file: LogFile,
    clock: Clock,
    times: FloatArray,
    marks: NDArray[Any],
    measured: NDArray[np.bool_],
    left_out: NDArray[np.bool_],
    found: Survey,
) -> None:
    """Faults of a clock's stamps; ``marks`` tell all samples of a row, ``measured`` if the clock's own are there."""
    missing = np.isnan(times)
    if clock.is_own:
        missing &= measured  # a row without stamp and samples does not count: others may have samples there
    _add(found, file, np.flatnonzero(missing & ~left_out), f"rows without a time in {clock.column!r}", "left out")
    left_out |= missing
    kept = np.flatnonzero(~left_out & ~np.isnan(times))
    if len(kept) > _LEAST_REVERSED and (np.diff(times[kept]) < 0.0).all():
        found.hopeless.append(
            f"the times in {clock.column!r} fall from the first row to the last: the rows are in reverse order. Turn "
            "them round, so that the earliest comes first"
        )
        return
    late, ahead, hopeless = _out_of_order(times[kept], marks[kept])
    _add(found, file, kept[late], f"rows whose time in {clock.column!r} is before that of a row above", "left out")
    _add(found, file, kept[ahead], f"rows whose time in {clock.column!r} is after that of rows below", "left out")
    found.ahead += [file.place(clock.column, int(row)) for row in kept[ahead[:1]]]
    left_out[kept[late]] = left_out[kept[ahead]] = True
    for at in hopeless[:1]:
        if (size := _counter_size(times[kept], int(at))) is not None:
            found.hopeless.append(
                f"{file.place(clock.column, int(kept[at]))}: the clock begins anew here, as a counter does after "
                f"{size:.10g}. Add that to all times in {clock.column!r} from here on, and again wherever this happens"
            )
            break
        found.hopeless.append(
            f"{file.place(clock.column, int(kept[at]))}: the clock was set back here"
            + (f", and at {len(hopeless) - 1} more places" if len(hopeless) > 1 else "")
            + ": how much time went by is not known, and no repair finds it out. Cut the file here"
        )
    kept = kept[~left_out[kept]]
    same = np.diff(times[kept], prepend=np.nan) == 0.0
    again = np.zeros(len(kept), bool)
    again[1:] = same[1:] & (marks[kept[1:]] == marks[kept[:-1]]).all(axis=1)
    _add(found, file, kept[again], "rows that repeat the row above", "left out, nothing is lost")
    left_out[kept[again]] = True


def _counter_size(times: FloatArray, row: int) -> float | None:
    """After how much a counter begins anew that does so before a row; None if no usual one would go on at that row."""
    steps = np.diff(times)
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else np.inf
    for size in (2.0**bits * tick for bits in _COUNTER_BITS for tick in _COUNTER_TICKS):
        if size > _LEAST_OF_COUNTER * usual and 0.0 < size + steps[row - 1] < _LOST_BESIDE * usual:
            return size
    return None


def _out_of_order(times: FloatArray, marks: NDArray[Any]) -> tuple[_Rows, _Rows, _Rows]:
    """Rows to leave out because they are late or ahead, and those at which the clock was set back for good.

    A row may be left out if the others show that its own stamp alone is wrong: there is room for it between its
    neighbours, or at its stamp, or it repeats a row. After a clock is set back rows go on at once: there is no room.
    Where there is room for many more rows than these, the log paused, and the clock may have been set in the pause.
    """
    late: list[int] = []
    ahead: list[int] = []
    hopeless: list[int] = []
    steps = np.diff(times)
    if not (steps < 0.0).any():
        return (np.empty(0, np.intp),) * 3
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    long = float(np.quantile(steps[steps > 0.0], _NO_PAUSE)) if (steps > 0.0).any() else 0.0

    def have_room(count: int, room: float, step: float = _A_STEP) -> bool:
        """Whether the time between two rows is that of this many rows, and a lost one perhaps."""
        return step * (count + 1) * usual <= room <= (count + 2) * long

    latest, before = 0, -1  # the last row that is kept, and the one before it
    i = 1
    while i < len(times):
        if times[i] >= times[latest]:
            before, latest = latest, i
            i += 1
            continue
        room = np.inf if before < 0 else times[i] - times[before]
        goes_on = i + 1 >= len(times) or times[i + 1] >= times[i]
        end = i + int(np.argmax(times[i:] > times[latest])) if (times[i:] > times[latest]).any() else len(times)
        run = np.arange(i, end)
        after = times[end] if end < len(times) else np.inf
        repeats = all(_is_repeated(int(row), latest, times, marks) for row in run[:1000]) and len(run) <= 1000
        fits = repeats or (end < len(times) and have_room(len(run), after - times[latest]))
        if end < len(times) or len(run) == 1:
            fits = fits or _have_places(times[run], np.append(times[max(i - 1000, 0) : i], times[end : end + 1]), usual)
        is_far = times[latest] - times[i] > _FAR * long
        has_room = before < 0 or have_room(1, room, _A_SHORT_STEP if is_far else _A_STEP)
        if len(run) > 1 and goes_on and has_room and not repeats:
            ahead.append(latest)
            latest = i
            i += 1
        elif fits:
            late += run.tolist()
            i = end
        else:
            hopeless.append(i)
            latest, before = i, -1
            i += 1
    return tuple(np.array(rows, dtype=np.intp) for rows in (late, ahead, hopeless))  # type: ignore[return-value]


def _is_repeated(row: int, latest: int, times: FloatArray, marks: NDArray[Any]) -> bool:
    """Whether an earlier row has the same stamp and the same values."""
    begin = max(latest - 1000, 0)
    same = times[begin : latest + 1] == times[row]
    return bool((same & (marks[begin : latest + 1] == marks[row]).all(axis=1)).any())


def _have_places(late: FloatArray, others: FloatArray, usual: float) -> bool:
    """Whether rows that are late would be a step away from all others if they stood in the order of time."""
    ordered = np.sort(np.concatenate([np.unique(others), late]))
    near = (ordered >= late.min() - 2.0 * usual) & (ordered <= late.max() + 2.0 * usual)
    return bool(len(late) <= 1000 and (np.diff(ordered[near]) >= _A_STEP * usual).all())


def _contradicting(times: FloatArray, marks: NDArray[np.uint64], left_out: NDArray[np.bool_]) -> _Rows:
    """Rows in which a sensor has another sample at the same time, with other values."""
    there = np.flatnonzero((marks != 0) & ~left_out & ~np.isnan(times))
    ends = np.flatnonzero(np.diff(times[there], prepend=np.nan, append=np.nan) != 0.0)
    if len(ends) == len(there) + 1:
        return np.empty(0, np.intp)
    groups = [there[a:b] for a, b in pairwise(ends) if b - a > 1 and len(np.unique(marks[there[a:b]])) > 1]
    return np.concatenate(groups) if groups else np.empty(0, np.intp)


# --- what is left -----------------------------------------------------------------------------------------------------


class Repaired:
    """A log without what a survey found. Rows count without those that are left out; places are those of the file.

    Parameters
    ----------
    file : LogFile
    found : Survey

    Raises
    ------
    FileError
        If something is wrong that cannot be left out.
    """

    def __init__(self, file: LogFile, found: Survey) -> None:
        if found.hopeless:
            raise FileError(f"{file.path}: {'; '.join(found.hopeless)}")
        self.found = found
        self.path = file.path
        self.columns = file.columns
        self.label = getattr(file, "label", "")
        self._file = file

    def stream(self, column: str) -> str:
        """See `LogFile`."""
        return self._file.stream(column)

    def holds_numbers(self, column: str) -> bool:
        """See `LogFile`."""
        return self._file.holds_numbers(column)

    def time_unit(self, column: str) -> str | None:
        """See `LogFile`."""
        return self._file.time_unit(column)

    def stamps(self, stream: str) -> tuple[str, str] | None:
        """See `LogFile`."""
        return self._file.stamps(stream)

    def about(self, column: str) -> str:
        """See `LogFile`."""
        return self._file.about(column)

    def batches(self, columns: Sequence[str]) -> Iterator[Batch]:
        """See `LogFile`."""
        without = self._left_out(columns[0])
        first = 0
        for batch in self._file.batches(columns):
            count = len(batch[columns[0]].values)
            keep = np.ones(count, bool)
            keep[_within(without, first, count)] = False
            yield {name: self._cells(name, cells, keep, first) for name, cells in batch.items()}
            first += count

    def _cells(self, name: str, cells: Cells, keep: NDArray[np.bool_], first: int) -> Cells:
        empty = cells.empty.copy()
        empty[_within(self.found.samples.get(name, np.empty(0, np.intp)), first, len(empty))] = True
        return Cells(cells.values[keep], empty[keep])

    def _left_out(self, column: str) -> _Rows:
        return self.found.rows.get(self._file.stream(column), np.empty(0, np.intp))

    def place(self, column: str, row: int) -> str:
        """See `LogFile`."""
        return self._file.place(column, _in_file(self._left_out(column), row))

    def places_of_rows(self, rows: Sequence[int]) -> list[str]:
        """See `LogFile`."""
        return self._file.places_of_rows([_in_file(self._left_out(self.columns[0]), row) for row in rows])


def _within(rows: _Rows, first: int, count: int) -> _Rows:
    """The rows of a batch, counted in it."""
    begin, end = np.searchsorted(rows, [first, first + count])
    return rows[begin:end] - first


def _in_file(left_out: _Rows, row: int) -> int:
    """A row of the file, from 0, that is the given one of those that are left."""
    # The k-th row that is left out has left_out[k] - k rows that are kept before it.
    return row + int(np.searchsorted(left_out - np.arange(len(left_out)), row, side="right"))
