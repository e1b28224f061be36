"""The truth behind recordings, by formulas of its own: how bodies move, and the Earth's field."""
