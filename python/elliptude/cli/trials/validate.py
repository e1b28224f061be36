"""The command ``elliptude validate``."""

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich import box
from rich.console import Console
from rich.table import Table

import elliptude
from elliptude.campaigns.pieces import Piece
from elliptude.cli.options import SummaryAsJson, quantity
from elliptude.cli.outputs import print_table, require_outputs
from elliptude.cli.trials import resumed
from elliptude.cli.trials.validate_recordings import validate_recordings
from elliptude.io.files import write_json
from elliptude.validation import adversary, monte_carlo, tally, trial_kinds
from elliptude.validation.adversary import Case
from elliptude.validation.judge import Mode
from elliptude.validation.monte_carlo import Arguments
from elliptude.validation.questions import combine_questions

_PROGRESS, _SUMMARY, _FIGURE = resumed.PROGRESS, "summary.json", "validation.png"
# In the guaranteed mode none of these may happen.
_FAULTS = ("escapes", "overclaimed", "refused", "failed", "stuck")


def validate(
    out: Annotated[
        Path,
        typer.Option(
            help="Folder for the results; created if missing. An interrupted run with the same arguments goes "
            "on there.",
            show_default=False,
        ),
    ],
    trials: Annotated[
        int,
        typer.Option(
            min=1,
            max=100_000_000,
            help="Runs of the filter for each case: each scenario, set of directions, bound and noise.",
        ),
    ] = 20,
    updates: Annotated[int, typer.Option(min=1, max=10_000, help="Updates in each trial.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all random draws.")] = 0,
    scenario: Annotated[
        Literal["disturbed", "free", "gyro", "orbit", "pendulum", "all"],
        typer.Option(help="; ".join(f"{name}: {what}" for name, what in adversary.DESCRIPTIONS.items()) + "."),
    ] = "all",
    directions: Annotated[
        Literal["two", "three", "five", "all"], typer.Option(help="How many directions are measured.")
    ] = "all",
    bound_deg: Annotated[
        list[float] | None,
        quantity(
            "Bound of a direction's error in degrees, and of the rate's in degrees/s; may be given several times.",
            least=1e-3,
            greatest=60.0,
            show_default="0.1, 1, 7 and 20",
        ),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(
            "--config",
            help="Try whole recordings instead: each trial is a log that keeps all that this configuration of the "
            "guaranteed mode states, and is estimated as by `estimate`. Only --trials, --seed, --smooth, --keep-worst, "
            "--processes, --json and --force go with it.",
            show_default=False,
        ),
    ] = None,
    smooth: Annotated[bool, typer.Option("--smooth", help="With --config: smooth each recording, too.")] = False,
    keep_worst: Annotated[
        Path | None,
        typer.Option(
            help="With --config: folder for the log and the configuration of the worst trial, for `estimate`.",
            show_default=False,
        ),
    ] = None,
    noise: Annotated[
        Literal["inside", "perpendicular", "common", "alternating", "search", "all"],
        typer.Option(
            help="inside: uniform within the bounds. perpendicular, common, alternating: as large as the bounds, each "
            "for itself, all directions alike, or with a sign that changes from update to update. search: errors and "
            "initial state are moved towards leaving the set, from run to run."
        ),
    ] = "all",
    kind: Annotated[
        list[str] | None,
        typer.Option(
            help="honest: all measurements, as they were made; "
            + "; ".join(f"{name}: {kind.tries}" for name, kind in trial_kinds.KINDS.items())
            + ". May be given several times; kinds other than honest are for mode guaranteed, and are not searched.",
            show_default="honest",
        ),
    ] = None,
    mode: Annotated[Mode, typer.Option(help="The estimator that is tried.")] = "guaranteed",
    processes: Annotated[
        int | None,
        typer.Option(min=1, max=1024, help="How many processes run side by side.", show_default="one for each core"),
    ] = None,
    as_json: SummaryAsJson = False,
    force: Annotated[
        bool, typer.Option("--force", help="Start over, although the folder has another validation.")
    ] = False,
) -> None:
    """Try to drive the truth out of the sets, with errors that keep their bounds.

    Prints for each case how many updates were judged, how often the truth had left the set, the largest value of its
    form (the edge is at 1), how often the prediction went into the set, and the mean trace and volume radius against
    those of mode paper and of the measurements alone on the same data; for other kinds than honest, what the sets
    claim, and how many updates the recovery from a liar took. In mode guaranteed the filter is also asked each question
    that it answers: a table has how often the truth was outside the answer, and how far it went towards its end.
    Writes summary.json and a figure.

    The exit code is 1 if the guaranteed mode lost the truth, gave a wrong answer, took true measurements for
    contradictory, gave up, or did not recover from a liar.
    """
    if config is not None:
        validate_recordings(
            config,
            out,
            number=trials,
            seed=seed,
            smooth=smooth,
            keep_worst=keep_worst,
            processes=processes,
            as_json=as_json,
            force=force,
        )
        return
    if smooth or keep_worst is not None:
        raise typer.BadParameter("is for recordings, with --config", param_hint="--smooth / --keep-worst")
    if mode == "guaranteed" and not hasattr(elliptude, "GuaranteedFilter"):
        raise typer.BadParameter("'guaranteed' is not in this version of elliptude", param_hint="--mode")
    cases = _cases(scenario, directions, bound_deg, noise, kind, mode)
    arguments = Arguments(mode=mode, trials=trials, updates=updates, seed=seed, cases=cases)
    # An interrupted run goes on in the same files; `begun` refuses those of another one.
    require_outputs((out / name for name in (_PROGRESS, _SUMMARY, _FIGURE)), force=True, folder=out)
    chunks = {name: Piece(name, (arguments, case, number)) for name, case, number in monte_carlo.chunks(arguments)}
    done = resumed.begun(out / _PROGRESS, arguments.to_dict(), set(chunks), force=force)
    out.mkdir(parents=True, exist_ok=True)
    # It says that the folder is complete.
    (out / _SUMMARY).unlink(missing_ok=True)
    console = Console(stderr=True)
    begin, before = time.monotonic(), len(done)
    every = list(chunks.values())
    resumed.run(monte_carlo.validate_chunk, every, done, arguments.to_dict(), out / _PROGRESS, processes, console)
    elapsed = time.monotonic() - begin
    summary = monte_carlo.summarize(arguments, done)
    from elliptude.report import figures  # imports Matplotlib, which would slow every command

    figures.save(figures.validation_figure(summary), out / _FIGURE)
    write_json(out / _SUMMARY, summary)
    if as_json:
        typer.echo(json.dumps(summary, indent=2, ensure_ascii=False))
    else:
        for table, is_honest in ((_table, True), (_table_of_kinds, False)):
            shown = [case for case in summary["cases"] if (case["kind"] == "honest") == is_honest]
            if shown:
                print_table(table(shown))
        if "questions" in summary["total"]:
            print_table(_table_of_questions(summary))
        _print_total(summary)
        if before == 0:
            typer.echo(f"{summary['total']['updates'] / elapsed:.0f} updates a second")
        typer.echo(f"{out / _SUMMARY}\n{out / _FIGURE}")
    total = summary["total"]
    if mode == "guaranteed" and sum(total[name] for name in _FAULTS) + _wrong_answers(total) > 0:
        raise typer.Exit(1)


