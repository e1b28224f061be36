"""What is wrong with a TOML file, in words: syntax by line, pydantic's findings by key, and what may stand there."""

import re
import textwrap
from collections.abc import Mapping, Sequence
from datetime import date, time
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from elliptude.io.files import did_you_mean

_EXPLAINED = {
    "T": "tesla",
    "mT": "millitesla",
    "G": "gauss",
    "mG": "milligauss",
    "uT": "microtesla",
    "nT": "nanotesla",
    "mg": "thousandths of g",
}
_WORDS = {
    "missing": "missing",
    "finite_number": "must be finite",
    "greater_than": "must be more than {gt:.10g}",
    "greater_than_equal": "must be at least {ge:.10g}",
    "less_than": "must be less than {lt:.10g}",
    "less_than_equal": "must be at most {le:.10g}",
    "too_long": "must have {max_length} values, not {actual_length}",
    "too_short": "must have at least {min_length} value(s)",
    "string_too_short": "must not be empty",
    "float_type": "must be a number",
    "float_parsing": "must be a number",
    "int_type": "must be a whole number",
    "int_parsing": "must be a whole number",
    "int_from_float": "must be a whole number",
    "bool_type": "must be true or false",
    "bool_parsing": "must be true or false",
    "string_type": "must be text in quotes",
    "tuple_type": "must be a list",
    "list_type": "must be a list",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
    "timezone_aware": "needs a time zone, as in 2015-10-13T14:49:00Z",
}
"""By pydantic's type of a fault, with its context."""
_OTHER_KINDS = {"tuple_type", "list_type", "dict_type", "model_type", "model_attributes_type"}
"""Faults that say that a list or a table should stand there."""
_SYNTAX = {
    "Expected '=' after": "a name is followed by = and a value; a name with a space in it stands in quotes",
    "Invalid value": "no value: numbers have a decimal point and no unit, text stands in quotes, lists in [ ]",
    "after a statement": "something is left over: numbers have a decimal point and no unit, text stands in quotes",
    "Cannot declare": "this table stands here a second time: put its lines together, or write [[...]] for a list",
    "Cannot|Duplicate": "this name has a value already: leave one of them out",
    "Unclosed array": "a list that begins with [ does not end with ], or lacks a comma",
    "inline table": "a table that begins with { does not end with }, or lacks a comma",
    "Expected ']": "the name of a table ends with ], that of a list of tables with ]]",
    "Unterminated|Illegal character '.?.[nr]'|Expected": "text in quotes does not end",
    "[Ee]scape|hex": "in double quotes a backslash begins a special character: write paths in single quotes",
    "Invalid (initial|statement)": "a line is name = value, [table] or # comment; a name has letters, digits, _ and -",
    "character": "a character that cannot be shown: leave it out",
    "date|time": "no such date or time",
}
"""What Python's parser says (patterns, the first one that fits), and what that is in other words."""


def faults_in_words(error: ValidationError, data: Mapping[str, Any], model: type[BaseModel]) -> str:
    """Every key at fault with what is wrong, each once: the members of a union repeat one another.

    Parameters
    ----------
    error : ValidationError
    data : mapping
        What was validated.
    model : type
        By what.

    Returns
    -------
    str
    """
    faults = error.errors()
    plain = {_key_path(fault, data).rstrip(": ") for fault in faults if not fault["type"].endswith("_type")}
    said = []
    for fault in faults:
        path = _key_path(fault, data)
        key = path.rstrip(": ")
        # That a list is no table, or a table no list, is not said where something in it is wrong.
        if fault["type"] in _OTHER_KINDS and any(one == key or one.startswith((f"{key}[", f"{key}.")) for one in plain):
            continue
        above = key.rpartition("[")[0]
        # Nor that a list of names is no matrix where a name is wrong.
        if fault["type"] == "tuple_type" and any(one == above or one.startswith(f"{above}[") for one in plain if above):
            continue
        said.append(path + _fault(fault, model) + _value(fault))
    return "; ".join(dict.fromkeys(said))


