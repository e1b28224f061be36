"""Logs written in other formats: as they stand, or as a configuration reads them."""

from elliptude.logs.conversion.convert import convert, convert_measurements
from elliptude.logs.conversion.writers import SUFFIXES

__all__ = ["SUFFIXES", "convert", "convert_measurements"]
