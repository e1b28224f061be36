"""What the guaranteed filter is given: where it begins, and row by row."""
