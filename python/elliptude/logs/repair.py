"""All that is wrong with the rows of a log, at once.

A repair only leaves out: rows, or samples of one sensor. What is left out of a gyro is a gap, about which its bounds
say nothing (docs/theory.md, section 17.6), and nothing is put in its place. The stamps that are kept are taken as
right. So a clock that was set back is no fault that can be left out: nothing says how much time went by.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from elliptude.io.files import FileError
from elliptude.io.readers.base import Batch, Cells, LogFile
from elliptude.io.readers.text.csv import CsvTable
from elliptude.io.readers.text.folder import CsvFolder
from elliptude.logs.alignment.batches import LARGEST_VALUE, without_direction
from elliptude.logs.alignment.clocks import Channel, Clock
from elliptude.logs.order_of_rows import Rows, contradicting, counter_size, out_of_order
from elliptude.typing import FloatArray

# Rows of which each is earlier than the one above show that all are in reverse order; in fewer a clock may have jumped.
_LEAST_REVERSED = 3
# Ticks of a clock; stamps beyond it are none, and count as this.
_FARTHEST = 1e300
MOST_PLACES = 20
"""How many places of a fault are kept, the first ones."""
_MOST_SAID = 3


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
    rows: dict[str, Rows] = field(default_factory=dict)
    """Rows of each stream that are left out, in order."""
    samples: dict[str, Rows] = field(default_factory=dict)
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


def _fault(file: LogFile, rows: Rows, what: str, done: str) -> Fault:
    first = [int(row) for row in rows[:MOST_PLACES]]
    places = [place or f"sample {row + 1}" for place, row in zip(file.places_of_rows(first), first, strict=True)]
    return Fault(what, len(rows), tuple(places), done)


def _add(found: Survey, file: LogFile, rows: Rows, what: str, done: str) -> None:
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
    bad: dict[str, dict[str, list[Rows]]] = {channel.name: {} for channel in channels}
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
            rows = contradicting(times[clock.column], own, left_out)
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
    lost: dict[Lost, tuple[Rows, str]] = {
        "rows": (rows[~np.array(again, dtype=np.bool_)], f"rows with {channel.name} that are left out"),
        "samples": (bad, f"samples of {channel.name} that are left out"),
        "empty": (empty, f"rows without {channel.name}"),
    }
    for kind, (where, what) in lost.items():
        if len(where):
            found.lost_torques.setdefault(kind, []).append(_fault(file, where, what, "lost"))


def _leave_out(file: LogFile, found: Survey, channel: Channel, rows: Rows, what: str, done: str) -> None:
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


def _bad_samples(batch: Batch, channel: Channel) -> dict[str, Rows]:
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
        zero |= there.all(axis=1) & without_direction(values[:, 3 * i : 3 * i + 3])
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
    late, ahead, hopeless = out_of_order(times[kept], marks[kept])
    _add(found, file, kept[late], f"rows whose time in {clock.column!r} is before that of a row above", "left out")
    _add(found, file, kept[ahead], f"rows whose time in {clock.column!r} is after that of rows below", "left out")
    found.ahead += [file.place(clock.column, int(row)) for row in kept[ahead[:1]]]
    left_out[kept[late]] = left_out[kept[ahead]] = True
    for at in hopeless[:1]:
        if (size := counter_size(times[kept], int(at))) is not None:
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
