"""``python -m elliptude`` is the command ``elliptude``, where that is not on the path.

A C++ build asks it where the headers and the CMake package are inside the installed package: ``--cmakedir`` for
CMake's ``elliptude_DIR``, ``--includedir`` for a compiler's ``-I``. These and ``--version`` need no extra.
"""

import importlib
import sys
from pathlib import Path

import elliptude

_FOLDERS = {"--cmakedir": "share/cmake/elliptude", "--includedir": "include"}


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
    """Print the version or the folder that the only argument asks for, or run the command."""
    if sys.argv[1:] == ["--version"]:
        print(elliptude.__version__)
        return
    if len(sys.argv) == 2 and sys.argv[1] in _FOLDERS:
        print(_installed_folder(_FOLDERS[sys.argv[1]]))
        return
    # By name: the package below does not know the command above it.
    importlib.import_module("elliptude.cli").main()


if __name__ == "__main__":
    main()
