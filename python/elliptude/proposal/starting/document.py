"""Writes a proposed configuration as TOML, with a comment on where each number comes from."""

from collections.abc import Collection, Iterator
from typing import Any, TypeAlias

import tomlkit

from elliptude.proposal.mapping import Tables

Place: TypeAlias = tuple[str, ...]
"""Where a number stands in a configuration: the names of the tables (of directions, their own names) and the key."""


class Once:
    """Says the reason of a number once; where it comes again, whose it is.

    Parameters
    ----------
    reasons : collection of str
        Those that may come again.
    """

    def __init__(self, reasons: Collection[str]) -> None:
        self._reasons = sorted(set(reasons), key=len, reverse=True)
        self._said: dict[str, str] = {}

    def __call__(self, place: Place, text: str) -> str:
        """A text, which may end with a reason, as it stands beside the number at a place."""
        reason = next((one for one in self._reasons if text.endswith(one)), None)
        if reason is None:
            return text
        own = ".".join(place[-2:])
        again = f"for the reason of {self._said.setdefault(reason, own)}"
        return text if self._said[reason] == own or len(again) >= len(reason) else text.removesuffix(reason) + again


def document_of(
    full: Tables, comments: dict[Place, str], margin: float, log: str, notes: list[str], once: Once
) -> tomlkit.TOMLDocument:
    """A configuration as TOML, each number with its comment.

    Parameters
    ----------
    full : dict
        Its tables.
    comments : dict
        By the place of a key.
    margin : float
        The factor for maxima.
    log : str
        The recording's name.
    notes : list of str
        Lines at the top.
    once : Once
        Knows the reasons of numbers.

    Returns
    -------
    tomlkit.TOMLDocument
    """
    document = tomlkit.document()
    for line in (
        f"Proposed by `elliptude bounds` from {log}. Bounds are what was seen in that recording, times {margin:g}.",
        "They guarantee nothing about another recording, or the next minute of this one. Replace each by a number for",
        "which there is a reason, such as a datasheet or the size of the room. Bounds are lengths of vectors: what",
        "a datasheet states for one axis counts 1.73 times, if each axis may be off by it.",
        *notes,
    ):
        document.add(tomlkit.comment(line))
    document.add(tomlkit.nl())
    full = {"bounds_from_recording": log, **full}
    comments["bounds_from_recording",] = "delete this line once there is a reason for each bound"
    for key, value in full.items():
        if not isinstance(value, dict | list):
            document.add(key, value)
            if (key,) in comments:
                document[key].comment(comments[key,])
    for key, value in full.items():
        if key == "directions":
            array = tomlkit.aot()
            for sensor in value:
                array.append(_section(sensor, (key, sensor["name"]), comments, once))
            document.add(key, array)
        elif isinstance(value, dict):
            document.add(key, _section(value, (key,), comments, once))
    return document


def _section(table: Tables, place: Place, comments: dict[Place, str], once: Once) -> tomlkit.items.Table:
    """A table of the file. Tables within it whose keys have comments get lines of their own and come last."""
    section = tomlkit.table()
    deeper = {key for key in table if any(one[:-1] == (*place, key) for one in comments)}
    for key, value in table.items():
        if key in deeper:
            continue
        if isinstance(value, dict):
            inline = tomlkit.inline_table()
            inline.update(value)
            section.add(key, inline)
        else:
            section.add(key, value)
        if (*place, key) in comments:
            section[key].comment(once((*place, key), comments[*place, key]))
    for key in table:
        if key in deeper:
            section.add(key, _section(table[key], (*place, key), comments, once))
    return section


_IN_SENSOR: dict[str, tuple[str, ...]] = {
    "accelerometer": ("sensor_error", "bound_from"),
    "motion": ("bound_from",),
    "magnetometer": ("sensor_error", "bound_from"),
}


def statements_in(document: tomlkit.TOMLDocument, of_rule: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The numbers of a file in which each sensor states its own bounds that a rule's would be, as they stand there.

    Parameters
    ----------
    document : tomlkit.TOMLDocument
        What `document_of` returns.
    of_rule : list of dict
        The numbers of the rule, as `elliptude.proposal.proposed_rule.statements_of` has them.

    Returns
    -------
    list of dict
        Likewise, with the table in the file as ``in_file``; those that are not in the file are left out.
    """
    found = []
    for one in of_rule:
        for place, section in _sections_of(document, one["table"]):
            if one["key"] in section:
                value = section[one["key"]]
                comment = value.trivia.comment.lstrip("# ")
                found.append(one | {"value": value.unwrap(), "how": comment or one["how"], "in_file": place})
    return found


def _sections_of(document: tomlkit.TOMLDocument, table: str) -> Iterator[tuple[str, Any]]:
    """The tables of a file, and what they are called, that have numbers of a rule's table."""
    if table == "gyro" and "flow" in document:
        yield "flow", document["flow"]
    kind = "accelerometer" if table == "motion" else table
    for sensor in document.get("directions", []):
        if sensor.get("kind") == kind:
            for name in _IN_SENSOR[table]:
                if name in sensor:
                    yield f"{sensor['name']}.{name}", sensor[name]
