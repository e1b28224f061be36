"""The stubs: mypy in strict mode, the stubs against the module, signatures and docstrings."""

import doctest
import importlib.metadata
import inspect
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import elliptude
import pytest
from elliptude import _core

ROOT = Path(__file__).parents[2]


def is_installed(distribution):
    try:
        importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


needs_mypy = pytest.mark.skipif(
    not (is_installed("mypy") and is_installed("scipy-stubs")), reason="mypy and scipy-stubs are not installed"
)


def run(*arguments, folder=ROOT):
    result = subprocess.run([sys.executable, "-m", *arguments], cwd=folder, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr


def programs(page):
    """The programs of a page: each block, or its examples one after the other."""
    found = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    session = [example.source for block in found for example in doctest.DocTestParser().get_examples(block)]
    return ["".join(session)] if session else found


@needs_mypy
def test_mypy_strict(tmp_path):
    """The package passes, and what a reader copies from the guide, the README and other pages.

    In one run, which reads the package once.
    """
    count = 0
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        for program in programs(page):
            count += 1
            (tmp_path / f"{page.stem}_{count}.py").write_text(program, encoding="utf-8")
    assert {"README", "guide", "library", "monitor"} <= {path.stem.rsplit("_", 1)[0] for path in tmp_path.glob("*.py")}
    with (ROOT / "pyproject.toml").open("rb") as file:
        package = tomllib.load(file)["tool"]["mypy"]["files"]
    run("mypy", *package, *sorted(map(str, tmp_path.glob("*.py"))))


@needs_mypy
def test_stubs_are_the_module(tmp_path):
    """In a folder of its own: mypy, which may run at the same time, locks its cache."""
    allowed = Path(__file__).parent / "typing" / "stubtest_allowlist.txt"
    options = ["--ignore-disjoint-bases", "--allowlist", str(allowed)]
    run("mypy.stubtest", "elliptude._core", "elliptude._truth", *options, folder=tmp_path)


def public_members():
    """Functions and classes of the core, and the methods and properties of these classes."""
    for name, thing in vars(_core).items():
        if name.startswith("_"):
            continue
        yield name, thing
        if inspect.isclass(thing):
            for member in vars(thing):
                if not member.startswith("_"):
                    yield f"{name}.{member}", getattr(thing, member)


MEMBERS = dict(public_members())

# The filter's own docstrings are written for readers who know its measurements, and refer to each other.
FILTER = ("AttitudeFilter", "GyroFlow", "RigidBodyFlow", "StateEllipsoid", "measured_attitude", "measured_state")


@pytest.mark.parametrize("name", [name for name in MEMBERS if name.split(".")[0] not in FILTER])
def test_docstrings(name):
    member = MEMBERS[name]
    assert member.__doc__
    if inspect.isroutine(member):
        parameters = [parameter for parameter in inspect.signature(member).parameters if parameter != "self"]
        if parameters:
            assert "\nParameters\n----------\n" in member.__doc__
            assert "\nRaises\n------\n" in member.__doc__
        for parameter in parameters:
            assert parameter in member.__doc__, f"{parameter} is not explained"


@pytest.mark.parametrize("name", [name for name in MEMBERS if inspect.isroutine(MEMBERS[name])])
def test_signatures_are_true(name):
    """The arguments that a docstring's first line names are those that the function takes."""
    member = MEMBERS[name]
    parameters = [parameter for parameter in inspect.signature(member).parameters if parameter != "self"]
    wrong = object()
    with pytest.raises(TypeError) as caught:
        member(*([wrong] if "." in name else []), **dict.fromkeys([*parameters, "no_such_parameter"], wrong))
    taken = re.split(", | and ", str(caught.value).partition("no argument no_such_parameter; it has ")[2])
    assert [parameter for parameter in taken if parameter] == parameters


def test_examples_in_docstrings():
    runner = doctest.DocTestRunner()
    parser = doctest.DocTestParser()
    for name, member in MEMBERS.items():
        runner.run(parser.get_doctest(member.__doc__, {}, name, None, None))
    assert runner.tries > 10
    assert runner.failures == 0


def test_everything_is_exported():
    core = {name for name in vars(_core) if not name.startswith("_")}
    assert core <= set(elliptude.__all__)
    for name in elliptude.__all__:
        assert hasattr(elliptude, name)
