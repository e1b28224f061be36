"""Sphinx's configuration of the site: `make site`.

The source folder is the repository's, so that links between its pages hold.
"""

import ast
import inspect
import logging
import os
import re
import sys
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

SITE = Path(__file__).parent
ROOT = SITE.parents[1]
sys.path.insert(0, str(SITE))

import elliptude  # noqa: E402

project = "elliptude"
author = "The elliptude developers"
release = elliptude.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "numpydoc", "sphinx_copybutton", "mathml"]
root_doc = "README"
include_patterns = [
    "README.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "docs/*.md",
    "docs/images/README.md",
    "docs/notebooks/*",
    "docs/reference/*.rst",
    "python/elliptude/data/fermi/README.md",
]
exclude_patterns = [".*", "build", "dist", "cpp", "tests", "tools", "benchmarks", "cmake", "conda"]

# Markdown as GitHub reads it.
myst_enable_extensions = ["dollarmath"]
myst_dmath_double_inline = True
myst_heading_anchors = 4

# The notebooks are kept without outputs; each is run for its page.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 600
nb_execution_in_temp = True
nb_merge_streams = True
logging.getLogger("traitlets").setLevel(logging.WARNING)  # a style that furo needs makes every logger tell what it does
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))

# Docstrings: single backticks are code, and members come in the order of the source.
default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_mock_imports = ["Basilisk"]  # the simulator, which is not installed here
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 88
numpydoc_show_class_members = False
numpydoc_xref_param_type = False

html_theme = "furo"
html_math_renderer = "mathml"
html_title = f"elliptude {release}"
html_static_path = ["static"]
html_css_files = ["style.css"]
html_copy_source = False
html_show_copyright = False
html_show_sourcelink = False
html_show_search_summary = False  # which a browser would fetch, and refuses for files
html_additional_pages = {"index": "to_readme.html"}
templates_path = ["templates"]
# For `man`: the page of the command line.
man_pages = [("docs/commands", "elliptude", "attitude estimation with bounds that hold", [author], 1)]
html_theme_options = {"navigation_with_keys": True}

# What the sidebar lists. These pages themselves are read on GitHub, too, which knows no such lists.
CONTENTS = {
    root_doc: """
```{toctree}
:hidden:
:caption: Use

docs/guide
docs/notebooks/README
docs/commands
docs/logs
docs/calibrate
docs/scenarios
docs/tables
docs/monitor
docs/campaigns
```

```{toctree}
:hidden:
:caption: Program

docs/library
docs/reference/index
docs/conventions
docs/domain
docs/performance
docs/flight
docs/basilisk
```

```{toctree}
:hidden:
:caption: Know why

docs/theory
docs/validation
```

```{toctree}
:hidden:
:caption: Change

docs/architecture
CONTRIBUTING
CHANGELOG
docs/images/README
python/elliptude/data/fermi/README
```
""",
    "docs/notebooks/README": """
```{toctree}
:hidden:

first_estimate
ahrs_from_arrays
spacecraft
pendulum
own_potential
monitor
calibration
smoothing
empty_intersection
```
""",
}


def add_contents(app: Sphinx, name: str, source: list[str]) -> None:
    """Append the list of pages to a page that has one."""
    source[0] += CONTENTS.get(name, "")


def stub_signatures() -> dict[str, tuple[str, str]]:
    """Arguments and result of each function, class and method in `_core.pyi`, by its name."""
    stubs = ast.parse((ROOT / "python" / "elliptude" / "_core.pyi").read_text(encoding="utf-8"))
    found: dict[str, tuple[str, str]] = {}

    def visit(nodes: list[ast.stmt], prefix: str) -> None:
        for node in nodes:
            if isinstance(node, ast.ClassDef):
                visit(node.body, f"{node.name}.")
            elif isinstance(node, ast.FunctionDef):
                decorators = {one.id for one in node.decorator_list if isinstance(one, ast.Name)}
                if "property" in decorators:
                    continue
                if prefix and "staticmethod" not in decorators:
                    node.args.args = node.args.args[1:]
                result = ast.unparse(node.returns) if node.returns is not None else ""
                name = prefix[:-1] if node.name == "__init__" else prefix + node.name
                found[name] = (
                    readable(f"({ast.unparse(node.args)})"),
                    "" if node.name == "__init__" else readable(result),
                )

    visit(stubs.body, "")
    return found


def readable(types: str) -> str:
    """Annotations without the names of modules and of the stubs' own aliases."""
    types = re.sub(r"\b_FloatOrFloats\b", "float64 | ndarray", types)
    types = re.sub(r"\b_BoolOrBools\b", "bool | ndarray", types)
    types = re.sub(r"\b_Floats\b", "ndarray", types)
    types = re.sub(r"\b_Criterion\b", "Literal['trace', 'volume']", types)
    types = re.sub(r"\b_Chart\b", "Literal['exponential', 'gibbs']", types)
    types = re.sub(r"NDArray\[np\.\w+\]", "ndarray", types)
    return re.sub(r"\bnp\.", "", types)


SIGNATURES = stub_signatures()
# Sphinx takes the names of types away, and these are long. It writes ~numpy.ndarray for what it shows as ndarray.
ARRAY = re.compile(r"(~?numpy\.)?ndarray\[tuple\[(~?typing\.)?Any, \.\.\.\], (~?numpy\.)?dtype\[[~\w.]+\]\]")
ARRAY_LIKE = re.compile(
    r"~?[\w.]*_Buffer \| .*? \| complex \| bytes \| str \| ~?[\w.]*_NestedSequence\[complex \| bytes \| str\]"
)
# Sphinx 9.0 replaces a signature only where it found one, and finds none of some compiled classes.
for class_name in [name for name in SIGNATURES if name[0].isupper() and "." not in name]:
    getattr(elliptude, class_name).__signature__ = inspect.Signature()


def of_the_stub(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, signature: str | None, result: str | None
) -> tuple[str, str] | None:
    """The signature of a compiled function: the stubs have the types."""
    short = name.removeprefix("elliptude.")
    if short in SIGNATURES:
        return SIGNATURES[short]
    return (by_name(signature), by_name(result or "")) if signature else None


def by_name(types: str) -> str:
    """Types of arrays and of what can be one, by their names."""
    return ARRAY_LIKE.sub("ArrayLike", ARRAY.sub("ndarray", types))


def types_of_fields(app: Sphinx, page: nodes.document) -> None:
    """The same for fields and names of types."""
    for found in [*page.findall(addnodes.desc_annotation), *page.findall(nodes.paragraph)]:
        if by_name(found.astext()) != found.astext():
            found.children = [nodes.Text(by_name(found.astext()))]


def bars_as_text(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """In docstrings a bar is that of a number's magnitude, not one of Sphinx's substitutions."""
    lines[:] = [line if line.lstrip().startswith((">>>", "...")) else line.replace("|", r"\|") for line in lines]


def setup(app: Sphinx) -> None:
    """What Sphinx calls."""
    app.connect("source-read", add_contents)
    app.connect("autodoc-process-signature", of_the_stub, priority=100)  # before numpydoc
    app.connect("autodoc-process-docstring", bars_as_text)
    app.connect("doctree-read", types_of_fields)
