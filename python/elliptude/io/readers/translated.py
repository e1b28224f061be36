"""A text as Arrow reads it: UTF-8, and a tab wherever columns are separated by blanks. Translated as it is read."""

import codecs
import io
import re
from collections.abc import Iterator
from typing import BinaryIO

_CHUNK = 1 << 20
_AT_ENDS = re.compile(rb"^[ \t]+|[ \t]+(?=\r?$)", re.MULTILINE)
_BETWEEN = re.compile(rb"[ \t]+")


class Translated(io.RawIOBase):
    """A stream of bytes in another encoding, or with blanks between columns, as UTF-8 with tabs.

    Parameters
    ----------
    stream : binary file
    encoding : str
        That of the stream.
    blanks : bool
        Whether blanks separate columns.
    """

    def __init__(self, stream: BinaryIO, encoding: str, *, blanks: bool) -> None:
        super().__init__()
        self._chunks = _tabbed(_decoded(stream, encoding)) if blanks else _decoded(stream, encoding)
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
            yield _line_tabbed(whole) + b"\n"
    yield _line_tabbed(rest)


def _line_tabbed(lines: bytes) -> bytes:
    return _BETWEEN.sub(b"\t", _AT_ENDS.sub(b"", lines))
