"""Bounds of errors: what is known about sensors and motion becomes bounds of angles and turns. Needs only NumPy."""
