"""ROS 1 and ROS 2 bags and MCAP files, by way of rosbags: the extra ``elliptude[ros]``."""

import operator
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from elliptude.io.files import FileError, as_path, system_fault
from elliptude.io.readers.base import BATCH_ROWS, Batch, Cells, NumbersAlone, numbered

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

_NUMBERS = {
    *("bool", "byte", "char", "octet", "float32", "float64"),
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
}
# Seconds and nanoseconds become one column of nanoseconds.
_STAMPS = {"builtin_interfaces/msg/Time"}
_LARGEST_ARRAY = 64
# What a file is by its ending, how each begins, and what may mend it.
_KINDS = {
    ".bag": ("a ROS 1 bag", b"#ROSBAG V2.0", "try `rosbag reindex`"),
    ".mcap": ("an MCAP file", b"\x89MCAP0\r\n", "try `mcap recover`"),
    ".db3": ("a ROS 2 bag", b"SQLite format 3\x00", "try `ros2 bag reindex` in its folder"),
}


class BagFile(NumbersAlone):
    """A bag. A column is ``/topic.field``, with a dot or an index for each level: ``/imu.angular_velocity.x``.

    Each topic is a stream in the order in which its messages were recorded, read message by message. A time stamp is
    one column, in ns: that of the message, ``/imu.header.stamp``, and for each topic ``/imu.bag_time``, when the bag
    took it. Sequences of any length are no columns. NaN is what was not measured.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = as_path(path)
        self._getters: dict[str, Callable[[Any], Any]] = {}
        topics: dict[str, str] = {}
        with self._open() as reader:
            for connection in reader.connections:
                if topics.setdefault(connection.topic, connection.msgtype) != connection.msgtype:
                    raise FileError(f"{path}: topic {connection.topic} has messages of more than one type")
                if connection.msgtype not in reader.typestore.fielddefs:
                    raise FileError(
                        f"{path}: topic {connection.topic}: the bag does not say what is in its messages, of type "
                        f"{connection.msgtype}; recorded as MCAP, it does"
                    )
                fields = _fields(reader.typestore.fielddefs, connection.msgtype)
                self._getters |= {f"{connection.topic}.{field}": getter for field, getter in fields.items()}
                self._getters[f"{connection.topic}.bag_time"] = lambda _: 0
        self.columns = tuple(self._getters)

    def stream(self, column: str) -> str:
        """The topic."""
        return column.partition(".")[0]

    def stamps(self, stream: str) -> tuple[str, str]:
        """The header's stamps where messages have a header, else when the bag took them; ns."""
        header = f"{stream}.header.stamp"
        return header if header in self._getters else f"{stream}.bag_time", "ns"

    def batches(self, columns: Sequence[str]) -> Iterator[Batch]:
        """See `elliptude.io.readers.base.LogFile`."""
        topic = self.stream(columns[0])
        getters = [None if name == f"{topic}.bag_time" else self._getters[name] for name in columns]
        with self._open() as reader:
            connections = [connection for connection in reader.connections if connection.topic == topic]
            rows: list[list[Any]] = []
            for connection, time, raw in reader.messages(connections):
                message = reader.deserialize(raw, connection.msgtype)
                rows.append([time if getter is None else getter(message) for getter in getters])
                if len(rows) == BATCH_ROWS:
                    yield _batch(columns, rows)
                    rows = []
            if rows:
                yield _batch(columns, rows)

    def place(self, column: str, row: int) -> str:
        """See `elliptude.io.readers.base.LogFile`."""
        return f"message {row + 1} of {column}"

    def places_of_rows(self, rows: Sequence[int]) -> list[str]:
        """Empty: topics do not share their rows."""
        return [""] * len(rows)

    @contextmanager
    def _open(self) -> Iterator["AnyReader"]:
        try:
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        except ModuleNotFoundError as error:
            raise FileError(f"{self.path}: reading a bag needs rosbags: pip install 'elliptude[ros]'") from error
        try:
            # Older ROS 2 bags do not hold the definitions of their messages.
            with AnyReader([Path(self.path)], default_typestore=get_typestore(Stores.LATEST)) as reader:
                yield reader
        except (FileError, KeyboardInterrupt, GeneratorExit):
            raise
        except OSError as error:
            raise FileError(f"{self.path}: {system_fault(error)}") from error
        except Exception as error:  # of rosbags and of what it unpacks with, in words for nobody
            raise FileError(f"{self.path}: {self._damage()}") from error

    def _damage(self) -> str:
        """Why it cannot be read, and what may be done."""
        path = Path(self.path)
        if path.is_dir():
            return (
                "a folder of a ROS 2 bag that is not whole: its metadata.yaml, or a file that it names, is damaged or "
                "missing; `ros2 bag reindex` writes the first anew"
            )
        what, magic, remedy = _KINDS[path.suffix]
        with path.open("rb") as file:
            begins = file.read(len(magic))
        if begins != magic:
            return f"not {what}: it begins with {begins[:8]!r} where {magic!r} must stand"
        return f"{what} that is damaged, or was not closed when the recording ended: {remedy}, or copy it again"


def _batch(columns: Sequence[str], rows: list[list[Any]]) -> dict[str, Cells]:
    return {name: numbered(np.array(values)) for name, values in zip(columns, zip(*rows, strict=True), strict=True)}


def _fields(definitions: Mapping[str, Any], kind: str) -> dict[str, Callable[[Any], Any]]:
    """The numbers in a message by their names, each with what takes it from the message."""
    from rosbags.interfaces import Nodetype

    found: dict[str, Callable[[Any], Any]] = {}
    for name, (node, what) in definitions[kind][1]:
        of_message = operator.attrgetter(name)
        if node == Nodetype.BASE and what[0] in _NUMBERS:
            found[name] = of_message
        elif node == Nodetype.NAME and what in _STAMPS:
            found[name] = _then(of_message, _nanoseconds)
        elif node == Nodetype.NAME:
            for field, getter in _fields(definitions, what).items():
                found[f"{name}.{field}"] = _then(of_message, getter)
        elif node == Nodetype.ARRAY:
            (inner_node, inner_what), length = what
            if inner_node == Nodetype.BASE and inner_what[0] in _NUMBERS and length <= _LARGEST_ARRAY:
                for i in range(length):
                    found[f"{name}[{i}]"] = _then(of_message, operator.itemgetter(i))
    return found


def _then(first: Callable[[Any], Any], second: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda message: second(first(message))


def _nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
