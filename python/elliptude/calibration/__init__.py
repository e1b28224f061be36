"""What a recording leaves possible of a sensor's parameters: sets, not estimates; docs/theory.md, section 19."""
