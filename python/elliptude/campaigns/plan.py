"""What a campaign runs: its TOML file, and the cases, estimators and blocks of seeds that follow from it."""

import itertools
import os
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeAlias, TypeVar
from urllib.parse import quote

from pydantic import AfterValidator, Field, model_validator

import elliptude
from elliptude.io.files import FileError, did_you_mean
from elliptude.io.toml import Model, Number, load_toml, validate
from elliptude.simulation import scenarios
from elliptude.simulation.scenarios import Scenario
from elliptude.validation.adversary import DIRECTIONS, SCENARIOS, Case
from elliptude.validation.judge import Mode

FORMAT = 1
"""The version of what a folder of results holds."""
BATCH_SEEDS = 50
"""Seeds that are drawn at once. A run's numbers depend on it: each is drawn with its whole batch."""
BLOCK_UPDATES = 50_000
"""About how many updates a block has: a second of work or some, a file of a megabyte."""

Item = TypeVar("Item")


def _different(items: tuple[Item, ...]) -> tuple[Item, ...]:
    # Numbers as names of cases have them.
    if len({f"{item:g}" if isinstance(item, float) else item for item in items}) < len(items):
        raise ValueError("must not name anything twice")
    return items


Items: TypeAlias = Annotated[tuple[Item, ...], Field(min_length=1), AfterValidator(_different)]
Criterion: TypeAlias = Literal["volume", "trace"]
Policy: TypeAlias = Literal["drop_measurement", "restart"]
Noise: TypeAlias = Literal["inside", "perpendicular", "common", "alternating"]
Rows: TypeAlias = Literal["updates", "runs"]


class Seeds(Model):
    """Whole numbers, one after the other; each makes a run of every case and estimator."""

    first: Annotated[int, Field(strict=True, ge=0, le=10**12)] = 0
    count: Annotated[int, Field(strict=True, ge=1, le=10**9)]


class Estimators(Model):
    """Modes, criteria and policies; all combinations that make sense."""

    mode: Items[Mode] = ("guaranteed",)
    criterion: Items[Criterion] = ("volume",)
    policy: Items[Policy] = ("drop_measurement",)


class Settings(Model):
    """The TOML file of a campaign."""

    scenarios: Items[Annotated[str, Field(min_length=1)]]
    """Those of ``elliptude validate``, or files of one's own."""
    directions: Items[Annotated[str, Field(min_length=1)]] = ("three",)
    bound_deg: Items[Annotated[Number, Field(ge=1e-3, le=60.0)]]
    noise: Items[Noise] = ("inside",)
    errors_over_bounds: Items[Annotated[Number, Field(ge=0.1, le=10.0)]] = (1.0,)
    """How large the errors of all measurements may be, over the bounds that the filters are told."""
    updates: Annotated[int, Field(strict=True, ge=1, le=10_000)] = 20
    rows: Rows = "updates"
    seeds: Seeds
    estimator: Estimators = Estimators()

    @model_validator(mode="after")
    def _errors_are_angles(self) -> Self:
        largest = max(self.bound_deg) * max(self.errors_over_bounds)
        if largest > 90.0:
            raise ValueError(f"bound_deg times errors_over_bounds must be at most 90 degrees, not {largest:g}")
        return self


@dataclass(frozen=True)
class CampaignCase(Case):
    """A case, perhaps with errors that do not keep the bounds that are stated."""

    errors_over_bounds: float = 1.0

    @property
    def true(self) -> Case:
        """The case whose bounds the errors keep."""
        return Case(self.scenario, self.directions, self.bound_deg * self.errors_over_bounds, self.noise)


@dataclass(frozen=True)
class Estimator:
    """One mode with one criterion and, in the guaranteed mode, one policy."""

    mode: Mode
    criterion: Criterion
    policy: Policy | None

    @property
    def name(self) -> str:
        """The words, with a space between."""
        return " ".join(word for word in (self.mode, self.criterion, self.policy) if word)

    @property
    def options(self) -> dict[str, Any]:
        """What its filter is made with."""
        return {"criterion": self.criterion} | ({} if self.policy is None else {"policy": self.policy})


@dataclass(frozen=True)
class Block:
    """Seeds of a case that are run and stored together."""

    case: CampaignCase
    first: int
    count: int
    number: int
    """Number of the block among those of all seeds from 0 on."""

    @property
    def path(self) -> str:
        """Its file, relative to the folder of the rows.

        Words of the case are folders with keys, as readers of Parquet know them; they would take numbers for words.
        """
        case = self.case
        words = {"scenario": case.scenario, "directions": case.directions, "noise": case.noise}
        folders = [f"{key}={quote(value, safe='')}" for key, value in words.items()]
        numbers = f"bound_{case.bound_deg!r}_deg_errors_{case.errors_over_bounds!r}"
        return "/".join([*folders, numbers, f"block-{self.number:08d}.parquet"])

    @property
    def name(self) -> str:
        """The case and the seeds in words."""
        times = self.case.errors_over_bounds
        over = "" if times == 1.0 else f", errors {times:g} times as large"
        return f"{self.case.name}{over}, seeds {self.first} to {self.first + self.count - 1}"


