"""Completion by the shell: the answers that a shell asks for, and the Tab key after `--install-completion`."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pexpect
import pytest

PROGRAM = [sys.executable, "-c", "import sys; sys.argv[0] = 'elliptude'; from elliptude.cli import main; main()"]

CONTROL = r"(?:\x1b\[\??[0-9;]*[a-zA-Z])"
"""What tells a terminal to do something."""
PROMPT = rf"[#$%>] {CONTROL}*$"
LINE = rf"[\r\n]{CONTROL}*"
"""The beginning of a line."""


def ask(**variables):
    environment = os.environ | variables
    done = subprocess.run(PROGRAM, env=environment, capture_output=True, text=True, check=False, timeout=300)
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


def test_fish():
    question = {"_ELLIPTUDE_COMPLETE": "complete_fish", "_TYPER_COMPLETE_ARGS": "elliptude co"}
    said = ask(**question, _TYPER_COMPLETE_FISH_ACTION="get-args")
    assert [line.split("\t")[0] for line in said.splitlines() if not line.startswith(" ")] == ["convert", "compare"]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_tab_completes_commands_options_and_files(shell, tmp_path):
    """In an interactive shell of a new user, after `elliptude --install-completion`."""
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell}: tools/install_system_packages.sh shells")
    (tmp_path / "recording.csv").touch()
    environment = {
        "HOME": str(tmp_path),
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "TERM": "dumb",
        "LC_ALL": "C.UTF-8",
    } | {name: value for name, value in os.environ.items() if name.startswith("PYTHON")}
    # Not the shell's last command: it would become the program, which looks for the shell that called it.
    subprocess.run(
        [shell, "-c", "elliptude --install-completion; true"], env=environment, check=True, timeout=300, cwd=tmp_path
    )
    terminal = pexpect.spawn(
        shell, ["-i"], env=environment, cwd=str(tmp_path), encoding="utf-8", timeout=300, dimensions=(50, 200)
    )
    try:
        terminal.expect(PROMPT)  # what is typed before is thrown away
        if shell == "zsh":
            terminal.send("elliptude \t\x15")  # the first Tab of a new zsh loads the completion, Ctrl-U clears the line
        for typed, completed in (
            ("compa", "compare"),
            ("estimate --ignore-impl", "estimate --ignore-implausible"),
            ("estimate record", "estimate recording.csv"),
        ):
            terminal.send(f"elliptude {typed}\t\x01echo this is \r")  # Ctrl-A: to the line's beginning
            terminal.expect(f"{LINE}this is elliptude {completed}\\s")
            terminal.expect(PROMPT)
    finally:
        terminal.close(force=True)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_is_one(shell):
    script = ask(_ELLIPTUDE_COMPLETE=f"source_{shell}")
    assert "_ELLIPTUDE_COMPLETE=complete_" in script
    if shutil.which(shell):
        subprocess.run([shell, "-n"], input=script, text=True, check=True, timeout=300)
