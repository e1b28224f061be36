"""What an estimation is made of, as a TOML file states it."""

from elliptude.configuration.configuration import Configuration, read_configuration

__all__ = ["Configuration", "read_configuration"]
