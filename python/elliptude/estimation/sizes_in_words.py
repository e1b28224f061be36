"""How far off attitudes may be, in words: a name for each figure, the same in the terminal, the report and pictures."""

from collections.abc import Mapping, Sequence
from typing import Any

LARGEST_ANGLE = "largest angle in the set"
"""Of the turns from the center of the set, the estimate, to the attitudes in it."""
TILT = "bound of the tilt"
"""Of the angle between estimated and true up."""
HEADING = "bound of the heading"
"""Of the turn about the vertical, to either side, that is left when the tilt is taken away."""
UP = "bound of up"
"""Of the angle between true up and up as well as it is known, also where no attitude is."""

_NAMES = {"largest_angle_deg": LARGEST_ANGLE, "tilt_bound_deg": TILT, "heading_bound_deg": HEADING}


def half_width(axis: str) -> str:
    """The name of how far the attitude errors in a set reach about an axis."""
    return f"half-width about {axis}"


def rows_in_words(count: int) -> str:
    """How many rows, such as "1 row"."""
    return "1 row" if count == 1 else f"{count} rows"


def tilt_beyond_set(rows: int) -> str:
    """Why a bound of the tilt may be larger than the largest angle in the set."""
    where = rows_in_words(rows)
    return (
        f"at {where} the {TILT} is above the {LARGEST_ANGLE}: it has the claim of up, which does not rest on what was "
        "left out, as the set does there"
    )


def lines(sizes: Mapping[str, Mapping[str, Any]], axes: Sequence[str]) -> list[str]:
    """The sizes of a run in a small table: a column for each part, a line for each figure.

    Parameters
    ----------
    sizes : mapping
        The parts of a run, such as "at_rest", with their sizes, as ``summary.json`` has them.
    axes : sequence of str
        Names of the reference axes.

    Returns
    -------
    list of str
        Empty if no row has a set. Half-widths only where tilt and heading, which say more, are not known.
    """
    parts = {name.replace("_", " "): part for name, part in sizes.items() if part["with_set"]}
    if not parts:
        return []
    figures = {
        name: [mean_and_most(part[key]["mean"], part[key]["max"]) for part in parts.values()]
        for key, name in _NAMES.items()
        if all(part[key] is not None for part in parts.values())
    }
    if HEADING not in figures:
        for i, axis in enumerate(axes):
            widths = [part["half_width_reference_deg"] for part in parts.values()]
            figures[half_width(axis)] = [mean_and_most(one["mean"][i], one["max"][i]) for one in widths]
    heads = [f"{name}, {rows_in_words(part['with_set'])}" for name, part in parts.items()]
    rows = [("degrees: mean (at most)", heads), *figures.items()]
    first = max(len(name) for name, _ in rows)
    widths_of_columns = [max(len(cells[i]) for _, cells in rows) for i in range(len(heads))]
    return [
        "  ".join(
            [name.ljust(first), *(cell.ljust(width) for cell, width in zip(cells, widths_of_columns, strict=True))]
        ).rstrip()
        for name, cells in rows
    ]


def mean_and_most(mean: float, most: float) -> str:
    """Mean and largest of a figure over rows, as in "62.5 (119)"."""
    return f"{mean:.3g} ({most:.3g})"
