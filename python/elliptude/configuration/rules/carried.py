"""The rules of the package, one for each way in which a sensor is carried, with the reasons beside their numbers."""

import functools
import os
from importlib import resources
from typing import Any

from elliptude.configuration.rules.tables import Carried, Rule
from elliptude.io.toml import load_toml, read_toml


def read_rule(path: str | os.PathLike[str]) -> Rule:
    """Read a rule in a TOML file.

    Raises
    ------
    FileError
        If the file cannot be read, is not TOML, or does not fit; with the file and every key at fault.
    """
    return read_toml(path, Rule)


@functools.cache
def hand_held() -> Rule:
    """The rule for a small sensor or phone in the hand, indoors, that starts at rest."""
    with resources.as_file(_preset("hand")) as file:
        return read_rule(file)


def rule_for(carried: Carried) -> Rule:
    """The rule for a small sensor that is carried in some way; ``"hand"`` is `hand_held`."""
    rule = hand_held()
    if carried == "hand":
        return rule
    tables = rule.model_dump(mode="json")
    for name, numbers in _stated(carried).items():
        tables[name] |= numbers
    return Rule.model_validate(tables | {"carried": carried})


def carried_numbers() -> list[tuple[str, str]]:
    """Tables and keys of the numbers that depend on how a sensor is carried."""
    others: tuple[Carried, ...] = ("person", "drone", "car", "boat")
    found = {(name, key): None for one in others for name, table in _stated(one).items() for key in table}
    of_hand = list(reasons_for("hand"))
    return [place for place in of_hand if place in found] + [place for place in found if place not in of_hand]


def reasons_for(carried: Carried) -> dict[tuple[str, str], str]:
    """The reason beside each number of `rule_for`, by table and key.

    A reason is the comment behind a number, or the lines of comments above it; a number without either has that of the
    number above it.
    """
    reasons = _reasons_in(_preset("hand").read_text(encoding="utf-8"))
    return reasons if carried == "hand" else reasons | _reasons_in(_preset(carried).read_text(encoding="utf-8"))


def _preset(carried: Carried) -> Any:
    name = "hand_held" if carried == "hand" else carried
    return resources.files("elliptude") / "data" / "bounds" / f"{name}.toml"


def _stated(carried: Carried) -> dict[str, dict[str, Any]]:
    with resources.as_file(_preset(carried)) as file:
        return load_toml(file)


def _reasons_in(text: str) -> dict[tuple[str, str], str]:
    reasons: dict[tuple[str, str], str] = {}
    table, above, last = "", list[str](), ""
    for line in text.splitlines():
        stated, _, comment = (part.strip() for part in line.partition("#"))
        if stated.startswith("["):
            table, above = stated.strip("[]"), []
        elif "=" in stated:
            last = " ".join([*above, comment]).strip() or last
            reasons[table, stated.split("=")[0].strip()] = last
            above = []
        else:
            above = [*above, comment] if comment else []
    return reasons
