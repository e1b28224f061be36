"""The command ``elliptude validate --config``: whole recordings within what a configuration states."""

import json
from pathlib import Path
from typing import Any

import typer
from rich.console import Console

from elliptude.campaigns.pieces import Piece
from elliptude.cli.outputs import require_outputs
from elliptude.cli.trials import resumed
from elliptude.configuration.configuration import read_configuration
from elliptude.io.files import FileError, write_json
from elliptude.smoothing import require_guaranteed
from elliptude.validation.recordings import trials
from elliptude.validation.recordings.statements import Stated
from elliptude.validation.recordings.trials import RecordingArguments

_SUMMARY = "summary.json"
# Faults that are printed; all are in the summary.
_MOST_PRINTED = 10


def validate_recordings(
    config: Path,
    out: Path,
    *,
    number: int,
    seed: int,
    smooth: bool,
    keep_worst: Path | None,
    processes: int | None,
    as_json: bool,
    force: bool,
) -> None:
    """Draw recordings that keep what a configuration states, estimate them, and print what became of them."""
    configuration = read_configuration(config)
    try:
        Stated(configuration)
        if smooth:
            require_guaranteed(configuration)
    except (FileError, ValueError) as error:
        raise FileError(f"{config}: {error}") from error
    arguments = RecordingArguments(configuration, number, seed, smooth)
    pieces = [Piece(f"trial {trial}", (arguments, trial)) for trial in range(number)]
    progress, summary_file = out / resumed.PROGRESS, out / _SUMMARY
    require_outputs((progress, summary_file), force=True, folder=out, read=[config])
    done = resumed.begun(progress, arguments.to_dict(), {piece.name for piece in pieces}, force=force)
    out.mkdir(parents=True, exist_ok=True)
    summary_file.unlink(missing_ok=True)
    resumed.run(trials.result_of, pieces, done, arguments.to_dict(), progress, processes, Console(stderr=True))
    summary = trials.summarize(arguments, [done[piece.name] for piece in pieces])
    kept = None if keep_worst is None else trials.keep(arguments, trials.worst_of(summary), keep_worst)
    write_json(summary_file, summary)
    if as_json:
        typer.echo(json.dumps(summary, indent=2, ensure_ascii=False))
    else:
        _say(summary)
        typer.echo(f"{summary_file}" if kept is None else f"{summary_file}\n{kept}")
    if summary["faults"]:
        raise typer.Exit(1)


def _say(summary: dict[str, Any]) -> None:
    total = summary["total"]
    typer.echo(
        f"{summary['trials']} recordings, {total['rows']} rows, {total['unconditional']} with an unconditional set: "
        f"{total['answers']} answers, {total['missing']} more missing, the truth outside of {total['outside']}; "
        f"{total['contradicted']} true measurements called contradictory; {total['failed']} recordings without a result"
    )
    for name, one in summary["answers"].items():
        if (largest := one["largest"]) is not None:
            typer.echo(
                f"  {name}: {one['answers']} answers, {one['outside']} without the truth, largest share "
                f"{largest['share']:.5g} in trial {largest['trial']} at row {largest['row']}"
            )
    if total["implausible"]:
        typer.echo(f"  {total['implausible']} recordings would have been refused as implausible; gone on regardless")
    for fault in summary["faults"][:_MOST_PRINTED]:
        typer.secho(f"  {fault['said']}", fg=typer.colors.RED)
    if len(summary["faults"]) > _MOST_PRINTED:
        typer.echo(f"  and {len(summary['faults']) - _MOST_PRINTED} more")
