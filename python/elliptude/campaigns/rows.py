"""The rows and the counts of a block, and the Parquet file that holds both."""

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray

from elliptude.campaigns.plan import CampaignCase, Estimator
from elliptude.io.files import FileError
from elliptude.typing import FloatArray
from elliptude.validation.adversary import Starts
from elliptude.validation.filter_runs import FAILED, HOLDS, REFUSED, WITHOUT_SET, Runs
from elliptude.validation.tally import SETTLED_UPDATE, SIZES, Tally, combine, mean_sizes

OUTCOMES = ("set", "refused", "no set", "failed")
"""Words for the outcomes of an update."""
assert tuple(range(len(OUTCOMES))) == (HOLDS, REFUSED, WITHOUT_SET, FAILED)
WIDTH_EDGES = np.concatenate([[0.0], np.geomspace(1e-4, 180.0, 126), [np.inf]])
"""Edges of the histogram of largest angles, degrees."""
_METADATA = b"elliptude.block"


@dataclass(frozen=True, eq=False)
class Judged:
    """T runs of an estimator with U updates each, judged."""

    seeds: NDArray[np.int64]
    """Shape (T,)."""
    starts: Starts
    runs: Runs
    forms: FloatArray
    """xᵀP⁻¹x of the truth, NaN where there is no set, shape (T, U)."""
    sizes: FloatArray
    """`elliptude.validation.tally.SIZES`, shape (T, U, 3)."""
    errors: FloatArray
    """Angles between the centers and the true attitudes, rad, shape (T, U)."""

    @property
    def has_set(self) -> NDArray[np.bool_]:
        """Shape (T, U)."""
        known: NDArray[np.bool_] = (self.runs.claims == HOLDS) | (self.runs.claims == REFUSED)
        return known

    @property
    def escaped(self) -> NDArray[np.bool_]:
        """Whether there is a set without the truth, as `Tally` counts it: NaN is none that holds it. Shape (T, U)."""
        return self.has_set & ~(self.forms <= 1.0)


# --- rows -------------------------------------------------------------------------------------------------------------


def of_updates(judged: Judged, case: CampaignCase, estimator: Estimator) -> pa.Table:
    """A row for each update."""
    count, updates = judged.forms.shape
    known = judged.has_set
    numbers = {"form": judged.forms, "error_angle_rad": judged.errors}
    numbers |= {name: judged.sizes[..., i] for i, name in enumerate(SIZES)}
    columns = {
        **_who(case, estimator, judged.seeds, updates),
        "update": pa.array(np.tile(np.arange(1, updates + 1, dtype=np.uint16), count)),
        "outcome": _words(OUTCOMES, judged.runs.claims.ravel()),
        "escaped": pa.array(judged.escaped.ravel()),
        "prediction_used": pa.array(judged.runs.used.ravel()),
        **{name: _numbers(np.where(known, values, np.nan)) for name, values in numbers.items()},
    }
    return pa.table(columns)


def of_runs(judged: Judged, case: CampaignCase, estimator: Estimator) -> pa.Table:
    """A row for each run: its counts, its worst update, its sizes in the mean over settled updates and at the end."""
    claims, known = judged.runs.claims, judged.has_set
    settled = slice(min(SETTLED_UPDATE - 1, claims.shape[1] - 1), None)
    counts = {
        "sets": known,
        "escapes": judged.escaped,
        "refused": claims == REFUSED,
        "without_set": claims == WITHOUT_SET,
        "failed": claims == FAILED,
        "predictions_used": judged.runs.used,
    }
    numbers = {"form": judged.forms, "error_angle_rad": judged.errors}
    columns = {
        **_who(case, estimator, judged.seeds, 1),
        **{name: pa.array(np.sum(where, axis=1).astype(np.uint16)) for name, where in counts.items()},
        **{f"largest_{name}": _numbers(_reduced(np.fmax, values, known)) for name, values in numbers.items()},
    }
    for i, name in enumerate(SIZES):
        values = np.where(known, judged.sizes[..., i], np.nan)
        columns[f"mean_{name}"] = _numbers(_means(values[:, settled]))
        columns[f"last_{name}"] = _numbers(values[:, -1])
    return pa.table(columns)


