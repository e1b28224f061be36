"""How the command line starts: quickly, and with every command."""

import importlib
import json
import os
import subprocess
import sys
from pathlib import Path

import elliptude
import pytest
from elliptude.cli.application import COMMANDS, make_app
from rich.text import Text
from typer.testing import CliRunner

# What the library needs is loaded with it, and Typer with Rich; the rest is for the command that needs it.
SLOW = ("matplotlib", "plotly", "pyarrow", "pydantic", "scipy", "tomlkit")


def loaded(program, modules=SLOW, folder=None):
    """Which of some modules a program has loaded when it ends."""
    at_the_end = f"import atexit, json, sys; atexit.register(lambda: print(json.dumps([name for name in {modules} " + (
        "if name in sys.modules]), file=sys.stderr))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", at_the_end + program], capture_output=True, text=True, check=True, cwd=folder
    )
    return json.loads(done.stderr.splitlines()[-1])


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_help_and_version_load_nothing_slow(option):
    assert loaded(f"sys.argv[1:] = ['{option}']; from elliptude.cli import main; main()") == []


# Each takes longer to load than a command takes to say what its options are.
OF_SOME_WORK = ("matplotlib", "pandas", "plotly", "scipy.integrate", "scipy.linalg", "scipy.optimize", "scipy.spatial")


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_starts_without_what_only_some_of_its_work_needs(name):
    assert (
        loaded(f"from elliptude.cli.application import COMMANDS; COMMANDS['{name}'].load('{name}')", OF_SOME_WORK) == []
    )


def test_bounds_and_check_load_neither_scipy_nor_pandas_for_a_plain_recording(tmp_path):
    recording_at_rest(tmp_path / "log.csv")
    for arguments in (["bounds", "log.csv", "--out", "config.toml"], ["check", "log.csv", "config.toml"]):
        program = f"sys.argv[1:] = {arguments}; from elliptude.cli import main; main()"
        assert loaded(program, OF_SOME_WORK, tmp_path) == [], arguments


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


def test_the_lines_of_help_end_where_the_terminal_does():
    shown = CliRunner().invoke(make_app(), ["bounds", "--help"], env={"COLUMNS": "100"}).output
    lines = [line.strip() for line in shown[shown.index("A configuration, --like") :].splitlines()]
    assert all(len(line) > 80 for line in lines[:3]), lines[:4]


def recording_at_rest(path):
    header = [f"{kind} {axis} ({unit})" for kind, unit in (("Gyr", "deg/s"), ("Acc", "m/s^2")) for axis in "XYZ"]
    rows = [f"{0.01 * i:.2f},0,0,{0.01 * (i % 2)},0,0,9.8" for i in range(100)]
    path.write_text("\n".join(["Time (s)," + ",".join(header), *rows]) + "\n")


def command(*arguments, **environment):
    """The command line as a process of its own."""
    program = "import sys; sys.argv[0] = 'elliptude'; from elliptude.cli import main; main()"
    return subprocess.run(
        [sys.executable, "-c", program, *arguments], capture_output=True, env=os.environ | environment, check=False
    )


def test_a_terminal_without_the_sign_of_a_degree_shows_another(tmp_path):
    recording_at_rest(log := tmp_path / "log.csv")
    done = command("bounds", str(log), PYTHONIOENCODING="ascii")
    assert done.returncode == 0, done.stderr
    assert b"gyro: rate, ?/s" in done.stdout


def test_a_name_that_is_no_text_is_refused_with_a_remedy():
    done = command("bounds", b"M\xfcnchen.csv", LC_ALL="C.UTF-8")
    assert done.returncode == 1
    assert b"error: 'M\\udcfcnchen.csv': a name that is no text in this system's encoding, utf-8: rename" in done.stderr
    assert b"Traceback" not in done.stderr


def test_python_runs_the_command_where_it_is_not_on_the_path():
    program = [sys.executable, "-m", "elliptude"]
    said = subprocess.run([*program, "bounds", "nowhere.csv"], capture_output=True, text=True, timeout=60, check=False)
    assert said.returncode != 0
    assert "nowhere.csv" in said.stderr
    assert "Traceback" not in said.stderr
    for option, inside in (("--includedir", "elliptude/version.hpp"), ("--cmakedir", "elliptudeConfig.cmake")):
        said = subprocess.run([*program, option], capture_output=True, text=True, timeout=60, check=True)
        assert (Path(said.stdout.strip()) / inside).is_file()


def test_the_version_needs_no_extra():
    blocked = "import runpy, sys; sys.modules['typer'] = None; runpy.run_module('elliptude', run_name='__main__')"
    said = subprocess.run(
        [sys.executable, "-c", blocked, "--version"], capture_output=True, text=True, timeout=60, check=True
    )
    assert said.stdout.strip() == elliptude.__version__
