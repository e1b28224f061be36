"""Errors of files, and files that are written whole or not at all."""

import atexit
import difflib
import errno
import json
import os
import secrets
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


class FileError(Exception):
    """A file cannot be used or written; the message says which, where in it, and why."""


def as_path(path: str | os.PathLike[str]) -> os.PathLike[str]:
    """A name as a path; what is a path already keeps the name that messages call it by.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    path-like
        ``str`` gives its name, ``os.fspath`` where it is.
    """
    return Path(path) if isinstance(path, str) else path


_SYSTEM_FAULTS = {
    errno.ENOENT: "no such file or folder",
    errno.EACCES: "no permission",
    errno.EPERM: "no permission",
    errno.EISDIR: "a folder, where a file is needed",
    errno.ENOTDIR: "within a file, where a folder is needed",
    errno.EEXIST: "there already, and no folder",
    errno.ENOSPC: "no space left",
    errno.EROFS: "a place where nothing can be written",
    errno.ENAMETOOLONG: "the name is too long",
    errno.EINVAL: "nothing that can be read as a file",
    errno.EIO: "the disk cannot read it",
}


def system_fault(error: OSError) -> str:
    """What the system refused, in words of the same kind as other messages.

    Parameters
    ----------
    error : OSError

    Returns
    -------
    str
    """
    return _SYSTEM_FAULTS.get(error.errno or 0) or error.strerror or "it cannot be read"


def sentence(text: str) -> str:
    """A message with a mark at its end, so that another sentence can follow.

    Parameters
    ----------
    text : str
        With a question mark at its end, a full stop, or without any.

    Returns
    -------
    str
    """
    return text if text.endswith((".", "?", "!")) else f"{text}."


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The known name that is most like another one, as the end of a message; empty if none is.

    Parameters
    ----------
    name : str
    known : iterable of str

    Returns
    -------
    str
        ", did you mean 'gyro_x'?"
    """
    by_small_letters = {one.lower(): one for one in known}
    near = difflib.get_close_matches(name.lower(), by_small_letters, n=1, cutoff=0.75)
    return f", did you mean {by_small_letters[near[0]]!r}?" if near else ""


def require_unicode(name: str) -> None:
    """Refuse a name of a file that is no Unicode text: PyArrow and JSON cannot hold it.

    Parameters
    ----------
    name : str
        As the system gave it.

    Raises
    ------
    FileError
        If it has bytes that the system's encoding does not know.
    """
    try:
        name.encode()
    except UnicodeEncodeError:
        shown = name.encode(errors="backslashreplace").decode()
        raise FileError(
            f"'{shown}': a name that is no text in this system's encoding, {sys.getfilesystemencoding()}: rename the "
            "file, or set a locale of UTF-8, such as LC_ALL=C.UTF-8"
        ) from None


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A temporary file that becomes ``path`` when the block ends well, and is removed when it does not.

    It lies in the same folder, so that it takes its final name in one step: a reader of ``path`` finds the old file or
    the whole new one.

    Parameters
    ----------
    path : path-like
        The final name. Its folder must exist.

    Yields
    ------
    pathlib.Path
        The file to write, new and empty.

    Raises
    ------
    FileError
        If the system refuses: no such folder, no permission, no space.
    """
    final = Path(path)
    try:
        with _temporary(final) as temporary:
            yield temporary
            with temporary.open("rb+") as file:
                os.fsync(file.fileno())
            temporary.replace(final)
    except OSError as error:
        raise FileError(f"{final}: not written: {system_fault(error)}") from error


_unfinished: set[Path] = set()
"""Temporary files of this process. An interrupt can come between two steps of a `with` statement itself, where nothing
removes them before the program ends."""
os.register_at_fork(after_in_child=_unfinished.clear)


@atexit.register
def _remove_unfinished() -> None:
    for temporary in list(_unfinished):
        _remove(temporary)


def _remove(temporary: Path) -> None:
    with suppress(OSError):  # its folder may be gone
        temporary.unlink(missing_ok=True)
    _unfinished.discard(temporary)


@contextmanager
def _temporary(final: Path) -> Iterator[Path]:
    """A new file in the same folder, for the time of the block.

    Not from `tempfile`: only the owner may read its files.
    """
    temporary = final.with_name(f".{final.name}.{secrets.token_hex(4)}.tmp")
    try:
        _unfinished.add(temporary)
        temporary.touch(exist_ok=False)
        yield temporary
    finally:
        _remove(temporary)


def require_writable(path: str | os.PathLike[str], *, makes_folders: bool = False) -> None:
    """Try whether `replacing` could write a file, and leave nothing behind.

    Parameters
    ----------
    path : path-like
    makes_folders : bool
        Whether missing folders will be made: then the nearest one that is there is tried.

    Raises
    ------
    FileError
        If the system refuses. It alone knows: a file system may be read-only, a name too long.
    """
    final = tried = Path(path)
    if final.is_dir():
        raise FileError(f"{final}: not written: it is a folder")
    if final.exists() and not final.is_file():
        raise FileError(f"{final}: not written: it is there, and no file: a device or a pipe")
    while makes_folders and not tried.parent.exists():
        tried = tried.parent
    try:
        with _temporary(tried):
            pass
    except OSError as error:
        raise FileError(f"{final}: not written: {system_fault(error)}") from error


def write_json(path: str | os.PathLike[str], data: object) -> None:
    """Write JSON for people and programs: indented, UTF-8, no NaN.

    Parameters
    ----------
    path : path-like
    data : object
        What `json.dumps` takes.

    Raises
    ------
    FileError
        If it cannot be written.
    """
    text = json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
