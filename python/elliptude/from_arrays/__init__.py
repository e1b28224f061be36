"""Attitudes with their bounds from arrays in memory, by what the commands use."""
