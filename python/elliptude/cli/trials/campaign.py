"""The command ``elliptude campaign``."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from elliptude.campaigns import campaign as campaigns
from elliptude.campaigns.plan import read_plan, template
from elliptude.campaigns.store import FILES, PAGE, ROWS, SUMMARY
from elliptude.cli.options import SummaryAsJson
from elliptude.cli.outputs import require_outputs
from elliptude.cli.progress import progress_with_time_left
from elliptude.io.files import FileError

if TYPE_CHECKING:
    import distributed

# How long a scheduler may take to answer, s.
_ANSWERS_WITHIN = 20


def campaign(
    config: Annotated[
        Path | None, typer.Argument(help="What to run, as TOML; --template shows one.", show_default=False)
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for the results; created if missing. An interrupted campaign goes on there.",
            show_default=False,
        ),
    ] = None,
    processes: Annotated[
        int | None,
        typer.Option(
            min=1, max=1024, help="How many processes of this machine work.", show_default="one for each core"
        ),
    ] = None,
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="SCHEDULER",
            help="Let the workers of a Dask cluster work instead: the address of its scheduler, as tcp://host:8786, or "
            "its scheduler file *.json.",
            show_default=False,
        ),
    ] = None,
    show_template: Annotated[
        bool, typer.Option("--template", help="Print a configuration to start from, and do nothing else.")
    ] = False,
    as_json: SummaryAsJson = False,
) -> None:
    """Run scenarios with many settings and seeds, on all cores or on a cluster, and store what each run gave.

    Writes a row for each update or run as Parquet files in FOLDER/rows, block by block, and last summary.json and
    summary.html: escapes, widths of the sets and cost. The same command goes on after an interruption of any kind. The
    numbers do not depend on who works.

    The exit code is 1 if the guaranteed mode lost the truth, took true measurements for contradictory, or gave up; and
    if parts of the work failed, after all others are done.
    """
    if show_template:
        typer.echo(template(), nl=False)
        return
    if config is None or out is None:
        raise typer.BadParameter(
            "a configuration and --out are needed; --template prints a configuration", param_hint="CONFIG"
        )
    if dask is not None and processes is not None:
        raise typer.BadParameter("with --dask the cluster says how many processes work", param_hint="--processes")
    # Those of a campaign that was begun are replaced, if it is this one.
    require_outputs((out / name for name in FILES), force=True, folder=out, read=[config])
    plan = read_plan(config)
    with (
        _workers(dask) as executor,
        progress_with_time_left(Console(stderr=True)) as progress,
    ):
        task = progress.add_task("Running", total=None)
        summary = campaigns.campaign(
            plan,
            out,
            executor=executor,
            processes=processes,
            progress=lambda done, total: progress.update(task, completed=done, total=total),
        )
    if as_json:
        typer.echo(json.dumps(summary, indent=2, ensure_ascii=False))
    else:
        _print(summary, out)
    if summary["faults_of_guaranteed_mode"]:
        raise typer.Exit(1)


@contextmanager
def _workers(dask: str | None) -> Iterator["distributed.Client | None"]:
    """The client of a cluster; None for processes of this machine."""
    if dask is None:
        yield None
        return
    try:
        import distributed
    except ModuleNotFoundError as error:
        raise FileError("--dask needs distributed: pip install 'elliptude[dask]'") from error
    where: dict[str, Any] = {"scheduler_file": dask} if dask.endswith(".json") else {"address": dask}
    if dask.endswith(".json") and not Path(dask).is_file():  # Dask would wait for it for ever
        raise FileError(f"{dask}: no such file")
    new_client: Any = distributed.Client  # has no types
    try:
        client = new_client(**where, timeout=_ANSWERS_WITHIN)
    except (OSError, ValueError, TypeError) as error:
        raise FileError(f"{dask}: no scheduler answers: {error}") from error
    with client:
        yield client


def _print(summary: dict[str, Any], out: Path) -> None:
    cost = summary["cost"]
    for mode, counts in summary["modes"].items():
        typer.echo(
            f"Mode {mode}: {counts['runs']} runs, {counts['updates']} updates, the truth outside at "
            f"{counts['escapes']}; {counts['refused']} refused, {counts['without_set']} without a set, "
            f"{counts['failed']} failed."
        )
    timed = cost["cpu_s_per_million_updates"]
    if timed is not None:
        typer.echo(f"{timed:.3g} s of a processor for a million updates, {cost['bytes_per_row']:.3g} bytes a row")
    typer.echo("\n".join(f"{out / name}" for name in (ROWS, SUMMARY, PAGE)))