def _cases(
    scenario: str,
    directions: str,
    bound_deg: list[float] | None,
    noise: adversary.Noise | Literal["all"],
    kind: list[str] | None,
    mode: Mode,
) -> tuple[Case, ...]:
    """What is tried, by the options of these names."""
    bounds = adversary.BOUNDS_DEG if bound_deg is None else tuple(dict.fromkeys(bound_deg))
    every_kind = ("honest", *trial_kinds.KINDS)
    for name in kind or ():
        if name not in (*every_kind, "all"):
            raise typer.BadParameter(f"{name!r} is none of {', '.join(every_kind)}, all", param_hint="--kind")
    kinds = every_kind if kind and "all" in kind else tuple(dict.fromkeys(kind or ("honest",)))
    if mode != "guaranteed" and kinds != ("honest",):
        raise typer.BadParameter("only mode guaranteed is tried with other kinds than honest", param_hint="--kind")
    cases = tuple(
        Case(one_scenario, one_set, bound, one_noise, one_kind)
        for one_kind in kinds
        for one_scenario in (adversary.SCENARIOS if scenario == "all" else (scenario,))
        for one_set in (adversary.DIRECTIONS if directions == "all" else (directions,))
        for bound in bounds
        for one_noise in (adversary.NOISES if noise == "all" else (noise,))
        if one_kind == "honest" or (one_scenario in trial_kinds.KINDS[one_kind].scenarios and one_noise != "search")
    )
    if not cases:
        where = ", ".join(f"{name} is of {', '.join(trial_kinds.KINDS[name].scenarios)}" for name in kinds)
        raise typer.BadParameter(f"nothing is left to try: {where}; none is searched", param_hint="--kind")
    return cases


# --- the table --------------------------------------------------------------------------------------------------------


def _new_table(names: tuple[str, ...], figures: tuple[str, ...]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 0, 0, 1))
    for heading in names:
        table.add_column(heading, no_wrap=True)
    for heading in figures:
        table.add_column(heading, justify="right", no_wrap=True)
    return table


