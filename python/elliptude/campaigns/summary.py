"""What came of a campaign, from the counts in the metadata of its files: no row is read."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from elliptude.campaigns.plan import Plan
from elliptude.campaigns.rows import WIDTH_EDGES, combined, read_counts
from elliptude.campaigns.store import Store
from elliptude.validation.judge import FORM_EDGES

FAULTS = ("escapes", "refused", "failed")
"""What the guaranteed mode promises never to happen while errors keep their bounds."""
_TOTALS = ("runs", "updates", *FAULTS, "without_set")
_SHARES = {"median": 0.5, "p95": 0.95}


def summarize(plan: Plan, store: Store) -> dict[str, Any]:
    """Figures of each case and estimator, and of all, for JSON.

    Parameters
    ----------
    plan : Plan
    store : Store
        It has all blocks.

    Returns
    -------
    dict

    Raises
    ------
    FileError
        If a file is not what it should be.
    """
    parts: dict[tuple[Any, str], list[dict[str, Any]]] = {
        (case, estimator.name): [] for case in plan.cases for estimator in plan.estimators
    }
    stored = 0
    blocks = list(plan.blocks())
    for block in blocks:
        file = store.file(block)
        stored += file.stat().st_size
        for name, counts in read_counts(file)["estimators"].items():
            parts[block.case, name].append(counts)
    cases = [
        asdict(case) | asdict(estimator) | _figures(parts[case, estimator.name])
        for case in plan.cases
        for estimator in plan.estimators
    ]
    for case in cases:
        del case["kind"]
    modes = {
        mode: {name: sum(case[name] for case in cases if case["mode"] == mode) for name in _TOTALS}
        for mode in plan.settings.estimator.mode
    }
    return plan.identity() | {
        "modes": modes,
        "faults_of_guaranteed_mode": sum(
            case[name]
            for case in cases
            if case["mode"] == "guaranteed" and case["errors_over_bounds"] <= 1.0
            for name in FAULTS
        ),
        "cases": cases,
        "form_edges": FORM_EDGES[:-1].tolist(),
        "width_edges_deg": WIDTH_EDGES[:-1].tolist(),
        "cost": _cost(plan, store, stored, len(blocks)),
    }


def _figures(parts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    figures = combined(parts)
    by_update = figures.pop("by_update")
    means = [
        angle / sets if sets else None
        for angle, sets in zip(by_update["largest_angle_deg"], by_update["sets"], strict=True)
    ]
    return figures | {
        "largest_angle_deg": {name: _quantile(figures["widths"], share) for name, share in _SHARES.items()},
        "mean_largest_angle_deg_by_update": means,
    }


def _quantile(histogram: Sequence[int], share: float) -> float | None:
    """The upper edge of the bin that holds a quantile: at most 12 % above it. None without any set."""
    counts = np.cumsum(histogram)
    if counts[-1] == 0:
        return None
    bin_ = int(np.searchsorted(counts, share * counts[-1]))
    return float(min(WIDTH_EDGES[bin_ + 1], 180.0))


def _cost(plan: Plan, store: Store, stored: int, blocks: int) -> dict[str, Any]:
    """What the campaign cost, by the clock of the processors that ran it, and takes on the disk."""
    updates, estimators = plan.settings.updates, len(plan.estimators)
    timed = store.timings()
    timed_updates = sum(seeds for seeds, _ in timed.values()) * updates * estimators
    rows = plan.updates if plan.settings.rows == "updates" else plan.runs
    return {
        "blocks": blocks,
        "rows": rows,
        "bytes": stored,
        "bytes_per_row": stored / rows,
        "timed_updates": timed_updates,
        "cpu_s_per_million_updates": 1e6 * sum(cpu for _, cpu in timed.values()) / timed_updates
        if timed_updates
        else None,
    }
