"""What elliptude costs beside what a user would take instead, in one run, as ratios.

    make compare
    python benchmarks/compare_peers.py --programs build/bench/cpp/benchmarks --page docs/performance.md

In C++ the peers are in `cpp/benchmarks/peers.hpp`: a step of Runge and Kutta's method on quaternions, a plain
multiplicative Kalman filter, Eigen's singular values, Boost's odeint. Times are medians of repetitions that take turns;
instructions are counted under valgrind, of programs for x86-64-v3. In Python a peer that is not installed is left out.
Nothing that a peer does bounds an error.
"""

import argparse
import importlib
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import elliptude as el
import numpy as np
from elliptude.typing import FloatArray
from rich.console import Console
from rich.table import Table
from scipy.spatial.transform import Rotation

STEP, KALMAN, WAHBA = "peer_quaternion_step_", "peer_kalman_cycle", "peer_wahba_by_eigen_3_directions"
# What is compared: what it is, the operation of the core, the peer's, and what the peer is.
CORE = [
    ("variational step, free body", "step_free_order_2", STEP + "free", "RK4 step, quaternion"),
    ("variational step, gravity gradient", "step_gravity_gradient_order_2", STEP + "gravity_gradient", "RK4 step"),
    ("variational step, pendulum", "step_pendulum_order_2", STEP + "pendulum", "RK4 step"),
    ("the same", "step_pendulum_order_2", "peer_odeint_step_pendulum", "odeint, dopri5 step"),
    ("step with A and A P Aᵀ, free body", "step_with_ellipsoid_free_order_2", STEP + "free", "RK4 step"),
    ("cycle of mode paper, trace", "paper_cycle_trace", KALMAN, "Kalman filter's cycle"),
    ("cycle of mode paper, volume", "paper_cycle_volume", KALMAN, "Kalman filter's cycle"),
    ("cycle of mode first_order, trace", "first_order_cycle_trace", KALMAN, "Kalman filter's cycle"),
    ("guaranteed cycle, trace", "guaranteed_cycle_trace", KALMAN, "Kalman filter's cycle"),
    ("guaranteed cycle, volume", "guaranteed_cycle_volume", KALMAN, "Kalman filter's cycle"),
    ("and bounds of tilt and heading", "guaranteed_cycle_with_bounds_trace", KALMAN, "Kalman filter's cycle"),
    ("fusion of two ellipsoids, trace", "fuse_trace", KALMAN, "Kalman filter's cycle"),
    ("Wahba, 3 directions, svd", "wahba_svd_3_directions", WAHBA, "Eigen's JacobiSVD"),
    ("Wahba, 3 directions, foam", "wahba_foam_3_directions", WAHBA, "Eigen's JacobiSVD"),
]


