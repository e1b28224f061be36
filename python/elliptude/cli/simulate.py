"""The commands ``elliptude simulate`` and ``elliptude scenarios``."""

import json
import math
from pathlib import Path
from typing import Annotated, Literal

import tomlkit
import typer
from rich.console import Console
from rich.progress import track

from elliptude import __version__
from elliptude.cli.options import Force, SummaryAsJson, quantity
from elliptude.cli.outputs import require_outputs
from elliptude.io import column_files
from elliptude.io.files import FileError, replacing, write_json
from elliptude.simulation import scenarios
from elliptude.simulation import simulated as simulation
from elliptude.simulation.configured import configuration_tables
from elliptude.simulation.scenarios import Scenario


def simulate(
    scenario: Annotated[
        str, typer.Argument(help="A built-in scenario's name, or your own file *.toml.", show_default=False)
    ],
    out: Annotated[Path, typer.Option(help="Folder for the files; created if missing.", show_default=False)],
    seed: Annotated[int, typer.Option(min=0, help="The first seed of the errors.")] = 0,
    seeds: Annotated[
        int, typer.Option(min=1, max=1_000_000, help="How many seeds; each makes a table of its own.")
    ] = 1,
    noise: Annotated[
        simulation.Noise,
        typer.Option(
            help="inside: uniform within the bounds. perpendicular: each direction turned by its bound, any way. "
            "common: all directions turned alike, by the bound."
        ),
    ] = "inside",
    bound_deg: Annotated[
        float | None,
        quantity(
            "Bound of a direction's error in degrees, and of the rate's in degrees/s.",
            least=1e-9,
            greatest=90.0,
            show_default="the scenario's first",
        ),
    ] = None,
    directions: Annotated[
        str | None,
        typer.Option(help="Name of one of the scenario's sets of directions.", show_default="the scenario's first"),
    ] = None,
    format: Annotated[Literal["csv", "parquet"], typer.Option(help="Format of the tables.")] = "csv",  # noqa: A002
    as_json: SummaryAsJson = False,
    force: Force = False,
) -> None:
    """Simulate measurements of a true motion, with errors within bounds.

    Writes a table of measurements with the truth beside them, for each seed; estimate.toml, the configuration to
    estimate from them; and, last, summary.json.
    """
    chosen = _scenario(scenario)
    if directions is not None and directions not in chosen.directions:
        raise typer.BadParameter(
            f"{directions!r} is not one of {', '.join(chosen.directions)}", param_hint="--directions"
        )

    all_seeds = range(seed, seed + seeds)
    files = {n: f"measurements{f'_seed{n}' if seeds > 1 else ''}.{format}" for n in all_seeds}
    summary_file = out / "summary.json"
    written = (out / file for file in (*files.values(), "estimate.toml", summary_file.name))
    require_outputs(written, force=force, folder=out, read=[Path(scenario)])
    out.mkdir(parents=True, exist_ok=True)
    # It says that the folder is complete.
    summary_file.unlink(missing_ok=True)

    console = Console(stderr=True)
    with console.status("Integrating the truth"):
        try:
            truth = simulation.truth(chosen)
        except ArithmeticError as error:
            raise FileError(str(error)) from error
    for n in track(all_seeds, "Measuring", console=console, transient=True, disable=not console.is_terminal):
        last = simulation.measure(chosen, truth, seed=n, directions=directions, bound_deg=bound_deg, noise=noise)
        last.measurements.write(out / files[n])
    with replacing(out / "estimate.toml") as temporary:
        temporary.write_text(tomlkit.dumps(configuration_tables(chosen, last)), encoding="utf-8")
    summary = {
        "elliptude": __version__,
        "table_version": column_files.VERSION,
        "noise": noise,
        "directions": last.directions,
        "direction_bound_rad": last.direction_bound,
        "rate_bound_rad_per_s": last.rate_bound,
        "files": [{"seed": n, "measurements": files[n]} for n in all_seeds],
        "configuration": "estimate.toml",
        "scenario": chosen.model_dump(mode="json"),
    }
    write_json(summary_file, summary)
    if as_json:
        typer.echo(json.dumps(summary, indent=2, ensure_ascii=False))
    else:
        typer.echo(
            f"{chosen.name}: {chosen.measurements} measurements of {len(last.measurements.sensors)} directions "
            f"and the rate, errors {noise} {math.degrees(last.direction_bound):g} degrees"
        )
        for file in (*files.values(), "estimate.toml", summary_file.name):
            typer.echo(f"  {out / file}")


def list_scenarios(
    as_json: Annotated[bool, typer.Option("--json", help="Print them as JSON, with all their keys.")] = False,
) -> None:
    """List the scenarios that are built in."""
    built_in = [scenarios.load(name) for name in scenarios.names()]
    if as_json:
        typer.echo(json.dumps([scenario.model_dump(mode="json") for scenario in built_in], indent=2))
        return
    for scenario in built_in:
        bounds = ", ".join(f"{bound:g}" for bound in scenario.bound_deg)
        typer.echo(f"{scenario.name}: {scenario.description}")
        typer.echo(f"  --directions {' | '.join(scenario.directions)}   --bound-deg {bounds}")


def _scenario(given: str) -> Scenario:
    if not given.endswith(".toml") and given not in scenarios.names():
        raise typer.BadParameter(
            f"no scenario {given!r}; there are {', '.join(scenarios.names())}, and a file of your own ends in .toml",
            param_hint="SCENARIO",
        )
    return scenarios.load(given)
