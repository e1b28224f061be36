"""The command ``elliptude``.

Each command is a plain function in a module beside this one; here they are put together, and here alone an
error that a person can mend becomes a message. Exit codes: 0 done, 1 a file or what is in it is at fault, 2 the command
line is, 130 interrupted, 143 terminated.
"""

from __future__ import annotations

import signal
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import typer


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
    from elliptude.cli import bounds, check, compare, estimate, report, simulate, validate
    from elliptude.io.files import FileError

    class Group(TyperGroup):
        def invoke(self, ctx: Any) -> Any:
            try:
                return super().invoke(ctx)
            except FileError as error:
                message = str(error)
            except BrokenPipeError:  # `| head` has seen enough; typer ends without a word
                raise
            except OSError as error:
                message = f"{error.filename}: {error.strerror}" if error.filename else str(error)
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

    app.command("scenarios")(simulate.list_scenarios)
    app.command("simulate")(simulate.simulate)
    app.command("estimate")(estimate.estimate)
    app.command("check")(check.check)
    app.command("convert")(check.convert)
    app.command("demo")(estimate.demo)
    app.command("validate")(validate.validate)
    app.command("bounds")(bounds.bounds)
    app.command("compare")(compare.compare)
    app.command("report")(report.make_report)
    return app


def main() -> None:
    """Run the command line; what `pip` installs as ``elliptude``."""
    # As an exception, so that temporary files are removed; by itself it would end the program at once.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        app = make_app()
    except ModuleNotFoundError as error:
        sys.exit(
            f"elliptude: the command line needs {error.name}, which is not installed: pip install 'elliptude[cli]'"
        )
    except KeyboardInterrupt:  # from here on typer takes care of it
        sys.exit(130)
    app()