def times_of(programs: Path) -> dict[str, float]:
    """Median processor time of each operation of `benchmark_core`, ns; repetitions of all operations take turns."""
    names = sorted({name for _, ours, peer, _ in CORE for name in (ours, peer)})
    said = subprocess.run(
        [
            programs / "benchmark_core",
            f"--benchmark_filter=^({'|'.join(names)})$",
            "--benchmark_format=json",
            "--benchmark_min_time=0.02",
            "--benchmark_repetitions=15",
            "--benchmark_enable_random_interleaving=true",
            "--benchmark_report_aggregates_only=true",
        ],
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    rows = json.loads(said)["benchmarks"]
    return {row["run_name"]: row["cpu_time"] for row in rows if row["aggregate_name"] == "median"}


def instructions_of(programs: Path) -> dict[str, int]:
    """Instructions of each operation of the two counting programs; none where valgrind or the programs are missing."""
    counts = {}
    script = Path(__file__).parents[1] / "tools/count_instructions.sh"
    for name in ("instructions_core", "instructions_peers"):
        said = subprocess.run([script, programs / name], check=False, capture_output=True, text=True).stdout
        for line in said.splitlines()[1:]:
            operation, count = line.split()[:2]
            counts[operation] = int(count)
    return counts


@dataclass
class Line:
    """One line of a table: what is measured, how long it takes, and how often that is the first of its group."""

    name: str
    microseconds: float
    ratio: float
    note: str = ""


def core_lines(programs: Path) -> list[list[str]]:
    """The C++ table: name, our time and the peer's, and the ratios of times and of instructions."""
    times, counts = times_of(programs), instructions_of(programs)
    lines = []
    for name, ours, peer, what in CORE:
        if ours not in times or peer not in times:
            continue  # Boost is not installed
        ratio = f"{counts[ours] / counts[peer]:.2f}" if ours in counts and peer in counts else "–"
        lines.append(
            [name, f"{times[ours]:.0f}", what, f"{times[peer]:.0f}", f"{times[ours] / times[peer]:.2f}", ratio]
        )
    return lines


def work_precision_lines(programs: Path) -> list[list[str]]:
    """Motion, method, and milliseconds to each error of the worst of the attitudes."""
    said = subprocess.run([programs / "work_precision"], check=True, capture_output=True, text=True).stdout
    return [line.split("\t") for line in said.splitlines()]


# --- Python -----------------------------------------------------------------------------------------------------------


def seconds(function: Callable[[], Any], rounds: int = 5, clock: Callable[[], float] = time.process_time) -> float:
    """The least processor time of some calls, or what else a clock shows."""
    found = []
    for _ in range(rounds):
        begin = clock()
        function()
        found.append(clock() - begin)
    return min(found)


def peer(name: str) -> Any:
    """A module, or None where it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def relative(lines: list[tuple[str, float, str]], unit: float) -> list[Line]:
    """Seconds for `unit` things as microseconds for each, with the ratio to the first."""
    return [Line(name, 1e6 * value / unit, value / lines[0][1], note) for name, value, note in lines]


def wahba_lines() -> list[Line]:
    """1e5 problems of three directions."""
    count, few = 100_000, 2000
    rng = np.random.default_rng(1)
    reference = np.eye(3) + 0.1 * rng.standard_normal((count, 3, 3))
    reference /= np.linalg.norm(reference, axis=2, keepdims=True)
    body = reference @ Rotation.random(count, rng=rng).as_matrix() + 0.01 * rng.standard_normal((count, 3, 3))

    def numpy() -> FloatArray:
        u, _, v = np.linalg.svd(reference.swapaxes(1, 2) @ body)
        u[:, :, 2] *= np.linalg.det(u @ v)[:, None]
        return u @ v

    def scipy() -> None:
        for e, b in zip(reference[:few], body[:few], strict=True):
            Rotation.align_vectors(e, b)

    foam = el.wahba(reference, body, method="foam").attitude
    assert np.abs(foam - numpy()).max() < 1e-2  # NumPy's directions are not made unit vectors
    return relative(
        [
            (
                "elliptude.wahba, foam",
                seconds(lambda: el.wahba(reference, body, method="foam", threads=1), 20),
                "with cost, condition",
            ),
            (
                "the same on all processors, by the clock",
                seconds(lambda: el.wahba(reference, body, method="foam"), 20, time.perf_counter),
                f"{os.cpu_count()} processors",
            ),
            ("elliptude.wahba, svd", seconds(lambda: el.wahba(reference, body, threads=1)), "with cost, condition"),
            ("NumPy, batched svd", seconds(numpy, 3), "the attitude alone"),
            ("SciPy, align_vectors in a loop", seconds(scipy, 2) * count / few, "with rssd"),
        ],
        count,
    )


@dataclass
class Spacecraft:
    """Updates of a body in an orbit: three directions and the angular velocity at each step."""

    flow: el.GuaranteedRigidBodyFlow
    times: FloatArray
    directions: FloatArray
    rates: FloatArray

    bound = float(np.deg2rad(7.0))

    @classmethod
    def make(cls, count: int) -> "Spacecraft":
        """The scenario `orbit` at 7 degrees, errors inside their bounds."""
        body = el.RigidBody([1.0, 2.8, 2.0])
        potential, step = el.GravityGradient(body, 1.0), 2.0 * np.pi / 300.0
        path = el.Integrator(body, potential, step=step, order=4).trajectory(
            el.exp([1.8325957145940461, 0.0, 0.0]), [2.316, 0.446, -0.591], steps=count - 1
        )
        rng = np.random.default_rng(2)
        errors = rng.uniform(-1.0, 1.0, (2, count, 3)) * cls.bound / np.sqrt(3.0)
        directions = path.attitudes @ el.exp(errors[0])
        flow = el.GuaranteedRigidBodyFlow(body, potential, step=step)
        return cls(flow, step * np.arange(count), directions, path.angular_velocities + errors[1])

    def keywords(self) -> dict[str, Any]:
        """What every update is told."""
        return {"reference": np.eye(3), "bounds": self.bound, "rate_bound": self.bound}


def cycle_lines(core_microseconds: float | None) -> list[Line]:
    """A prediction of one step and an update with three directions and the rate, from Python."""
    craft = Spacecraft.make(2000)

    def loop() -> None:
        estimator = el.GuaranteedFilter(craft.flow, criterion="trace")
        for time_, directions, rate in zip(craft.times, craft.directions, craft.rates, strict=True):
            estimator.predict(time_)
            estimator.update(directions, angular_velocity=rate, **craft.keywords())

    def whole() -> None:
        el.GuaranteedFilter(craft.flow, criterion="trace").run(
            craft.times, directions=craft.directions, angular_velocity=craft.rates, **craft.keywords()
        )

    lines = [
        ("GuaranteedFilter.run, whole log", seconds(whole), ""),
        ("predict and update, one by one", seconds(loop, 3), ""),
    ]
    if core_microseconds is not None:
        lines.insert(0, ("C++, guaranteed cycle", 1e-6 * core_microseconds * len(craft.times), ""))
    if (filterpy := peer("filterpy.kalman")) is not None:
        other = filterpy.KalmanFilter(dim_x=6, dim_z=12)
        other.H = np.vstack([np.random.default_rng(3).standard_normal((9, 6)), np.eye(6)[3:]])

        def kalman() -> None:
            for _ in craft.times:
                other.predict()
                other.update(np.zeros(12))

        lines.append(("filterpy, KalmanFilter of 6 by 12", seconds(kalman, 3), "linear: no attitude, no dynamics"))
    return relative(lines, len(craft.times))


def imu_lines() -> list[Line]:
    """A row of a log of an inertial sensor with magnetometer, 100 Hz, as arrays in memory."""
    count = 6000
    times = 0.01 * np.arange(count)
    rng = np.random.default_rng(4)
    turn = 0.5 * np.sin(times)[:, None] * (times > 3.0)[:, None] * [1.0, 0.7, 0.4]
    attitudes = np.empty((count, 3, 3))
    attitudes[0] = np.eye(3)
    for row in range(1, count):
        attitudes[row] = attitudes[row - 1] @ el.exp(0.005 * (turn[row - 1] + turn[row]))
    gyr = turn + rng.uniform(-1e-3, 1e-3, (count, 3))
    acc = np.array([0.0, 0.0, 9.81]) @ attitudes + rng.uniform(-0.02, 0.02, (count, 3))
    mag = np.array([0.0, 2e-5, -4.5e-5]) @ attitudes + rng.uniform(-2e-7, 2e-7, (count, 3))
    lines = [("elliptude.ahrs", seconds(lambda: el.ahrs(times, gyr, acc, mag), 3), "sets, claims, roll, pitch, yaw")]
    if (vqf := peer("vqf")) is not None:
        lines.append(("vqf", seconds(lambda: vqf.VQF(0.01).updateBatch(gyr, acc, mag), 3), "C++"))
    if (imufusion := peer("imufusion")) is not None:

        def fuse() -> None:
            filter_ = imufusion.Ahrs().set_sample_period(0.01)
            for g, a, m in zip(np.rad2deg(gyr), acc / 9.81, 1e6 * mag, strict=True):
                filter_.update(g, a, m)

        lines.append(("imufusion", seconds(fuse, 3), "C, a call a row"))
    if (ahrs := peer("ahrs")) is not None:
        lines.append(
            ("ahrs, Madgwick", seconds(lambda: ahrs.filters.Madgwick(gyr=gyr, acc=acc, mag=1e9 * mag), 1), "Python")
        )
        lines.append(("ahrs, EKF", seconds(lambda: ahrs.filters.EKF(gyr=gyr, acc=acc, mag=1e6 * mag), 1), "Python"))
    return relative(lines, count)


# --- the page ---------------------------------------------------------------------------------------------------------

CORE_HEADER = ["what", "ns", "beside", "ns", "ratio of times", "ratio of instructions"]
PYTHON_HEADER = ["what", "µs each", "ratio", ""]
WORK_HEADER = ["motion", "method", "ms to 1e-3 rad", "to 1e-6", "to 1e-9"]


def markdown(header: list[str], lines: list[list[str]]) -> str:
    """A table."""
    rows = [header, ["---"] * len(header), *lines]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def with_tables(page: str, tables: dict[str, str]) -> str:
    """The page with the text between `<!-- NAME -->` and `<!-- end -->` replaced."""
    for name, table in tables.items():
        begin, end = f"<!-- {name} -->", "<!-- end -->"
        before, found, rest = page.partition(begin)
        _, closed, after = rest.partition(end)
        if not found or not closed:
            raise SystemExit(f"the page has no {begin} … {end}")
        page = f"{before}{begin}\n\n{table}\n\n{end}{after}"
    return page


def machine() -> str:
    """Processor and versions, in one line."""
    model = next(
        (
            line.partition(":")[2].strip()
            for line in Path("/proc/cpuinfo").read_text().splitlines()
            if "model name" in line
        ),
        platform.processor(),
    )
    return f"{model}, Python {platform.python_version()}, NumPy {np.__version__}, elliptude {el.__version__}"


def main() -> None:
    """Print the tables, and put them into the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--programs", type=Path, help="folder of the C++ programs; without it Python alone is measured")
    parser.add_argument("--page", type=Path, help="a Markdown page whose tables are replaced")
    arguments = parser.parse_args()
    console = Console()
    tables, core_microseconds = {"machine": machine()}, None
    console.print(tables["machine"])
    if arguments.programs is not None:
        lines = core_lines(arguments.programs)
        core_microseconds = next(1e-3 * float(line[1]) for line in lines if line[0] == "guaranteed cycle, trace")
        tables["core"] = markdown(CORE_HEADER, lines)
        work = work_precision_lines(arguments.programs)
        tables["work_precision"] = markdown(WORK_HEADER, work)
        for header, title, rows in ((CORE_HEADER, "C++", lines), (WORK_HEADER, "Work and precision", work)):
            table = Table(*header, title=title)
            for line in rows:
                table.add_row(*line)
            console.print(table)
    for name, title, found in (
        ("wahba", "Wahba's problem, three directions, from NumPy", wahba_lines()),
        ("cycle", "A guaranteed cycle from Python", cycle_lines(core_microseconds)),
        ("imu", "A row of an inertial sensor with magnetometer", imu_lines()),
    ):
        rows = [[line.name, f"{line.microseconds:.3g}", f"{line.ratio:.3g}", line.note] for line in found]
        tables[name] = markdown(PYTHON_HEADER, rows)
        table = Table(*PYTHON_HEADER, title=title)
        for row in rows:
            table.add_row(*row)
        console.print(table)
    if arguments.page is not None:
        arguments.page.write_text(with_tables(arguments.page.read_text(), tables))


if __name__ == "__main__":
    sys.exit(main())
