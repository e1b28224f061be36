"""The examples of the reference run and say what they print, and every public name has one."""

import doctest
import inspect
import re
from pathlib import Path

import elliptude
import pytest

REFERENCE = Path(__file__).parents[3] / "docs" / "reference"
# A name that a page describes, and what follows up to the next.
DESCRIBED = re.compile(r"^\.\. auto(?:class|function|data):: (\w+)$(.*?)(?=^\.\. auto|\Z)", re.MULTILINE | re.DOTALL)
PAGES = {path.stem: path.read_text(encoding="utf-8") for path in sorted(REFERENCE.glob("*.rst"))}


def run(text, names, known):
    """Run the examples of a text, which may use and add names."""
    said = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    test = doctest.DocTestParser().get_doctest(text, {}, names, None, None)
    test.globs = known
    runner.run(test, out=said.append, clear_globs=False)
    assert runner.failures == 0, "".join(said)


def shown(name, text, known):
    """Whether examples show a name: they use it, or something that is an instance of it."""
    thing = getattr(elliptude, name)
    instances = [word for word, value in known.items() if inspect.isclass(thing) and isinstance(value, thing)]
    source = "\n".join(example.source for example in doctest.DocTestParser().get_examples(text))
    return any(re.search(rf"\b{word}\b", source) for word in [f"el.{name}", *instances])


def without_example(page):
    """Names of a page that no example shows; all examples are run, as a reader would, from the top."""
    known = {}
    start = DESCRIBED.search(page)
    run(page[: start.start()], "imports", known)
    missing = []
    for name, text in DESCRIBED.findall(page):
        run(text, name, known)
        docstring = getattr(elliptude, name).__doc__ or ""
        if not shown(name, text, known) and not re.search(rf">>> .*\b{name}\b", docstring):
            missing.append(name)
    return missing


@pytest.mark.parametrize("name", [name for name, page in PAGES.items() if ".. currentmodule:: elliptude" in page])
def test_every_name_of_a_page_has_an_example_that_runs(name):
    assert without_example(PAGES[name]) == []


def test_every_public_name_is_described_once():
    described = [name for page in PAGES.values() for name, _ in DESCRIBED.findall(page)]
    assert sorted(described) == sorted(elliptude.__all__)


def test_a_name_without_an_example_would_be_found():
    page = ">>> import elliptude as el\n\n.. autofunction:: vee\n\n   >>> el.hat([1, 2, 3]).shape\n   (3, 3)\n"
    assert without_example(page) == ["vee"]
