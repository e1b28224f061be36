"""How long files and functions may be: lines of code, without comments, docstrings and blank lines.

What is longer is listed, with the most lines that it may have and why it is one piece. Tests are free: a file of tests
is a list of cases.
"""

import ast
import io
import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MOST_LINES_OF_FILE = 400
MOST_LINES_OF_FUNCTION = 60
PYTHON = ("python", "tools", "benchmarks", "docs", "tests/python/reference")
CPP = ("cpp", "python/bindings", "tests/fuzz")
CPP_SUFFIXES = {".hpp", ".cpp", ".h", ".c"}

LONG_FILES = {
    "cpp/c_interface/elliptude.cpp": (560, "the one file that a flight program compiles"),
}
A_TABLE = "a table of what is bound, with its names and arguments"
LONG_FUNCTIONS = {
    "python/bindings/attitude/state_ellipsoid.cpp:define_state_ellipsoids": (80, A_TABLE),
    "python/bindings/base/so3.cpp:define_rotations": (130, A_TABLE),
    "python/bindings/dynamics/own_potential.cpp:define_own_potentials": (80, A_TABLE),
    "python/bindings/guaranteed/filter.cpp:define_guaranteed_filter": (90, A_TABLE),
    "python/bindings/guaranteed/flow.cpp:define_guaranteed_flows": (90, A_TABLE),
    "python/bindings/sets/ellipsoid.cpp:define_ellipsoids": (120, A_TABLE),
    "python/bindings/sets/quadric.cpp:define_quadrics": (80, A_TABLE),
    "python/bindings/truth/extrapolation.hpp:integrate": (74, "one algorithm from a book, in the book's order"),
    "tests/fuzz/first_order_session.hpp:one_call": (99, "a call of each function of a filter, chosen by a byte"),
    "tests/fuzz/fuzz_quadric_fusion.cpp:many": (72, "an input, the function, and its oracle"),
    "python/elliptude/cli/bounds.py:bounds": (70, "the steps of a command in their order; each is a function"),
    "tools/mutate.py:main": (100, "the steps of a program in their order; each is a function"),
    "tests/python/reference/error_tube.py:step_within": (80, "the equations of theory 17.5 in their order"),
    "tests/python/reference/motion_series.py:expand_motion": (65, "the equations of theory 17.2 in their order"),
}
"""The most lines that each may have, so that none grows, and why it is one piece."""


def code_of_python(text: str) -> set[int]:
    """The numbers of the lines of code. A text that is a statement is a docstring, or stands below what it explains."""
    texts: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            texts |= set(range(node.lineno, (node.end_lineno or 0) + 1))
    no_code = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
    code: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in no_code:
            code |= set(range(token.start[0], token.end[0] + 1))
    return code - texts


def python_functions(text: str) -> dict[str, int]:
    """Lines of code in the body of each function; its parameters, which for a command are its options, are a table."""
    code = code_of_python(text)
    found: dict[str, int] = {}

    def visit(node: ast.AST, prefix: str) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
                body = range(child.body[0].lineno, (child.end_lineno or 0) + 1)
                found[prefix + child.name] = len(code & set(body))
                visit(child, f"{prefix}{child.name}.")
            elif isinstance(child, ast.ClassDef):
                visit(child, f"{prefix}{child.name}.")
            else:
                visit(child, prefix)

    visit(ast.parse(text), "")
    return found


def code_of_cpp(text: str) -> list[str]:
    """Lines of code. Raw strings are docstrings of the bindings, and lose all lines but their first."""
    text = re.sub(r'R"(\w*)\(.*?\)\1"', 'R""', text, flags=re.DOTALL)
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    return [line for line in (re.sub(r"\s*//.*", "", line).rstrip() for line in text.splitlines()) if line]


