"""What `elliptude.ahrs` returns."""

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from importlib import import_module
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from elliptude.results.claims import CLAIMS
from elliptude.results.guaranteed import GuaranteedLog
from elliptude.results.shown import panel
from elliptude.typing import AttitudeLike, FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class AhrsResult:
    """Attitudes with their bounds, of n rows: what `elliptude.ahrs` returns. NaN where nothing is known.

    C = Rz(yaw) Ry(pitch) Rx(roll) takes body vectors to ENU: east, north, up; north is magnetic north.
    """

    times: FloatArray
    """In s, from the first whole second where they count from 1970, shape (n,)."""
    quaternions: FloatArray
    """(qw, qx, qy, qz) of the attitude, the center of its set, shape (n, 4)."""
    attitudes: FloatArray
    """The same as matrices, from body to reference axes, shape (n, 3, 3)."""
    roll_pitch_yaw: FloatArray
    """Roll and pitch of `ups`, also where no attitude is known, and yaw of the attitude, rad, shape (n, 3)."""
    least_roll_pitch_yaw: FloatArray
    """The truth is from here, up to whole turns, rad, shape (n, 3); −π to π: not defined, or anything."""
    most_roll_pitch_yaw: FloatArray
    """To here, rad, shape (n, 3)."""
    claims: NDArray[np.str_]
    """What attitude, yaw and sets rest on, a word of `elliptude.results.CLAIMS`, shape (n,)."""
    tilt_bounds: FloatArray
    """How far the attitude's up may be from true up, by `up_claims`, rad, shape (n,)."""
    heading_from: FloatArray
    """The turn about up from the attitude to the truth is at least this, rad, shape (n,)."""
    heading_to: FloatArray
    """And at most this, rad, shape (n,)."""
    largest_angles: FloatArray
    """The largest attitude error in each set, rad, shape (n,)."""
    ups: FloatArray
    """Up as well as it is known, unit vectors, body axes, shape (n, 3)."""
    up_bounds: FloatArray
    """How far true up may be from there, rad, shape (n,)."""
    up_claims: NDArray[np.str_]
    """What up, roll and pitch rest on, shape (n,)."""
    sets: GuaranteedLog
    """The sets themselves."""
    statements: str
    """What the bounds of the sensors' errors come from, as it was given."""
    are_proposals: bool
    """Whether they are only what the recording showed: then nothing is guaranteed, whatever the claims say."""
    heading: str
    """What yaw counts from: "from magnetic east", or "from the first row" without a magnetometer; or "not known"."""
    dropped: Mapping[str, int]
    """How many measurements of each sensor were left out, as they contradict the others or their own bounds."""
    notes: tuple[str, ...]
    """What a reader should know: why there is no set, gaps in the gyro, and which axis was up at rest."""
    columns: Mapping[str, NDArray[Any]]
    """The table that `elliptude estimate` writes, by its columns' names."""

    def __len__(self) -> int:
        """The number of rows."""
        return len(self.times)

    @property
    def claim_shares(self) -> dict[str, float]:
        """The share of rows with each claim of the attitude."""
        return {claim: float(np.mean(self.claims == claim)) for claim in CLAIMS}

    def contains(self, true_attitudes: AttitudeLike) -> NDArray[np.bool_]:
        """Whether attitudes (n, 3, 3) or a Rotation of SciPy, from body to the same axes, are in the sets, (n,)."""
        inside: NDArray[np.bool_] = self.sets.forms(true_attitudes) <= 1.0
        return inside

    def to_frame(self, library: Literal["pandas", "polars"] | None = None) -> Any:
        """The table that `elliptude estimate` writes as a data frame.

        Parameters
        ----------
        library : {"pandas", "polars"}, optional
            The one that is installed, pandas first, if left out.

        Raises
        ------
        ModuleNotFoundError
            If it is not installed.
        ValueError
            If it is another one.
        """
        if library not in {None, "pandas", "polars"}:
            raise ValueError(f"library: {library!r}, neither 'pandas' nor 'polars'")
        for name in (library,) if library is not None else ("pandas", "polars"):
            try:
                return import_module(name).DataFrame(dict(self.columns))
            except ModuleNotFoundError:
                continue
        raise ModuleNotFoundError(f"to_frame needs {library or 'pandas or polars'}, which is not installed")

    def __repr__(self) -> str:
        """One line: rows, claims, mean bounds."""
        span = f"{self.times[0]:.6g} to {self.times[-1]:.6g} s"
        claims = ", ".join(f"{name} {100.0 * share:.3g} %" for name, share in self.claim_shares.items())
        bounds = ", ".join(f"{name} {size}" for name, size in self._means().items())
        doubt = "; by proposals, no guarantee" if self.are_proposals else ""
        return f"<AhrsResult: {len(self)} rows, {span}; claims: {claims}; mean bounds: {bounds}{doubt}>"

    def _repr_html_(self) -> str:
        """For notebooks: a small plot of roll, pitch and yaw with their bounds, and the mean bounds."""
        angles = (self.least_roll_pitch_yaw, self.most_roll_pitch_yaw, self.roll_pitch_yaw)
        panels = "".join(
            panel(name, *(np.rad2deg(values[:, i]) for values in angles))
            for i, name in enumerate(("roll", "pitch", "yaw"))
        )
        rows = {f"{name} (mean bound)": size for name, size in self._means().items()}
        rows |= {f"claim: {name}": f"{100.0 * share:.4g} % of rows" for name, share in self.claim_shares.items()}
        rows |= {"statements": self.statements + (", proposals: no guarantee" if self.are_proposals else "")}
        rows |= {"yaw": f"counts {self.heading}"}
        table = "".join(
            f'<tr><th style="text-align:left">{escape(name)}</th><td>{escape(value)}</td></tr>'
            for name, value in rows.items()
        )
        return f"<div><table>{table}</table>{panels}</div>"

    def _means(self) -> dict[str, str]:
        """Mean bounds over rows that have any, in degrees."""
        heading = np.maximum(-self.heading_from, self.heading_to)
        bounds = {"up": self.up_bounds, "tilt": self.tilt_bounds, "heading": heading, "angle": self.largest_angles}
        known = {name: values[np.isfinite(values)] for name, values in bounds.items()}
        return {
            name: f"{np.rad2deg(values.mean()):.3g}°" if len(values) else "not known" for name, values in known.items()
        }
