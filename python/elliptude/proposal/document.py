"""Writes a proposed configuration as TOML, with a comment on where each number comes from."""

from typing import TypeAlias

import tomlkit

from elliptude.proposal.mapping import Tables

Place: TypeAlias = tuple[str, ...]
"""Where a number stands in a configuration: the names of the tables (of directions, their own names) and the key."""


def document_of(
    full: Tables, comments: dict[Place, str], margin: float, log: str, notes: list[str]
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

    Returns
    -------
    tomlkit.TOMLDocument
    """
    document = tomlkit.document()
    for line in (
        f"Proposed by `elliptude bounds` from {log}. Bounds are what was seen in that recording, times {margin:g}.",
        "They guarantee nothing about another recording, or the next minute of this one. Replace each by a number for",
        "which there is a reason, such as a datasheet or the size of the room.",
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
                array.append(_section(sensor, (key, sensor["name"]), comments))
            document.add(key, array)
        elif isinstance(value, dict):
            document.add(key, _section(value, (key,), comments))
    return document


def _section(table: Tables, place: Place, comments: dict[Place, str]) -> tomlkit.items.Table:
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
            section[key].comment(comments[*place, key])
    for key in table:
        if key in deeper:
            section.add(key, _section(table[key], (*place, key), comments))
    return section
