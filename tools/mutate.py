"""Change the source as a person might by mistake, one place at a time, and see whether a test notices.

`make mutate`, or `.venv/bin/python tools/mutate.py [--only TEXT] [--language cpp|python] [--jobs N]`. The mistakes are
listed in `tests/mutations/*.toml`:

    file = "cpp/include/elliptude/attitude/state_ellipsoid.hpp"    what is changed
    tests = ["test_fusion", "test_chart"]           what is run, the likeliest to notice first

    [[mutation]]
    name = "recentring_by_half"                     unique in all files
    at = "Scalar e = «scalar::sqrt(x) / scale»;"    a piece of source that occurs once; replaced is what « and » enclose
    to = "half * scalar::sqrt(x) / scale"
    why = "a bound that is not doubled"
    equivalent = "..."                              why no test can notice it, if none can

Spaces and line breaks count for nothing. What is replaced in C++ is an expression, or one or more statements with the
semicolon; all are compiled in at once, `mutant(123) ? (to) : (from)`, and the environment variable ELLIPTUDE_MUTANT
says which one acts. In Python the text is replaced in a copy of the package.

It fails if a piece of source is not found, if the unchanged source fails a test, if a mutation that is not argued to be
equivalent is not noticed, and if one is noticed that is. A test that runs much longer than it should counts as
noticing.
"""

import argparse
import ast
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
import zlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BUILD = ROOT / "build" / "mutate"
LISTS = ROOT / "tests" / "mutations"
INCLUDE = "cpp/include/"
# To compile takes longer than to run.
FLAGS = ["-std=c++17", "-O1", "-w"]
SWITCH = """#pragma once
#include <cstdlib>
namespace elliptude {
inline const int active_mutant = [] {
  const char* text = std::getenv("ELLIPTUDE_MUTANT");
  return text == nullptr ? 0 : std::atoi(text);
}();
inline bool mutant(int number) noexcept { return number == active_mutant; }
}  // namespace elliptude
"""


@dataclass(frozen=True)
class Mutation:
    """One mistake."""

    number: int
    name: str
    file: str
    at: str
    to: str
    why: str
    tests: tuple[str, ...]
    equivalent: str

    @property
    def is_cpp(self) -> bool:
        """Whether it is in the core."""
        return self.file.startswith(INCLUDE)


@dataclass(frozen=True)
class Place:
    """Where a mutation is in its file."""

    start: int
    stop: int
    mutation: Mutation


def read_lists() -> list[Mutation]:
    """All mutations, in the order of the files' names."""
    found: list[Mutation] = []
    for path in sorted(LISTS.glob("*.toml")):
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        for entry in table["mutation"]:
            entry.setdefault("equivalent", "")
            tests = tuple(entry.pop("tests", table["tests"]))
            # A number that does not depend on what else is in the lists: other headers stay as they are.
            number = zlib.crc32(entry["name"].encode()) & 0x7FFFFFFF
            found.append(Mutation(number, file=table["file"], tests=tests, **entry))
    names = [mutation.name for mutation in found]
    if len(set(names)) < len(names):
        sys.exit(f"names that occur twice: {sorted({name for name in names if names.count(name) > 1})}")
    return found


def locate(mutation: Mutation, source: str) -> Place | str:
    """Where the text between « and » is, or what is wrong."""
    if mutation.at.count("«") != 1 or mutation.at.count("»") != 1:
        return "one « and one » are needed"
    before, rest = mutation.at.split("«")
    inside, after = rest.split("»")

    def pattern(text: str) -> str:
        # Between words and signs there may be any space; within a word none.
        return r"\s*".join(re.escape(token) for token in re.findall(r"\w+|[^\w\s]", text))

    parts = [pattern(before), f"(?P<inside>{pattern(inside)})", pattern(after)]
    matches = list(re.finditer(r"\s*".join(part for part in parts if part), source))
    if len(matches) != 1:
        return f"occurs {len(matches)} times in {mutation.file}: {mutation.at}"
    return Place(matches[0].start("inside"), matches[0].end("inside"), mutation)


