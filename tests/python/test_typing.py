"""The stubs: mypy in strict mode, the stubs against the module, signatures and docstrings."""

import doctest
import importlib.metadata
import inspect
import subprocess
import sys
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


def run(*arguments):
    result = subprocess.run([sys.executable, "-m", *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr


@needs_mypy
def test_mypy_strict():
    run("mypy")


@needs_mypy
def test_stubs_are_the_module():
    run("mypy.stubtest", "elliptude._core", "--ignore-disjoint-bases")


def public_members():
    """Functions and classes of the core, and the methods of these classes."""
    for name, thing in vars(_core).items():
        if name.startswith("_") or not callable(thing):
            continue
        yield name, thing
        if inspect.isclass(thing):
            for method_name, method in vars(thing).items():
                if not method_name.startswith("_"):
                    yield f"{name}.{method_name}", getattr(thing, method_name)


MEMBERS = dict(public_members())


@pytest.mark.parametrize("name", MEMBERS)
def test_docstrings(name):
    member = MEMBERS[name]
    assert member.__doc__
    if inspect.isroutine(member):
        parameters = [p for p in inspect.signature(member).parameters if p != "self"]
        for parameter in parameters:
            assert parameter in member.__doc__, f"{parameter} is not explained"
        sections = ["Parameters\n----------"] if parameters else []
        for section in sections:
            assert section in member.__doc__


def test_examples_in_docstrings():
    runner = doctest.DocTestRunner()
    parser = doctest.DocTestParser()
    for name, member in MEMBERS.items():
        runner.run(parser.get_doctest(member.__doc__, {}, name, None, None))
    assert runner.tries > 10
    assert runner.failures == 0


def test_everything_is_exported():
    assert sorted(elliptude.__all__) == elliptude.__all__ or set(elliptude.__all__) >= set(MEMBERS) - {
        name for name in MEMBERS if "." in name
    }
    for name in elliptude.__all__:
        assert hasattr(elliptude, name)
