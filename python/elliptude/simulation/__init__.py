"""Scenarios and simulated measurements, whose truth is known."""

from elliptude.simulation.simulated import Simulation, measure, simulate, truth

__all__ = ["Simulation", "measure", "simulate", "truth"]
