#!/usr/bin/env python3
"""single_header.py OUT [--header HEADER] [--include FOLDER]

Writes the C++ core as one header: elliptude/elliptude.hpp with all that it includes of its own, each once. Eigen and
the standard library stay outside. Fails, and writes nothing, if it meets an include that is neither. Needs only
Python's own modules.
"""

import argparse
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
INCLUDE = re.compile(r"^\s*#\s*include\b\s*(.*?)\s*(?://.*)?$")
NAMED = re.compile(r'^(?:"([^"]+)"|<([^>]+)>)$')
CONDITION = re.compile(r"^\s*#\s*(if|ifdef|ifndef|endif)\b")
ONCE = re.compile(r"^\s*#\s*pragma\s+once\b")
# Eigen's modules, and the standard library's headers, of which no name has a dot or a folder.
OUTSIDE = re.compile(r"Eigen/[A-Za-z]+|[a-z_]+")


class Unresolved(Exception):
    """An include that this program cannot put into one file."""


class Joined:
    """A header with all that it includes, each once."""

    def __init__(self, folder: Path, first: str) -> None:
        self.folder = folder
        self.outside: list[str] = []
        self._conditions: dict[str, str] = {}  # of each header, that under which it is there; empty if always
        self.lines = self._joined(first, "")

    def _joined(self, name: str, condition: str) -> list[str]:
        """The lines of a header of the folder, after those of what it includes."""
        self._conditions[name] = condition
        before: list[str] = []
        text: list[str] = []
        open_conditions: list[str] = []
        for number, line in enumerate((self.folder / name).read_text(encoding="utf-8").splitlines(), start=1):
            place = f"{name}:{number}"
            if found := CONDITION.match(line):
                if found[1] == "endif":
                    open_conditions.pop()
                else:
                    open_conditions.append(place)
            if include := INCLUDE.match(line):
                under = condition or (open_conditions[0] if open_conditions else "")
                (text if open_conditions else before).extend(self._included(place, include[1], under))
            elif not ONCE.match(line):
                text.append(line)
        return [*before, "", f"// --- {name}", *"\n".join(text).strip("\n").split("\n")]

    def _included(self, place: str, given: str, condition: str) -> list[str]:
        named = NAMED.match(given)
        name = (named[1] or named[2]) if named else given
        if named and (self.folder / name).is_file():
            before = self._conditions.get(name)
            if before is None:
                return self._joined(name, condition)
            if before not in ("", condition):
                raise Unresolved(f"{place}: {given} is there already, but only under the condition of {before}")
        elif named and named[2] and OUTSIDE.fullmatch(name):
            if condition.startswith(f"{place.split(':')[0]}:"):  # of this header itself
                raise Unresolved(f"{place}: an include of something else under a condition: {given}")
            if name not in self.outside:
                self.outside.append(name)
        else:
            raise Unresolved(f"{place}: neither in {self.folder} nor of Eigen or the standard library: {given}")
        return []

    def text(self) -> str:
        """The file."""
        head = [
            "// SPDX-License-Identifier: MIT",
            "// elliptude as one header, made by tools/single_header.py: change the headers that it names instead.",
            "#pragma once",
            "",
            *(f"#include <{name}>" for name in sorted(self.outside)),
        ]
        return "\n".join([*head, *self.lines, ""])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="the file to write")
    parser.add_argument("--header", default="elliptude/elliptude.hpp", help="what to begin with")
    parser.add_argument("--include", type=Path, default=ROOT / "cpp" / "include", help="the folder of the headers")
    given = parser.parse_args()
    try:
        joined = Joined(given.include, given.header)
        part = given.out.with_name(f"{given.out.name}.part")
        part.parent.mkdir(parents=True, exist_ok=True)
        part.write_text(joined.text(), encoding="utf-8")
        part.replace(given.out)
    except (Unresolved, OSError) as error:
        sys.exit(f"single_header.py: {error}")


if __name__ == "__main__":
    main()
