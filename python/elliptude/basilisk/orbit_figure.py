"""The orbit in one picture: errors in their bounds, sizes of sets, where the truth is in them, pointing."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elliptude.basilisk.orbit import BLIND_FROM, BLIND_TO, Flight
from elliptude.report.figures import BLACK, BLUE, GREY, ORANGE

_ARC_SECOND = np.deg2rad(1.0 / 3600.0)


def orbit_figure(flight: Flight) -> Figure:
    """Left: the error about each body axis in its band. Right: how far it may be off and is, the form, the pointing."""
    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    axes = figure.subplots(3, 2, sharex=True)
    minutes = flight.times / 60.0
    for panel in axes.ravel():
        _shade(panel, flight)
        panel.grid(alpha=0.3)
    errors = flight.errors() / _ARC_SECOND
    widths = np.sqrt(np.einsum("kii->ki", flight.shapes)[:, :3]) / _ARC_SECOND
    for number, name in enumerate("xyz"):
        panel = axes[number, 0]
        panel.fill_between(minutes, -widths[:, number], widths[:, number], color=BLUE, alpha=0.3, lw=0.0, label="bound")
        panel.plot(minutes, errors[:, number], color=BLACK, lw=0.7, label="error of the estimate")
        panel.set_yscale("symlog", linthresh=100.0, linscale=2.0)
        panel.set_ylabel(f"about body {name}, ″")
    axes[0, 0].legend(loc="upper left", fontsize="small")
    size, form, pointing = axes[:, 1]
    size.semilogy(minutes, flight.angles / _ARC_SECOND, color=BLUE, label="may be off")
    size.semilogy(minutes, np.linalg.norm(errors, axis=1), color=BLACK, lw=0.7, label="is off")
    size.set_ylabel("attitude, ″")
    size.legend(loc="upper left", fontsize="small")
    form.plot(minutes, flight.forms(), color=BLACK, lw=0.7)
    form.axhline(1.0, color=ORANGE)
    form.set_ylim(0.0, 1.1)
    form.set_ylabel("form of the truth;\nin the set up to 1")
    pointing.semilogy(flight.pointing[:, 0] / 60.0, np.rad2deg(flight.pointing[:, 1]), color=BLACK)
    pointing.set_ylabel("pointing error, °")
    for panel in axes[-1]:
        panel.set_xlabel("time, min   (grey: eclipse; orange: star tracker off)")
    inside = int(flight.inside().sum())
    figure.suptitle(
        f"A spacecraft in Basilisk that steers by elliptude's estimate: the truth is inside at {inside} of "
        f"{len(flight.times)} updates"
    )
    return figure


def _shade(panel: Axes, flight: Flight) -> None:
    """Where there is no Sun, and where there is no star tracker."""
    dark = np.flatnonzero(flight.sunlight < 0.5)
    if len(dark):
        panel.axvspan(flight.times[dark[0]] / 60.0, flight.times[dark[-1]] / 60.0, color=GREY, alpha=0.2, lw=0.0)
    if flight.times[-1] > BLIND_FROM:
        until = min(BLIND_TO, flight.times[-1])
        panel.axvspan(BLIND_FROM / 60.0, until / 60.0, color=ORANGE, alpha=0.2, lw=0.0)
