"""Runs the seeds of a block, on whatever machine: the one place of a campaign where something is simulated."""

import math
import os
import socket
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

import elliptude
from elliptude.campaigns.plan import BATCH_SEEDS, Block, CampaignCase, Estimator, Plan
from elliptude.campaigns.rows import Judged, combined, count, of_runs, of_updates, parquet
from elliptude.validation.adversary import Measured, Motion, Plant, Starts, draw_errors, draw_starts, measure
from elliptude.validation.filter_runs import forms, run
from elliptude.validation.judge import sizes
from elliptude.validation.plants import plant


@dataclass(frozen=True)
class BlockResult:
    """What comes back of a block."""

    file: bytes
    """A Parquet file."""
    cpu_s: float
    """Time of a processor that it took."""
    wall_s: float
    """Time by the clock."""
    began: float
    """When it began, in s since 1970."""
    worker: str
    """Machine and process."""


@dataclass(frozen=True, eq=False)
class _Batch:
    """The measured motions of all seeds of a batch."""

    of: Plant
    """What the filters are told."""
    starts: Starts
    motion: Motion
    measured: Measured

    def judged(self, estimator: Estimator, seeds: NDArray[np.int64], wanted: NDArray[np.intp]) -> Judged:
        """Run an estimator over all of them; the wanted ones, which have these seeds."""
        runs = run(self.of, estimator.mode, self.starts, self.measured, **estimator.options)
        values, extents = forms(estimator.mode, runs, self.motion), sizes(estimator.mode, runs.shapes)
        # |C − Ĉ| = 2√2 sin(θ/2), Frobenius' norm.
        chords = np.linalg.norm(runs.attitudes - self.motion.attitudes[:, 1:], axis=(2, 3))
        angles = 2.0 * np.arcsin(np.minimum(chords / math.sqrt(8.0), 1.0))
        return Judged(
            seeds[wanted], self.starts.of(wanted), runs.of(wanted), values[wanted], extents[wanted], angles[wanted]
        )


def _draw(plan: Plan, case: CampaignCase, of: Plant, true: Plant, number: int) -> _Batch:
    draws = np.random.default_rng(np.random.SeedSequence(number, spawn_key=tuple(case.name.encode())))
    starts = draw_starts(true, BATCH_SEEDS, draws)
    errors = draw_errors(true, case.noise, starts, plan.settings.updates, draws)
    motion = true.motion(starts, errors)
    return _Batch(of, starts, motion, measure(true, motion, errors))


def _judged(plan: Plan, block: Block) -> Iterator[tuple[Estimator, Judged]]:
    """All runs of a block, batch by batch.

    A batch is always drawn, run and judged as a whole, so that no digit of a run depends on which others are wanted.
    """
    own, end = plan.own.get(block.case.scenario), block.first + block.count
    of, true = plant(block.case, own), plant(block.case.true, own)
    for number in range(block.first // BATCH_SEEDS, -(-end // BATCH_SEEDS)):
        batch = _draw(plan, block.case, of, true, number)
        seeds = np.arange(number * BATCH_SEEDS, (number + 1) * BATCH_SEEDS, dtype=np.int64)
        wanted = np.flatnonzero((seeds >= block.first) & (seeds < end))
        for estimator in plan.estimators:
            yield estimator, batch.judged(estimator, seeds, wanted)


def simulate_block(plan: Plan, block: Block, version: str) -> BlockResult:
    """Run a block: a function of the plan and the block alone, whoever calls it.

    Parameters
    ----------
    plan : Plan
    block : Block
    version : str
        That of the package where the campaign was started.

    Returns
    -------
    BlockResult

    Raises
    ------
    RuntimeError
        If this is another version.
    """
    if version != elliptude.__version__:
        raise RuntimeError(f"elliptude {elliptude.__version__} on a worker, {version} where the campaign was started")
    cpu, wall, began = time.process_time(), time.perf_counter(), time.time()
    table_of = of_updates if plan.settings.rows == "updates" else of_runs
    tables: list[pa.Table] = []
    counts: dict[str, list[dict[str, Any]]] = {estimator.name: [] for estimator in plan.estimators}
    for estimator, judged in _judged(plan, block):
        counts[estimator.name].append(count(judged))
        tables.append(table_of(judged, block.case, estimator))
    metadata = {
        "case": asdict(block.case),
        "first_seed": block.first,
        "seeds": block.count,
        "estimators": {name: combined(parts) for name, parts in counts.items()},
    }
    file = parquet(pa.concat_tables(tables), metadata)
    worker = f"{socket.gethostname()}:{os.getpid()}"
    return BlockResult(file, time.process_time() - cpu, time.perf_counter() - wall, began, worker)
