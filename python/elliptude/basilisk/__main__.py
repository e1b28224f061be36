"""Flies the orbit of `elliptude.basilisk.orbit`: ``python -m elliptude.basilisk --out orbit.png``."""

import argparse
import os
import sys
from pathlib import Path

import numpy as np


def main() -> int:
    """Fly, say what came of it, and draw it."""
    parser = argparse.ArgumentParser(
        prog="python -m elliptude.basilisk",
        description="One orbit in Basilisk with elliptude as the attitude estimator, drawn.",
    )
    parser.add_argument("--out", type=Path, default=Path("orbit.png"), help="the picture [%(default)s]")
    parser.add_argument("--step", type=float, default=0.01, help="of the dynamics, s, 0.001 to 0.5 [%(default)s]")
    parser.add_argument("--seed", type=int, default=1, help="of the sensors' errors, 1 to 1000 [%(default)s]")
    given = parser.parse_args()
    if not 0.001 <= given.step <= 0.5 or not 1 <= given.seed <= 1000:
        parser.error(f"--step must be from 0.001 to 0.5 and --seed from 1 to 1000, not {given.step} and {given.seed}")
    if not given.out.parent.is_dir() or not os.access(given.out.parent, os.W_OK):
        parser.error(f"--out: cannot write into {given.out.parent}")
    try:
        from Basilisk.architecture import bskLogging

        from elliptude.basilisk.orbit import Orbit
        from elliptude.basilisk.orbit_figure import orbit_figure
        from elliptude.report.figures import save
    except ModuleNotFoundError as error:
        parser.error(f"this needs {error.name}: pip install 'elliptude[basilisk]'")
    # Basilisk warns that the errors are cut off at their bounds, which is what is wanted here.
    bskLogging.setDefaultLogLevel(bskLogging.BSK_ERROR)
    orbit = Orbit(given.step, given.seed)
    orbit.execute()
    flight = orbit.recorded()
    inside, seconds = flight.inside(), np.rad2deg(flight.angles) * 3600.0
    errors = np.rad2deg(np.linalg.norm(flight.errors(), axis=1)) * 3600.0
    known = [claim == "unconditional" for claim in flight.claims]
    print(f"{len(inside)} updates in {flight.times[-1]:.0f} s, {sum(known)} with an unconditional set")
    print(f"truth inside: {int(inside.sum())}; form of the truth at most {np.nanmax(flight.forms()):.3f}")
    print(f"the attitude may be off by {np.nanmedian(seconds):.0f}″ (median), {np.nanmax(seconds):.0f}″ (most)")
    print(f"it is off by {np.nanmedian(errors):.0f}″ (median), {np.nanmax(errors):.0f}″ (most)")
    save(orbit_figure(flight), given.out)
    print(f"picture: {given.out}")
    return 0 if inside.all() else 1


if __name__ == "__main__":
    sys.exit(main())
