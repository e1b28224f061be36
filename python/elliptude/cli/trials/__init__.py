"""Commands that simulate many runs: ``elliptude validate`` and ``elliptude campaign``."""
