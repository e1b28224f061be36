"""The exceptions that elliptude raises besides Python's own."""

import ast
import difflib
import re
from math import nan, sqrt
from typing import Any


class RowError(ValueError):
    """Something is wrong in one row of a log.

    Parameters
    ----------
    message : str
        What is wrong.
    row : int
        The row of the given arrays, from 0.
    place : str
        What a message calls the row: its line in a file, if known.
    """

    def __init__(self, message: str, row: int, place: str = "") -> None:
        super().__init__(message, row, place)
        self.row = row
        self.place = place

    def __str__(self) -> str:
        """The place and the message."""
        return f"{self.place or f'row {self.row}'}: {self.args[0]}"

    def at(self, place: str) -> "RowError":
        """The same error with a place that a person can find."""
        return RowError(self.args[0], self.row, place)


class InconsistentMeasurement(ValueError):
    """Sets that must meet have no common point: some bound is wrong.

    Parameters
    ----------
    message : str
        What does not meet.
    margin : float
        How far the sets are from meeting: negative, see `elliptude.overlap_margin`; NaN if unknown.
    time : float
        The filter's time, s; NaN if no filter is involved.
    sensor : str
        The sensor's name, as it was given to the update.
    row : int, optional
        The row of the given arrays, from 0, if these were a whole log.
    place : str
        What a message calls the row: its line in a file, if known.
    """

    def __init__(
        self,
        message: str,
        margin: float,
        time: float = nan,
        sensor: str = "",
        row: int | None = None,
        place: str = "",
    ) -> None:
        super().__init__(message, margin, time, sensor, row, place)
        self.margin = margin
        self.time = time
        self.sensor = sensor
        self.row = row
        self.place = place

    def __str__(self) -> str:
        """The place, where there is one, and the message."""
        place = self.place or ("" if self.row is None else f"row {self.row}")
        return f"{place}: {self.args[0]}" if place else str(self.args[0])

    def at(self, place: str) -> "InconsistentMeasurement":
        """The same error with a place that a person can find."""
        return InconsistentMeasurement(self.args[0], self.margin, self.time, self.sensor, self.row, place)


class PredictionError(ValueError):
    """A prediction whose arguments are right, after which no set can be given: too long a step, or too large a set."""


# --- what the bindings say of all their functions and objects alike ---------------------------------------------------

_NUMBER = "typing.SupportsInt | typing.SupportsIndex"
_SIMPLE = {"str": "a str", "bool": "a bool", "bytes": "bytes", "dict": "a dict", _NUMBER: "an integer"}
"""Types that pybind11 converts itself; all others but classes of the module come as objects, and are checked later."""


def _said_of_call(message: str, arguments: tuple[Any, ...], named: dict[str, Any]) -> str | None:
    """What is wrong with a call, by name, from what pybind11 says of it; None if that cannot be told.

    Parameters
    ----------
    message : str
        pybind11's: "name(): incompatible ...", with one signature on a line of its own.
    arguments : tuple
        With the object itself first, if it is a method.
    named : dict
    """
    name, _, rest = message.partition("(): incompatible ")
    signatures = re.findall(r"^    \d+\. (.*)$", rest.partition("\n\nInvoked with")[0], flags=re.MULTILINE)
    if len(signatures) != 1:
        return None
    signature = signatures[0].rpartition(" -> ")[0] or signatures[0]
    owner, _, listed = signature.partition("(")
    try:
        definition = ast.parse(f"def _({listed}: ...").body[0]
    except SyntaxError:
        return None
    if not isinstance(definition, ast.FunctionDef) or definition.args.vararg or definition.args.kwarg:
        return None
    parameters = definition.args
    if owner:  # a constructor, whose object is not listed
        name, arguments = owner.rpartition(".")[2], arguments[1:]
    elif parameters.args and parameters.args[0].arg == "self" and parameters.args[0].annotation is not None:
        name = f"{ast.unparse(parameters.args[0].annotation).rpartition('.')[2]}.{name}"
    return _wrong_names(name, parameters, arguments, named) or _wrong_type(name, parameters, arguments, named)