def switched(source: str, places: list[Place]) -> str:
    """C++ with all mutations compiled in; of nested places the inner ones are in the unchanged part of the outer."""
    ordered = sorted(places, key=lambda place: (place.start, -place.stop))

    def render(start: int, stop: int, inner: list[Place]) -> str:
        text, at = "", start
        while inner:
            first = inner[0]
            same = [place for place in inner if (place.start, place.stop) == (first.start, first.stop)]
            within = [place for place in inner if place not in same and place.stop <= first.stop]
            rest = [place for place in inner if place not in same and place not in within]
            if any(place.start < first.stop for place in rest):
                names = [first.mutation.name, *(place.mutation.name for place in rest if place.start < first.stop)]
                sys.exit(f"mutations that overlap without one inside the other: {names}")
            piece = render(first.start, first.stop, within)
            for place in same:
                number, to = place.mutation.number, place.mutation.to
                if source[place.start : place.stop].rstrip().endswith((";", "}")):
                    piece = f"if (::elliptude::mutant({number})) {{ {to} }} else {{ {piece} }}"
                else:
                    piece = f"(::elliptude::mutant({number}) ? ({to}) : ({piece}))"
            text += source[at : first.start] + piece
            at, inner = first.stop, rest
        return text + source[at:stop]

    return render(0, len(source), ordered)


def write_if_changed(path: Path, text: str) -> None:
    """Leaves the file's time as it is where nothing changes, so that nothing is compiled again."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def run(command: list[str], seconds: float, environment: dict[str, str], folder: Path) -> str:
    """Empty if it ends well; else what went wrong."""
    try:
        done = subprocess.run(
            command, capture_output=True, timeout=seconds, env=environment, text=True, errors="replace", cwd=folder
        )
    except subprocess.TimeoutExpired:
        return f"more than {seconds:.0f} s"
    if done.returncode == 0:
        return ""
    return done.stdout + done.stderr or f"status {done.returncode}"


# --- the core ---------------------------------------------------------------------------------------------------------


def write_core(places: list[Place]) -> None:
    """Copy the headers with all mutations in them."""
    headers = BUILD / "include"
    for path in (ROOT / INCLUDE).rglob("*.hpp"):
        source = path.read_text(encoding="utf-8")
        name = path.relative_to(ROOT).as_posix()
        here = [place for place in places if place.mutation.file == name]
        text = switched(source, here)
        if here:
            text = text.replace("#pragma once", '#pragma once\n#include "elliptude/mutant.hpp"', 1)
        write_if_changed(headers / path.relative_to(ROOT / INCLUDE), text)
    write_if_changed(headers / "elliptude" / "mutant.hpp", SWITCH)


def compiler() -> list[str]:
    """The command that compiles with these headers. Clang takes less than half of GCC's time for these programs."""
    eigen = os.environ.get("EIGEN_INCLUDE", "/usr/include/eigen3")
    name = os.environ.get("CXX", "clang++" if shutil.which("clang++") else "c++").split()
    return [*name, *FLAGS, "-isystem", eigen, "-I", str(BUILD / "include"), "-I", "tests/cpp"]


def unparsed(places: list[Place]) -> str:
    """What the compiler or Python says of a mutation that is no source; nothing if all are."""
    write_core([place for place in places if place.mutation.is_cpp])
    for name in ("flight_core.cpp", "flight_core_float.cpp"):  # which instantiate all of the core
        everything = f"tests/cpp/freestanding/{name}"
        if error := run([*compiler(), "-fsyntax-only", everything], 600, dict(os.environ), ROOT):
            return error
    for place in places:
        mutation = place.mutation
        if not mutation.is_cpp:
            source = (ROOT / mutation.file).read_text(encoding="utf-8")
            try:
                ast.parse(source[: place.start] + mutation.to + source[place.stop :])
            except SyntaxError as error:
                return f"{mutation.name}: {error}"
    return ""


def check(places: list[Place]) -> int:
    """Says whether all mutations are source."""
    error = unparsed(places)
    print(error[:6000] if error else "each is found, and is source")
    return 1 if error else 0


