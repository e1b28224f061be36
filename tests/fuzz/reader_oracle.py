"""The readers of files, given any bytes: a clean result, or `FileError` that names the file; nothing half-written."""

from pathlib import Path

from elliptude.configuration import read_configuration
from elliptude.io.files import FileError
from elliptude.io.readers.open import open_log
from elliptude.logs import read_log
from elliptude.logs.conversion import convert

SUFFIXES = {"csv": ".csv", "npz": ".npz", "toml": ".toml", "ulog": ".ulg", "zip": ".zip"}

# What the configurations are tried on.
LOG = "t,wx,wy,wz,ax,ay,az,mx,my,mz,qw,qx,qy,qz\n" + "".join(
    f"{0.01 * i},{0.1 * i},0.2,-0.1,0.1,9.8,0.3,20,{i},-40,1,0,0,0\n" for i in range(8)
)


class OracleBroken(Exception):
    """What a reader did is none of what it may do."""


def check(kind: str, data: bytes, folder: Path) -> None:
    """Tries one input in a folder that is empty before and after.

    Parameters
    ----------
    kind : str
        One of `SUFFIXES`.
    data : bytes
        The content of the file.
    folder : Path

    Raises
    ------
    OracleBroken
        And whatever a reader raises that is no `FileError`.
    """
    path = folder / f"input{SUFFIXES[kind]}"
    path.write_bytes(data)
    log = folder / "log.csv"
    try:
        if kind == "toml":
            log.write_text(LOG)
            configuration = read_configuration(path)
            read_log(log, configuration)
        else:
            _read(path)
    except FileError as error:
        if str(path) not in str(error) and str(log) not in str(error):
            raise OracleBroken(f"the message names no file: {error}") from error
    finally:
        path.unlink()
        log.unlink(missing_ok=True)
    left = sorted(folder.iterdir())
    if left:
        raise OracleBroken(f"left behind: {left}")


def _read(path: Path) -> None:
    """All of a log, and the same once more after it was written in another format."""
    file = open_log(path)
    rows: dict[str, int] = {}
    # Commas at the end of each line are no columns to `convert`; of other columns with one name it refuses the file.
    named = [name for name in file.columns if name or file.columns.count(name) == 1]
    for stream in dict.fromkeys(file.stream(column) for column in file.columns):
        columns = [name for name in named if file.stream(name) == stream and file.holds_numbers(name)]
        if len(set(columns)) < len(columns) or not columns:
            continue
        batches = [{name: len(cells.values) for name, cells in batch.items()} for batch in file.batches(columns)]
        if any(len(set(batch.values())) != 1 for batch in batches):
            raise OracleBroken("columns of one stream with different numbers of rows")
        rows[stream] = sum(batch[columns[0]] for batch in batches)
        if rows[stream] > 0:
            file.place(columns[0], rows[stream] - 1)
            if len(file.places_of_rows([0, rows[stream] - 1])) != 2:
                raise OracleBroken("a row without a place")
    target = path.with_name("converted.npz")
    try:
        written = convert(path, target)
        if written != sum(rows.values()):
            raise OracleBroken(f"{written} rows written of {sum(rows.values())}")
        again = open_log(target)
        there = {name: sum(len(batch[name].values) for batch in again.batches([name])) for name in again.columns}
        if len(there) == 0:
            raise OracleBroken("what was written has no columns")
    except FileError:
        if target.exists():
            raise OracleBroken("an error, and yet a file") from None
        raise
    finally:
        target.unlink(missing_ok=True)
