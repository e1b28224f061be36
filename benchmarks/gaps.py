"""The guaranteed mode on simulated logs with gaps: whether the truth is in every set that is claimed unconditionally.

    python benchmarks/gaps.py --logs 1000

Each log is forty seconds of a sensor that rests and is then turned and moved as a hand does, of which one to six
pieces of 0.1 to 10 s, anywhere in motion, are cut out: of all sensors, or of the gyro alone where the others have
stamps of their own. Then what a user does: bounds proposed from that log, as `elliptude bounds` does, and an estimation
with them as they stand. The true attitude is never shown to either.
"""

import argparse
import json
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from elliptude import estimation, logs
from elliptude.configuration import Configuration
from elliptude.estimation import Estimation
from elliptude.proposal import mapping, proposals
from elliptude.proposal.starting.configuration import starting_configuration
from elliptude.typing import FloatArray
from scipy.spatial.transform import Rotation

DURATION_S, REST_S, STEP_S = 40.0, 3.0, 0.01
_FINE_S = 0.001
# µT, ENU.
FIELD = np.array([0.0, 19.0, -44.0])
GRAVITY = 9.807
# m/s²; the largest.
ACCELERATION = 2.0
SENSORS = ("gyr", "acc", "mag")


@dataclass(frozen=True, eq=False)
class Simulated:
    """A log, and what is true of it."""

    stamps: dict[str, FloatArray]
    """By sensor, s."""
    values: dict[str, FloatArray]
    """By sensor: rad/s, m/s², µT; body axes."""
    gaps: list[tuple[float, float]]
    """Begin and end, s."""
    true_times: FloatArray
    true_attitudes: Rotation
    largest_rate: float
    """rad/s."""
    largest_acceleration: float
    """Of the turn, rad/s²."""

    def attitudes_at(self, times: FloatArray) -> Rotation:
        """True attitudes; the simulation's own steps are 1 ms."""
        return self.true_attitudes[np.clip(np.round(times / _FINE_S).astype(int), 0, len(self.true_times) - 1)]


def simulate(
    seed: int,
    gaps: list[tuple[float, float]] | None = None,
    *,
    magnetometer: bool = True,
    own_stamps: bool = False,
    shortest: float = 0.1,
) -> Simulated:
    """A log with gaps.

    Parameters
    ----------
    seed : int
    gaps : list of (begin, length), optional
        s; one to six at random if left out.
    magnetometer : bool
        Whether there is one.
    own_stamps : bool
        Whether the gyro has stamps of its own; it alone then loses samples.
    shortest : float
        Of the gaps at random, s.

    Returns
    -------
    Simulated
    """
    draws = np.random.default_rng(seed)
    fine = np.arange(0.0, DURATION_S + _FINE_S, _FINE_S)
    # From rest to motion in half a second, and a pause somewhere.
    pause = draws.uniform(15.0, 30.0)
    moving = np.clip(2.0 * (fine - REST_S), 0.0, 1.0) * np.clip(2.0 * np.abs(fine - pause) - 1.0, 0.0, 1.0)
    moving = moving**2 * (3.0 - 2.0 * moving)
    rates = moving[:, None] * _waves(draws, fine, 5, draws.uniform(0.2, 0.8))
    largest = float(np.linalg.norm(rates, axis=1).max())
    fastest_change = float(np.linalg.norm(np.diff(rates, axis=0), axis=1).max()) / _FINE_S
    middles = Rotation.from_rotvec(_FINE_S * 0.5 * (rates[1:] + rates[:-1]))
    turns = np.empty((len(fine), 4))
    turns[0], steps = Rotation.random(rng=draws).as_quat(), middles.as_quat()
    turns = _running_products(turns[0], steps)
    attitudes = Rotation.from_quat(turns)
    # The place: within half a metre, below 3 m/s.
    place = moving[:, None] * _waves(draws, fine, 3, 0.06)
    accelerations = np.gradient(np.gradient(place, _FINE_S, axis=0), _FINE_S, axis=0)
    accelerations *= min(1.0, ACCELERATION / float(np.linalg.norm(accelerations, axis=1).max()))
    forces = attitudes.inv().apply(accelerations + np.array([0.0, 0.0, GRAVITY]))
    fields = attitudes.inv().apply(FIELD)
    bias = np.deg2rad(0.5) * _unit(draws)
    true = {"gyr": rates + bias, "acc": forces, "mag": fields}
    errors = {"gyr": np.deg2rad(0.1), "acc": 0.03, "mag": 0.3}
    if gaps is None:
        count = int(draws.integers(1, 7))
        lengths = np.exp(draws.uniform(np.log(shortest), np.log(10.0), count))
        begins = draws.uniform(REST_S + 0.5, DURATION_S - 0.5, count)
        gaps = list(zip(begins.tolist(), lengths.tolist(), strict=True))
    stamps, values = {}, {}
    for name, late in zip(SENSORS, (0.0, 0.0033, 0.0033), strict=True):
        if name == "mag" and not magnetometer:
            continue
        times = np.round(np.arange(0.0, DURATION_S, STEP_S) + (late if own_stamps else 0.0), 6)
        measured = true[name][np.round(times / _FINE_S).astype(int)]
        measured = measured + errors[name] * np.array([_unit(draws) for _ in times]) * draws.random((len(times), 1))
        keep = np.ones(len(times), bool)
        if not own_stamps or name == "gyr":
            for begin, length in gaps:
                keep &= (times < begin) | (times > begin + length)
        stamps[name], values[name] = times[keep], measured[keep]
    spans = [(begin, begin + length) for begin, length in gaps]
    return Simulated(stamps, values, spans, fine, attitudes, largest, fastest_change)