def _groups(
    cases: list[dict[str, Any]],
) -> Iterator[tuple[list[dict[str, Any]], dict[str, Any], dict[str, Any] | None]]:
    """Cases that differ in the noise alone, all of them together, and the one with the worst form."""
    groups: dict[tuple[str, str, str, float], list[dict[str, Any]]] = {}
    for case in cases:
        groups.setdefault((case["kind"], case["scenario"], case["directions"], case["bound_deg"]), []).append(case)
    for group in groups.values():
        judged = [case for case in group if case["worst"] is not None]
        yield group, tally.combine(group), max(judged, key=lambda case: case["worst"]["form"], default=None)


def _table_of_kinds(cases: list[dict[str, Any]]) -> Table:
    """A line for each kind, scenario, set of directions and bound, over all noises."""
    counts = ("updates", "unconditional", "conditional", "without_set", *_FAULTS[:4], "misled")
    of_liars = ("liars", "recoveries", "slowest", "stuck")
    headings = (
        "updates",
        "uncond.",
        "cond.",
        "no set",
        "escapes",
        "overcl.",
        "refused",
        "failed",
        "misled",
        "worst form",
    )
    table = _new_table(
        ("kind", "scenario", "directions"), ("bound °", *headings, "liars", "recovered", "within", "stuck")
    )
    for (first, *_), line, worst in _groups(cases):
        table.add_row(
            first["kind"],
            first["scenario"],
            first["directions"],
            f"{first['bound_deg']:g}",
            *(f"{line[name]}" for name in counts),
            "" if worst is None else f"{worst['worst']['form']:.5g}",
            *(f"{line[name]}" if line["recoveries"] + line["stuck"] else "" for name in of_liars),
        )
    return table


def _table(cases: list[dict[str, Any]]) -> Table:
    """A line for each scenario, set of directions and bound, over all noises."""
    headings = ("bound °", "updates", "escapes", "refused", "no set", "failed", "worst form", "noise", "used %")
    table = _new_table(("scenario", "directions"), (*headings, "trace/paper", "/alone", "radius/paper", "/alone"))
    for (first, *_), line, worst in _groups(cases):
        table.add_row(
            first["scenario"],
            first["directions"],
            f"{first['bound_deg']:g}",
            *(f"{line[name]}" for name in ("updates", "escapes", "refused", "without_set", "failed")),
            "" if worst is None else f"{worst['worst']['form']:.5g}",
            "" if worst is None else worst["noise"],
            f"{100.0 * line['used'] / line['predictions']:.1f}" if line["predictions"] else "",
            *(_ratio(line["sizes"], size, to) for size in ("trace", "volume_radius") for to in ("paper", "measured")),
        )
    return table


def _table_of_questions(summary: dict[str, Any]) -> Table:
    """A line for each question, with the largest share in each scenario, over all else."""
    scenarios = list(dict.fromkeys(case["scenario"] for case in summary["cases"]))
    table = _new_table(("question",), ("answers", "escapes", *(f"share in {name}" for name in scenarios)))
    of_scenarios = [
        combine_questions([case["questions"] for case in summary["cases"] if case["scenario"] == name])
        for name in scenarios
    ]
    for question, counted in summary["total"]["questions"].items():
        largest = [asked[question]["largest"] if question in asked else None for asked in of_scenarios]
        shares = ("" if one is None else f"{one['share']:.5g}" for one in largest)
        table.add_row(question, f"{counted['updates']}", f"{counted['escapes']}", *shares)
    return table


def _wrong_answers(total: dict[str, Any]) -> int:
    return sum(counted["escapes"] for counted in total.get("questions", {}).values())


def _ratio(sizes: dict[str, Any], size: str, to: str) -> str:
    if to not in sizes:
        return ""
    return f"{sizes['own'][size] / sizes[to][size]:.3g}"


def _print_total(summary: dict[str, Any]) -> None:
    total = summary["total"]
    worst = total["worst_form"]
    typer.echo(
        f"\nMode {summary['mode']}: {total['updates']} updates, the truth outside at {total['escapes']}, "
        f"largest form {'not known' if worst is None else f'{worst:.6g}'}; "
        f"{total['refused']} refused, {total['without_set']} without a set, {total['failed']} failed."
    )
    if "questions" in total:
        answers = sum(counted["updates"] for counted in total["questions"].values())
        typer.echo(
            f"{answers} answers to single questions, the truth outside of {_wrong_answers(total)}. Share: how far it "
            "went from the\nmiddle of an answer towards its end, which is at 1."
        )
    kinds = {case["kind"] for case in summary["cases"]}
    if "honest" in kinds:
        typer.echo(
            "Used: the share of the predictions that went into the set. Trace, and radius of the ball of the same\n"
            f"volume: means from the {tally.SETTLED_UPDATE}th update on, against mode paper and the measurements "
            "alone."
        )
    if total["liars"]:
        typer.echo(
            f"{total['liars']} trials with liars, {total['stuck']} not got over within twice regain_after updates of "
            "the first contradiction.\nMisled: unconditional sets without the truth that rest on a lie which nothing "
            "has contradicted yet."
        )
