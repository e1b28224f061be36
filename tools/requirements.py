"""Print requirements from pyproject.toml, one a line: `requirements.py build runtime test dev`.

`build` stands for the build system's, `runtime` for the package's own; any other word for that extra.
"""

import sys
import tomllib
from pathlib import Path

pyproject = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))
groups = {
    "build": pyproject["build-system"]["requires"],
    "runtime": pyproject["project"]["dependencies"],
    **pyproject["project"]["optional-dependencies"],
}
for name in sys.argv[1:]:
    for requirement in groups[name]:
        if not requirement.startswith("elliptude["):  # an extra that includes another one
            print(requirement)
