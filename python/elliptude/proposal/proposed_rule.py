"""Proposes a rule to start from: the numbers that the guaranteed mode needs, as far as a recording shows them.

A recording shows some numbers in full: with a reference attitude the error of a vector is visible. It shows others
in part: without a reference only the length of a vector, and of the gyro only what it does at rest. A number seen in
full is proposed, times the margin. A number seen in part never makes the bound smaller than in the rule for how the
sensor is carried (`elliptude.configuration.rules.rule_for`), which has reasons of its own. None is a guarantee.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import tomlkit

from elliptude.bounds.gyro import TIMES_USUAL
from elliptude.configuration import rules
from elliptude.configuration.rules import Carried
from elliptude.proposal.delays import DelayProposal
from elliptude.proposal.proposals import Proposal, StartProposal
from elliptude.proposal.starting.document import Once
from elliptude.proposal.statistics import Quantiles

_DEGREES = math.degrees(1.0)
# An increment with a reference is compared with the noise over this window, s.
_SHORTEST_WINDOW_S = 1.0
_LARGEST_SCALE_ERROR = 0.99
# s; a piece of a recording that is looked at as a whole.
_SHORTEST_REST_S = 0.5
# m/s²; the offset of an axis that datasheets of small sensors state at most.
_UNCALIBRATED = 0.8
_GRAVITY = "gravity_m_per_s2"
NOT_SEEN = "not seen in the recording"


@dataclass(frozen=True)
class Proposed:
    """A number to start from."""

    value: Any
    how: str
    """Where it comes from, for a comment."""
    reason: str | None = None
    """Why, if it is a number of the rule for how the sensor is carried."""


OwnRest: TypeAlias = Literal["no", "longer", "any"]
RuleTables: TypeAlias = dict[str, dict[str, Proposed]]
"""By table and key of `elliptude.configuration.rules.Rule`."""


def upward(value: float) -> float:
    """Three digits, rounded up."""
    if value == 0.0:
        return 0.0
    scale = 10.0 ** (2 - math.floor(math.log10(value)))
    return float(f"{math.ceil(value * scale - 1e-9) / scale:.3g}")


def in_words(carried: Carried) -> str:
    """What kind of rule a rule is."""
    return "the rule for a sensor in the hand" if carried == "hand" else f"the rule for a sensor on a {carried}"


def rule_tables(
    proposed: Proposal,
    margin: float,
    *,
    from_start: bool = True,
    carried: Carried = "hand",
    own_rest: OwnRest = "no",
) -> RuleTables:
    """A rule to start from; each number says where it comes from.

    Parameters
    ----------
    proposed : Proposal
    margin : float
        The factor for maxima.
    from_start : bool
        Whether bias and field come from the rest at the start, if there is one, or from all rest.
    carried : {"hand", "person", "drone", "car", "boat"}
        How the sensor is carried: it says what the recording does not show.
    own_rest : {"no", "longer", "any"}
        Whether the rest at the start lasts as long as in this recording, and not as in all of its kind: if that is
        longer, or in any case.

    Returns
    -------
    dict
        Tables for `elliptude.configuration.rules.Rule`. Without a magnetometer in the recording there is no table for
        it.
    """
    standard = rules.rule_for(carried).model_dump(mode="json", exclude_none=True, exclude={"carried"})
    if proposed.magnetometer is None:
        del standard["magnetometer"]
    reasons = rules.reasons_for(carried)

    def usual(name: str, key: str, value: Any) -> Proposed:
        reason = reasons[name, key]
        return Proposed(value, f"{NOT_SEEN}: {reason}", reason)

    tables = {name: {key: usual(name, key, value) for key, value in table.items()} for name, table in standard.items()}
    start = proposed.start if from_start else None
    _rest(tables["rest"], proposed)
    _gyro(tables["gyro"], proposed, start, margin)
    if own_rest != "no" and proposed.start is not None:
        _as_long_as_it_is(tables, proposed.start.duration, shorter=own_rest == "any")
    if proposed.accelerometer is not None:
        _accelerometer(tables["accelerometer"], proposed, margin)
    if proposed.magnetometer is not None:
        _magnetometer(tables["magnetometer"], proposed, start, margin)
    return tables


def _rest(table: dict[str, Proposed], proposed: Proposal) -> None:
    """What counts as a rest, where the sensor's noise asks for more than usual."""
    if not proposed.rest_limits:
        return
    for key, name, scale in (
        ("rate_deviation_deg_per_s", "rate_deviation", _DEGREES),
        ("acceleration_deviation_m_per_s2", "acceleration_deviation", 1.0),
    ):
        limit = upward(scale * proposed.rest_limits[name])
        if limit > table[key].value:
            table[key] = Proposed(limit, "no guarantee: five times the noise between samples beside one another")