def build_core(mutations: list[Mutation], places: list[Place], jobs: int) -> None:
    """Compile the programs that are wanted, with all mutations in the headers."""
    write_core(places)
    (BUILD / "cpp").mkdir(parents=True, exist_ok=True)
    cached = ["ccache", *compiler()] if shutil.which("ccache") else compiler()

    def compile_one(name: str) -> str:
        target, log = BUILD / "cpp" / f"{name}.o", BUILD / "cpp" / f"{name}.d"
        program = BUILD / "cpp" / name
        if target.exists() and log.exists():
            used = [Path(used) for used in log.read_text(encoding="utf-8").replace("\\\n", " ").split()[1:]]
            if all(path.exists() and path.stat().st_mtime <= target.stat().st_mtime for path in used):
                return ""
        (source,) = (ROOT / "tests" / "cpp").rglob(f"{name}.cpp")
        command = [*cached, "-MMD", "-MF", str(log), "-c", str(source), "-o", str(target)]
        error = run(command, 3600, dict(os.environ), ROOT)
        if not error and name != "main":
            program.unlink(missing_ok=True)
        if error:
            target.unlink(missing_ok=True)
        return error

    names = list(dict.fromkeys(test for mutation in mutations if mutation.is_cpp for test in mutation.tests))
    with ThreadPoolExecutor(jobs) as pool:
        for name, error in zip(["main", *names], pool.map(compile_one, ["main", *names]), strict=True):
            if error:
                sys.exit(f"{name} does not compile:\n{error[:6000]}")
    for name in names:
        program, objects = BUILD / "cpp" / name, [str(BUILD / "cpp" / f"{part}.o") for part in (name, "main")]
        link = [*compiler(), *objects, "-o", str(program)]
        if not program.exists() and (error := run(link, 600, dict(os.environ), ROOT)):
            sys.exit(f"{name} does not link:\n{error[:6000]}")


def core_command(test: str) -> list[str]:
    """What runs one program, all cases that are in it, up to its first failure."""
    return [str(BUILD / "cpp" / test), "--source-file=*", "--abort-after=1", "--no-version"]


# --- the package ------------------------------------------------------------------------------------------------------


def package_command(test: str) -> list[str]:
    """What runs one file of tests, or one test of it, up to its first failure."""
    quiet = ["-x", "-q", "--no-header", "-p", "no:cacheprovider", "-p", "no:randomly"]
    return [sys.executable, "-m", "pytest", *quiet, f"tests/python/{test}"]


def copy_package(folder: Path, place: Place | None) -> None:
    """The package with its compiled modules, and with one mutation."""
    import elliptude  # the installed one, for its compiled core

    target = folder / "elliptude"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(ROOT / "python" / "elliptude", target, ignore=shutil.ignore_patterns("__pycache__", "_*.so"))
    for module in Path(elliptude.__file__).parent.glob("_*.so"):
        (target / module.name).symlink_to(module.resolve())
    if place is not None:
        path = folder / place.mutation.file.removeprefix("python/")
        source = path.read_text(encoding="utf-8")
        path.write_text(source[: place.start] + place.mutation.to + source[place.stop :], encoding="utf-8")


# --- all --------------------------------------------------------------------------------------------------------------


