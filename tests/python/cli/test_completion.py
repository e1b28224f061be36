"""Completion by the shell, as the scripts that `--install-completion` writes ask for it."""

import os
import shutil
import subprocess
import sys

import pytest

PROGRAM = [sys.executable, "-c", "import sys; sys.argv[0] = 'elliptude'; from elliptude.cli import main; main()"]


def ask(**variables):
    environment = os.environ | variables
    done = subprocess.run(PROGRAM, env=environment, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_bash():
    said = ask(_ELLIPTUDE_COMPLETE="complete_bash", COMP_WORDS="elliptude co", COMP_CWORD="1")
    assert set(said.split()) == {"compare", "convert"}
    said = ask(_ELLIPTUDE_COMPLETE="complete_bash", COMP_WORDS="elliptude compare --refer", COMP_CWORD="2")
    assert said.split() == ["--reference-error-deg"]


def test_zsh():
    said = ask(_ELLIPTUDE_COMPLETE="complete_zsh", _TYPER_COMPLETE_ARGS="elliptude co")
    assert '"compare"' in said
    assert '"convert"' in said


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_the_script_is_one(shell):
    script = ask(_ELLIPTUDE_COMPLETE=f"source_{shell}")
    assert "_ELLIPTUDE_COMPLETE=complete_" in script
    if shutil.which(shell):
        subprocess.run([shell, "-n"], input=script, text=True, check=True, timeout=60)