def _who(case: CampaignCase, estimator: Estimator, seeds: NDArray[np.int64], times: int) -> dict[str, pa.Array]:
    """What the folders do not say: the numbers of the case, the estimator, the seed."""
    count = len(seeds) * times
    numbers = {name: pa.array(np.full(count, getattr(case, name))) for name in ("bound_deg", "errors_over_bounds")}
    words = {"mode": estimator.mode, "criterion": estimator.criterion, "policy": estimator.policy}
    told = {name: _same_word(word, count) for name, word in words.items()}
    return numbers | told | {"seed": pa.array(np.repeat(seeds, times))}


def _same_word(word: str | None, count: int) -> pa.Array:
    """The word in each row; missing if there is none."""
    indices = pa.nulls(count, pa.int8()) if word is None else pa.array(np.zeros(count, np.int8))
    return pa.DictionaryArray.from_arrays(indices, pa.array([] if word is None else [word], pa.string()))


def _words(words: Sequence[str], indices: NDArray[np.uint8]) -> pa.Array:
    return pa.DictionaryArray.from_arrays(pa.array(indices, pa.int8()), pa.array(words, pa.string()))


def _numbers(values: FloatArray) -> pa.Array:
    """In single precision: of a statistic no more digits count. NaN is missing."""
    with np.errstate(over="ignore"):
        return pa.array(values.ravel().astype(np.float32), from_pandas=True)


def _reduced(function: np.ufunc, values: FloatArray, known: NDArray[np.bool_]) -> FloatArray:
    reduced: FloatArray = function.reduce(np.where(known, values, np.nan), axis=1)
    return reduced


def _means(values: FloatArray) -> FloatArray:
    """The mean of each row, over what is known in it."""
    known = np.isfinite(values)
    sums, counts = np.where(known, values, 0.0).sum(axis=1), known.sum(axis=1)
    means: FloatArray = np.divide(sums, counts, out=np.full(len(values), np.nan), where=counts > 0)
    return means


# --- counts -----------------------------------------------------------------------------------------------------------


def count(judged: Judged) -> dict[str, Any]:
    """The counts of some runs, as plain numbers."""
    tally = Tally()
    tally.add(judged.starts, judged.runs, judged.forms)
    counts = tally.to_dict()
    worst = counts.pop("worst")
    if worst is not None:
        worst["seed"] = int(judged.seeds[worst.pop("trial")])
    degrees = np.where(judged.has_set, np.rad2deg(judged.sizes[..., 2]), np.nan)
    known = np.isfinite(degrees)
    return counts | {
        "runs": len(judged.seeds),
        "worst": worst,
        "sizes": mean_sizes({"own": judged.sizes}),
        "widths": np.histogram(degrees[known], WIDTH_EDGES)[0].tolist(),
        "by_update": {
            "sets": known.sum(axis=0).tolist(),
            "largest_angle_deg": np.where(known, degrees, 0.0).sum(axis=0).tolist(),
        },
    }


def combined(parts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The counts of several lots of runs, in their order, as those of one."""
    by_update = {
        name: np.sum([part["by_update"][name] for part in parts], axis=0).tolist() for name in parts[0]["by_update"]
    }
    return combine(parts) | {
        "runs": sum(part["runs"] for part in parts),
        "widths": np.sum([part["widths"] for part in parts], axis=0).tolist(),
        "by_update": by_update,
    }


# --- the file ---------------------------------------------------------------------------------------------------------


def parquet(table: pa.Table, metadata: Mapping[str, Any]) -> bytes:
    """A Parquet file with the rows, and with the counts as its metadata."""
    text = json.dumps(metadata, ensure_ascii=False, allow_nan=False).encode()
    table = table.unify_dictionaries().replace_schema_metadata({_METADATA: text})
    split = [field.name for field in table.schema if field.type == pa.float32()]
    file = io.BytesIO()
    pa.parquet.write_table(
        table,
        file,
        compression="zstd",
        use_dictionary=[name for name in table.column_names if name not in split],
        use_byte_stream_split=split,
        write_statistics=False,
    )
    return file.getvalue()


def read_counts(file: Path) -> dict[str, Any]:
    """The counts of a block, from the metadata of its file; the rows are not read.

    Raises
    ------
    FileError
        If it is no such file.
    """
    try:
        metadata = pa.parquet.read_metadata(file).metadata
        counts: dict[str, Any] = json.loads(metadata[_METADATA])
    except (OSError, pa.ArrowException, KeyError, TypeError, ValueError) as error:
        raise FileError(f"{file}: not a block of a campaign; remove it, and the same command makes it anew") from error
    return counts
