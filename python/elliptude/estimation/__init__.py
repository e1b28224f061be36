"""Estimation: from a log and a configuration to attitudes with their sets."""

from elliptude.estimation.estimator import Estimation, PieceEstimator, estimate, summarize

__all__ = ["Estimation", "PieceEstimator", "estimate", "summarize"]