@dataclass(frozen=True)
class Plan:
    """A campaign as its file says, with the scenarios of one's own that it names."""

    settings: Settings
    """All scenarios by name, also those that the file names by their files."""
    own: Mapping[str, Scenario]
    """The latter, by their names."""

    @property
    def cases(self) -> tuple[CampaignCase, ...]:
        """Each scenario with each set of directions, bound, kind and size of errors."""
        given = self.settings
        each = itertools.product(
            given.scenarios, given.directions, given.bound_deg, given.noise, given.errors_over_bounds
        )
        return tuple(
            CampaignCase(scenario, directions, bound_deg, noise, errors_over_bounds=over)
            for scenario, directions, bound_deg, noise, over in each
        )

    @property
    def estimators(self) -> tuple[Estimator, ...]:
        """What each run of a case is repeated with, on the same measurements."""
        given = self.settings.estimator
        return tuple(
            dict.fromkeys(
                Estimator(mode, criterion, policy if mode == "guaranteed" else None)
                for mode, criterion, policy in itertools.product(given.mode, given.criterion, given.policy)
            )
        )

    @property
    def runs(self) -> int:
        """How many runs there are in all."""
        return self.settings.seeds.count * len(self.cases) * len(self.estimators)

    @property
    def updates(self) -> int:
        """How many updates there are in all."""
        return self.runs * self.settings.updates

    def blocks(self) -> Iterator[Block]:
        """The pieces of work. They depend on what is run, never on who works.

        All cases go on side by side, so that the time left can be told from the time gone.
        """
        seeds, rows = self.settings.seeds, self.settings.updates * len(self.estimators)
        size = BATCH_SEEDS * max(1, round(BLOCK_UPDATES / (BATCH_SEEDS * rows)))
        end = seeds.first + seeds.count
        for number in range(seeds.first // size, -(-end // size)):
            first = max(seeds.first, number * size)
            for case in self.cases:
                yield Block(case, first, min(end, (number + 1) * size) - first, number)

    def identity(self) -> dict[str, Any]:
        """All that the results depend on, as plain numbers and words."""
        return {
            "elliptude": elliptude.__version__,
            "format": FORMAT,
            "settings": self.settings.model_dump(mode="json"),
            "own_scenarios": {name: scenario.model_dump(mode="json") for name, scenario in self.own.items()},
        }


def template() -> str:
    """A campaign to start from, as TOML with comments."""
    return (resources.files("elliptude") / "data" / "campaigns" / "example.toml").read_text(encoding="utf-8")


def read_plan(campaign: str | os.PathLike[str] | Mapping[str, Any]) -> Plan:
    """Read what a campaign runs.

    Parameters
    ----------
    campaign : path-like or mapping
        A TOML file, or what would be in one. Scenarios of one's own are named relative to the file.

    Returns
    -------
    Plan

    Raises
    ------
    FileError
        If it cannot be read or does not fit, or names a scenario or directions that there are not.
    """
    if isinstance(campaign, Mapping):
        path, folder, tables = "campaign", Path(), dict(campaign)
    else:
        path, folder, tables = os.fspath(campaign), Path(campaign).parent, load_toml(campaign)
    settings = validate(path, tables, Settings)
    own: dict[str, Scenario] = {}
    names = []
    for i, name in enumerate(settings.scenarios):
        where = f"{path}: scenarios[{i}]"
        if not name.endswith(".toml"):
            if name not in SCENARIOS:
                said = did_you_mean(name, SCENARIOS) or f"; there are {', '.join(SCENARIOS)}"
                raise FileError(f"{where}: no scenario {name!r}{said}; a file of your own ends in .toml")
            names.append(name)
            known: Collection[str] = DIRECTIONS
        else:
            scenario = scenarios.load(folder / name)
            names.append(scenario.name)
            if scenario.name in own or scenario.name in SCENARIOS:
                raise FileError(f"{where}: another scenario has the name {scenario.name!r}, too")
            own[scenario.name] = scenario
            known = scenario.directions
        for directions in settings.directions:
            if directions not in known:
                raise FileError(f"{where}: {name} has the directions {', '.join(known)}, not {directions!r}")
    return Plan(settings.model_copy(update={"scenarios": tuple(names)}), own)
