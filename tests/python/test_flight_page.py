"""docs/flight.md against the headers: the bounds of loops, and the limits."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
CORE = ROOT / "cpp" / "include" / "elliptude"
PAGE = (ROOT / "docs" / "flight.md").read_text(encoding="utf-8")
NO_LOOP = {"most_stages", "most_in_quotient", "most_of_choices"}  # sizes of arrays, and what is refused beyond


def table_of(heading: str) -> list[list[str]]:
    """The rows of the first table after a heading, cell by cell, without the first two lines."""
    section = PAGE.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    rows = [line.strip("|").split("|") for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in row] for row in rows[2:]]


def bounds_in_headers() -> dict[str, set[int]]:
    """The constants by which loops are bounded, header by header."""
    found: dict[str, set[int]] = {}
    for header in sorted(CORE.rglob("*.hpp")):
        for name, number in re.findall(r"constexpr int (most_\w+) = (\d+);", header.read_text(encoding="utf-8")):
            if name not in NO_LOOP:
                found.setdefault(header.relative_to(CORE).as_posix(), set()).add(int(number))
    return found


def test_every_bound_of_a_loop_is_on_the_page() -> None:
    stated: dict[str, set[int]] = {}
    for headers, _, numbers in table_of("Loops"):
        for header in re.findall(r"`([^`]+)`", headers):
            stated[header] = {int(number) for number in numbers.split(";")}
    bounds = bounds_in_headers()
    assert sum(map(len, bounds.values())) > 15
    assert {header: stated.get(header) for header in bounds} == bounds


def test_the_limits_are_those_of_the_header() -> None:
    header = (CORE / "base" / "limits.hpp").read_text(encoding="utf-8")
    defaults = dict(re.findall(r"#define (ELLIPTUDE_(?:MOST|ONLY)_\w+) (.+)", header))
    stated = {row[0].strip("`"): row[2].replace(",", "") for row in table_of("Limits")}
    assert stated.keys() == defaults.keys()
    assert defaults.pop("ELLIPTUDE_MOST_QUADRICS") == "(ELLIPTUDE_MOST_DIRECTIONS + 8)"
    assert stated.pop("ELLIPTUDE_MOST_QUADRICS") == "directions + 8"
    assert stated == defaults


def read_limits() -> dict[tuple[str, str], int]:
    lines = (ROOT / "cpp" / "examples" / "bare_metal" / "limits.txt").read_text(encoding="utf-8").splitlines()
    return {(row[0], row[1]): int(row[2]) for row in map(str.split, lines) if row[0] != "#"}


def test_the_figures_of_the_page_are_the_limits() -> None:
    limits = read_limits()
    table = table_of("What it costs")
    assert {row[0].strip("`") for row in table} == {name for name, _ in limits}
    columns = ["rows", "predict_mean", "predict_most", "update_mean", "update_most"]
    columns += ["predict_stack", "update_stack", "frame", "filter", "code", "core"]
    for row in table:
        numbers = [int(cell.replace(" ", "")) for cell in row[1:]]
        assert numbers == [limits[row[0].strip("`"), column] for column in columns]


def test_what_the_page_has_chosen_is_what_is_measured() -> None:
    limits = read_limits()
    settings = (ROOT / "cpp" / "examples" / "bare_metal" / "CMakeLists.txt").read_text(encoding="utf-8")
    chosen = [row for row in table_of("Less code") if row[0].startswith("**")]
    assert len(chosen) == 2
    for name, unrolled, forced, *figures in chosen:
        program = name.strip("*`")
        image = f"m7/{program}"
        cycle = limits[image, "predict_mean"] + limits[image, "update_mean"]
        numbers = [int(figure.replace(" ", "")) for figure in figures]
        assert numbers == [limits[image, "code"], cycle, limits[image, "frame"]]
        assert f"set(most_unrolled_{program} {unrolled})" in settings
        assert (f"set(inlining_{program} " in settings) == (forced == "yes")
