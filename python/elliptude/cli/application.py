"""The command ``elliptude``.

Each command is a plain function in a module beside this one; here they are put together, and here alone an
error that a user can mend becomes a message. Exit codes: 0 done, 1 a file or what is in it is at fault, 2 the command
line is, 130 interrupted, 143 terminated.
"""

from __future__ import annotations

import importlib
import inspect
import io
import re
import signal
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, get_args, get_type_hints

if TYPE_CHECKING:
    import typer


@dataclass(frozen=True)
class Command:
    """A command whose module is imported when it is called: SciPy, pydantic and PyArrow take most of a second."""

    module: str
    function: str
    summary: str
    """The first paragraph of the function's docstring."""

    def load(self, name: str) -> Any:
        """The command with its options, as Typer makes it from the function."""
        import typer

        app = typer.Typer(add_completion=False)
        try:
            module = importlib.import_module(f"elliptude.cli.{self.module}")
        except ModuleNotFoundError as error:
            _exit_for_want_of(error)
        function = getattr(module, self.function)
        # Lines of a docstring end where the source wraps; a terminal wraps paragraphs by itself.
        paragraphs = (inspect.getdoc(function) or "").split("\n\n")
        says = "\n\n".join(" ".join(one.split()) for one in paragraphs)
        app.command(name, cls=_with_named_paths(function), help=says)(function)
        return typer.main.get_command(app)


def _with_named_paths(function: Any) -> Any:
    """Typer's class of a command that refuses an empty path, which would become the current folder."""
    import typer
    from typer.core import TyperCommand

    hints = get_type_hints(function)
    paths = {name for name, hint in hints.items() if Path in (hint, *get_args(hint))}

    class NamedPaths(TyperCommand):
        def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
            given, _, _ = self.make_parser(ctx).parse_args(args=list(args))
            parameters: list[Any] = self.params
            for parameter in parameters:
                if parameter.name in paths and given.get(parameter.name) == "":
                    said = "it is empty, and names no file or folder; . is the current folder"
                    raise typer.BadParameter(said, ctx=ctx, param=parameter)
            return super().parse_args(ctx, args)

    return NamedPaths


COMMANDS = {
    "scenarios": Command("simulate", "list_scenarios", "List the scenarios that are built in."),
    "simulate": Command("simulate", "simulate", "Simulate measurements of a true motion, with errors within bounds."),
    "estimate": Command("estimate", "estimate", "Estimate attitudes and their bounds from a log of measurements."),
    "check": Command(
        "check",
        "check",
        "Look at a log and its configuration: what each sensor measured, and what is or may be wrong.",
    ),
    "convert": Command(
        "check", "convert", "Convert a log to CSV, Parquet or NPZ: as it stands, or as a configuration reads it."
    ),
    "demo": Command(
        "demo",
        "demo",
        "Show the estimator at work: a simulated spacecraft, a simulated pendulum, and an hour of the Fermi "
        "spacecraft.",
    ),
    "validate": Command(
        "trials.validate", "validate", "Try to drive the truth out of the sets, with errors that keep their bounds."
    ),
    "campaign": Command(
        "trials.campaign",
        "campaign",
        "Run scenarios with many settings and seeds, on all cores or on a cluster, and store what each run gave.",
    ),
    "bounds": Command(
        "bounds",
        "bounds",
        "Propose bounds, delays and time offsets from a recording, with or without a reference attitude.",
    ),
    "calibrate": Command(
        "check",
        "calibrate",
        "Find what a recording leaves possible of its sensors' offsets and scales, and write how to correct them.",
    ),
    "compare": Command(
        "judging.compare",
        "compare",
        "Compare results with a reference attitude: containment, error of the center, width of the sets.",
    ),
    "monitor": Command(
        "judging.monitor",
        "monitor",
        "Bound the error of another filter's attitudes, with a proof where they cannot be true.",
    ),
    "report": Command(
        "report",
        "make_report",
        "Make an interactive report of a result: one HTML file that any browser shows without a network.",
    ),
    "view": Command(
        "report",
        "view",
        "Show a result in Rerun, to go through it in time: the body's axes, where they may point, bounds and claims.",
    ),
}
"""In the order in which ``--help`` lists them."""


def _stands_for_a_command() -> None:
    """A stand-in for ``--help``; the command itself is imported when it is called."""


_SAID_OF_OPTIONS = {
    r"^Value error, (.*?)\.?$": r"\1",
    r"^Input should be a valid number.*": "not a number",
    r"^Input should be a valid integer.*": "not a whole number",
    r"^Input should be greater than or equal to (\S+)$": r"must be at least \1",
    r"^Input should be less than or equal to (\S+)$": r"must be at most \1",
    r"^Input should be ": "must be ",
}
"""What pydantic, by which typer reads options, says of a value (patterns), and what that is in other words."""


def option_in_words(said: str) -> str:
    """What is wrong with the value of an option, without the words of a library.

    Parameters
    ----------
    said : str
        By typer.

    Returns
    -------
    str
    """
    for pattern, words in _SAID_OF_OPTIONS.items():
        said = re.sub(pattern, words, said, flags=re.DOTALL)
    return said


def make_app() -> typer.Typer:
    """Put the commands together.

    Returns
    -------
    typer.Typer

    Raises
    ------
    ModuleNotFoundError
        If the extra ``elliptude[cli]`` is not installed.
    """
    # Imported here: the package may be installed without what its command line needs.
    import typer
    from typer.core import TyperGroup

    from elliptude import __version__
    from elliptude.io.files import FileError, require_unicode, system_fault

    class Group(TyperGroup):
        def resolve_command(self, ctx: Any, args: list[str]) -> Any:
            for one in args:
                require_unicode(one)
            name, command, rest = super().resolve_command(ctx, args)
            return name, command and COMMANDS[str(command.name)].load(str(command.name)), rest

        def invoke(self, ctx: Any) -> Any:
            try:
                return super().invoke(ctx)
            except typer.BadParameter as error:  # of a command's options, too: the group calls it
                error.message = option_in_words(error.message)
                raise
            except FileError as error:
                message = str(error)
            except BrokenPipeError:  # `| head` has read enough; typer ends without a message
                raise
            except OSError as error:
                message = f"{error.filename}: {system_fault(error)}" if error.filename else system_fault(error)
            typer.secho(f"error: {message}", err=True, fg=typer.colors.RED)
            raise typer.Exit(1)

    app = typer.Typer(
        cls=Group,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
        help="Attitude estimation with ellipsoidal bounds: simulate measurements, estimate from logs.",
    )

    def print_version(wanted: bool) -> None:
        if wanted:
            typer.echo(__version__)
            raise typer.Exit

    @app.callback()
    def options(
        version: bool = typer.Option(
            False, "--version", callback=print_version, is_eager=True, help="Print the version."
        ),
    ) -> None:
        pass

    for name, command in COMMANDS.items():
        app.command(name, help=command.summary)(_stands_for_a_command)
    return app


def _exit_for_want_of(error: ModuleNotFoundError) -> NoReturn:
    sys.exit(f"elliptude: the command line needs {error.name}, which is not installed: pip install 'elliptude[cli]'")


def main() -> None:
    """Run the command line; what `pip` installs as ``elliptude``."""
    # As an exception, so that temporary files are removed; by itself it would end the program at once.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # None if it is closed
            stream.reconfigure(errors="replace")  # a terminal without ° or µ shows ?
    try:
        app = make_app()
    except ModuleNotFoundError as error:
        _exit_for_want_of(error)
    except KeyboardInterrupt:  # inside, typer handles it
        sys.exit(130)
    app()
