"""What a campaign of guaranteed runs of 20 updates costs, from a part of it, and how well several processes share it.

    python benchmarks/campaign.py --scenario gyro

Measured are times of processors, so that other programs on the machine count little; each scenario's runs by one
process and by several, in turn, and again; medians count. The efficiency is the rate of several processes over that of
as many times one: the time of a processor that the runs take in a single process, over that which they, their results
and the process that stores them take of all, times the share of time in which no process waits for work. It leaves out
what a campaign of any length needs once: starting the processes, and the summary.
"""

import argparse
import csv
import tempfile
import time
from collections import defaultdict
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import median

import elliptude as el
from elliptude.campaigns import engine
from elliptude.validation.adversary import SCENARIOS

MILLION, UPDATES = 1_000_000, 20


@dataclass(frozen=True)
class Cost:
    """What a campaign took."""

    worked_s: float
    """Time of a processor of a run in a block. The first of each worker does not count: it imports, and warms up."""
    stored_s: float
    """Time of a processor of a run in the process that stores them."""
    waited: float
    """Share of the time from a worker's first block to its last in which it had none."""
    bytes_per_row: float


def campaign(settings: dict[str, object], processes: int) -> Cost:
    """Run one, and forget its results."""
    with tempfile.TemporaryDirectory() as folder:
        # From the first block on, until the last one is kept: without starting processes, and without the summary.
        moments: list[float] = []
        summary = el.campaign(
            settings, folder, processes=processes, progress=lambda done, total: moments.append(time.process_time())
        )
        with (Path(folder) / "timings.csv").open(newline="") as lines:
            rows = list(csv.DictReader(lines))
    spans = defaultdict(list)
    for row in rows:
        began = float(row["began"])
        spans[row["worker"]].append((began, began + float(row["wall_s"])))
    gaps = [after[0] - before[1] for one in spans.values() for before, after in pairwise(sorted(one))]
    whole = [max(ends) - min(begins) for begins, ends in (zip(*one, strict=True) for one in spans.values())]
    first = {worker: min(one)[0] for worker, one in spans.items()}
    later = [row for row in rows if float(row["began"]) > first[row["worker"]]]
    worked = sum(float(row["cpu_s"]) for row in later) / sum(int(row["seeds"]) for row in later)
    # A process that works itself stores as little as one that does not: what it stores is not measured.
    stored = (moments[-1] - moments[0]) / sum(int(row["seeds"]) for row in rows) if processes > 1 else 0.0
    waited = sum(gaps) / sum(whole) if processes > 1 else 0.0
    return Cost(worked, stored, waited, summary["cost"]["bytes_per_row"])


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=15_000, help="how many runs of each scenario are measured")
    parser.add_argument("--processes", type=int, default=max(2, engine.cores()))
    parser.add_argument("--times", type=int, default=3, help="how often each is measured")
    parser.add_argument("--scenario", action="append", choices=SCENARIOS, help="may be given several times")
    parser.add_argument("--rows", choices=("updates", "runs"), default="updates")
    arguments = parser.parse_args()
    processes, runs = arguments.processes, arguments.runs
    print(f"{runs} runs of {UPDATES} updates, three directions within 1°, one process and {processes}")
    print(f"scenario    µs/update  storing %  waiting %  efficiency %  bytes/row  1e6 runs on {processes} cores, min")
    for scenario in arguments.scenario or SCENARIOS:
        settings = {
            "scenarios": [scenario],
            "bound_deg": [1.0],
            "updates": UPDATES,
            "rows": arguments.rows,
            "seeds": {"count": runs},
        }
        pairs = [(campaign(settings, 1), campaign(settings, processes)) for _ in range(arguments.times)]
        alone = median(one.worked_s for one, _ in pairs)
        waited = median(several.waited for _, several in pairs)
        busy = median(several.worked_s + several.stored_s for _, several in pairs)
        stored = median(several.stored_s for _, several in pairs) / busy
        minutes = busy / (1.0 - waited) * MILLION / processes / 60.0
        print(
            f"{scenario:10}  {1e6 * alone / UPDATES:9.2f}  {100.0 * stored:9.2f}  {100.0 * waited:9.2f}  "
            f"{100.0 * alone / busy * (1.0 - waited):12.1f}  {pairs[0][1].bytes_per_row:9.2f}  {minutes:9.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
