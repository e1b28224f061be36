"""What elliptude costs in Basilisk: the orbit of `elliptude.basilisk` with and without it, in turns.

    python benchmarks/basilisk_cost.py --step 0.01 --pairs 7

On a busy machine the time of a pair says little. Instructions do not depend on that: run it with `--only with` and
`--only without` for two durations each under `valgrind --tool=cachegrind --cache-sim=no`, and subtract.
"""

import argparse
import statistics
import time

from Basilisk.architecture import bskLogging
from elliptude.basilisk.orbit import Orbit


def seconds(step: float, duration: float, estimator: bool) -> float:
    """Processor time of a simulation without recorded sets."""
    orbit = Orbit(step, estimator=estimator, record=False)
    began = time.process_time()
    orbit.execute(duration)
    return time.process_time() - began


def main() -> None:
    """Measure and say."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--step", type=float, default=0.01, help="of the dynamics, s")
    parser.add_argument("--duration", type=float, default=600.0, help="s, with an update a second")
    parser.add_argument("--pairs", type=int, default=7)
    parser.add_argument("--only", choices=["with", "without"], help="one simulation of this kind")
    given = parser.parse_args()
    bskLogging.setDefaultLogLevel(bskLogging.BSK_ERROR)
    if given.only is not None:
        print(f"{seconds(given.step, given.duration, given.only == 'with'):.3f} s")
        return
    shares, updates = [], []
    for _ in range(given.pairs):
        without, with_it = (seconds(given.step, given.duration, one) for one in (False, True))
        shares.append(100.0 * (with_it - without) / with_it)
        updates.append(1e3 * (with_it - without) / given.duration)
    print(f"share of elliptude: {statistics.median(shares):.1f} % (median), {min(shares):.1f} to {max(shares):.1f} %")
    print(f"an update: {statistics.median(updates):.3f} ms (median)")


if __name__ == "__main__":
    main()
