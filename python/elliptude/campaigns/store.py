"""The folder of a campaign: what is in it is whole, belongs to one campaign, and is there once."""

import csv
import fcntl
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from elliptude.campaigns.plan import Block, Plan
from elliptude.campaigns.simulate import BlockResult
from elliptude.io.files import FileError, replacing, require_writable, write_json

IDENTITY, ROWS, TIMINGS, SUMMARY, PAGE = "campaign.json", "rows", "timings.csv", "summary.json", "summary.html"
FILES = (IDENTITY, TIMINGS, SUMMARY, PAGE)
"""What is in the folder beside the rows."""
_DIFFERENCES = 3


@dataclass(frozen=True)
class Store:
    """A folder that is open for a campaign, and for no other process."""

    folder: Path

    def file(self, block: Block) -> Path:
        """Where a block's rows are."""
        return self.folder / ROWS / block.path

    def keep(self, block: Block, result: BlockResult) -> None:
        """Write a block, whole or not at all; the same block again replaces itself."""
        # First, so that each block that is there was timed; a line of a block that was lost is replaced with it.
        with (self.folder / TIMINGS).open("a", encoding="utf-8", newline="") as timings:
            told = (f"{result.cpu_s:.6f}", f"{result.wall_s:.6f}", f"{result.began:.6f}", result.worker)
            csv.writer(timings, lineterminator="\n").writerow((block.path, block.count, *told))
        file = self.file(block)
        file.parent.mkdir(parents=True, exist_ok=True)
        with replacing(file) as temporary:
            temporary.write_bytes(result.file)

    def timings(self) -> dict[str, tuple[int, float]]:
        """Seeds and time of a processor, s, of each block that was timed."""
        found: dict[str, tuple[int, float]] = {}
        file = self.folder / TIMINGS
        if file.exists():
            with file.open(encoding="utf-8", newline="") as lines:
                for line in csv.reader(lines):
                    try:
                        path, seeds, cpu_s, _, _, _ = line
                        found[path] = int(seeds), float(cpu_s)
                    except ValueError:  # the names of the columns, or a line that was cut off
                        continue
        return found


@contextmanager
def open_store(folder: Path, plan: Plan) -> Iterator[Store]:
    """Open a folder for a campaign, a new one or the one that was begun there.

    Parameters
    ----------
    folder : pathlib.Path
        Made if it is missing.
    plan : Plan

    Yields
    ------
    Store

    Raises
    ------
    FileError
        If it cannot be written, holds something else or another campaign (with what differs), or is in use.
    """
    file = folder / IDENTITY
    for name in FILES:
        require_writable(folder / name, makes_folders=True)
    if not file.exists() and folder.exists() and any(not one.name.startswith(".") for one in folder.iterdir()):
        raise FileError(f"{folder}: holds files, but no campaign ({IDENTITY}): choose a new folder")
    folder.mkdir(parents=True, exist_ok=True)
    if not file.exists():
        write_json(file, plan.identity())
    with file.open(encoding="utf-8") as opened:
        _lock(opened, folder)
        _require_same(opened, file, plan)
        if not (folder / TIMINGS).exists():
            (folder / TIMINGS).write_text("block,seeds,cpu_s,wall_s,began,worker\n", encoding="utf-8")
        # They say that the folder is complete.
        for name in (SUMMARY, PAGE):
            (folder / name).unlink(missing_ok=True)
        # A process that was killed has left it.
        for temporary in (*folder.glob(".*.tmp"), *(folder / ROWS).rglob(".block-*.tmp")):
            temporary.unlink(missing_ok=True)
        yield Store(folder)


def _lock(opened: IO[str], folder: Path) -> None:
    """Refuse a folder in which another process works. The lock ends with the process, however it ends."""
    try:
        fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise FileError(f"{folder}: another process works on this campaign") from error
    except OSError:  # a file system without locks: then two processes write the same blocks, each in one step
        pass


def _require_same(opened: IO[str], file: Path, plan: Plan) -> None:
    try:
        begun = json.load(opened)
    except ValueError:
        begun = None
    if not isinstance(begun, Mapping) or "settings" not in begun:
        raise FileError(f"{file}: not a campaign's: choose a new folder")
    differences = list(_differences("", begun, json.loads(json.dumps(plan.identity()))))
    if differences:
        more = f"; and {len(differences) - _DIFFERENCES} more" if len(differences) > _DIFFERENCES else ""
        said = "; ".join(differences[:_DIFFERENCES]) + more
        raise FileError(f"{file.parent}: holds another campaign: {said}. Choose another folder")


def _differences(key: str, there: Any, here: Any) -> Iterator[str]:
    """What differs, by key: there in the folder, here in what is asked for."""
    if isinstance(there, Mapping) and isinstance(here, Mapping):
        for name in dict.fromkeys([*there, *here]):
            below = f"{key}.{name}" if key and key != "settings" else name
            yield from _differences(below, there.get(name), here.get(name))
    elif there != here:
        yield f"{key} is {_shown(there)} there and {_shown(here)} here"


def _shown(value: Any) -> str:
    return "missing" if value is None else json.dumps(value, ensure_ascii=False)
