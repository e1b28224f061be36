"""Which way the axes of a sensor point: what it measured, tried against the gyro in every way round."""
