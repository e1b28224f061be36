"""The core's exp, log, sin, cos and atan2: their constants, and the proof of their bounds, by tools/elementary.py."""

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[3]
BASE = ROOT / "cpp" / "include" / "elliptude" / "base"


@pytest.fixture(scope="module")
def elementary() -> ModuleType:
    specification = importlib.util.spec_from_file_location("elementary", ROOT / "tools" / "elementary.py")
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    sys.modules["elementary"] = module  # where dataclasses look
    specification.loader.exec_module(module)
    return module


def test_the_constants_are_those_that_are_derived(elementary: ModuleType) -> None:
    assert elementary.HEADER.read_text(encoding="utf-8") == elementary.header()


@pytest.mark.parametrize("name", ["double", "float"])
def test_the_bounds_of_the_header_are_proved(elementary: ModuleType, name: str) -> None:
    text = (BASE / "rounding.hpp").read_text(encoding="utf-8")
    stated = {key: float(number) for key, number in re.findall(r"double (\w+)_units = ([\d.]+);", text)}
    assert stated.keys() == {"exp", "log", "sine", "atan2"}
    form = next(form for form in elementary.FORMATS if form.name == name)
    proved = elementary.bounds(form)
    proved["sine"] = max(proved.pop("sin"), proved.pop("cos"))  # of which a quarter turn makes the other
    for key, bound in stated.items():
        assert bound - 0.12 < proved[key] <= bound


def test_a_mistake_in_a_coefficient_is_seen(elementary: ModuleType) -> None:
    form = elementary.FLOAT
    of = elementary.series()["exp"]
    coefficients = elementary.fitted(of, form.terms["exp"], form.digits)
    assert elementary.prove_exp(form, coefficients) < 1
    coefficients[3] *= 1 + elementary.Fraction(1, 100)
    assert elementary.prove_exp(form, coefficients) > 1.5
