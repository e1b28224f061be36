"""The formats of logs, a module a format."""
