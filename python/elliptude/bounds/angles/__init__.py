"""Angles that people ask for, of sets of attitudes: about axes of the body or the reference; roll, pitch and yaw."""
