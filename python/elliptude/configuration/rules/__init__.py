"""Rules for bounds: what is known about a kind of recording, as a TOML file, and what follows for one recording.

A rule states numbers once, for every recording of its kind. ``data/bounds/hand_held.toml`` gives its reasons beside
each; ``car.toml`` and others beside it say what differs where a sensor is carried otherwise. `apply_rule` turns a rule
into a bound of each direction per row. These bounds hold if the rule's statements do.
"""

from elliptude.configuration.rules.apply import RuledRecording, apply_rule
from elliptude.configuration.rules.at_start import (
    MovedFields,
    after_rest,
    field_at_start,
    moved_fields,
    rest_at_start,
)
from elliptude.configuration.rules.carried import carried_numbers, hand_held, read_rule, reasons_for, rule_for
from elliptude.configuration.rules.tables import (
    AccelerometerRule,
    Carried,
    GyroRule,
    MagnetometerRule,
    MotionRule,
    RestRule,
    Rule,
)

__all__ = [
    "AccelerometerRule",
    "Carried",
    "GyroRule",
    "MagnetometerRule",
    "MotionRule",
    "MovedFields",
    "RestRule",
    "Rule",
    "RuledRecording",
    "after_rest",
    "apply_rule",
    "carried_numbers",
    "field_at_start",
    "hand_held",
    "moved_fields",
    "read_rule",
    "reasons_for",
    "rest_at_start",
    "rule_for",
]
