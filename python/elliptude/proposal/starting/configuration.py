"""A whole configuration to start from: the mapping of a log, and bounds proposed from it, with where each comes from.

In the guaranteed mode a rule states the bounds, if a rule can describe the recording; if not, each
sensor states its own. In the mode of first order each direction has one angle. Bounds are what the recording showed,
times a margin, and guarantee nothing about another recording.
"""

import copy
from collections.abc import Mapping
from typing import Literal, TypeAlias

import tomlkit
from pydantic import ValidationError

from elliptude.configuration import rules
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.rules import Carried
from elliptude.proposal.mapping import Tables
from elliptude.proposal.proposals import Proposal
from elliptude.proposal.proposed_rule import (
    NOT_SEEN,
    RuleTables,
    between_samples,
    in_words,
    own_rest_of,
    rule_tables,
)
from elliptude.proposal.starting.by_sensor import ANCHOR_S, Shared, is_up_alone, put_by_sensor, put_first_order
from elliptude.proposal.starting.document import Once, Place, document_of

Mode: TypeAlias = Literal["guaranteed", "first_order"]

# The next recording breaks bounds that one recording showed: what contradicts them is left out and listed.
_ESTIMATOR = {"mode": "guaranteed", "policy": "drop_measurement", "criterion": "trace"}
# Keys of what is tried, or of where a row is: nothing that could be wrong.
_CHOICES = {"windows_s", "at"}
MARGIN = 1.2
"""The factor for maxima, if nothing else is said."""
UP_ALONE = "Up only, no heading: an accelerometer and a gyro say which way is up, and nothing measures where north is."
"""What a reader should know of a configuration with one direction and no rule."""


def starting_configuration(
    tables: Tables,
    proposed: Proposal,
    margin: float,
    *,
    mode: Mode,
    log: str,
    origin: int,
    shared_stamps: float = 1.0,
    shared_forces: float = 1.0,
    carried: Carried = "hand",
) -> tomlkit.TOMLDocument:
    """A configuration for `elliptude estimate`, with comments.

    Parameters
    ----------
    tables : dict
        Tables of `elliptude.proposal.mapping`: which columns are which sensors. Bounds that they have stay.
    proposed : Proposal
    margin : float
        The factor for maxima.
    mode : "guaranteed" or "first_order"
    log : str
        The recording's name.
    origin : int
        What was subtracted from the file's times, s.
    shared_stamps, shared_forces : float
        The share of rows at which all sensors were sampled, and the accelerometer.
    carried : {"hand", "person", "drone", "car", "boat"}
        How the sensor is carried: it says what the recording does not show.

    Returns
    -------
    tomlkit.TOMLDocument

    Raises
    ------
    ValueError
        If there are no two directions to start from, and no accelerometer whose up a gyro can carry; or nothing says
        where the magnetic field points.
    """
    full = copy.deepcopy(tables)
    comments: dict[Place, str] = {}
    if mode == "first_order":
        put_first_order(full, comments, proposed, margin, origin)
        notes = []
    else:
        shared = Shared(shared_stamps, shared_forces)
        notes = _guaranteed(full, comments, proposed, margin, origin, shared, carried)
    if "velocity" in full and not _over_windows(full):
        del full["velocity"]
        notes = [
            *notes,
            "The measured velocity is left out: it counts where forces are averaged over windows.",
        ]
    if any(how.startswith(NOT_SEEN) for how in comments.values()):
        notes = [
            *notes,
            f"What was {NOT_SEEN} is, with its reason, from {in_words(carried)}, unless it says otherwise.",
        ]
    return document_of(full, comments, margin, log, notes, Once(rules.reasons_for(carried).values()))


def _over_windows(full: Tables) -> bool:
    """Whether an accelerometer is averaged over windows."""
    bounds = [sensor.get("bound_from", {}) for sensor in full.get("directions", [])]
    return "rule" in full or any(bound.get("kind") == "velocity_window" for bound in bounds)


def ruled_configuration(tables: Tables, rule: Tables) -> Tables:
    """The tables with a rule that says all bounds, so that nothing is proposed; as they are with one in ``tables``.

    Parameters
    ----------
    tables : dict
        As of `starting_configuration`.
    rule : dict
        The table ``rule`` of a configuration.

    Returns
    -------
    dict
    """
    return copy.deepcopy(tables) | {"estimator": dict(_ESTIMATOR), "rule": {"anchor_s": ANCHOR_S} | rule}


