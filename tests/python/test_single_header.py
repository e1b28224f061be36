"""tools/single_header.py: what it writes, and what it refuses. ctest shows that the file compiles, and its bits."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
INCLUDE = ROOT / "cpp" / "include"


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, ROOT / "tools" / "single_header.py", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)


def test_it_has_all_of_the_core_once_and_includes_nothing_of_it(tmp_path: Path) -> None:
    out = tmp_path / "made" / "elliptude.hpp"
    done = run(out)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    text = out.read_text(encoding="utf-8")
    assert [path.name for path in out.parent.iterdir()] == ["elliptude.hpp"]
    outside = re.findall(r"#\s*include\s*(\S+)", text)
    assert "<Eigen/Core>" in outside
    assert len(outside) == len(set(outside))
    assert all(re.fullmatch(r"<(Eigen/\w+|[a-z_]+)>", name) for name in outside)
    assert text.count("#pragma once") == 1
    # Every other line of every header is there, as often as in the headers.
    for header in INCLUDE.rglob("*.hpp"):
        body = header.read_text(encoding="utf-8")
        kept = [line for line in body.splitlines() if not re.match(r"\s*#\s*(include|pragma once)", line)]
        # That of the first header has others in between, where they are included under a condition.
        assert "\n".join(kept).strip("\n") in text or header.name == "elliptude.hpp", header
        assert text.count(f"// --- {header.relative_to(INCLUDE).as_posix()}\n") == 1


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('#include "elliptude/lost.hpp"', 'neither in .* nor of Eigen or the standard library: "elliptude/lost.hpp"'),
        ("#include <elliptude/lost.hpp>", "neither in .*: <elliptude/lost.hpp>"),
        ('#  include "array"', 'neither in .*: "array"'),
        ("#include <boost/array.hpp>", "neither in .*: <boost/array.hpp>"),
        ("#include SOME_MACRO  // which", "neither in .*: SOME_MACRO"),
        ("#ifdef A\n#include <array>\n#endif", "an include of something else under a condition: <array>"),
    ],
)
def test_an_include_that_it_cannot_resolve_is_refused(tmp_path: Path, line: str, said: str) -> None:
    headers = tmp_path / "include" / "elliptude"
    headers.mkdir(parents=True)
    (headers / "elliptude.hpp").write_text('#pragma once\n#include "elliptude/one.hpp"\n', encoding="utf-8")
    (headers / "one.hpp").write_text(f"#pragma once\n{line}\n", encoding="utf-8")
    out = tmp_path / "out.hpp"
    out.write_text("what was there", encoding="utf-8")
    done = run(out, "--include", tmp_path / "include")
    assert done.returncode == 1
    assert re.fullmatch(rf"single_header.py: elliptude/one.hpp:[23]: {said}\n", done.stderr)
    assert out.read_text(encoding="utf-8") == "what was there"
    assert {path.name for path in tmp_path.iterdir()} == {"include", "out.hpp"}


def test_a_condition_stays_about_what_it_includes(tmp_path: Path) -> None:
    headers = tmp_path / "elliptude"
    headers.mkdir()
    first = '#include "elliptude/all.hpp"\n#if defined(A)\n#include "elliptude/some.hpp"\n#endif\nint first;\n'
    (headers / "elliptude.hpp").write_text(first, encoding="utf-8")
    (headers / "some.hpp").write_text('#include <array>\n#include "elliptude/all.hpp"\nint some;\n', encoding="utf-8")
    (headers / "all.hpp").write_text("int all;\n", encoding="utf-8")
    out = tmp_path / "out.hpp"
    assert run(out, "--include", tmp_path).returncode == 0
    code = [line for line in out.read_text(encoding="utf-8").splitlines() if line and not line.startswith("//")]
    assert code[1:] == ["#include <array>", "int all;", "#if defined(A)", "int some;", "#endif", "int first;"]
    # Without A nobody would have what is needed outside.
    (headers / "elliptude.hpp").write_text(f'{first}#include "elliptude/some.hpp"\n', encoding="utf-8")
    done = run(out, "--include", tmp_path)
    assert done.returncode == 1
    assert (
        '"elliptude/some.hpp" is there already, but only under the condition of elliptude/elliptude.hpp:2'
        in done.stderr
    )


def test_a_circle_ends_and_a_lost_header_is_named(tmp_path: Path) -> None:
    headers = tmp_path / "elliptude"
    headers.mkdir()
    (headers / "one.hpp").write_text('#include "elliptude/other.hpp"\nint one;\n', encoding="utf-8")
    (headers / "other.hpp").write_text('#include "elliptude/one.hpp"\nint other;\n', encoding="utf-8")
    out = tmp_path / "out.hpp"
    assert run(out, "--include", tmp_path, "--header", "elliptude/one.hpp").returncode == 0
    assert re.findall(r"^int \w+;$", out.read_text(encoding="utf-8"), re.MULTILINE) == ["int other;", "int one;"]
    lost = run(out, "--include", tmp_path, "--header", "elliptude/lost.hpp")
    assert lost.returncode == 1
    assert "lost.hpp" in lost.stderr
    assert "Traceback" not in lost.stderr