def cpp_functions(text: str) -> dict[str, int]:
    """Lines of code of each function, from its name to its last brace, as clang-format lays them out."""
    lines = code_of_cpp(text)
    found: dict[str, int] = {}
    for end, line in enumerate(lines):
        if not (closing := re.fullmatch(r"( *)\};?", line)):
            continue
        start, open_braces = end, 1
        while start > 0 and open_braces > 0:
            start -= 1
            open_braces += lines[start].count("}") - lines[start].count("{")
        while start > 0 and len(lines[start]) - len(lines[start].lstrip()) > len(closing[1]):
            start -= 1
        head = " ".join(lines[start : start + 8]).split("{")[0]
        kind = re.search(r"\b(class|struct|union|enum|namespace|extern)\b[^(]*$", head.split("(")[0])
        name = re.search(r"([\w:~]+|operator\S+)\(", head)
        if kind is None and name is not None and not re.match(r" *(if|for|while|switch|else)\b", head):
            found[name[1]] = max(found.get(name[1], 0), end - start + 1)
    return found


def sources(folders: tuple[str, ...], suffixes: set[str]) -> dict[str, str]:
    paths = sorted(path for folder in folders for path in (ROOT / folder).rglob("*") if path.suffix in suffixes)
    return {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in paths}


@pytest.fixture(scope="module")
def files() -> dict[str, int]:
    lines = {name: len(code_of_python(text)) for name, text in sources(PYTHON, {".py"}).items()}
    lines |= {name: len(code_of_cpp(text)) for name, text in sources(CPP, CPP_SUFFIXES).items()}
    return lines


@pytest.fixture(scope="module")
def functions() -> dict[str, int]:
    found: dict[str, int] = {}
    for name, text in sources(PYTHON, {".py"}).items():
        found |= {f"{name}:{function}": lines for function, lines in python_functions(text).items()}
    for name, text in sources(CPP, CPP_SUFFIXES).items():
        found |= {f"{name}:{function}": lines for function, lines in cpp_functions(text).items()}
    return found


def too_long(lines: dict[str, int], most: int, listed: dict[str, tuple[int, str]]) -> dict[str, int]:
    return {name: count for name, count in lines.items() if count > (listed[name][0] if name in listed else most)}


def test_no_file_is_too_long(files):
    assert len(files) > 200
    assert too_long(files, MOST_LINES_OF_FILE, LONG_FILES) == {}


def test_no_function_is_too_long(functions):
    assert len(functions) > 2000
    assert too_long(functions, MOST_LINES_OF_FUNCTION, LONG_FUNCTIONS) == {}


def test_what_is_listed_is_still_longer(files, functions):
    assert {name for name in LONG_FILES if files.get(name, 0) <= MOST_LINES_OF_FILE} == set()
    assert {name for name in LONG_FUNCTIONS if functions.get(name, 0) <= MOST_LINES_OF_FUNCTION} == set()
    assert all(reason for _, reason in (*LONG_FILES.values(), *LONG_FUNCTIONS.values()))


def test_lines_of_python_are_counted():
    text = '''"""What it is."""

LIMIT = 3
"""What it limits."""


class Counter:
    # A comment.
    def count(
        self,
        first: int,
    ) -> int:
        """How many."""
        total = """text that
        is used"""

        def inner():
            return 1

        return first
'''
    assert len(code_of_python(text)) == 11
    assert python_functions(text) == {"Counter.count": 5, "Counter.count.inner": 1}


def test_lines_of_cpp_are_counted():
    text = """#include <array>
namespace a {
/// What it is.
template <typename Scalar>
class Filter {
 public:
  /* a comment
     of two lines */
  [[nodiscard]] Status update(const Scalar& one,
                              const Scalar& other) noexcept {
    if (one > other) {
      return Status::ok;
    }
    return [&] {
      return Status::out_of_range;
    }();
  }
};

void define(Module& module) {
  module.def("f", R"(f()
--

What it does.
)");
}
}  // namespace a
"""
    assert len(code_of_cpp(text)) == 19
    assert cpp_functions(text) == {"update": 9, "define": 3}
