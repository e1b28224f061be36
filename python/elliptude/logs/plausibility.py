"""Checks whether sensors agree with one another: a unit, an order or an axis that is stated wrongly shows.

The checks themselves are in `agreement` and `axes`; here they are put together, for a log piece by piece.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from elliptude.configuration.configuration import Configuration
from elliptude.configuration.findings import suspicions
from elliptude.configuration.findings.finding import KEYS, Finding, Words
from elliptude.configuration.sensors import Accelerometer
from elliptude.io.files import FileError, sentence
from elliptude.logs.agreement.attitudes import reference_attitude
from elliptude.logs.agreement.sizes import OddSize, length_counts, odd_sizes
from elliptude.logs.agreement.turns import Turns, WrongUnit, gyro_against_direction, stuck_gyro
from elliptude.logs.axes.axes_check import look_at_axes
from elliptude.logs.axes.stated import Stated
from elliptude.logs.body_at_rest import UpAtRest, up_in_log
from elliptude.logs.log import Log, joined
from elliptude.logs.signals.saturation import Saturation
from elliptude.logs.signals.silence import Stuck

BLOCK_ROWS = 1 << 18
"""Rows of a long log that are checked together."""


class ImplausibleError(FileError):
    """What contradicts within a log, and what to do if it is right.

    Parameters
    ----------
    name : str
        Name of the log.
    errors : sequence of Finding
    heard : Heard
        Has what is suspicious beside them.
    words : Words
        How they are said.
    """

    def __init__(self, name: str, errors: Sequence[Finding], heard: "Heard", words: Words = KEYS) -> None:
        self.errors = tuple(errors)
        contradicting = sentence("; ".join(error.in_words(words) for error in errors))
        super().__init__(f"{name}: {contradicting}{heard.beside(errors, words)} {words.if_right}")


@dataclass
class Heard:
    """What a check of a log found besides faults, for the reader of the results."""

    ignored: list[Finding] = field(default_factory=list)
    """Errors that ``implausible = "ignore"`` goes on regardless of."""
    notes: list[str] = field(default_factory=list)
    """The same as notes in a table."""
    up: UpAtRest | None = None
    """What was up in the first rest."""
    suspicious: list[Finding] = field(default_factory=list)
    """What may be wrong: sensors that do not fit one another, or that may have been at the end of their range; complete
    when all pieces are passed on."""
    of_units: dict[str, Finding] = field(default_factory=dict)
    """Of all this what would be usual in another unit, in the log or in the configuration, by the sensor's name."""

    stuck: list[Finding] = field(default_factory=list)
    """Sensors that showed the same for long, as far as the log was read."""

    def beside(self, errors: Sequence[Finding] = (), words: Words = KEYS) -> str:
        """What may be why anything else failed, as further sentences with a blank before them; else empty."""
        causes = dict.fromkeys([*self.of_units.values(), *self.stuck])
        others = [one.in_words(words) for one in causes if one not in errors]
        return f" Suspicious: {sentence('; '.join(others))}" if others else ""

    def after(self, message: str, words: Words = KEYS) -> str:
        """A message of what failed, and what may be why."""
        beside = self.beside(words=words)
        return f"{sentence(message)}{beside}" if beside else message


def plausible_pieces(
    pieces: Iterable[Log], configuration: Configuration, name: str, heard: Heard | None = None
) -> Iterator[Log]:
    """Pass the pieces of a log on after `contradictions` has checked them.

    A stated unit, order or axis holds for the whole log. So it is looked at in blocks, each before any of its rows is
    passed on, until one has moved enough to tell; a log of one block is looked at as a whole.

    Parameters
    ----------
    pieces : iterable of Log
    configuration : Configuration
        Its key ``implausible`` may say to go on regardless.
    name : str
        Name of the log, for messages.
    heard : Heard, optional
        Collects what is found.

    Yields
    ------
    Log
        The pieces.

    Raises
    ------
    ImplausibleError
        With all errors that were found, unless the configuration says to ignore them.
    """
    waiting: list[Log] = []
    heard = Heard() if heard is None else heard
    saturation, stuck, stated = Saturation(configuration), Stuck(configuration), Stated(configuration)
    is_told = False
    begin = end = None
    for piece in pieces:
        saturation.add(piece)
        stuck.add(piece)
        if len(piece.times):
            begin, end = piece.times[0] if begin is None else begin, piece.times[-1]
        if is_told:
            yield piece
            continue
        waiting.append(piece)
        if sum(len(part.times) for part in waiting) >= BLOCK_ROWS:
            heard.stuck = stuck.found()
            is_told = _require_plausible(joined(waiting), configuration, stated, name, heard)
            yield from waiting
            waiting = []
    heard.stuck = stuck.found()
    if waiting:
        _require_plausible(joined(waiting), configuration, stated, name, heard)
        yield from waiting
    heard.suspicious += [*saturation.found(), *heard.stuck]
    if begin is not None and end is not None:
        heard.suspicious += suspicions.of_configured_duration(configuration, float(end - begin))


