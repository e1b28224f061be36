"""Commands that judge attitudes: ``elliptude compare`` and ``elliptude monitor``."""
