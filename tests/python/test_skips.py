"""What `.ci/run` asks for: a skip for a reason that is not on the list fails."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import LISTED

NO_DATASETS = LISTED[0].reason

CASES = """
import pytest

def test_passes():
    pass

@pytest.mark.skipif(True, reason={reason!r})
def test_of_a_mark():
    raise AssertionError

def test_of_a_call():
    pytest.skip({reason!r})
"""


def run(folder, *arguments, **variables):
    shutil.copy(Path(__file__).with_name("conftest.py"), folder)
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("ELLIPTUDE_", "PYTEST_"))}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *arguments],
        cwd=folder, env=kept | variables, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout


@pytest.mark.parametrize("processes", [[], ["-n", "2"]])
@pytest.mark.parametrize(
    ("reason", "variables", "fails"),
    [
        ("no such program", {}, False),
        ("no such program", {"ELLIPTUDE_SKIPS": "listed"}, True),
        (NO_DATASETS, {"ELLIPTUDE_SKIPS": "listed"}, False),
        (NO_DATASETS, {"ELLIPTUDE_SKIPS": "listed", "ELLIPTUDE_DATASETS": "there"}, True),
    ],
)
def test_skips_for_a_reason(tmp_path, processes, reason, variables, fails):
    (tmp_path / "test_some.py").write_text(CASES.format(reason=reason))
    code, said = run(tmp_path, *processes, **variables)
    assert "1 passed, 2 skipped" in said
    assert code == (1 if fails else 0), said
    assert ("not on the list" in said) == fails


@pytest.mark.parametrize("processes", [[], ["-n", "2"]])
def test_a_module_that_is_skipped(tmp_path, processes):
    """As with `importorskip` at the top of a file: nothing of it is run, or counted as a test."""
    (tmp_path / "test_some.py").write_text("import pytest\npytest.importorskip('no_such_module')\n")
    (tmp_path / "test_other.py").write_text("def test_passes():\n    pass\n")
    code, said = run(tmp_path, *processes, ELLIPTUDE_SKIPS="listed")
    assert code == 1, said
    assert "test_some.py: could not import 'no_such_module'" in said


def test_a_failure_stays_one(tmp_path):
    (tmp_path / "test_some.py").write_text(CASES.format(reason=NO_DATASETS) + "\ndef test_fails():\n    assert False\n")
    assert run(tmp_path, ELLIPTUDE_SKIPS="listed")[0] == 1
