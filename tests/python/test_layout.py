"""How the package is laid out: a folder for each stage that data pass, imports down only, no folder too full."""

import ast
from collections import Counter
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "python" / "elliptude"

FLOORS = (
    {"elliptude"},
    {"io"},
    {"bounds", "monitoring"},
    {"configuration"},
    {"logs"},
    {"estimation"},
    {"simulation", "smoothing"},
    {"validation", "proposal", "calibration", "report"},
    {"campaigns", "from_arrays", "basilisk", "view"},
    {"cli"},
)
"""Folders from the ground up. A module imports from its own folder and from floors below."""
ON_THE_GROUND = {"results"}
"""Folders that are part of the ground floor: the package's own modules import from them, and they from these."""
MOST_FLOORS = 10
MOST_MODULES = 12
ALIASES = {"elliptude.physical_bounds"}
"""Names for users of modules that are elsewhere; nothing in the package imports them."""


def modules_of(package):
    """Modules by their full names; a package is the module that its ``__init__.py`` is."""
    found = {}
    for file in package.rglob("*.py"):
        parts = (package.name, *file.relative_to(package).with_suffix("").parts)
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    return found | {f"{package.name}.{stub.stem}": None for stub in package.glob("_*.pyi")}


def imports(file, modules):
    """Modules that a file imports, at its top or within a function, for types alone or not.

    Packages above an imported module are imported with it; those above the file are there already.
    """
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: an import says where from in full"
            full = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= full & set(modules)
            if full - set(modules):
                found.add(node.module)
    return found & set(modules)


def graph_of(package):
    modules = modules_of(package)
    graph = {name: set() if file is None else imports(file, modules) for name, file in modules.items()}
    for name, used in graph.items():
        for one in list(used):
            above = one.rpartition(".")[0]
            while above and not name.startswith(f"{above}.") and name != above:
                used.add(above)
                above = above.rpartition(".")[0]
    return graph


def folder_of(module):
    """Whose floor a module is on: the folder below the package, or the package."""
    return module.split(".")[1] if "." in module and module.split(".")[1] in set().union(*FLOORS) else "elliptude"


def upward(graph):
    """Imports of a module on a higher floor."""
    height = {folder: i for i, floor in enumerate(FLOORS) for folder in floor}
    return [
        (name, one)
        for name, used in graph.items()
        if name not in ALIASES
        for one in used
        if one in ALIASES or not (folder_of(one) == folder_of(name) or height[folder_of(one)] < height[folder_of(name)])
    ]


def circle(graph):
    """Modules that import one another in a circle, if there are any."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def floors(graph):
    """The number of folders in the longest chain of imports."""
    folders = {}
    for name, used in graph.items():
        if name not in ALIASES:
            folders.setdefault(folder_of(name), set()).update(map(folder_of, used))
    for name, used in folders.items():
        used.discard(name)
    height = {}
    for folder in TopologicalSorter(folders).static_order():
        height[folder] = 1 + max((height[one] for one in folders.get(folder, ())), default=0)
    return max(height.values())


@pytest.fixture(scope="module")
def graph():
    return graph_of(PACKAGE)


def test_every_folder_has_its_floor():
    folders = {file.parent.relative_to(PACKAGE).parts[0] for file in PACKAGE.rglob("*.py") if file.parent != PACKAGE}
    assert folders - ON_THE_GROUND == set().union(*FLOORS) - {"elliptude"}
    assert sum(map(len, FLOORS)) == len(set().union(*FLOORS))


def test_imports_go_down(graph):
    assert upward(graph) == []


def test_no_imports_go_in_a_circle(graph):
    assert circle(graph) == []


def test_there_are_few_floors(graph):
    assert floors(graph) <= MOST_FLOORS


def test_no_folder_is_full():
    counts = Counter(file.parent for file in PACKAGE.rglob("*.py"))
    assert {str(folder): count for folder, count in counts.items() if count > MOST_MODULES} == {}


def laid_out(folder, sources):
    package = folder / "elliptude"
    for name, source in sources.items():
        file = package / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(source)
    return graph_of(package)


def test_what_is_wrong_is_seen(tmp_path):
    sound = {
        "__init__.py": "from elliptude import _core, typing",
        "_core.pyi": "",
        "typing.py": "",
        "io/__init__.py": "from elliptude.io.tables import read",
        "io/tables.py": "import elliptude\nfrom elliptude.typing import FloatArray",
        "logs/__init__.py": "",
        "logs/log.py": "from elliptude.io import tables",
    }
    graph = laid_out(tmp_path / "sound", sound)
    assert graph["elliptude.logs.log"] == {"elliptude.io.tables", "elliptude.io"}
    assert (upward(graph), circle(graph), floors(graph)) == ([], [], 3)

    within = sound | {"io/tables.py": "def read():\n    from elliptude.logs.log import Log"}
    graph = laid_out(tmp_path / "upward", within)
    assert set(upward(graph)) == {("elliptude.io.tables", f"elliptude.logs{end}") for end in ("", ".log")}
    assert set(circle(graph)) >= {"elliptude.io.tables", "elliptude.logs.log"}

    beside = sound | {"io/files.py": "from elliptude.io.tables import a", "io/tables.py": "import elliptude.io.files"}
    graph = laid_out(tmp_path / "circle", beside)
    assert upward(graph) == []
    assert set(circle(graph)) == {"elliptude.io.tables", "elliptude.io.files"}

    graph = laid_out(
        tmp_path / "alias", sound | {"physical_bounds.py": "", "logs/log.py": "from elliptude import physical_bounds"}
    )
    assert upward(graph) == [("elliptude.logs.log", "elliptude.physical_bounds")]
