"""The conda recipe says of versions and requirements what the package itself says."""

import re
import tomllib
from pathlib import Path

import elliptude

ROOT = Path(__file__).parents[2]
RECIPE = (ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8")
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
    header = re.search(r'load_from_file\("(.*?)"\)', RECIPE)
    assert header
    text = (ROOT / "conda" / header[1]).read_text(encoding="utf-8")
    before = re.findall(r'split\("(.*?)"\)', RECIPE)
    assert ".".join(text.split(words)[-1].split()[0] for words in before) == elliptude.__version__


def test_the_requirements_are_those_of_the_package():
    extras = PYPROJECT["project"]["optional-dependencies"]
    assert listed("host") == as_conda_has_it(PYPROJECT["build-system"]["requires"])
    assert listed("run") == as_conda_has_it(PYPROJECT["project"]["dependencies"] + extras["cli"])
    others = [one for extra in ("report", "igrf", "ulog", "hdf5", "ros") for one in extras[extra]]
    assert listed("run_constraints") == as_conda_has_it(others)
