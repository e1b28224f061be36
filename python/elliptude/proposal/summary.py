"""Prints a proposal: its numbers by name, for people and for JSON, and remarks in words."""

import dataclasses
from typing import Any, NamedTuple

import numpy as np

from elliptude.proposal.gyro import GyroProposal
from elliptude.proposal.proposals import Proposal, StartProposal
from elliptude.proposal.statistics import Quantiles
from elliptude.proposal.vectors import VectorProposal

_DEGREES = float(np.rad2deg(1.0))


class Line(NamedTuple):
    """One number of a proposal."""

    key: str
    """Its name in JSON, with the unit."""
    name: str
    """What it is, in words."""
    factor: float
    """Factor from SI units to the printed unit."""
    found: Quantiles | None
    """None if the recording does not show it."""


def lines_of(proposed: Proposal) -> list[Line]:
    """All numbers of a proposal, in the order in which they are printed."""
    lines = _of_gyro(proposed.gyro)
    if proposed.accelerometer is not None:
        lines += _of_vector("accelerometer", "m_per_s2", "m/s²", proposed.accelerometer)
    if proposed.magnetometer is not None:
        lines += _of_vector("magnetometer", "ut", "µT", proposed.magnetometer)
    dip = "angle between field and specific force at rest, from its median, °"
    lines.append(Line("dip_rest_deg", dip, _DEGREES, proposed.dip))
    if proposed.start is not None:
        lines += _of_start(proposed.start)
    return lines


def _of_gyro(gyro: GyroProposal) -> list[Line]:
    bias, rate = "gyro: bias of 0.5 s at rest, from its mean, °/s", "gyro: rate over 0.05 s, from the reference, °/s"
    unexplained = "gyro: turns over 1 to 16 s, bias and scale taken out, °"
    return [
        Line("gyro_speed_deg_per_s", "gyro: rate, °/s", _DEGREES, gyro.speed),
        Line("gyro_noise_deg_per_s", "gyro: noise at rest, °/s", _DEGREES, gyro.noise),
        Line("gyro_bias_spread_deg_per_s", bias, _DEGREES, gyro.bias_spread),
        Line("gyro_sums_rest_deg", "gyro: what noise adds up to in a rest, °", _DEGREES, gyro.sums_rest),
        Line("gyro_rate_error_deg_per_s", rate, _DEGREES, gyro.rate_error),
        *(
            Line(
                f"gyro_turn_error_{duration:g}s_deg",
                f"gyro: turn over {duration:g} s, from the reference, °",
                _DEGREES,
                angles,
            )
            for duration, angles in gyro.window_angles.items()
        ),
        Line("gyro_unexplained_deg", unexplained, _DEGREES, gyro.unexplained),
    ]


def _of_vector(sensor: str, unit: str, shown: str, vector: VectorProposal) -> list[Line]:
    lines: list[Line] = []
    for state, about, length, whole, angle in (
        ("rest", "at rest", vector.norm_rest, vector.vector_rest, vector.angle_rest),
        ("moving", "moving", vector.norm_moving, vector.vector_moving, vector.angle_moving),
    ):
        lines += [
            Line(f"{sensor}_norm_{state}_{unit}", f"{sensor}: length off, {about}, {shown}", 1.0, length),
            Line(f"{sensor}_vector_{state}_{unit}", f"{sensor}: vector off, {about}, {shown}", 1.0, whole),
            Line(f"{sensor}_angle_{state}_deg", f"{sensor}: angle off, {about}, °", _DEGREES, angle),
        ]
    aligned = f"{sensor}: the same at rest, best turn removed, °"
    averaged = f"{sensor}: mean over 0.5 s off, at rest, {shown}"
    scatter = f"{sensor}: sample from its mean over 0.5 s, at rest, {shown}"
    return [
        *lines,
        Line(f"{sensor}_aligned_rest_deg", aligned, _DEGREES, vector.aligned_rest),
        Line(f"{sensor}_averaged_rest_{unit}", averaged, 1.0, vector.averaged_rest),
        Line(f"{sensor}_scatter_rest_{unit}", scatter, 1.0, vector.scatter_rest),
    ]


def _of_start(start: StartProposal) -> list[Line]:
    bias = "gyro: bias of 0.5 s at rest, from that at the start, °/s"
    field = "magnetometer: off from the start, delay taken out, µT"
    return [
        Line("gyro_bias_moved_deg_per_s", bias, _DEGREES, start.bias_moved),
        Line("magnetometer_field_moved_ut", field, 1.0, start.field_moved),
    ]


def summarize(proposed: Proposal) -> dict[str, Any]:
    """The proposal for JSON: quantiles by key, delays in s; None if the recording does not show it."""
    summary: dict[str, Any] = {"duration_s": proposed.duration, "share_at_rest": proposed.rest}
    bias = proposed.gyro.bias
    summary["gyro_bias_deg_per_s"] = None if bias is None else np.rad2deg(bias).tolist()
    summary["gyro_scale_error"] = proposed.gyro.scale_error
    summary["quantiles"] = {
        key: None
        if found is None
        else {
            "samples": found.count,
            "50%": found.half * factor,
            "90%": found.ninety * factor,
            "99%": found.ninety_nine * factor,
            "99.9%": found.ninety_nine_point_nine * factor,
            "max": found.maximum * factor,
        }
        for key, _, factor, found in lines_of(proposed)
    }
    for key, delay in (("gyro_delay_s", proposed.gyro_delay), ("magnetometer_delay_s", proposed.magnetometer_delay)):
        summary[key] = None if delay is None else dataclasses.asdict(delay)
    return summary


def remarks_on(proposed: Proposal) -> list[str]:
    """Bias, scale error, delays and misalignments, in words."""
    lines = []
    if proposed.gyro.bias is not None:
        bias = ", ".join(f"{value:.3f}" for value in np.rad2deg(proposed.gyro.bias))
        lines.append(f"Gyro: bias ({bias}) °/s")
    if proposed.gyro.scale_error is not None:
        lines.append(f"Gyro: scale and cross-axis error about {100.0 * proposed.gyro.scale_error:.2g} %")
    for name, against, delay in (
        ("Gyro", "the reference", proposed.gyro_delay),
        ("Magnetometer", "the gyro", proposed.magnetometer_delay),
    ):
        if delay is not None:
            lines.append(
                f"{name}: {1e3 * delay.delay:.2f} ms late against {against}; in {delay.pieces} pieces of the recording "
                f"at most {1e3 * delay.scatter:.2f} ms from that (a row is {1e3 * delay.step:.3g} ms)"
            )
    for name, vector in (("Accelerometer", proposed.accelerometer), ("Magnetometer", proposed.magnetometer)):
        if vector is not None and vector.misalignment is not None:
            lines.append(
                f"{name}: the turn that fits best at rest is {_DEGREES * vector.misalignment:.2g}° "
                "(about the vector itself a single pose tells nothing)"
            )
    return lines
