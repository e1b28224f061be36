"""The command ``elliptude bounds``."""

import dataclasses
import json
import shlex
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import tomlkit
import typer
from rich import box
from rich.console import Console
from rich.table import Table

from elliptude.cli.columns import in_words as columns_in_words
from elliptude.cli.columns import state_field, stated_reading, tables_of, words_of
from elliptude.cli.options import LOG_HELP, Force, Repair, quantity
from elliptude.cli.outputs import CONFIGURATION, print_table, require_outputs
from elliptude.cli.progress import steps
from elliptude.configuration.configuration import Configuration
from elliptude.configuration.findings import suspicions
from elliptude.configuration.findings.finding import Finding, Words
from elliptude.configuration.rules import Carried
from elliptude.io.files import FileError, replacing, sentence
from elliptude.io.readers.open import open_log
from elliptude.io.readers.text.dialect import Decimal, Delimiter, Stated
from elliptude.io.spool import NamedFile
from elliptude.io.spool import recording as recording_of
from elliptude.io.toml import validate
from elliptude.logs import body_at_rest, plausibility
from elliptude.logs import log as logs
from elliptude.logs.repair import Survey
from elliptude.proposal import mapping, proposals
from elliptude.proposal.known_formats import AtRest
from elliptude.proposal.mapping import Tables, presets
from elliptude.proposal.proposals import Proposal, Recording
from elliptude.proposal.proposed_rule import (
    RuleTables,
    between_samples,
    in_words,
    numbers_of,
    own_rest_of,
    rule_document,
    rule_tables,
    statements_of,
    what_it_says,
)
from elliptude.proposal.starting.by_sensor import is_up_alone
from elliptude.proposal.starting.configuration import MARGIN, UP_ALONE, Mode, starting_configuration, why_no_rule
from elliptude.proposal.starting.document import Once, statements_in
from elliptude.proposal.summary import lines_of, remarks_on, summarize

_NO_RULE_IN_FREE_FALL = (
    "there is no rule for a spacecraft: in free fall an accelerometer does not show up, and every rule begins with up. "
    "State star tracker, Sun sensor and gyro one by one in a configuration (docs/logs.md), each with the bound of its "
    "datasheet"
)
_NOTE = (
    "These are quantiles and maxima of one recording. They are no guarantee: another recording, or the next minute of "
    "this one, may exceed any of them. A bound to rely on needs a reason, such as a datasheet or the size of the room."
)

_DELIMITERS: dict[str, Delimiter] = {"comma": ",", "semicolon": ";", "tab": "\t", "blank": " ", "bar": "|"}
_DECIMALS: dict[str, Decimal] = {"point": ".", "comma": ","}
_INDENT = 6 * " "


def _stated(
    delimiter: str | None, decimal: str | None, packet_rate_hz: float | None, row_rate_hz: float | None
) -> Stated:
    """What the options say of how the file is to be read."""
    return Stated(
        None if delimiter is None else _DELIMITERS[delimiter],
        None if decimal is None else _DECIMALS[decimal],
        packet_rate_hz=packet_rate_hz,
        row_rate_hz=row_rate_hz,
    )