def _unit(draws: np.random.Generator) -> FloatArray:
    vector = draws.standard_normal(3)
    unit: FloatArray = vector / np.linalg.norm(vector)
    return unit


def _waves(draws: np.random.Generator, times: FloatArray, count: int, size: float) -> FloatArray:
    """Sums of sines of 0.1 to 1 Hz, shape (N, 3)."""
    result = np.zeros((len(times), 3))
    for _ in range(count):
        frequency = draws.uniform(0.1, 1.0)
        result += size * np.sin(2.0 * np.pi * (frequency * times[:, None] + draws.random(3))) * draws.random(3)
    return result


def _running_products(first: FloatArray, steps: FloatArray) -> FloatArray:
    """Running products of quaternions (qx, qy, qz, qw), each step on the right, shape (N + 1, 4)."""
    result = np.empty((len(steps) + 1, 4))
    result[0] = x, y, z, w = first
    for i, (a, b, c, d) in enumerate(steps.tolist()):
        x, y, z, w = (
            w * a + x * d + y * c - z * b,
            w * b - x * c + y * d + z * a,
            w * c + x * b - y * a + z * d,
            w * d - x * a - y * b - z * c,
        )
        result[i + 1] = x, y, z, w
    return result


def tables(simulated: Simulated, *, own_stamps: bool = False) -> dict[str, Any]:
    """What says which arrays of the file are which sensors."""

    def sensor(array: str, **more: Any) -> dict[str, Any]:
        stamps = {"time_column": f"t_{array}", "time_unit": "s"} if own_stamps else {}
        return {"columns": [f"{array}[{i}]" for i in range(3)]} | more | stamps

    found = {
        "time_column": "t_gyr",
        "reference_frame": "ENU",
        "flow": sensor("gyr", kind="gyro", unit="rad/s"),
        "directions": [sensor("acc", name="up", kind="accelerometer", unit="m/s^2")],
    }
    if "mag" in simulated.values:
        found["directions"].append(sensor("mag", name="field", kind="magnetometer", unit="uT"))
    if own_stamps:
        # A user's to state: nothing proposes a start where sensors never have the same stamp, and of an acceleration a
        # recording without a reference shows the part along gravity alone.
        bound = {"kind": "acceleration", "acceleration_m_per_s2": ACCELERATION, "gravity_error_m_per_s2": 0.027}
        found["directions"][0]["bound_from"] = bound
        start = (simulated.attitudes_at(np.zeros(1)) * Rotation.from_rotvec([0.05, -0.03, 0.02]))[0]
        quaternion = start.as_quat(canonical=True, scalar_first=True).tolist()
        found["start"] = {"kind": "given", "attitude_qw_qx_qy_qz": quaternion, "P_diagonal": [0.01] * 6}
    return found


def write(simulated: Simulated, path: Path) -> None:
    """As NPZ."""
    arrays = {f"t_{name}": stamps for name, stamps in simulated.stamps.items()}
    np.savez(path, **arrays, **simulated.values)


def bounds_and_estimate(
    path: Path, mapped: dict[str, Any], known: dict[str, float] | None = None
) -> tuple[Estimation, Configuration]:
    """What `elliptude bounds` and `elliptude estimate` do, with what the user knows of the gyro, if anything."""
    reading = mapping.configuration_of(mapped, path)
    recording, origin = mapping.read_recording(path, reading)
    document = starting_configuration(
        mapped,
        proposals.propose(recording),
        1.5,
        mode="guaranteed",
        log=path.name,
        origin=origin,
        shared_stamps=recording.shared_stamps,
    )
    full = document.unwrap()
    (full["rule"]["gyro"] if "rule" in full else full["flow"]).update(known or {})
    configuration = Configuration.model_validate(full)
    return estimation.estimate(logs.read_log(path, configuration), configuration), configuration


