"""A text as Arrow reads it: UTF-8, and a tab wherever columns are separated by blanks. Translated as it is read.

Lines may be emptied, too: Arrow passes over an empty line, and those below it keep their numbers.
"""

import codecs
import io
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import BinaryIO

BLANKS = " \t\r\n"
_CHUNK = 1 << 20
_AT_ENDS = re.compile(rb"^[ \t]+|[ \t]+(?=\r?$)", re.MULTILINE)
_BETWEEN = re.compile(rb"[ \t]+")


class Chunks(io.RawIOBase):
    """A stream of the bytes in chunks.

    Parameters
    ----------
    chunks : iterable of bytes
    """

    def __init__(self, chunks: Iterable[bytes]) -> None:
        super().__init__()
        self._chunks = iter(chunks)
        self._left = b""

    def readable(self) -> bool:
        """Yes."""
        return True

    def readinto(self, buffer: bytearray | memoryview, /) -> int:  # type: ignore[override]
        """See `io.RawIOBase`."""
        while not self._left:
            chunk = next(self._chunks, None)
            if chunk is None:
                return 0
            self._left = chunk
        count = min(len(buffer), len(self._left))
        buffer[:count] = self._left[:count]
        self._left = self._left[count:]
        return count


def translated(stream: BinaryIO, encoding: str, *, blanks: bool) -> Chunks:
    """A stream of bytes in another encoding, or with blanks between columns, as UTF-8 with tabs.

    Parameters
    ----------
    stream : binary file
    encoding : str
        That of the stream.
    blanks : bool
        Whether blanks separate columns.

    Returns
    -------
    Chunks
    """
    chunks = _decoded(stream, encoding)
    return Chunks(_tabbed(chunks) if blanks else chunks)


def without_lines(stream: BinaryIO, lines: Iterable[str]) -> Chunks:
    """A stream in UTF-8 in which certain lines are empty.

    Parameters
    ----------
    stream : binary file
    lines : iterable of str
        Without `BLANKS` at the ends, which do not count; none of them empty.

    Returns
    -------
    Chunks
    """
    return Chunks(_emptied(iter(lambda: stream.read(_CHUNK), b""), [line.encode() for line in lines]))


def _emptied(chunks: Iterable[bytes], lines: Sequence[bytes]) -> Iterator[bytes]:
    rest = b""
    for chunk in chunks:
        whole, newline, rest = (rest + chunk).rpartition(b"\n")
        if newline:
            yield _without(lines, whole) + b"\n"
    yield _without(lines, rest)


def _without(lines: Sequence[bytes], text: bytes) -> bytes:
    if not any(line in text for line in lines):  # as nearly always; to split a text takes ten times as long
        return text
    # A file that was put after another one may begin with a mark of its encoding.
    blanks, every = BLANKS.encode(), text.split(b"\n")
    return b"\n".join(b"" if one.removeprefix(codecs.BOM_UTF8).strip(blanks) in lines else one for one in every)


def _decoded(stream: BinaryIO, encoding: str) -> Iterator[bytes]:
    decoder = codecs.getincrementaldecoder(encoding)(errors="replace")
    while chunk := stream.read(_CHUNK):
        yield decoder.decode(bytes(chunk)).encode()
    yield decoder.decode(b"", final=True).encode()


def _tabbed(chunks: Iterator[bytes]) -> Iterator[bytes]:
    rest = b""
    for chunk in chunks:
        whole, newline, rest = (rest + chunk).rpartition(b"\n")
        if newline:
            yield tabbed(whole) + b"\n"
    yield tabbed(rest)


def tabbed(lines: bytes) -> bytes:
    """Lines with a tab wherever blanks separate columns."""
    return _BETWEEN.sub(b"\t", _AT_ENDS.sub(b"", lines))
