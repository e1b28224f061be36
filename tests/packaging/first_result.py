"""A first result with an installed elliptude: a set, errors, and a simulated log by the command line."""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import elliptude as el
import numpy as np
from elliptude import _truth


def by_the_library() -> None:
    """The program of the README."""
    flow = el.GuaranteedGyroFlow(noise=np.deg2rad(0.5))
    estimator = el.GuaranteedFilter(flow, vector_bound=np.deg2rad(0.1))
    up_and_north = np.array([[0, 0, 1], [0, 1, 0]])
    estimator.update([[0.01, 0, 1], [0.02, 1, 0]], up_and_north, np.deg2rad([2.0, 5.0]), sensors=["gravity", "compass"])
    estimator.predict(0.5, gyro=[0, 0, 0.1])
    angle = np.rad2deg(estimator.ellipsoid.extent().largest_angle)
    print(f"library: {estimator.claim}, within {angle:.1f} degrees")
    assert estimator.claim == "unconditional"
    assert 5 < angle < 15


def errors() -> None:
    """Each module's errors arrive as they are, though each may have a C++ library of its own."""
    for kind, call in (
        (ValueError, lambda: el.GuaranteedGyroFlow(noise=-1)),
        (OverflowError, lambda: _truth.motion([0, 1], np.eye(3), [1e200, 1e200, 0], np.diag([1.0, 2.0, 2.5]))),
    ):
        try:
            call()
        except kind:
            continue
        raise AssertionError(f"no {kind.__name__}")


def elliptude(*arguments: object) -> None:
    """Run the command that was installed with this Python."""
    program = Path(sys.executable).with_name("elliptude.exe" if sys.platform == "win32" else "elliptude")
    subprocess.run([program, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


def by_the_command_line() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        elliptude("simulate", "orbit", "--out", folder)
        measurements, configuration = folder / "measurements.csv", folder / "estimate.toml"
        elliptude("estimate", measurements, "--config", configuration, "--out", folder / "result")
        summary = json.loads((folder / "result" / "summary.json").read_text(encoding="utf-8"))
    inside = summary["inside_share_of_rows"]
    print(f"command line: {summary['updates']} updates, {inside:.0%} of the rows hold the truth")
    assert summary["updates"] == 20
    assert inside == 1


by_the_library()
errors()
by_the_command_line()
