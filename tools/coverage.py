"""How much of the C++ core the tests run: lines and branches of each header, by clang's coverage.

`make coverage`, or `python3 tools/coverage.py [--only PROGRAM ...] [--show HEADER ...] [--build FOLDER]`. It builds
the C++ tests with the preset `coverage`, runs each program once, and prints a table. A template that no program
instantiates has no lines here; `test_no_allocation` instantiates all that `tests/cpp/support/every_function.hpp` names.
"""

import argparse
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CORE = "/cpp/include/elliptude/"
# Programs that look for counterexamples need to be told how often.
TRIES = {
    "wahba_set_escapes": "2000",
    "common_set_escapes": "2000",
    "questions": "2",
    "edges": "200",
    "liars": "200",
    "float_filter_escapes": "200",
    "thin_sets": "1",
    "faults": "140",
    "faults_float": "140",
    "bit_flips": "20",
    "worst_case": "200",
}
SECONDS = 900


@dataclass(frozen=True)
class Header:
    """What of a header was run."""

    name: str
    lines: int
    lines_run: int
    branches: int
    branches_run: int


def programs() -> list[str]:
    """The tests' programs by name, as CMake has them."""
    tests = [path.stem for path in sorted((ROOT / "tests" / "cpp").glob("**/test_*.cpp"))]
    corpora = [f"replay_{path.stem}" for path in sorted((ROOT / "tests" / "fuzz").glob("fuzz_*.cpp"))]
    return [*tests, *corpora, *TRIES, "c_interface_refusals", "c_interface_replay"]


def arguments_of(program: str) -> list[str]:
    if program.startswith("replay_"):
        return [str(ROOT / "tests" / "fuzz" / "corpus" / f"{program.removeprefix('replay_')}.txt")]
    return [TRIES[program]] if program in TRIES else []


def run(program: Path, profile: Path) -> None:
    """One program, which leaves its counts in a file."""
    command = [str(program), *arguments_of(program.name)]
    environment = {**os.environ, "LLVM_PROFILE_FILE": str(profile)}
    try:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=SECONDS, check=False)
    except subprocess.TimeoutExpired:
        sys.exit(f"{program.name} has not ended after {SECONDS} s")
    if done.returncode != 0:
        sys.exit(f"{program.name} failed ({done.returncode}):\n{done.stdout[-2000:]}{done.stderr[-2000:]}")


def llvm_cov(action: list[str], data: Path, images: list[Path], sources: list[str]) -> str:
    objects = [word for image in images[1:] for word in ("-object", str(image))]
    command = ["llvm-cov", *action, "-instr-profile", str(data), str(images[0]), *objects, *sources]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def headers(data: Path, images: list[Path]) -> list[Header]:
    """The headers of the core that some program instantiates, by name."""
    exported = json.loads(llvm_cov(["export", "-summary-only"], data, images, []))
    found = []
    for file in exported["data"][0]["files"]:
        if CORE in file["filename"]:
            lines, branches = file["summary"]["lines"], file["summary"]["branches"]
            name = file["filename"].split(CORE)[1]
            found.append(Header(name, lines["count"], lines["covered"], branches["count"], branches["covered"]))
    return sorted(found, key=lambda header: header.name)


def percent(part: int, whole: int) -> str:
    return f"{100 * part / whole:.1f} %" if whole > 0 else "-"


def table(found: list[Header]) -> str:
    """A row for each header, and one for all."""
    total = Header(
        "all",
        sum(header.lines for header in found),
        sum(header.lines_run for header in found),
        sum(header.branches for header in found),
        sum(header.branches_run for header in found),
    )
    rows = [f"{'header':44} {'lines':>7} {'run':>9} {'branches':>9} {'run':>9}"]
    for header in [*found, total]:
        rows.append(
            f"{header.name:44} {header.lines:7} {percent(header.lines_run, header.lines):>9} "
            f"{header.branches:9} {percent(header.branches_run, header.branches):>9}"
        )
    return "\n".join(rows)


def main() -> int:
    every = programs()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=every, default=every, metavar="PROGRAM", help="all if not given")
    parser.add_argument("--show", nargs="+", default=[], metavar="HEADER", help="print these with counts")
    parser.add_argument("--build", type=Path, help="a folder that has the programs already")
    arguments = parser.parse_args()
    folder = arguments.build or ROOT / "build" / "coverage"
    if arguments.build is None:
        subprocess.run(["cmake", "--preset", "coverage"], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
        subprocess.run(["cmake", "--build", str(folder), "--target", *arguments.only], cwd=ROOT, check=True)
    images = [path for name in arguments.only for path in sorted(folder.glob(f"tests/**/{name}")) if path.is_file()]
    if len(images) != len(arguments.only):
        missing = set(arguments.only) - {image.name for image in images}
        sys.exit(f"{folder} has no {', '.join(sorted(missing))}")
    profiles = [folder / f"{image.name}.profraw" for image in images]
    for image, profile in zip(images, profiles, strict=True):
        run(image, profile)
    data = folder / "all.profdata"
    subprocess.run(["llvm-profdata", "merge", "-o", str(data), *map(str, profiles)], check=True)
    print(table(headers(data, images)))
    for header in arguments.show:
        sources = [str(path) for path in (ROOT / "cpp" / "include").glob(f"elliptude/{header}")]
        if not sources:
            sys.exit(f"there is no header {header}")
        print(llvm_cov(["show", "-show-branches=count", "-show-instantiations=false"], data, images, sources))
    return 0


if __name__ == "__main__":
    sys.exit(main())
