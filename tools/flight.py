#!/usr/bin/env python3
"""flight.py [--only TARGET/PROGRAM ...] [--update]

Builds the programs of cpp/examples/bare_metal for this machine and for two microcontrollers and runs the latter in
QEMU. It compares the sets, bit for bit, and what they cost with cpp/examples/bare_metal/limits.txt. It fails if fewer
rows agree than there, where a figure is more than 10 % above its limit, or where a symbol of the heap or a mathematical
function is linked. With --update it writes the figures as the new limits. Needs only Python's own modules.
"""

import argparse
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "cpp" / "examples" / "bare_metal"
LIMITS = SOURCE / "limits.txt"
BUILD = ROOT / "build" / "flight"
PROGRAMS = ["paper", "guaranteed", "guaranteed_gyro"]
EXACT = {"rows", "data"}  # rows that agree may not become fewer, nor initialised data more
HEAP = {"malloc", "free", "calloc", "realloc", "_malloc_r", "_free_r", "_sbrk", "_sbrk_r", "_Znwj", "_ZdlPv"}
MATHEMATICS = re.compile(
    r"(__ieee754_|__kernel_)?(exp|log|pow|sin|cos|tan|asin|acos|atan|atan2|sqrt|floor|ceil|fabs|scalbn|rem_pio2)f?"
)
SECONDS = 120


@dataclass(frozen=True)
class Target:
    """A microcontroller, the board that QEMU has with it, and the scalar that it calculates in."""

    processor: str
    board: str
    scalar: str


TARGETS = {"m7": Target("Cortex-M7", "mps2-an500", "double"), "m4": Target("Cortex-M4F", "mps2-an386", "float")}


def run(*command: str | Path) -> str:
    """What a command prints; ends this program with what it says if it fails."""
    done = subprocess.run(command, text=True, capture_output=True, check=False, timeout=1800)
    if done.returncode != 0:
        said_last = f"{done.stdout[-4000:]}{done.stderr[-4000:]}"
        sys.exit(f"{' '.join(map(str, command))} failed ({done.returncode}):\n{said_last}")
    return str(done.stdout)


def configure(folder: Path, *options: str) -> None:
    run("cmake", "-S", SOURCE, "-B", folder, "-G", "Ninja", *options)


def build(images: list[tuple[str, str]]) -> None:
    """The recording, the programs for this machine, and the images."""
    configure(BUILD / "host")
    hosts = {f"{program}_{TARGETS[target].scalar}" for target, program in images}
    run("cmake", "--build", BUILD / "host", "--target", "recording", *sorted(hosts))
    for target in sorted({target for target, _ in images}):
        toolchain = SOURCE / "arm-none-eabi.cmake"
        configure(
            BUILD / target,
            f"-DCMAKE_TOOLCHAIN_FILE={toolchain}",
            f"-DFLIGHT_TARGET={target}",
            f"-DFLIGHT_RECORDING={BUILD / 'host'}",
        )
        run("cmake", "--build", BUILD / target, "--target", *(program for of, program in images if of == target))


def emulated(target: str, image: Path) -> str:
    """What an image prints by semihosting, on its board."""
    command = ["qemu-system-arm", "-M", TARGETS[target].board, "-kernel", str(image), "-nographic", "-monitor", "none"]
    command += ["-serial", "none", "-icount", "shift=0", "-chardev", "stdio,id=said"]
    command += ["-semihosting-config", "enable=on,target=native,chardev=said"]
    try:
        done = subprocess.run(
            command, text=True, capture_output=True, check=False, timeout=SECONDS, stdin=subprocess.DEVNULL
        )
    except subprocess.TimeoutExpired:
        sys.exit(f"{image} has not ended after {SECONDS} s")
    if done.returncode != 0:
        sys.exit(f"{image} failed ({done.returncode}): {done.stdout[-1000:]}{done.stderr[-1000:]}")
    return str(done.stdout)


def said(output: str, word: str) -> list[list[str]]:
    """The lines that begin with a word, without it."""
    return [line.split()[1:] for line in output.splitlines() if line.split()[:1] == [word]]


def agreeing_rows(host: str, target: str, name: str) -> int:
    """How many rows have the same bits before the first that has others. All have the same widths within 1 %."""
    here, there = said(host, "row"), said(target, "row")
    if len(here) != len(there) or not here:
        sys.exit(f"{name}: {len(there)} rows, but {len(here)} on this machine")
    for one, other in zip(here, there, strict=True):
        if abs(int(one[2]) - int(other[2])) > 0.01 * int(one[2]):
            sys.exit(f"{name}: row {one[0]} has a width of {other[2]} nrad, but of {one[2]} nrad on this machine")
    same = [one[1] == other[1] for one, other in zip(here, there, strict=True)]
    return same.index(False) if False in same else len(same)