def main() -> int:
    """Read, build, run, report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="a part of a name or of a file's name")
    parser.add_argument("--language", choices=["cpp", "python"])
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--check", action="store_true", help="only look whether each is found, and is source")
    arguments = parser.parse_args()

    every = read_lists()
    places: dict[str, Place] = {}
    faults: list[str] = []
    for mutation in every:
        path = ROOT / mutation.file
        place = locate(mutation, path.read_text(encoding="utf-8")) if path.exists() else f"no file {mutation.file}"
        if isinstance(place, str):
            faults.append(f"{mutation.name}: {place}")
        else:
            places[mutation.name] = place
    if faults:
        print("\n".join(["Pieces of source that are not there (change the list with the code):", *faults]))
        return 1
    chosen = [
        mutation
        for mutation in every
        if (arguments.only in mutation.name or arguments.only in mutation.file)
        and arguments.language in (None, "cpp" if mutation.is_cpp else "python")
    ]
    print(f"{len(chosen)} of {len(every)} mutations")
    if arguments.check:
        return check(list(places.values()))
    if not chosen:
        return 0

    if any(mutation.is_cpp for mutation in chosen):
        began = time.monotonic()
        core = [place for place in places.values() if place.mutation.is_cpp]
        build_core(chosen, core, arguments.jobs)
        print(f"built in {time.monotonic() - began:.0f} s", flush=True)

    plain = BUILD / "python" / "plain"
    if not all(mutation.is_cpp for mutation in chosen):
        copy_package(plain, None)

    def attempt(test: str, number: int, package: Path, is_cpp: bool, seconds: float) -> str:
        environment = dict(os.environ) | {"ELLIPTUDE_MUTANT": str(number)}
        if is_cpp:
            return run(core_command(test), seconds, environment, ROOT)
        environment |= {"PYTHONPATH": str(package), "PYTHONDONTWRITEBYTECODE": "1"}
        return run(package_command(test), seconds, environment, ROOT)

    # The unchanged source first: it must pass, and says how long a test takes.
    baselines = list(dict.fromkeys((test, mutation.is_cpp) for mutation in chosen for test in mutation.tests))
    seconds: dict[tuple[str, bool], float] = {}

    def baseline(case: tuple[str, bool]) -> str:
        began = time.monotonic()
        error = attempt(case[0], 0, plain, case[1], 3600)
        seconds[case] = time.monotonic() - began
        return error

    with ThreadPoolExecutor(arguments.jobs) as pool:
        for case, error in zip(baselines, pool.map(baseline, baselines), strict=True):
            if error:
                print(f"{case[0]} fails without any mutation:\n{error[-3000:]}")
                return 1

    def notices(mutation: Mutation) -> tuple[str, str]:
        """The test that noticed, or nothing, and what it said."""
        package = BUILD / "python" / mutation.name
        if not mutation.is_cpp:
            copy_package(package, places[mutation.name])
        try:
            for test in mutation.tests:
                limit = 20.0 + 10.0 * seconds[test, mutation.is_cpp]
                if error := attempt(test, mutation.number, package, mutation.is_cpp, limit):
                    return test, error
        finally:
            shutil.rmtree(package, ignore_errors=True)
        return "", ""

    began = time.monotonic()
    lines: list[str] = []
    survivors: list[Mutation] = []
    refuted: list[Mutation] = []
    with ThreadPoolExecutor(arguments.jobs) as pool:
        for mutation, (test, said) in zip(chosen, pool.map(notices, chosen), strict=True):
            verdict = f"noticed by {test}" if test else "equivalent" if mutation.equivalent else "NOT NOTICED"
            (BUILD / "said").mkdir(exist_ok=True)
            (BUILD / "said" / f"{mutation.name}.txt").write_text(said, encoding="utf-8")
            if not test and not mutation.equivalent:
                survivors.append(mutation)
            if test and mutation.equivalent:
                refuted.append(mutation)
                verdict += ", THOUGH ARGUED EQUIVALENT"
            lines.append(f"{mutation.name:42} {Path(mutation.file).name:24} {verdict}")
            print(lines[-1], flush=True)
    equivalent = [m for m in chosen if m.equivalent and m not in refuted]
    counted = len(chosen) - len(equivalent)
    noticed = counted - len(survivors)
    summary = (
        f"{noticed} of {counted} noticed ({100.0 * noticed / max(counted, 1):.1f} %), "
        f"{len(equivalent)} argued equivalent, in {time.monotonic() - began:.0f} s"
    )
    describe: Callable[[Mutation], str] = lambda m: f"  {m.name} ({m.file}): {m.why}"  # noqa: E731
    report = [*lines, "", summary]
    if survivors:
        report += ["", "Not noticed:", *map(describe, survivors)]
    if equivalent:
        report += ["", "Argued equivalent:", *(f"  {m.name}: {m.equivalent}" for m in equivalent)]
    (BUILD / "report.txt").write_text("\n".join(report) + "\n", encoding="utf-8")
    print("\n".join(report[len(lines) :]))
    return 1 if survivors or refuted else 0


if __name__ == "__main__":
    sys.exit(main())
