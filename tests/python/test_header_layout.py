"""A header of the core includes only headers of its own folder and of those above it, and there are no circles."""

import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CORE = ROOT / "cpp" / "include" / "elliptude"
FOLDERS = [
    *("base", "linear", "sets", "attitude", "measurement", "dynamics", "ensemble", "first_order", "guaranteed"),
    "smoothing",
]
WHOLE = "elliptude.hpp"  # includes everything, and nothing in the core includes it


def core_includes() -> dict[str, list[str]]:
    """The headers of the core, and what each includes of the core."""
    pattern = re.compile(r'^\s*#\s*include\s*["<]elliptude/([^">]+)[">]', re.MULTILINE)
    return {
        path.relative_to(CORE).as_posix(): pattern.findall(path.read_text(encoding="utf-8"))
        for path in sorted(CORE.rglob("*.hpp"))
    }


def upward(includes: dict[str, list[str]]) -> list[str]:
    """Includes that go to a folder below, or out of the folders."""
    floor = {folder: number for number, folder in enumerate(FOLDERS)}
    found = []
    for header, included in includes.items():
        if header == WHOLE:
            continue
        for other in included:
            to = floor.get(other.split("/")[0], len(FOLDERS))
            if "/" not in other or to > floor.get(header.split("/")[0], -1):
                found.append(f"{header} includes {other}")
    return found


def is_free_of_circles(includes: dict[str, list[str]]) -> bool:
    try:
        TopologicalSorter(includes).prepare()
    except CycleError:
        return False
    return True


def test_headers_are_in_the_folders():
    in_no_folder = {header for header in core_includes() if header.split("/")[0] not in FOLDERS}
    assert in_no_folder == {WHOLE, "version.hpp"}


def test_a_header_includes_its_own_folder_and_those_above():
    includes = core_includes()
    assert sum(map(len, includes.values())) > len(includes)
    assert upward(includes) == []


def test_no_header_includes_itself_by_way_of_others():
    assert is_free_of_circles(core_includes())


def test_the_whole_includes_every_header_that_users_call():
    includes = core_includes()
    called = {header for header in includes if "/detail/" not in header and header != WHOLE}
    assert set(includes[WHOLE]) == called


@pytest.mark.parametrize(
    ("header", "other"),
    [("sets/ellipsoid.hpp", "attitude/chart.hpp"), ("base/so3.hpp", "elliptude.hpp"), ("base/so3.hpp", "version.hpp")],
)
def test_what_would_break_the_rule_is_found(header, other):
    includes = core_includes()
    includes[header].append(other)
    assert upward(includes) == [f"{header} includes {other}"]


def test_a_circle_would_be_found():
    includes = core_includes()
    includes["base/scalar.hpp"].append("base/so3.hpp")
    assert not is_free_of_circles(includes)


def places_of_epsilon(text: str) -> list[str]:
    """Lines of code, without their comments, that name the distance from 1 to the next number."""
    code = [line.split("//")[0] for line in text.splitlines()]
    return [line.strip() for line in code if re.search(r"\bepsilon\b", line)]


def test_multiples_of_epsilon_have_one_home():
    """What rounding may do is a named constant of rounding.hpp, with the statement that it covers."""
    homes = {"base/scalar.hpp", "base/rounding.hpp"}
    texts = {path.relative_to(CORE).as_posix(): path.read_text(encoding="utf-8") for path in CORE.rglob("*.hpp")}
    assert all(places_of_epsilon(texts[home]) for home in homes)
    assert {
        name: lines for name, text in texts.items() if (lines := places_of_epsilon(text)) and name not in homes
    } == {}
    assert places_of_epsilon("// 3 epsilon\nx = Scalar(3) * scalar::epsilon<Scalar>;") != []


@pytest.mark.parametrize("mirror", ["tests/cpp", "python/bindings"])
def test_bindings_and_tests_have_the_same_folders(mirror):
    beside = {"support", "freestanding", "limits", "same_bits", "c_interface", "validation"}
    others = {"tests/cpp": beside, "python/bindings": {"truth"}}[mirror]
    folders = {path.name for path in (ROOT / mirror).iterdir() if path.is_dir() and path.name != "__pycache__"}
    assert folders - others <= set(FOLDERS)