def _wrong_names(name: str, parameters: ast.arguments, arguments: tuple[Any, ...], named: dict[str, Any]) -> str | None:
    """Arguments that are too many, unknown, given twice or missing."""
    places = [parameter.arg for parameter in parameters.args]
    by_name = [parameter.arg for parameter in parameters.kwonlyargs]
    known = [one for one in (*places, *by_name) if one != "self"]
    if len(arguments) > len(places):
        need = f"; {_listed(by_name)} must be named" if by_name else ""
        counted = [one for one in places if one != "self"]
        most, given = len(counted), len(arguments) - len(places) + len(counted)
        takes = f"at most {most} argument{'s' * (most != 1)} without a name" if known else "no argument"
        return f"{name}() takes {takes}, not {given}{need}"
    for key in named:
        if key not in known:
            near = difflib.get_close_matches(key, known, 1)
            hint = f"; did you mean {near[0]}?" if near else f"; it has {_listed(known)}" if known else ""
            return f"{name}() has no argument {key}{hint}"
    for key in named:
        if key in places[: len(arguments)]:
            return f"{name}(): {key} is given twice, by its place and by its name"
    needed = places[: len(places) - len(parameters.defaults)][len(arguments) :]
    needed += [key for key, default in zip(by_name, parameters.kw_defaults, strict=True) if default is None]
    missing = [key for key in needed if key not in named]
    return f"{name}() needs the argument{'s' * (len(missing) > 1)} {_listed(missing)}" if missing else None


def _wrong_type(name: str, parameters: ast.arguments, arguments: tuple[Any, ...], named: dict[str, Any]) -> str | None:
    """The first argument whose type is not that of the signature."""
    places = [parameter.arg for parameter in parameters.args]
    values = dict(zip(places, arguments, strict=False)) | named
    for parameter in (*parameters.args, *parameters.kwonlyargs):
        kind = "object" if parameter.annotation is None else ast.unparse(parameter.annotation)
        if parameter.arg not in values or kind == "object":
            continue
        value, needed = values[parameter.arg], kind.removesuffix(" | None")
        if needed == _NUMBER and hasattr(value, "__index__"):
            return f"{name}(): {parameter.arg} is too large an integer: {value!r}" if _is_long(value) else None
        element = re.fullmatch(r"collections\.abc\.(Sequence|Iterable)(?:\[(.*)\])?", needed)
        if element is not None and isinstance(value, list | tuple):
            wrong = next((one for one in value if not _fits(one, element[2] or "object")), None)
            if wrong is not None:
                return f"{name}(): {parameter.arg} must hold {_word(element[2])}, not {type(wrong).__name__}"
        elif not _fits(value, needed):
            or_none = " or None" if needed != kind else ""
            return f"{name}(): {parameter.arg} must be {_word(needed)}{or_none}, not {type(value).__name__}"
    return None


def _fits(value: Any, kind: str) -> bool:
    """Whether a value has a type that a signature names."""
    if kind == _NUMBER:
        return hasattr(value, "__index__")
    if kind == "bool":
        return value is None or hasattr(value, "__bool__")
    return kind == "object" or kind.rpartition(".")[2] in (one.__name__ for one in type(value).__mro__)


def _is_long(value: Any) -> bool:
    return not -(2**31) <= value.__index__() < 2**31


def _word(kind: str) -> str:
    """A type of a signature in words."""
    if kind in _SIMPLE:
        return _SIMPLE[kind]
    if kind.startswith("collections.abc."):
        return "a sequence"
    name = kind.rpartition(".")[2]
    return f"{'an' if name[0] in 'AEIOU' else 'a'} {name}"


def _listed(names: list[str]) -> str:
    return " and ".join([", ".join(names[:-1])] * (len(names) > 1) + names[-1:])


def _shown(thing: Any) -> str:
    """One line for an object: its name and its properties, in short; of a shape that is a ball the radius."""
    parts = []
    for name, attribute in vars(type(thing)).items():
        if isinstance(attribute, property) and (said := _shown_value(getattr(thing, name))):
            parts.append(f"{name} {said}")
    return f"<{type(thing).__name__}: {', '.join(parts)}>"


def _shown_value(value: Any) -> str:
    """Short, or nothing for what is not there."""
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, int | str):
        return repr(value)
    shape = getattr(value, "shape", None)
    if shape == (3, 3):
        rows, square = value.tolist(), float(value[0, 0])
        is_ball = rows == [[square if i == j else 0.0 for j in range(3)] for i in range(3)]
        return f"{sqrt(square):.6g}" if is_ball else "an ellipsoid"
    if shape == (3,):
        return f"[{', '.join(f'{float(one):.4g}' for one in value)}]"
    return type(value).__name__
