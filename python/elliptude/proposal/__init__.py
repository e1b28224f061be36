"""Proposals: what a recording shows of its errors, and a configuration to start from."""
