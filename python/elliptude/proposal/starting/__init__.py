"""A configuration to start from: as a whole, sensor by sensor, as TOML."""
