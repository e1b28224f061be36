"""From a file and a configuration to one log in time order, and what is odd in it."""

from elliptude.logs.log import Log, log_of, read_log, read_pieces

__all__ = ["Log", "log_of", "read_log", "read_pieces"]
