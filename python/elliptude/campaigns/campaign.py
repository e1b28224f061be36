"""A campaign from its file to its summary: `elliptude.campaign`."""

import os
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import elliptude
from elliptude.campaigns import engine
from elliptude.campaigns.pieces import Piece
from elliptude.campaigns.plan import Plan, read_plan
from elliptude.campaigns.simulate import simulate_block
from elliptude.campaigns.store import PAGE, SUMMARY, Store, open_store
from elliptude.campaigns.summary import summarize
from elliptude.io.files import write_json

if TYPE_CHECKING:
    import distributed


def campaign(
    settings: str | os.PathLike[str] | Mapping[str, Any] | Plan,
    out: str | os.PathLike[str],
    *,
    executor: "Executor | distributed.Client | None" = None,
    processes: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Run a campaign, or the rest of one; see `elliptude.campaign`."""
    engine.require_workers(executor, processes)
    plan = settings if isinstance(settings, Plan) else read_plan(settings)
    with open_store(Path(out), plan) as store:
        _run(plan, store, executor, processes, progress or (lambda done, total: None))
        summary = summarize(plan, store)
        from elliptude.report.campaign import write_page  # imports Matplotlib, which takes its time

        write_page(summary, store.folder / PAGE)
        write_json(store.folder / SUMMARY, summary)
    return summary


def _run(
    plan: Plan,
    store: Store,
    executor: "Executor | distributed.Client | None",
    processes: int | None,
    progress: Callable[[int, int], None],
) -> None:
    """Run the blocks that are not there."""
    blocks = {block.name: block for block in plan.blocks()}
    total = plan.settings.seeds.count * len(plan.cases)
    left = {name: block for name, block in blocks.items() if not store.file(block).exists()}
    done = total - sum(block.count for block in left.values())
    progress(done, total)
    pieces = [Piece(name, (block,)) for name, block in left.items()]
    work = partial(simulate_block, plan, version=elliptude.__version__)
    with closing(engine.results(work, pieces, executor=executor, processes=processes)) as results:
        for name, result in results:
            store.keep(blocks[name], result)
            done += blocks[name].count
            progress(done, total)
