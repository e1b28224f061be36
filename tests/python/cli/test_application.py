"""How the command line starts: quickly, and with every command."""

import importlib
import json
import subprocess
import sys

import pytest
from elliptude.cli.application import COMMANDS, make_app
from rich.text import Text
from typer.testing import CliRunner

# What the library needs is loaded with it, and Typer with Rich; the rest is for the command that needs it.
SLOW = ("matplotlib", "plotly", "pyarrow", "pydantic", "scipy", "tomlkit")


def loaded(program):
    """Which slow modules a program has loaded when it ends."""
    at_the_end = f"import atexit, json, sys; SLOW = {SLOW}; atexit.register(lambda: print(json.dumps(" + (
        "[name for name in SLOW if name in sys.modules]), file=sys.stderr))\n"
    )
    done = subprocess.run([sys.executable, "-c", at_the_end + program], capture_output=True, text=True, check=True)
    return json.loads(done.stderr)


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_help_and_version_load_nothing_slow(option):
    assert loaded(f"sys.argv[1:] = ['{option}']; from elliptude.cli import main; main()") == []


def test_commands_start_without_what_only_pictures_need():
    modules = ", ".join(sorted({f"elliptude.cli.{command.module}" for command in COMMANDS.values()}))
    program = f"import {modules}; print([m for m in sys.modules if m in ('matplotlib', 'plotly', 'scipy.integrate')])"
    done = subprocess.run([sys.executable, "-c", f"import sys; {program}"], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize("name", COMMANDS)
def test_help_says_what_the_command_does(name):
    """The list of commands is written down, as it must not need their modules; each is what the command says itself."""
    command = COMMANDS[name]
    function = getattr(importlib.import_module(f"elliptude.cli.{command.module}"), command.function)
    assert command.summary == " ".join(function.__doc__.split("\n\n")[0].split())
    done = CliRunner().invoke(make_app(), [name, "--help"], env={"COLUMNS": "200"})
    assert done.exit_code == 0
    assert command.summary in done.output


@pytest.mark.parametrize("name", COMMANDS)
def test_help_shows_all_that_options_say(name):
    """What is in brackets would be taken for markup, and not be shown."""
    for parameter in COMMANDS[name].load(name).params:
        said = getattr(parameter, "help", None) or ""
        assert Text.from_markup(said).plain == said


def test_a_command_that_lacks_a_module_says_which(monkeypatch):
    monkeypatch.setitem(sys.modules, "elliptude.cli.report", None)
    with pytest.raises(SystemExit) as stopped:
        COMMANDS["report"].load("report")
    assert "elliptude.cli.report, which is not installed: pip install 'elliptude[cli]'" in str(stopped.value)
