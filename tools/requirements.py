"""Print requirements from pyproject.toml, one a line: `requirements.py build runtime test dev`.

`build` stands for the build system's, `runtime` for the package's own; any other word for that extra, with those that
it includes.
"""

import re
import sys
import tomllib
from pathlib import Path

pyproject = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))
groups = {
    "build": pyproject["build-system"]["requires"],
    "runtime": pyproject["project"]["dependencies"],
    **pyproject["project"]["optional-dependencies"],
}


def requirements_of(names: list[str]) -> list[str]:
    """All of some groups, each once, in order."""
    found: dict[str, None] = {}
    for name in names:
        for requirement in groups[name]:
            included = re.fullmatch(r"elliptude\[(.*)\]", requirement)
            found |= dict.fromkeys(requirements_of(included[1].split(",")) if included else [requirement])
    return list(found)


print(*requirements_of(sys.argv[1:]), sep="\n")
