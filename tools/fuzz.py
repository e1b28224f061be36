"""Runs the fuzz targets, each for a while, from the inputs that are kept in tests/fuzz/corpus, and says what was found.

    tools/fuzz.py BUILD [TARGET ...] [--seconds 600] [--jobs 2] [--keep]

BUILD is the folder of a CMake build with ELLIPTUDE_FUZZ. A kept corpus is a text file: one input a line, in hexadecimal
digits, and after `#` why it is there. What is found is left in BUILD/fuzz and printed as such a line, to be kept. With
--keep the corpus is written anew: all lines with a comment, and the shortest inputs that reach what the others reach.
"""

import argparse
import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CORPUS = ROOT / "tests" / "fuzz" / "corpus"
READERS = ROOT / "tests" / "fuzz" / "fuzz_readers.py"
FORMATS = ("csv", "npz", "toml", "ulog", "zip")
MOST_BYTES = {"readers": 6000}
"""Largest length of an input in bytes; 600 for a C++ target, which is more than one run reads."""
KEPT_BYTES = 3000
"""Bytes of a corpus that --keep writes, besides the lines with a comment."""


def kept_lines(target: str) -> list[tuple[bytes, str]]:
    """The inputs of a corpus, each with its comment."""
    path = CORPUS / f"{target}.txt"
    lines = path.read_text().splitlines() if path.exists() else []
    parts = [line.partition("#") for line in lines]
    return [(bytes.fromhex(digits), comment.strip()) for digits, _, comment in parts if digits.strip()]


def commands(build: Path) -> dict[str, list[str]]:
    """What runs each target that there is."""
    programs = {path.stem: [str(path)] for path in sorted((build / "tests" / "fuzz").glob("fuzz_*")) if path.is_file()}
    try:
        import atheris  # noqa: F401
    except ModuleNotFoundError:
        print("atheris is not installed: the readers are left out")
        return programs
    return programs | {f"readers_{kind}": [sys.executable, str(READERS), kind] for kind in FORMATS}


def run(target: str, command: list[str], folder: Path, seconds: int, seed: int) -> bool:
    """Runs one target. Returns whether nothing was found."""
    inputs, found = folder / "inputs", folder / "found"
    for path in (inputs, found):
        path.mkdir(parents=True, exist_ok=True)
    for number, (data, _) in enumerate(kept_lines(target)):
        (inputs / f"kept{number:04}").write_bytes(data)
    before = set(found.iterdir())
    limit = MOST_BYTES.get(target.partition("_")[0], 600)
    options = [f"-max_total_time={seconds}", f"-seed={seed}", f"-max_len={limit}", "-timeout=25", "-rss_limit_mb=3000"]
    arguments = [*command, *options, "-print_final_stats=1", f"-artifact_prefix={found}/", str(inputs)]
    with (folder / "log").open("wb") as log:
        status = subprocess.run(arguments, stdout=log, stderr=log, check=False).returncode
    text = (folder / "log").read_text(errors="replace")
    executed = re.findall(r"stat::number_of_executed_units: *(\d+)", text)
    covered = re.findall(r"cov: (\d+)", text)
    outcome = "no finding" if status == 0 else "FINDING"
    said = [
        f"{target}: {executed[-1] if executed else '?'} executions, {covered[-1] if covered else '?'} edges: {outcome}"
    ]
    if status != 0:
        said += re.findall(r"ORACLE BROKEN.*|runtime error.*|SUMMARY.*|.*Error: .*|.*OracleBroken: .*", text)[-5:]
        for path in sorted(set(found.iterdir()) - before):
            said += [f"to be kept in {CORPUS / f'{target}.txt'}:", f"{path.read_bytes().hex()} # found: what?"]
    print("\n".join(said), flush=True)
    return status == 0


def keep(target: str, command: list[str], folder: Path) -> None:
    """Writes the corpus anew: a small part of what was reached."""
    merged = folder / "merged"
    merged.mkdir(exist_ok=True)
    for path in merged.iterdir():
        path.unlink()
    arguments = [*command, "-merge=1", str(merged), str(folder / "inputs")]
    subprocess.run(arguments, capture_output=True, check=True)
    kept = [(data, comment) for data, comment in kept_lines(target) if comment]
    room = KEPT_BYTES
    for data in sorted((path.read_bytes() for path in merged.iterdir()), key=len, reverse=target.startswith("fuzz")):
        if len(data) <= room and data and all(data != other for other, _ in kept):
            kept.append((data, ""))
            room -= len(data)
    lines = [f"{data.hex()} # {comment}" if comment else data.hex() for data, comment in kept]
    (CORPUS / f"{target}.txt").write_text("\n".join(lines) + "\n")


def main() -> int:
    """Returns 1 if something was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build", type=Path)
    parser.add_argument("targets", nargs="*", help="all, unless some are named")
    parser.add_argument("--seconds", type=int, default=600, help="for each target")
    parser.add_argument("--seed", type=int, default=0, help="0, the default, is another one each time")
    parser.add_argument("--keep", action="store_true", help="write the corpora anew")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="how many targets at a time")
    options = parser.parse_args()
    there_are = commands(options.build)
    unknown = set(options.targets) - set(there_are)
    if unknown or not there_are:
        parser.error(f"no target {', '.join(sorted(unknown))}; there are {', '.join(there_are) or 'none'}")

    def whole(target: str) -> bool:
        folder = options.build / "fuzz" / target
        clean = run(target, there_are[target], folder, options.seconds, options.seed)
        if options.keep:
            keep(target, there_are[target], folder)
        return clean

    with ThreadPoolExecutor(options.jobs) as pool:
        return 0 if all(list(pool.map(whole, options.targets or there_are))) else 1


if __name__ == "__main__":
    sys.exit(main())