def _guaranteed(
    full: Tables,
    comments: dict[Place, str],
    proposed: Proposal,
    margin: float,
    origin: int,
    shared: Shared,
    carried: Carried,
) -> list[str]:
    """Put in what is missing; returns the comment at the top of the file."""
    if "estimator" not in full:
        full["estimator"] = dict(_ESTIMATOR)
        comments["estimator", "policy"] = "what contradicts the bounds is left out, and listed in dropped.csv"
        comments["estimator", "criterion"] = "sharper headings, and fewer sets lost; no effect on what holds"
    if "rule" in full:
        return ["Its [rule] was there before, and says all bounds."]
    apart = between_samples(proposed, carried)
    table = rule_tables(proposed, margin, carried=carried, own_rest=own_rest_of(full))
    reason = why_no_rule(full, table, proposed, shared.by_all)
    if reason is None:
        _put_rule(full, comments, table, carried)
        return [
            "A [rule] says all bounds, as the recording starts at rest. The frame is ENU; north is magnetic north.",
            "There is no [start]: the recording's own rest is where it starts.",
            *apart,
        ]
    put_by_sensor(full, comments, proposed, margin, origin, shared, carried, reason)
    by_sensor = f"Each sensor states its bounds. A [rule] for the whole recording is not used: {reason}."
    if is_up_alone(full):
        unseen = ", ".join(_not_seen(comments))
        return [by_sensor, UP_ALONE, f"Not seen here, so that each needs a reason: {unseen}.", *apart]
    begins = "There is no [start]: it begins with the first measurements that determine an attitude."
    return [by_sensor, begins, *apart]


def _not_seen(comments: Mapping[Place, str]) -> list[str]:
    """The keys of statements that the recording does not show."""
    unseen = [place for place, how in comments.items() if how.startswith(NOT_SEEN) and place[-1] not in _CHOICES]
    return [".".join(place[-2:]) for place in unseen]


def _stated(table: RuleTables) -> Tables:
    return {"kind": "stated", "anchor_s": ANCHOR_S} | {
        name: {key: one.value for key, one in part.items()} for name, part in table.items()
    }


def _put_rule(full: Tables, comments: dict[Place, str], table: RuleTables, carried: Carried) -> None:
    full["rule"] = _stated(table)
    full.pop("carried", None)  # a rule says it itself
    if carried != "hand":
        full["rule"]["carried"] = carried
        comments["rule", "carried"] = "whose numbers are usual: those that were not seen are of its rule"
    comments["rule", "anchor_s"] = (
        "how often a prediction begins anew: changes how large sets are, not whether they hold"
    )
    for name, part in table.items():
        for key, one in part.items():
            comments["rule", name, key] = one.how


def why_no_rule(full: Tables, table: RuleTables, proposed: Proposal, shared_stamps: float) -> str | None:
    """Why a rule cannot describe a recording.

    Parameters
    ----------
    full : dict
        Tables of a configuration in the guaranteed mode, without a rule.
    table : dict
        The rule.
    proposed : Proposal
    shared_stamps : float
        The share of rows at which all sensors were sampled.

    Returns
    -------
    str, optional
        In words.
    """
    # First, because no rest would mend it: with sensors that began apart, none has samples of all of them at its start.
    if shared_stamps <= 0.5:
        return f"all sensors were sampled together in {100.0 * shared_stamps:.3g} % of the rows alone"
    least = table["rest"]["least_s"].value
    lasted = 0.0 if proposed.start is None else proposed.start.duration
    if lasted < 0.99 * least:
        ended = proposed.no_rest or proposed.rest_ends
        why = "" if ended is None else f"; {ended}"
        return f"the recording starts with a rest of {lasted:.3g} s, and a rule asks for {least:g} s{why}"
    try:
        of_sensors = {key: value for key, value in full.items() if key != "carried"}
        Configuration.model_validate(of_sensors | {"rule": _stated(table)})
    except ValidationError as error:
        return error.errors()[0]["msg"].removeprefix("Value error, ")
    return None
