"""The command ``elliptude``."""

from elliptude.cli.application import main, make_app

__all__ = ["main", "make_app"]
