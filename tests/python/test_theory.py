"""The equations of docs/theory.md: each has a number of its own, and those that the code names are there."""

import re
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[2]
NUMBERS = re.findall(r"\\tag\{([^}]*)\}", (ROOT / "docs" / "theory.md").read_text(encoding="utf-8"))


def test_no_two_equations_have_one_number() -> None:
    assert [number for number, count in Counter(NUMBERS).items() if count > 1] == []


def test_equations_that_the_code_names_are_there() -> None:
    files = [*(ROOT / "cpp" / "include").rglob("*.hpp"), *(ROOT / "python" / "elliptude").rglob("*.py")]
    named = {
        (number, file.name)
        for file in files
        for number in re.findall(r"(?<![\w.)])\((\d{1,2}\.\d{1,2})\)(?!\()", file.read_text(encoding="utf-8"))
    }
    assert len(named) > 100
    assert sorted((number, file) for number, file in named if number not in NUMBERS) == []
