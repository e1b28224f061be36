"""Prints where a C++ build finds the headers and the CMake package inside the installed package.

``python -m elliptude --cmakedir`` for CMake's ``elliptude_DIR``, ``--includedir`` for a compiler's ``-I``.
"""

import argparse
import importlib.metadata
from pathlib import Path

import elliptude


def _installed_folder(relative: str) -> Path:
    """Return a folder installed inside the package.

    An editable install has the Python sources in one folder and what CMake installed in another, both in ``__path__``.
    """
    for root in elliptude.__path__:
        folder = Path(root, relative)
        if folder.is_dir():
            return folder
    raise FileNotFoundError(f"no {relative} in {list(elliptude.__path__)}: is elliptude installed with pip?")


def main() -> None:
    """Print the folder that the option names."""
    parser = argparse.ArgumentParser(prog="python -m elliptude", description="Facts for C++ builds against elliptude.")
    parser.add_argument("--version", action="version", version=importlib.metadata.version("elliptude"))
    wanted = parser.add_mutually_exclusive_group(required=True)
    wanted.add_argument("--cmakedir", action="store_true", help="print the folder of the CMake package (elliptude_DIR)")
    wanted.add_argument("--includedir", action="store_true", help="print the folder of the C++ headers")
    arguments = parser.parse_args()
    print(_installed_folder("share/cmake/elliptude" if arguments.cmakedir else "include"))


if __name__ == "__main__":
    main()
