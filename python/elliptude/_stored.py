"""What both filters do to be stored."""

import json
from typing import Any, ClassVar, Self


class Stored:
    """A filter that is stored as a dictionary or JSON, which says of what format it is."""

    FORMAT_VERSION: ClassVar[int]
    """Of what `to_dict` returns."""

    def to_dict(self) -> dict[str, Any]:
        """All that the filter is, as numbers, strings, lists and dictionaries."""
        raise NotImplementedError

    @classmethod
    def _made_from(cls, fields: dict[str, Any]) -> Self:
        """From a dictionary of this format, of which a key may lack."""
        raise NotImplementedError

    @classmethod
    def from_dict(cls, fields: dict[str, Any]) -> Self:
        """The inverse of `to_dict`.

        Raises
        ------
        ValueError
            For another format, a key that lacks, or numbers that make no filter.
        TypeError
            If it is not a dictionary, or holds something of another type.
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