def largest_frame(target: str, program: str) -> int:
    """Of the functions of the core, bytes, as the compiler says."""
    usage = BUILD / target / "CMakeFiles" / f"{program}.dir" / f"{program}.cpp.su"
    frames = (line.split("\t") for line in usage.read_text(encoding="utf-8").splitlines())
    return max(int(size) for function, size, _ in frames if "/elliptude/" in function)


def sections(image: Path) -> dict[str, int]:
    rows = (line.split() for line in run("arm-none-eabi-size", "-A", image).splitlines())
    return {row[0]: int(row[1]) for row in rows if len(row) == 3 and row[0].startswith(".")}


def symbols(image: Path) -> set[str]:
    return {line.split()[-1] for line in run("arm-none-eabi-nm", "--defined-only", image).splitlines()}


def core_bytes(image: Path) -> int:
    """Of an image's code, what functions and tables of the core and of Eigen have that are not inlined elsewhere."""
    rows = (line.split(None, 3) for line in run("arm-none-eabi-nm", "-S", "--demangle", image).splitlines())
    sized = {(row[0], row[1]): row[3] for row in rows if len(row) == 4 and row[2] not in "bBdD"}
    names = ((name, int(size, 16)) for (_, size), name in sized.items() if "flight::" not in name)
    return sum(size for name, size in names if "elliptude::" in name or "Eigen::" in name)


def figures(target: str, program: str) -> dict[str, int]:
    """What a program costs on a target, by name."""
    image = BUILD / target / program
    output = emulated(target, image)
    host = run(BUILD / "host" / f"{program}_{TARGETS[target].scalar}")
    costs = {row[0]: [int(number) for number in row[1:]] for row in said(output, "cost")}
    size = sections(image)
    linked = symbols(image)
    forbidden = linked & HEAP | {name for name in linked if MATHEMATICS.fullmatch(name)}
    if forbidden:
        sys.exit(f"{target}/{program} is linked with {', '.join(sorted(forbidden))}")
    return {
        "rows": agreeing_rows(host, output, f"{target}/{program}"),
        "predict_mean": costs["predict"][0],
        "predict_most": costs["predict"][1],
        "predict_stack": costs["predict"][2],
        "update_mean": costs["update"][0],
        "update_most": costs["update"][1],
        "update_stack": costs["update"][2],
        "frame": largest_frame(target, program),
        "filter": int(said(output, "size")[0][0]),
        "code": size[".text"],
        "core": core_bytes(image),
        "data": size.get(".data", 0),
    }


def read_limits() -> dict[tuple[str, str], int]:
    rows = (line.split() for line in LIMITS.read_text(encoding="utf-8").splitlines() if not line.startswith("#"))
    return {(row[0], row[1]): int(row[2]) for row in rows}


def is_worse(figure: str, value: int, limit: int) -> bool:
    if figure == "rows":
        return value < limit
    return value > limit if figure in EXACT else value * 10 > limit * 11


def judge(name: str, found: dict[str, int], limits: dict[tuple[str, str], int]) -> bool:
    """Prints the figures beside their limits; whether all keep them."""
    kept = True
    for figure, value in found.items():
        limit = limits.get((name, figure))
        if limit is None:
            verdict, kept = "no limit: add one with --update", False
        elif is_worse(figure, value, limit):
            verdict, kept = "WORSE", False
        else:
            verdict = ""
        print(f"{name:20} {figure:14} {value:8} {limit if limit is not None else '-':>8} {verdict}".rstrip())
    return kept


def write_limits(limits: dict[tuple[str, str], int]) -> None:
    head = [line for line in LIMITS.read_text(encoding="utf-8").splitlines() if line.startswith("#")]
    body = [f"{name:20} {figure:14} {value:8}" for (name, figure), value in limits.items()]
    LIMITS.write_text("\n".join(head + body) + "\n", encoding="utf-8")


def main() -> int:
    every = [f"{target}/{program}" for target in TARGETS for program in PROGRAMS]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--only", nargs="+", choices=every, default=every, metavar="TARGET/PROGRAM", help=", ".join(every)
    )
    parser.add_argument("--update", action="store_true", help="write the figures as the new limits")
    arguments = parser.parse_args()
    images = [(name.split("/")[0], name.split("/")[1]) for name in arguments.only]
    build(images)
    limits = read_limits()
    kept = True
    print(f"{'program':20} {'figure':14} {'value':>8} {'limit':>8}")
    for target, program in images:
        name = f"{target}/{program}"
        found = figures(target, program)
        if arguments.update:
            limits.update({(name, figure): value for figure, value in found.items()})
        kept = judge(name, found, limits) and kept
    if arguments.update:
        write_limits(limits)
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