def own_rest_of(tables: Mapping[str, Any]) -> OwnRest:
    """Whether a shorter rest than usual may do for a recording: where there is no other way to begin.

    Parameters
    ----------
    tables : mapping
        Of a configuration; with two directions each sensor may state its own bounds instead.

    Returns
    -------
    OwnRest
    """
    return "any" if "start" not in tables and len(tables.get("directions", [])) < 2 else "longer"


def _as_long_as_it_is(tables: RuleTables, duration: float, *, shorter: bool) -> None:
    """Let the rest last as long as it does in the recording, if it is long enough for a piece of it."""
    shown = math.floor(100.0 * duration) / 100.0
    usual = tables["rest"]["least_s"].value
    still = Proposed(shown, "no guarantee: how long the sensors show nothing else than a rest")
    if shown > usual:
        tables["rest"]["most_s"] = still
    elif shorter and _SHORTEST_REST_S <= shown < usual:
        tables["rest"]["least_s"] = still
        gyro = tables["gyro"]
        # The bias is the mean over the rest: what else turns in it counts the more, the shorter it is.
        value = upward(gyro["bias_deg_per_s"].value * usual / shown)
        how = f"no guarantee: what counts for {usual:g} s of rest, times {usual:g} / {shown:g}"
        gyro["bias_deg_per_s"] = Proposed(value, how)


def _seen(found: Quantiles | None, what: str, margin: float, standard: Proposed, *, in_full: bool) -> Proposed:
    """A maximum times the margin; if it was only seen in part, the standard number if that is larger."""
    if found is None or found.maximum == 0.0:  # no sensor is without an error
        return standard
    value = upward(margin * found.maximum)
    if in_full or value >= standard.value:
        return Proposed(value, f"no guarantee: maximum of {what}, {found.maximum:.3g}, times {margin:g}")
    how = f"no guarantee: the usual number, as the maximum of {what}, {found.maximum:.3g}, shows a part: "
    return Proposed(standard.value, how + (standard.reason or ""), standard.reason)


def _in_degrees(found: Quantiles | None) -> Quantiles | None:
    if found is None:
        return None
    angles = (found.half, found.ninety, found.ninety_nine, found.ninety_nine_point_nine, found.maximum)
    return Quantiles(found.count, *(_DEGREES * angle for angle in angles))


def _gyro(table: dict[str, Proposed], proposed: Proposal, start: StartProposal | None, margin: float) -> None:
    gyro = proposed.gyro
    noise, sums, unexplained = (_in_degrees(one) for one in (gyro.noise, gyro.sums_rest, gyro.unexplained))
    moved = _in_degrees(gyro.bias_spread if start is None else start.bias_moved)
    noise_what, sums_what = "the rate at rest less the bias", "what the noise adds up to in a phase of rest"
    # With a reference the gyro's errors in motion are visible, too. An angle by which the turn over a second is off
    # is the mean noise, per second.
    in_full = noise is not None and unexplained is not None
    if unexplained is not None:
        what = "what a turn over 1 to 16 s is off against the reference, bias and scale taken out"
        if noise is None or unexplained.maximum / _SHORTEST_WINDOW_S > noise.maximum:
            noise, noise_what = unexplained, what
        if sums is None or unexplained.maximum > sums.maximum:
            sums, sums_what = unexplained, what
    table["noise_deg_per_s"] = _seen(noise, noise_what, margin, table["noise_deg_per_s"], in_full=in_full)
    for key in {"increment_deg", "noise_turn_deg"} & table.keys():
        table[key] = _seen(sums, sums_what, margin, table[key], in_full=in_full)
    since = "its mean over all rest" if start is None else "its mean in the rest at the start"
    table["bias_deg_per_s"] = _seen(
        moved, f"the bias over 0.5 s at rest less {since}", margin, table["bias_deg_per_s"], in_full=False
    )
    table["drift_deg_per_s2"] = Proposed(
        table["drift_deg_per_s2"].value, "no guarantee: what the bias moved is in bias_deg_per_s"
    )
    table["longest_interval_s"] = Proposed(
        upward(gyro.longest_interval),
        "no guarantee: 1.5 times the usual interval between samples, at which the bounds above were seen",
    )
    table["largest_rate_deg_per_s"] = _seen(
        _in_degrees(gyro.speed), "the rate", margin, table["largest_rate_deg_per_s"], in_full=False
    )
    if gyro.scale_error is not None:
        value = min(upward(margin * gyro.scale_error), _LARGEST_SCALE_ERROR)
        how = f"no guarantee: best fit to the reference, {gyro.scale_error:.3g}, times {margin:g}"
        table["scale_error"] = Proposed(value, how)


