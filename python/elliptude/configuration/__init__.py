"""Configurations: what an estimation needs, as a TOML file states it."""

from elliptude.configuration.configuration import Configuration, read_configuration

__all__ = ["Configuration", "read_configuration"]