def _fault(fault: ErrorDetails, model: type[BaseModel]) -> str:
    kind, context = fault["type"], fault.get("ctx", {})
    if kind == "value_error":
        return fault["msg"].removeprefix("Value error, ")
    if kind == "extra_forbidden":
        if other := _other_kind(model, fault["loc"]):
            return other
        keys = _known_keys(model, fault["loc"])
        return "no such key" + (did_you_mean(str(fault["loc"][-1]), keys) or f"; there are {', '.join(sorted(keys))}")
    if kind == "missing" and isinstance(fault["loc"][-1], int):
        return "missing: the list has too few values"
    if kind == "literal_error":
        expected = str(context["expected"])
        names = [name for name in _EXPLAINED if f"'{name}'" in expected]
        explained = "; ".join(f"{name} is {_EXPLAINED[name]}" for name in names if name != "T")
        return f"must be {expected}" + (f" ({explained})" if explained else "")
    if kind in {"union_tag_invalid", "union_tag_not_found"}:
        tags = sorted(_kinds(_models_at(model, fault["loc"])))
        one_of = " or ".join(f"'{tag}'" for tag in tags)
        if kind == "union_tag_not_found":
            return f"kind: missing, must be {one_of}"
        return f"kind must be {one_of}, not {context['tag']!r}" + did_you_mean(str(context["tag"]), tags)
    if kind.startswith(("datetime", "date_")):
        return "must be a date with time and zone, as 2015-10-13T14:49:00Z"
    return _WORDS.get(kind, "not what may stand here").format(**context)


def _value(fault: ErrorDetails) -> str:
    """What stands there instead, if it is short enough to be said."""
    value = fault["input"]
    is_list = isinstance(value, list) and fault["type"] not in _OTHER_KINDS
    if isinstance(value, date | time):
        return f", not {value.isoformat()}"
    if fault["type"] in {"missing", "extra_forbidden"} or not (is_list or isinstance(value, bool | int | float | str)):
        return ""
    shown = str(value).lower() if isinstance(value, bool) else repr(value)
    return f", not {textwrap.shorten(shown, 60, placeholder='...')}"


def _key_path(fault: ErrorDetails, data: Mapping[str, Any]) -> str:
    """Where in the file a fault is, "potential.orbit_rate: "; empty for the file as a whole.

    pydantic names the members of unions among the keys; they are not in the file.
    """
    path = ""
    here: Any = data
    for depth, part in enumerate(fault["loc"], start=1):
        is_missing = fault["type"] == "missing" and depth == len(fault["loc"])
        if isinstance(here, list) and isinstance(part, int):
            path += f"[{part}]"
            here = None if is_missing else here[part]
        elif isinstance(here, Mapping) and (part in here or is_missing):
            path += f".{part}"
            here = here.get(part)
    return f"{path.lstrip('.')}: " if path else ""


# --- what may stand where ---------------------------------------------------------------------------------------------


def _known_keys(model: type[BaseModel], place: Sequence[int | str]) -> set[str]:
    return {key for one in _models_at(model, place[:-1]) for key in one.model_fields}


def _other_kind(model: type[BaseModel], place: Sequence[int | str]) -> str:
    """What is said of a key that a table of another kind has; empty if none has it."""
    if len(place) < 2:
        return ""
    kind, key = place[-2:]
    siblings = _models_at(model, place[:-2])
    others = _kinds({one for one in siblings if key in one.model_fields})
    if kind not in _kinds(siblings) or not others:
        return ""
    taking = " or ".join(f"kind = {other!r}" for other in sorted(others))
    return f"no such key with kind = {kind!r}; {taking} takes it"


def _models_at(model: type[BaseModel], place: Sequence[int | str]) -> set[type[BaseModel]]:
    """The tables that may stand at a place."""
    here = {model}
    for part in place:
        if isinstance(part, int):
            continue
        below = {
            found for one in here if part in one.model_fields for found in _models_in(one.model_fields[part].annotation)
        }
        tagged = {one for one in here if part in _kinds({one})}
        here = below or tagged or here
    return here


def _models_in(annotation: Any) -> set[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return {annotation}
    return {found for one in get_args(annotation) for found in _models_in(one)}


def _kinds(models: set[type[BaseModel]]) -> set[str]:
    """What ``kind`` may be in these tables."""
    fields: list[Any] = [one.model_fields["kind"].annotation for one in models if "kind" in one.model_fields]
    return {str(name) for one in fields for name in get_args(one)}


def syntax_in_words(said: str, text: str) -> str:
    """Where a text is no TOML, what stands there and what may.

    Parameters
    ----------
    said : str
        By Python's parser.
    text : str

    Returns
    -------
    str
        Such as "line 3, column 8: not TOML: ...: 'step ='".
    """
    lines = text.splitlines() or [""]
    found = re.search(r"\(at line (\d+), column (\d+)\)", said)
    row, column = (int(found[1]), int(found[2])) if found else (len(lines), len(lines[-1]) + 1)
    words = next((words for pattern, words in _SYNTAX.items() if re.search(pattern, said)), "this cannot be read")
    there = lines[min(row, len(lines)) - 1].strip()
    return f"line {row}, column {column}: not TOML: {words}" + (f": '{textwrap.shorten(there, 60)}'" if there else "")