def _accelerometer(table: dict[str, Proposed], proposed: Proposal, margin: float) -> None:
    vector = proposed.accelerometer
    assert vector is not None
    in_full = vector.vector_rest is not None
    against = "the vector at rest against the reference" if in_full else "its length at rest less gravity"
    single = vector.vector_rest or vector.norm_rest
    table["error_m_per_s2"] = _seen(single, against, margin, table["error_m_per_s2"], in_full=in_full)
    averaged = f"{against}, mean over 0.5 s"
    table["averaged_error_m_per_s2"] = _seen(
        vector.averaged_rest, averaged, margin, table["averaged_error_m_per_s2"], in_full=in_full
    )


def _magnetometer(table: dict[str, Proposed], proposed: Proposal, start: StartProposal | None, margin: float) -> None:
    vector, delay = proposed.magnetometer, proposed.magnetometer_delay
    assert vector is not None
    # Errors that calibration leaves do not show if only the field itself is measured.
    scatter = "a sample at rest less the mean over its 0.5 s"
    table["error_ut"] = _seen(vector.scatter_rest, scatter, margin, table["error_ut"], in_full=False)
    in_full = vector.reference is not None
    if start is not None:
        moved = start.field_moved
        reference = "the one at the start"
    else:
        found = (vector.vector_rest, vector.vector_moving) if in_full else (vector.norm_rest, vector.norm_moving)
        moved = max((one for one in found if one is not None), key=lambda one: one.maximum, default=None)
        reference = "its median at rest"
    what = f"the field less {reference}" if in_full else f"the field's length less that of {reference}"
    table["disturbance_ut"] = _seen(moved, what, margin, table["disturbance_ut"], in_full=in_full)
    if delay is not None:
        table["delay_s"] = Proposed(
            round(delay.delay, 4), "no guarantee: best fit of the field's turning to the gyro's"
        )
        table["time_offset_bound_s"] = Proposed(
            upward(_offset_bound(delay, margin)),
            f"no guarantee: maximum of pieces of 8 s, {delay.scatter:.3g}, and half a row, times {margin:g}",
        )


def _offset_bound(delay: DelayProposal, margin: float) -> float:
    """The scatter over the recording, and half a row, because less cannot be resolved."""
    return margin * (delay.scatter + 0.5 * delay.step)


def numbers_of(tables: RuleTables) -> dict[str, dict[str, Any]]:
    """The tables with the numbers alone."""
    return {name: {key: one.value for key, one in table.items()} for name, table in tables.items()}


def statements_of(tables: RuleTables) -> list[dict[str, Any]]:
    """The numbers that depend on how a sensor is carried, each with where it comes from, for people to check."""
    return [
        {"table": name, "key": key, "value": tables[name][key].value, "how": one.how, "reason": one.reason}
        for name, key in rules.carried_numbers()
        if name in tables and (one := tables[name].get(key)) is not None
    ]