def forms(estimated: Estimation, simulated: Simulated) -> FloatArray:
    """Where the truth is in each row's set: at most 1 inside; NaN without a set.

    The frame of an estimation with a rule has its north where the field pointed at the start, and without a field its
    heading counts from the first row; so the truth is turned about the vertical before.
    """
    run = estimated.guaranteed
    assert run is not None
    true = simulated.attitudes_at(run.sets.times)
    if run.starts_heading:
        from elliptude.estimation.guaranteed_run import turned_to_start

        true = Rotation.from_matrix(turned_to_start(true.as_matrix(), run))
    known = np.isfinite(run.sets.shapes[:, 0, 0])
    result = np.full(len(known), np.nan)
    estimates = Rotation.from_matrix(run.sets.attitudes[known])
    errors = (estimates.inv() * true[known]).as_quat()
    gibbs = 2.0 * errors[:, :3] / errors[:, 3:]
    scaled = np.linalg.solve(run.sets.shapes[known, :3, :3], gibbs[..., None])[..., 0]
    result[known] = np.einsum("ni,ni->n", gibbs, scaled)
    return result


def attempt(
    seed: int,
    folder: Path,
    gaps: list[tuple[float, float]] | None = None,
    *,
    knows_motion: bool = False,
    shortest: float = 0.1,
) -> dict[str, Any]:
    """One log: what kind it was, and what came of it; with the true largest rate and change of it stated if known."""
    kind = seed % 4
    magnetometer, own_stamps = kind != 1, kind == 2
    simulated = simulate(seed, gaps, magnetometer=magnetometer, own_stamps=own_stamps, shortest=shortest)
    path = folder / "log.npz"
    write(simulated, path)
    known = {
        "largest_rate_deg_per_s": float(np.rad2deg(simulated.largest_rate)),
        "largest_angular_acceleration_deg_per_s2": float(np.rad2deg(simulated.largest_acceleration)),
    }
    mapped = tables(simulated, own_stamps=own_stamps)
    estimated, _ = bounds_and_estimate(path, mapped, known if knows_motion else None)
    found = forms(estimated, simulated)
    claims = np.array(estimated.result.claims)
    unconditional = claims == "unconditional"
    outside = unconditional & (found > 1.0)
    return {
        "seed": seed,
        "kind": "own stamps" if own_stamps else "with field" if magnetometer else "no field",
        "rows": len(claims),
        "unconditional": int(unconditional.sum()),
        "none": int((claims == "none").sum()),
        "outside": int(outside.sum()),
        "largest_form": float(np.nanmax(np.where(unconditional, found, np.nan), initial=0.0)),
    }


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", type=int, default=1000, help="how many")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument(
        "--known-motion",
        action="store_true",
        help="state the true largest rate and change of it, not what bounds wrote",
    )
    parser.add_argument("--shortest", type=float, default=0.1, help="of the gaps, s")
    parser.add_argument("--json", type=Path, help="write what came of each log to this file")
    arguments = parser.parse_args()
    lines: list[dict[str, Any]] = []
    failed: Counter[str] = Counter()
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        for seed in range(arguments.first, arguments.first + arguments.logs):
            try:
                lines.append(
                    attempt(seed, Path(name), knows_motion=arguments.known_motion, shortest=arguments.shortest)
                )
            except ValueError as error:
                failed[str(error).split(";")[0]] += 1
            if len(lines) % 50 == 0 and lines:
                print(f"{len(lines)} logs, {sum(one['outside'] for one in lines)} rows outside", flush=True)
    for kind in sorted({one["kind"] for one in lines}):
        chosen = [one for one in lines if one["kind"] == kind]
        rows, unconditional = (sum(one[key] for one in chosen) for key in ("rows", "unconditional"))
        print(
            f"{kind:12} {len(chosen):5} logs  {rows:9} rows  unconditional {100.0 * unconditional / rows:6.2f} %  "
            f"outside {sum(one['outside'] for one in chosen)} rows "
            f"of {sum(one['outside'] > 0 for one in chosen)} logs  "
            f"largest form {max(one['largest_form'] for one in chosen):.3g}"
        )
    for message, count in failed.items():
        print(f"refused {count} times: {message}")
    print(f"{time.perf_counter() - begin:.0f} s")
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(lines, indent=2), encoding="utf-8")


if __name__ == "__main__":
    main()
