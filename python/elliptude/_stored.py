"""How both filters are stored: as a dictionary, as JSON and by pickle."""

import json
from typing import Any, ClassVar, Self


class Stored:
    """A filter that can be stored as a dictionary or JSON, with the version of the format."""

    FORMAT_VERSION: ClassVar[int]
    """The version of the format that `to_dict` writes."""

    def to_dict(self) -> dict[str, Any]:
        """The whole state of the filter, as numbers, strings, lists and dictionaries."""
        raise NotImplementedError

    @classmethod
    def _made_from(cls, fields: dict[str, Any]) -> Self:
        """The filter from a dictionary of this format; a missing key raises KeyError."""
        raise NotImplementedError

    @classmethod
    def from_dict(cls, fields: dict[str, Any]) -> Self:
        """The inverse of `to_dict`.

        Raises
        ------
        ValueError
            If the format is another, a key is missing, or the numbers are not those of a filter.
        TypeError
            If it is not a dictionary, or a value has another type.
        """
        if not isinstance(fields, dict):
            raise TypeError(f"a stored filter is a dictionary, not {type(fields).__name__}")
        if fields.get("format") != cls.FORMAT_VERSION:
            raise ValueError(f"format is {fields.get('format')!r}, but this version reads {cls.FORMAT_VERSION}")
        try:
            return cls._made_from(fields)
        except KeyError as error:
            raise ValueError(f"a stored filter needs the key {error}") from error

    def to_json(self) -> str:
        """`to_dict` as JSON; floats come back bit for bit."""
        return json.dumps(self.to_dict())

    @classmethod
    def from_json(cls, text: str) -> Self:
        """The inverse of `to_json`."""
        return cls.from_dict(json.loads(text))
