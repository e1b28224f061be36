"""What a gyro's matrix K' does along a turn: the integrals of C K' ω, entry by entry, and what they may be off."""

import numpy as np

from elliptude.bounds.turns import from_the_first, lengths_of
from elliptude.typing import FloatArray


def scale_effects(steps: FloatArray, attitudes: FloatArray, rates: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The running integrals of the matrices that take the entries of K' to C K' ω, and what they may be off, (18.13).

    Parameters
    ----------
    steps : (N - 1,) array
        s.
    attitudes : (N, 3, 3) array
        C, carried with the mean rate of each step.
    rates : (N, 3) array
        rad/s.

    Returns
    -------
    effects : (N, 3, 9) array
    chords : (N,) array
        Bounds of how far C K' ω may be integrated wrongly, for a K' of norm one: on a chord instead of an arc, and with
        one rate for a step in which it is on a line; but for what coning turns C.
    """
    means = 0.5 * (rates[1:] + rates[:-1])
    halves = 0.5 * steps[:, None, None] * (attitudes[1:] + attitudes[:-1])
    in_steps = (halves[:, :, :, None] * means[:, None, None, :]).reshape(-1, 3, 9)
    effects = np.concatenate([np.zeros((1, 3, 9)), np.cumsum(in_steps, axis=0)])
    return effects, from_the_first(chord_errors(steps, rates))


def chord_errors(steps: FloatArray, rates: FloatArray) -> FloatArray:
    """Bounds of ‖∫ C K' ω - h (C₀ + C₁)/2 K' (ω₀ + ω₁)/2‖ in each step, for a K' of norm one, (18.50).

    Parameters
    ----------
    steps : (N - 1,) array
        h, s.
    rates : (N, 3) array
        ω at the ends, on a line between them, rad/s.

    Returns
    -------
    (N - 1,) array
        rad.
    """
    speeds = lengths_of(rates)
    turns, changes = steps * np.maximum(speeds[1:], speeds[:-1]), steps * lengths_of(rates[1:] - rates[:-1])
    errors: FloatArray = turns**3 / 12.0 + changes * turns / 6.0
    return errors


def largest_stretch(matrices: FloatArray) -> FloatArray:
    """Largest singular values of matrices (N, 3, 9); NaN where an entry or its square is not finite."""
    squares = matrices @ matrices.transpose(0, 2, 1)
    missing = np.logical_not(np.isfinite(squares).all(axis=(1, 2)))
    values = np.linalg.eigvalsh(np.where(missing[:, None, None], 0.0, squares))[:, -1]
    return np.where(missing, np.nan, np.sqrt(np.maximum(values, 0.0)))
