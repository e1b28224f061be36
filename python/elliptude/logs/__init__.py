"""Logs: from a file and a configuration to rows in time order, and checks of them."""

from elliptude.logs.log import Log, log_of, read_log, read_pieces

__all__ = ["Log", "log_of", "read_log", "read_pieces"]
