"""Whole recordings within what a configuration states: drawn, estimated as users do it, and judged by their truth."""