def _require_plausible(log: Log, configuration: Configuration, stated: Stated, name: str, heard: Heard) -> bool:
    """Whether the log has moved enough, or no further check would help."""
    heard.up = heard.up or up_in_log(log, configuration)
    findings, is_told = _look(log, configuration, stated)
    # Of a size it is enough to hear once, and not of each block again.
    findings = [one for one in findings if not isinstance(one, OddSize) or one.sensor not in heard.of_units]
    heard.of_units |= {f"stated of {one.sensor}": one for one in suspicions.of_units(configuration)}
    heard.of_units |= {one.sensor: one for one in reversed(findings) if isinstance(one, OddSize)}
    errors = [finding for finding in findings if finding.severity == "error"]
    # What an accelerometer shows beside gravity turns as it likes: `check` says it, and it means little.
    forces = {sensor.name for sensor in configuration.directions if isinstance(sensor, Accelerometer)}
    means_little = [one for one in findings if one.sensor in forces and not isinstance(one, OddSize)]
    warnings = [one for one in findings if one.severity == "warning" and one not in means_little]
    heard.suspicious += [warning for warning in warnings if warning not in heard.suspicious]
    if not errors:
        return is_told
    if configuration.implausible == "refuse":
        raise ImplausibleError(name, errors, heard)
    heard.ignored += errors
    heard.notes += [f"implausible, and gone on regardless: {error}" for error in errors]
    return True


def suspected(pieces: Iterable[Log], configuration: Configuration) -> list[Finding]:
    """All that may be wrong with the beginning of a log of which hardly anything is stated, so that nothing is sure.

    Parameters
    ----------
    pieces : iterable of Log
    configuration : Configuration
        What its bounds say does not count.

    Returns
    -------
    list of Finding
    """
    heard = Heard()
    regardless = configuration.model_copy(update={"implausible": "ignore"})
    next(plausible_pieces(pieces, regardless, "", heard), None)
    return [*heard.ignored, *heard.suspicious]


def contradictions(log: Log, configuration: Configuration) -> list[Finding]:
    """Check the units, orders and axes of a log's sensors against one another.

    Parameters
    ----------
    log : Log
    configuration : Configuration

    Returns
    -------
    list of Finding
    """
    return _look(log, configuration, Stated(configuration))[0]


def _look(log: Log, configuration: Configuration, stated: Stated) -> tuple[list[Finding], bool]:
    """What was found, causes before what may follow from them, and whether the log has moved enough to tell.

    Slopes and choices of axes suggest what is wrong; an error is only what a proof stands beside: means of the
    direction that differ by more than all that is stated allows.
    """
    stated.rates(log)  # in the first piece of a recording the bias is known
    turns = Turns(log, configuration)
    by_direction = [gyro_against_direction(log, turns, i, configuration) for i in range(len(configuration.directions))]
    statements, sizes = _statements(log, configuration, stated), _sizes(log, configuration, stated)
    found = [_if_sure(finding, log, stated) for finding in by_direction if isinstance(finding, Finding)]
    is_confirmed = "confirmed" in by_direction
    of_unit: list[Finding] = [finding for finding in found if isinstance(finding, WrongUnit)]
    # One that confirms the rate is enough: the others are at fault themselves, or do not stand still in the reference.
    if is_confirmed:
        found = [replace(finding, severity="warning") for finding in found]
    elif of_unit:
        # A rate of another size explains all else that does not turn as it says; axes tried against it show nothing.
        return statements + of_unit + sizes, False
    if not is_confirmed and (stuck := stuck_gyro(log, configuration, stated)) is not None:
        return [*statements, stuck, *sizes], False
    axes = look_at_axes(log, configuration, stated)
    if axes.wrong:
        # What is sure, with what would be right, comes before what a slope only suggests.
        named = {wrong.sensor for wrong in axes.wrong}
        found = [] if named & {"the gyro", "rate"} else [finding for finding in found if finding.sensor not in named]
        found += [Finding("error" if wrong.is_sure else "warning", wrong.sensor, wrong.said) for wrong in axes.wrong]
    found = statements + found + sizes
    if not any(finding.severity == "error" for finding in found):
        attitude = reference_attitude(log, turns, configuration, stated)
        found += [attitude] if attitude is not None else []
    return found, is_confirmed and axes.is_told


def _sizes(log: Log, configuration: Configuration, stated: Stated) -> list[Finding]:
    """Odd sizes of what is measured."""
    return [one if one.is_proved else _if_sure(one, log, stated) for one in odd_sizes(log, configuration)]


def _statements(log: Log, configuration: Configuration, stated: Stated) -> list[Finding]:
    """Odd sizes of what is stated, if the log rules it out."""
    counted = {sensor.name for sensor in configuration.directions if length_counts(sensor, configuration)}
    of_statements = [one for one in suspicions.of_units(configuration) if one.sensor in counted]
    # An infinite one is of another reason: a rest that is missing, or samples further apart than stated.
    proved = [one for one in of_statements if 1.0 < stated.quotient(log, one.sensor) < math.inf]
    return [replace(one, severity="error") for one in proved]


def _if_sure(finding: Finding, log: Log, stated: Stated) -> Finding:
    """The finding, of a direction's name, and a mere warning unless what is stated rules out what the log shows."""
    if finding.severity == "warning" or stated.quotient(log, finding.sensor) > 1.0:
        return finding
    return replace(finding, severity="warning")
