"""What all commands do alike with numbers and with what they are to write: refuse it before they work."""

import importlib
import inspect
import typing
from pathlib import Path

import pytest
import typer
from elliptude.cli.application import COMMANDS, make_app
from typer.testing import CliRunner


def run(*arguments):
    return CliRunner().invoke(make_app(), [str(argument) for argument in arguments], env={"COLUMNS": "300"})


def parameters(name):
    """A command's function: names, whether they are needed, types and Typer's information."""
    command = COMMANDS[name]
    function = getattr(importlib.import_module(f"elliptude.cli.{command.module}"), command.function)
    hints = typing.get_type_hints(function, include_extras=True)
    for one in inspect.signature(function).parameters.values():
        hint = typing.get_args(hints[one.name])
        yield one.name, one.default is inspect.Parameter.empty, str(hint[0]), hint[1]


def option(name):
    return "--" + name.replace("_", "-")


def required(name):
    """What a command cannot do without, made up."""
    arguments = []
    for one, is_required, _, information in parameters(name):
        if is_required:
            is_argument = isinstance(information, typer.models.ArgumentInfo)
            arguments += ["made-up"] if is_argument else [option(one), "made-up"]
    return arguments


NUMBERS = [(name, option(one)) for name in COMMANDS for one, _, kind, _ in parameters(name) if "float" in kind]


def test_all_options_that_are_numbers_are_found():
    assert ("calibrate", "--disturbance-ut") in NUMBERS
    assert ("validate", "--bound-deg") in NUMBERS
    assert len(NUMBERS) >= 9


@pytest.mark.parametrize(("name", "option"), NUMBERS)
@pytest.mark.parametrize("value", ["1e300", "-1e300", "inf", "-inf", "nan"])
def test_a_number_that_nothing_measures_is_refused_with_option_value_and_limit(name, option, value):
    done = run(name, *required(name), option, value)
    assert done.exit_code == 2
    assert option in done.output
    assert f"{float(value):g} is not from " in done.output


@pytest.fixture
def files(tmp_path):
    """A folder with a configuration; what the commands are to read is missing."""
    (tmp_path / "file").write_text("no folder")
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "config.toml").write_text(
        '[rule]\nkind = "hand_held"\n[flow]\nkind = "gyro"\ncolumns = ["x", "y", "z"]\n[estimator]\n'
        'mode = "guaranteed"\n[[directions]]\nname = "up"\nkind = "accelerometer"\ncolumns = ["a", "b", "c"]\n'
        'unit = "m/s^2"\n'
    )
    return tmp_path


def commands(folder, out):
    """Every command that writes, with a log that is not there: who reads it first has not tried the output."""
    log, config = folder / "missing.csv", folder / "config.toml"
    return {
        "bounds": ("bounds", log, "--like", "broad", "--out", out),
        "bounds rule": ("bounds", log, "--like", "broad", "--rule", out),
        "calibrate": ("calibrate", log, config, "--out", out),
        "convert": ("convert", log, out.with_suffix(".csv")),
        "report": ("report", log, "--out", out),
        "report pictures": ("report", log, "--out", folder / "r.html", "--pictures", out),
        "view": ("view", log, "--out", out),
        "estimate": ("estimate", log, "--config", config, "--out", out),
        "estimate report": ("estimate", log, "--config", config, "--out", folder / "out", "--report", out),
        "compare": ("compare", log, log, "--tum", out),
        "monitor": ("monitor", log, "--estimate", log, "--out", out),
        "simulate": ("simulate", "orbit", "--out", out),
        "validate": ("validate", "--out", out),
        "campaign": ("campaign", log.with_suffix(".toml"), "--out", out),
        "demo": ("demo", "--out", out),
    }


FOLDERS = ("report pictures", "estimate", "compare", "monitor", "simulate", "validate", "campaign", "demo")


@pytest.mark.parametrize("name", commands(Path("x"), Path("x")))
def test_an_output_that_cannot_be_written_fails_before_the_work(files, name):
    before = sorted(files.rglob("*"))
    places = [files / "file" / "out.toml"] + ([] if name in FOLDERS else [files / "none" / "out.toml"])
    for place in places:
        done = run(*commands(files, place)[name])
        assert done.exit_code == 1, done.output
        assert "not written" in done.output
        assert "missing." not in done.output
    assert sorted(files.rglob("*")) == before


PATHS = [(name, one) for name in COMMANDS for one, _, kind, _ in parameters(name) if "Path" in kind]


def test_all_paths_are_found():
    assert {("estimate", "out"), ("report", "pictures"), ("check", "log"), ("bounds", "rule")} <= set(PATHS)
    assert len(PATHS) > 40


@pytest.mark.parametrize(("name", "empty"), PATHS)
def test_an_empty_path_is_refused_by_name(tmp_path, monkeypatch, name, empty):
    """As a path it would be the folder in which the command is called."""
    monkeypatch.chdir(tmp_path)
    arguments, called = [], empty
    for one, is_required, _, information in parameters(name):
        if is_required or one == empty:
            value = "" if one == empty else "made-up"
            called = information.metavar or empty if one == empty else called
            arguments += [value] if isinstance(information, typer.models.ArgumentInfo) else [option(one), value]
    done = run(name, *arguments)
    assert done.exit_code == 2, done.output
    assert "is empty, and names no file or folder" in done.output
    assert f"for {called}:" in done.output.replace("--", "").replace("-", "_").replace("'", "")
    assert list(tmp_path.iterdir()) == []


def test_every_command_that_writes_is_tried(files):
    writing = {name for name in COMMANDS if {"out", "tum"} & {one for one, *_ in parameters(name)}}
    assert writing | {"convert"} == {name.split()[0] for name in commands(files, files)}


def test_a_folder_in_the_place_of_a_file(files):
    done = run(*commands(files, files / "folder.toml")["calibrate"])
    assert done.exit_code == 1
    assert "folder.toml: not written: it is a folder" in done.output


def test_what_is_there_is_kept_and_the_option_named(files):
    (files / "out.toml").write_text("kept")
    done = run(*commands(files, files / "out.toml")["bounds"])
    assert done.exit_code == 1
    assert "out.toml is there already; --force replaces it" in done.output
    assert (files / "out.toml").read_text() == "kept"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            ("bounds", "x", "--carried", "plane"),
            "'plane' is not one of 'hand', 'person', 'drone', 'car', 'boat', 'spacecraft' ",
        ),
        (("bounds", "x", "--margin", "wide"), "'--margin': not a number "),
        (("validate", "--out", "x", "--trials", "1e3"), "'--trials': not a whole number "),
        (("validate", "--out", "x", "--trials", "0"), "'--trials': must be at least 1 "),
        (("validate", "--out", "x", "--processes", "9999"), "'--processes': must be at most 1024 "),
        (
            ("estimate", "x", "--config", "x", "--out", "x", "--format", "xlsx"),
            "'xlsx' is not one of 'csv', 'parquet' ",
        ),
    ],
)
def test_the_value_of_an_option_is_refused_in_our_words(arguments, said):
    done = run(*arguments)
    assert done.exit_code == 2
    assert said in done.output
    assert "Value error" not in done.output
    assert "Input should" not in done.output
