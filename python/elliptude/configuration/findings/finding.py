"""What may be wrong, as data, and how it is said.

A finding knows which sensor it is of, which key is stated wrongly, and what would be right. What sensors and keys are
called depends on where somebody states them: in a TOML configuration, by options of a command, by arguments of a
function. `Words` has the words of a configuration, and what is derived from it those of others.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from elliptude.configuration.findings.axes import axes_in_words

Severity: TypeAlias = Literal["error", "warning"]
Kind: TypeAlias = Literal["gyro", "rate", "accelerometer", "magnetometer"]
Value: TypeAlias = str | float | tuple[float, ...]
"""Of a key: a unit, a number, a vector."""


@dataclass(frozen=True)
class Name:
    """A sensor, by its name in the configuration."""

    sensor: str


@dataclass(frozen=True)
class Key:
    """Something that is stated."""

    of: Kind | Literal["time", "rule"]
    name: str


@dataclass(frozen=True)
class Remedy:
    """What would be stated instead, if what is stated is wrong."""

    key: Key
    stated: Value
    meant: Value
    fitting: tuple[str, ...] = ()
    """The units in which what was measured would be as usual, if it is that by which this was found."""


@dataclass(frozen=True)
class Axes:
    """Axes that would fit a sensor."""

    of: Kind
    columns: tuple[str, ...]
    """Of the log, three."""
    matrix: tuple[tuple[float, ...], ...]
    """From the sensor's axes to the body's, left-handed ones too."""


@dataclass(frozen=True)
class TurnedRound:
    """The opposite of what an accelerometer shows."""

    at_rest: Literal["up", "down"]
    """Which way it would then be said to point at rest."""


Said: TypeAlias = "str | Name | Key | Remedy | Axes | TurnedRound | tuple[Said, ...]"
"""A message: text, and between it what each vocabulary says in its own words. An empty one says nothing."""


class Words:
    """What a TOML configuration calls sensors and keys."""

    if_right = (
        "If it is right as it is, say implausible = 'ignore' in the configuration, or --ignore-implausible of estimate"
    )
    """What to do about a contradiction that is none."""
    strength, by_strength = "unit_ut", "in unit_ut"
    """What says how many µT a normalized field of one is."""

    def sensor(self, name: str) -> str:
        """A sensor before what is said of it, by its name in the configuration."""
        return name

    def name(self, name: Name) -> str:
        """A sensor within a sentence."""
        return repr(name.sensor)

    def key(self, key: Key) -> str:
        """What is stated, by its key."""
        tables = {"gyro": "flow.", "rate": "rate.", "rule": "rule."}
        return f"{tables.get(key.of, '')}{key.name}"

    def remedy(self, remedy: Remedy) -> str:
        """What to write, and in which unit what was measured would be as usual."""
        why = f"it would be in {' or '.join(remedy.fitting)}: " if remedy.fitting else ""
        return f"{why}{self.to_state(remedy)}"

    def to_state(self, remedy: Remedy) -> str:
        """What to write."""
        return f"write {self.key(remedy.key)} = {_as_toml(remedy.meant)}{self.of_normalized(remedy)}"

    def of_normalized(self, remedy: Remedy) -> str:
        """What else to say of a normalized field, or to leave out."""
        if remedy.meant == "normalized":
            return f", and {self.by_strength} how many µT 1 is"
        return f", without {self.strength}" if remedy.stated == "normalized" else ""

    def axes(self, axes: Axes) -> str:
        """What to write for axes."""
        return axes_in_words(axes.matrix, axes.columns)

    def turned_round(self, turned: TurnedRound) -> str:
        """What to write for an accelerometer that shows the opposite."""
        return f"at_rest = '{turned.at_rest}'"

    def __call__(self, said: Said) -> str:
        """A message in these words."""
        match said:
            case Name():
                return self.name(said)
            case Key():
                return self.key(said)
            case Remedy():
                return self.remedy(said)
            case Axes():
                return self.axes(said)
            case TurnedRound():
                return self.turned_round(said)
            case tuple():
                return "".join(map(self, said))
        return said


KEYS = Words()
"""Those of a configuration, and of all that is said without others."""


@dataclass(frozen=True, eq=False)
class Finding:
    """A fault, or something that may be one. Two are the same that say the same of a sensor, as sure or not."""

    severity: Severity
    sensor: str
    """Its name in the configuration; empty for what is of none."""
    said: Said

    @property
    def message(self) -> str:
        """What is said of the sensor, in the words of a configuration."""
        return KEYS(self.said)

    def in_words(self, words: Words) -> str:
        """What is said, behind the name of the sensor."""
        return f"{words.sensor(self.sensor)}: {words(self.said)}" if self.sensor else words(self.said)

    def __str__(self) -> str:
        """What is said, in the words of a configuration."""
        return self.in_words(KEYS)

    def __eq__(self, other: object) -> bool:
        """Whether it says the same of the same sensor."""
        return isinstance(other, Finding) and (self.sensor, self.said) == (other.sensor, other.said)

    def __hash__(self) -> int:
        """That of what it says."""
        return hash((self.sensor, self.said))


def _as_toml(value: Value) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    return f"{value:.10g}" if isinstance(value, float) else f"[{', '.join(f'{part:.10g}' for part in value)}]"
