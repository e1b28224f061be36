"""The guide's commands, programs and numbers."""

import doctest
import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
GUIDE = ROOT / "docs" / "guide.md"
TEXT = GUIDE.read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", TEXT, flags=re.DOTALL)


def test_the_commands_run_one_after_the_other(tmp_path):
    lines = [line for block in blocks("sh") for line in block.splitlines()]
    assert len(lines) == 6
    for line in lines:
        command, *arguments = shlex.split(line)
        assert command == "elliptude"
        program = [sys.executable, "-c", "from elliptude.cli import main; main()", *arguments]
        done = subprocess.run(program, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300)
        assert done.returncode == 0, f"{line}\n{done.stderr}"
        if arguments[0] == "simulate":  # then the reader adds these lines
            with (tmp_path / "log" / "estimate.toml").open("a") as configuration:
                configuration.write("\n".join(blocks("toml")))
    assert json.loads((tmp_path / "result" / "summary.json").read_text())["mode"] == "guaranteed"
    gained = json.loads((tmp_path / "smoothed" / "summary.json").read_text())["smoothing"]["largest_angle_deg"]
    assert gained["smoothed"] < gained["forward"]
    for name in ("report.html", "compared.html", "result/results.csv", "pictures/axes.png"):
        assert (tmp_path / name).stat().st_size > 1000
    page = (tmp_path / "compared.html").read_text(encoding="utf-8")
    assert "simulated truth, at 21 rows" in page


def test_the_numbers_are_what_python_says():
    test = doctest.DocTestParser().get_doctest("\n".join(blocks("python")), {}, "guide.md", str(GUIDE), 0)
    assert len(test.examples) > 25
    report = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    failed, _ = runner.run(test, out=report.append)
    assert failed == 0, "".join(report)


def test_the_numbers_in_the_text():
    from math import asin, cos, degrees, radians, sin, sqrt

    assert "up to 32° of heading" in " ".join(TEXT.split())
    assert degrees(asin(sin(radians(11)) / cos(radians(69)))) == pytest.approx(32, abs=0.5)
    assert 0.01 * sqrt(140) == pytest.approx(0.12, abs=0.005)
    assert 0.01 * sqrt(140) * sqrt(3) == pytest.approx(0.2, abs=0.01)
    assert 0.01 * sqrt(12) == pytest.approx(0.035, abs=0.0005)


def test_the_files_that_it_names_exist():
    for target in re.findall(r"\]\(([^)#]+)", TEXT):
        assert target.startswith("https://") or (GUIDE.parent / target).exists(), target
    headings = re.findall(r"^## (.*)$", TEXT, flags=re.MULTILINE)
    anchors = {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}
    assert set(re.findall(r"\]\(#([^)]+)\)", TEXT)) == anchors