def what_it_says(numbers: dict[str, dict[str, Any]], proposed: Proposal) -> list[str]:
    """How much a rule leaves of accelerometer and magnetometer, in words; above all where that is nothing."""
    lines = []
    motion, gravity = rules.MotionRule.model_validate(numbers["motion"]).bounds(), numbers["accelerometer"][_GRAVITY]
    if proposed.accelerometer is not None:
        # (18.5) and (18.6): 2 v/T with equal weights, 16 p/T² with those of a triangle.
        shortest = min(2.0 * motion.velocity / gravity, 4.0 * math.sqrt(motion.position / gravity))
        longest = np.array([0.5 * max(numbers["motion"]["windows_s"])])
        left = min(
            float(motion.mean_acceleration_uniform(longest, longest)[0]),
            float(motion.mean_acceleration_triangular(longest, longest)[0]),
        )
        if motion.acceleration >= gravity:
            lines.append(f"Less than {shortest:.2g} s of an accelerometer that moves so say nothing about up.")
        if left < gravity:
            angle = math.degrees(math.asin(left / gravity))
            lines.append(
                f"Over {2.0 * longest[0]:g} s the motion leaves up within {angle:.2g} degrees; errors of the sensors "
                "come on top."
            )
        else:
            lines.append("No window is long enough for such a motion: the accelerometer says nothing about up.")
        if (averaged := numbers["accelerometer"]["averaged_error_m_per_s2"]) < _UNCALIBRATED:
            lines.append(
                f"averaged_error_m_per_s2 = {averaged:.2g} is of an accelerometer whose offset was calibrated: "
                "datasheets state up to 80 mg, 0.8 m/s^2, for an axis."
            )
    field = proposed.magnetometer
    if field is not None:
        share = numbers["magnetometer"]["disturbance_ut"] / field.magnitude
        if share >= 1.0:
            lines.append(
                "The magnetometer says nothing: the disturbance may be as large as the field, "
                f"{field.magnitude:.3g} µT."
                + ("" if 20.0 <= field.magnitude <= 70.0 else " The Earth's is 20 to 70 µT: is the unit right?")
            )
        else:
            lines.append(
                f"The disturbance alone may turn the field by {math.degrees(math.asin(share)):.2g} degrees, and the "
                "heading by more: the horizontal part of the field alone counts for it."
            )
    return lines


def between_samples(proposed: Proposal, carried: Carried) -> list[str]:
    """That the usual noise does not hold for samples as far apart as these, in words; empty where it does."""
    step, most = proposed.gyro.longest_interval / TIMES_USUAL, rules.rule_for(carried).gyro.longest_interval_s
    if most is None or not step > most:
        return []
    return [
        f"The gyro's samples are {1e3 * step:.3g} ms apart. The noise in {in_words(carried)} is for steps of up to "
        f"{1e3 * most:.3g} ms: what the rate does between samples further apart is not in it. Fewer than "
        f"{math.ceil(1.0 / most)} samples a second need statements of their own, above all noise_deg_per_s."
    ]


def _sections(tables: RuleTables) -> dict[str, tomlkit.items.Table]:
    """The tables as TOML, each number with its comment; a reason that several numbers have stands beside the first."""
    once = Once([one.reason for table in tables.values() for one in table.values() if one.reason])
    result: dict[str, tomlkit.items.Table] = {}
    for name, table in tables.items():
        result[name] = tomlkit.table()
        for key, one in table.items():
            result[name].add(key, one.value)
            result[name][key].comment(once((name, key), one.how))
    return result


def rule_document(proposed: Proposal, margin: float, log: str, carried: Carried) -> tomlkit.TOMLDocument:
    """A rule alone as TOML, proposed from the recording of that name."""
    document = tomlkit.document()
    for line in (
        f"Proposed by `elliptude bounds` from {log}: maxima of that recording, times {margin:g}.",
        "They guarantee nothing about another recording. Replace each number by one for which there is a reason, such",
        "as a datasheet or the size of the room; what the recording could not show is, as marked, that of",
        f"{in_words(carried)}, and what it shows in part alone is not less than that.",
    ):
        document.add(tomlkit.comment(line))
    document.add(tomlkit.nl())
    document.add("bounds_from_recording", log)
    document["bounds_from_recording"].comment("delete this line once there is a reason for each bound")
    if carried != "hand":
        document.add("carried", carried)
    for name, section in _sections(rule_tables(proposed, margin, carried=carried)).items():
        document.add(tomlkit.nl())
        document.add(name, section)
    return document
