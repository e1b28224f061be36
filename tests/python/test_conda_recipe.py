"""The conda recipe says of versions and requirements what the package itself says."""

import re
import tomllib
from pathlib import Path

import elliptude

ROOT = Path(__file__).parents[2]
RECIPE = (ROOT / "conda" / "meta.yaml").read_text(encoding="utf-8")
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
CONDA_NAMES = {"matplotlib": "matplotlib-base", "cmeel-eigen": "eigen"}


def listed(section: str) -> set[str]:
    """The requirements of a section that have a version, without spaces."""
    found = re.search(rf"^  {section}:.*\n((?:    - .*\n)+)", RECIPE, flags=re.MULTILINE)
    assert found
    return {line.strip("- ").replace(" ", "") for line in found[1].splitlines() if ">=" in line}


def as_conda_has_it(requirements: list[str]) -> set[str]:
    return {CONDA_NAMES.get(name, name) + bound for name, bound in (re.split("(?=>=)", one) for one in requirements)}


def test_the_version_is_read_from_the_header():
    pattern = re.search(r'regex_pattern="(.*)"\)', RECIPE)
    header = re.search(r'load_file="(.*?)"', RECIPE)
    assert pattern
    assert header
    text = (ROOT / "conda" / header[1]).read_text(encoding="utf-8")
    found = re.search(pattern[1], text)
    assert found
    assert ".".join(found.groups()) == elliptude.__version__


def test_the_requirements_are_those_of_the_package():
    extras = PYPROJECT["project"]["optional-dependencies"]
    assert listed("host") == as_conda_has_it(PYPROJECT["build-system"]["requires"])
    assert listed("run") == as_conda_has_it(PYPROJECT["project"]["dependencies"] + extras["cli"])
    others = [one for extra in ("report", "igrf", "ulog", "ros") for one in extras[extra]]
    assert listed("run_constrained") == as_conda_has_it(others)