def bounds(
    log: Annotated[
        Path, typer.Argument(help=f"A recording, in any format of docs/logs.md; {LOG_HELP}", show_default=False)
    ],
    config: Annotated[
        Path | None,
        typer.Argument(help="Which columns are which sensors: TOML; bounds may be missing.", show_default=False),
    ] = None,
    like: Annotated[
        str | None,
        typer.Option(help=f"Columns and units of a known kind of file: {', '.join(presets())}.", show_default=False),
    ] = None,
    time: Annotated[str | None, typer.Option(help="Column of times.", show_default=False)] = None,
    time_unit: Annotated[
        str | None, typer.Option(help="s, ms, 0.1ms, us or ns; s if left out.", show_default=False)
    ] = None,
    gyro: Annotated[str | None, typer.Option(help="Three columns, separated by commas.", show_default=False)] = None,
    gyro_unit: Annotated[str | None, typer.Option(help="rad/s or deg/s.", show_default=False)] = None,
    accelerometer: Annotated[str | None, typer.Option(help="Three columns.", show_default=False)] = None,
    accelerometer_unit: Annotated[str | None, typer.Option(help="m/s^2, g or mg.", show_default=False)] = None,
    at_rest: Annotated[
        AtRest | None,
        typer.Option(
            help="Where the accelerometer points at rest, with columns by name or --like; up if left out and the file "
            "does not say otherwise. Some drivers report the opposite.",
            show_default=False,
        ),
    ] = None,
    magnetometer: Annotated[str | None, typer.Option(help="Three columns.", show_default=False)] = None,
    magnetometer_unit: Annotated[
        str | None, typer.Option(help="T, mT, G, mG, uT, nT, normalized.", show_default=False)
    ] = None,
    field_ut: Annotated[
        float | None,
        quantity(
            "How many µT the unit of a normalized magnetometer is, at least.",
            least=1.0,
            greatest=1000.0,
            show_default=False,
        ),
    ] = None,
    truth: Annotated[
        str | None, typer.Option(help="Four columns qw,qx,qy,qz from body to reference axes.", show_default=False)
    ] = None,
    reference: Annotated[
        bool,
        typer.Option("--reference/--no-reference", help="Compare with the reference attitude, if there is one."),
    ] = True,
    mode: Annotated[
        Mode | None,
        typer.Option(
            help="Mode of what --out writes. If left out, that of the configuration, else guaranteed, whose sets hold "
            "if the stated bounds do, and which says where these are contradicted; first_order drops second-order "
            "terms.",
            show_default=False,
        ),
    ] = None,
    carried: Annotated[
        Literal["hand", "person", "drone", "car", "boat", "spacecraft"],
        typer.Option(help="How the sensor is carried: it says, with a reason for each, what a recording cannot show."),
    ] = "hand",
    margin: Annotated[float, quantity("Factor for maxima in what is written.", least=1.0, greatest=100.0)] = MARGIN,
    out: Annotated[
        Path | None, typer.Option(help="Write a whole configuration to start from: TOML.", show_default=False)
    ] = None,
    rule: Annotated[
        Path | None, typer.Option(help="Write a rule for bounds to start from: TOML.", show_default=False)
    ] = None,
    repair: Repair = False,
    delimiter: Annotated[
        Literal["comma", "semicolon", "tab", "blank", "bar"] | None,
        typer.Option(help="What separates the columns of a CSV file, if two readings fit.", show_default=False),
    ] = None,
    decimal: Annotated[
        Literal["point", "comma"] | None,
        typer.Option(help="The decimal mark of a CSV file, if two readings fit.", show_default=False),
    ] = None,
    packet_rate_hz: Annotated[
        float | None,
        quantity(
            "How many packets of Xsens' PacketCounter there are in a second, if the file does not say it.",
            least=1.0,
            greatest=10_000.0,
            show_default=False,
        ),
    ] = None,
    row_rate_hz: Annotated[
        float | None,
        quantity(
            "How many rows there are in a second, in the place of --time, of a file that has no times.",
            least=1.0,
            greatest=1e6,
            show_default=False,
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
    force: Force = False,
) -> None:
    """Propose bounds, delays and time offsets from a recording, with or without a reference attitude.

    A configuration, --like, options that name columns and units, or the file's header say which columns are which
    sensors, in which units; a header states sensor, axis and unit, such as "Gyroscope X (deg/s)". The command prints
    quantiles and maxima of this recording, which guarantee nothing about another.
    """
    if carried == "spacecraft":
        raise typer.BadParameter(_NO_RULE_IN_FREE_FALL, param_hint="--carried")
    _require_outputs(out, rule, force=force, read=[log, config])
    source = recording_of(log)
    named = {"gyroscope": (gyro, gyro_unit), "accelerometer": (accelerometer, accelerometer_unit)}
    named["magnetometer"] = magnetometer, magnetometer_unit
    stated = _stated(delimiter, decimal, packet_rate_hz, row_rate_hz)
    tables, stated_in = tables_of(source, config, like, time, time_unit, named, truth, stated, at_rest)
    state_field(tables, field_ut, config)
    if carried != "hand" and "rule" in tables:
        raise typer.BadParameter("the configuration's [rule] says all bounds", param_hint="--carried")
    if carried != "hand":
        tables["carried"] = carried
    tables = mapping.as_written(tables, open_log(source, stated_reading(tables, stated), lenient=repair), repair=repair)
    configuration = mapping.configuration_of(tables, stated_in)
    carried = configuration.carried or "hand"
    mode = _mode(mode, tables)
    with steps(Console(stderr=True), 4 if configuration.timing.repair else 3) as step:
        repaired, recording, origin = _recorded(source, configuration, step, reference=reference)
        step("Proposing")
        words = words_of(config, named)
        with _naming(source, configuration, words):
            proposed = proposals.propose(recording)
        document, starting = None, None
        with suppress(*[FileError] if out is None else []):  # what is not written need not be there
            with _naming(source, configuration, words):
                document = starting_configuration(
                    tables,
                    proposed,
                    margin,
                    mode=mode,
                    log=source.name,
                    origin=origin,
                    shared_stamps=recording.shared_stamps,
                    shared_forces=recording.shared_forces,
                    carried=carried,
                )
            starting = validate(stated_in, document.unwrap(), Configuration)
        step("Looking at the sensors")
        heard = _look(source, configuration, starting, tables, words, refuse=out is not None or rule is not None)
        if out is not None and document is not None:
            _write(out, document)
        if rule is not None:
            _write(rule, rule_document(proposed, margin, source.name, carried))
        ruled = rule_tables(proposed, margin, carried=carried, own_rest=own_rest_of(tables))
        implausible = [one.in_words(words) for one in heard.ignored]
        found = [*_suspicious_in(ruled, recording, carried), *heard.suspicious]
        suspicious = [one.in_words(words) for one in found]
        no_rule, says = None, list[str]()
        if mode == "guaranteed" and "rule" not in tables:
            no_rule = why_no_rule({"estimator": {"mode": mode}} | tables, ruled, proposed, recording.shared_stamps)
            says = [*what_it_says(numbers_of(ruled), proposed), *between_samples(proposed, carried)]
        up = _up_at_rest(recording, origin, proposed.rest_limits or None)
    if as_json:
        summary = {"log": str(source), "note": _NOTE, "margin": margin} | summarize(proposed)
        summary |= {"implausible": implausible, "suspicious": suspicious, "repaired": repaired.to_dict()}
        summary |= {"carried": carried, "statements": _to_check(ruled, no_rule, document), "what_they_say": says}
        summary |= {"why_no_rule": no_rule, "up_at_rest": _up_as_json(up)}
        typer.echo(json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False))
        return
    for line in repaired.lines():
        typer.secho(line, fg=typer.colors.YELLOW)
    _say(source, tables, recording, proposed, up, implausible, suspicious)
    _say_statements(carried, _to_check(ruled, no_rule, document), says)
    _say_no_rule(no_rule, recording, up_alone=is_up_alone(tables))
    typer.echo(_NOTE)
    if out is not None:
        _say_next(source, out, mode, margin)
    if rule is not None:
        typer.echo(f"Written: {rule}, maxima times {margin:g}; {in_words(carried)} where it shows nothing.")


def _require_outputs(out: Path | None, rule: Path | None, *, force: bool, read: list[Path | None]) -> None:
    written = [path for path in (out, rule) if path is not None]
    require_outputs(written, force=force, read=read, endings=dict.fromkeys(written, CONFIGURATION))


def _recorded(
    source: NamedFile, configuration: Configuration, step: Callable[[str], None], *, reference: bool
) -> tuple[Survey, Recording, int]:
    """What was repaired, the recording, and its first time."""
    repaired = Survey()
    if configuration.timing.repair:
        step("Looking for faults")
        repaired = logs.faults_of(source, configuration)
    step("Reading")
    recording, origin = mapping.read_recording(source, configuration)
    return repaired, recording if reference else dataclasses.replace(recording, attitudes=None), origin


def _look(
    log: NamedFile,
    configuration: Configuration,
    starting: Configuration | None,
    tables: Tables,
    words: Words,
    *,
    refuse: bool,
) -> plausibility.Heard:
    """What contradicts between the log and what is proposed for it, as degrees declared as radians, or may.

    Bounds are not written for a log whose turns these bounds rule out. What a sensor shows of gravity or of the field
    is suspicious alone unless its bounds were stated. Where no bounds can be proposed, all that is found is suspicious.
    """
    if starting is None:
        return plausibility.Heard(suspicious=_suspected(log, configuration))
    heard = plausibility.Heard()
    regardless = starting.model_copy(update={"implausible": "ignore"})
    with suppress(FileError):  # a log that cannot be estimated may still show how large its errors are
        next(plausibility.plausible_pieces(logs.read_pieces(log, regardless), regardless, str(log), heard), None)
    bounded = mapping.with_own_bounds(tables)
    proposed = [one for name, one in heard.of_units.items() if one in heard.ignored and name not in bounded]
    ignored = [one for one in heard.ignored if one not in proposed]
    if ignored and refuse and starting.implausible == "refuse":
        raise plausibility.ImplausibleError(str(log), ignored, heard, words)
    return plausibility.Heard(ignored, suspicious=[*proposed, *heard.suspicious])


def _suspicious_in(ruled: RuleTables, recording: Recording, carried: Carried) -> list[Finding]:
    """What is suspicious in a proposed rule, and of how long it is for."""
    numbers, lasted = numbers_of(ruled), float(recording.times[-1] - recording.times[0])
    found = suspicions.of_rule(numbers, stated="proposed", carried=carried)
    return [*found, *suspicions.of_duration(numbers["gyro"], lasted, carried)]


def _suspected(log: NamedFile, configuration: Configuration) -> list[Finding]:
    """What is suspicious in a log of which nothing is stated."""
    with suppress(FileError):
        return plausibility.suspected(logs.read_pieces(log, configuration), configuration)
    return []


@contextmanager
def _naming(log: NamedFile, configuration: Configuration, words: Words) -> Iterator[None]:
    """What cannot be proposed is said of the log, with what is suspicious in it."""
    try:
        yield
    except ValueError as error:
        suspected = [one.in_words(words) for one in _suspected(log, configuration)]
        beside = f"{sentence(str(error))} Suspicious: {'; '.join(suspected)}" if suspected else str(error)
        raise FileError(f"{log}: {beside}") from error


def _mode(mode: Mode | None, tables: Tables) -> Mode:
    """The mode of the option, that of the configuration, or the guaranteed mode."""
    estimator = tables.get("estimator")
    if not isinstance(estimator, dict):
        return mode or "guaranteed"
    stated: Mode = "guaranteed" if estimator.get("mode") == "guaranteed" else "first_order"
    if mode not in {None, stated}:
        raise typer.BadParameter(f"{mode!r}, but the configuration's [estimator] says otherwise", param_hint="--mode")
    return stated


def _up_as_json(up: body_at_rest.UpAtRest | None) -> dict[str, Any] | None:
    return None if up is None else dataclasses.asdict(up) | {"in_words": str(up)}


def _up_at_rest(recording: Recording, origin: float, limits: dict[str, float] | None) -> body_at_rest.UpAtRest | None:
    if recording.specific_forces is None:
        return None
    times = recording.times + origin
    return body_at_rest.up_at_rest(
        times, recording.angular_velocities, recording.specific_forces, recording.fields, limits
    )


# --- what is said -----------------------------------------------------------------------------------------------------


def _say(
    log: NamedFile,
    tables: Tables,
    recording: Recording,
    proposed: Proposal,
    up: body_at_rest.UpAtRest | None,
    implausible: list[str],
    suspicious: list[str],
) -> None:
    """What was read, what it shows, and what is odd in it."""
    compared = "with its reference attitude" if recording.attitudes is not None else "without a reference attitude"
    typer.echo(
        f"{log}: {len(recording.times)} samples of the gyro, {proposed.duration:.4g} s, "
        f"{100.0 * proposed.rest:.3g} % at rest, "
        f"{compared}"
    )
    for line in columns_in_words(tables):
        typer.echo(f"  {line}")
    print_table(_table(proposed))
    for line in remarks_on(proposed):
        typer.echo(line)
    if proposed.no_rest is not None:
        typer.secho(f"No rest: {proposed.no_rest}.", fg=typer.colors.YELLOW)
    if up is not None:
        typer.echo(f"{up}.")
    for one in implausible:
        typer.secho(f"implausible: {one}", fg=typer.colors.RED)
    for one in suspicious:
        typer.secho(f"suspicious: {one}", fg=typer.colors.YELLOW)


def _to_check(ruled: RuleTables, no_rule: str | None, own: tomlkit.TOMLDocument | None) -> list[dict[str, Any]]:
    """What a person must check: numbers of the rule, or of a file in which each sensor states its own."""
    return statements_of(ruled) if no_rule is None or own is None else statements_in(own, statements_of(ruled))


def _say_statements(carried: Carried, statements: list[dict[str, Any]], says: list[str]) -> None:
    """What a person must check: numbers that depend on how the sensor is carried, each with its reason."""
    if not says:
        return
    others = ", ".join(f"--carried {one}" for one in get_args(Carried) if one != carried)
    typer.echo(f"What sets will rest on, by {in_words(carried)} ({others} if it is not); check each number:")
    once = Once([one["reason"] for one in statements if one["reason"] and "in_file" not in one])
    for one in statements:
        value = one["value"]
        numbers = ", ".join(f"{number:g}" for number in value) if isinstance(value, list | tuple) else f"{value:g}"
        typer.echo(f"  {one.get('in_file', one['table'])}.{one['key']} = {numbers}")
        # Below it, not beside it: in a narrow column names of other statements would be cut.
        said = one["how"] if "in_file" in one else once((one["table"], one["key"]), one["reason"] or one["how"])
        typer.echo(textwrap.fill(said, Console().width, initial_indent=_INDENT, subsequent_indent=_INDENT))
    for line in says:
        typer.secho(line, fg=typer.colors.YELLOW)


def _say_no_rule(why: str | None, recording: Recording, *, up_alone: bool) -> None:
    if why is None:
        return
    if up_alone:
        typer.secho(UP_ALONE, fg=typer.colors.YELLOW)
    apart = "" if recording.shared_forces > 0.5 else ": what is not sampled together is not averaged over windows"
    typer.secho(
        f"no rule can describe this recording: {why}. Each sensor states its own bounds, which say less{apart}",
        fg=typer.colors.YELLOW,
    )


def _say_next(log: NamedFile, out: Path, mode: Mode, margin: float) -> None:
    """What was written, and the command that it is for."""
    typer.echo(f"Written: {out}, mode {mode}, maxima times {margin:g}. It is for")
    following = ["estimate", log.argument, "--config", str(out), "--out", "result", "--report", "report.html"]
    typer.echo(f"  elliptude {shlex.join(following)}")


def _table(proposed: Proposal) -> Table:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 0, 0, 1))
    table.add_column("")
    for heading in ("50 %", "90 %", "99 %", "99.9 %", "max"):
        table.add_column(heading, justify="right", no_wrap=True)
    for _, name, factor, found in lines_of(proposed):
        if found is not None:
            numbers = (found.half, found.ninety, found.ninety_nine, found.ninety_nine_point_nine, found.maximum)
            table.add_row(name, *(f"{factor * number:.3g}" for number in numbers))
    return table


# --- what is written --------------------------------------------------------------------------------------------------


def _write(path: Path, document: tomlkit.TOMLDocument) -> None:
    with replacing(path) as temporary:
        temporary.write_text(tomlkit.dumps(document), encoding="utf-8")
