"""Campaigns: the same numbers whoever works, kept through every kind of interruption, and right."""

import csv
import json
import os
import resource
import signal
import subprocess
import sys
import time
import types
from concurrent.futures import ThreadPoolExecutor

import elliptude as el
import numpy as np
import pyarrow.dataset
import pytest
from elliptude.campaigns import plan as plans
from elliptude.campaigns import simulate, store, summary
from elliptude.campaigns.plan import read_plan
from elliptude.io.files import FileError
from elliptude.validation import adversary, plants
from elliptude.validation.adversary import Case
from scipy.spatial.transform import Rotation

PROGRAM = [sys.executable, "-c", "from elliptude.cli import main; main()"]


def settings(**changed):
    """Two cases with three estimators, and 120 seeds."""
    given = {
        "scenarios": ["gyro", "free"],
        "directions": ["two"],
        "bound_deg": [7.0],
        "noise": ["perpendicular"],
        "updates": 8,
        "seeds": {"first": 10, "count": 120},
        "estimator": {"mode": ["guaranteed", "paper"], "criterion": ["volume", "trace"]},
    }
    return given | changed


@pytest.fixture
def small_blocks(monkeypatch):
    """Blocks of one batch."""
    monkeypatch.setattr(plans, "BLOCK_UPDATES", 1)


def files(folder):
    return {str(file.relative_to(folder)): file.read_bytes() for file in sorted((folder / "rows").rglob("*.parquet"))}


def rows(folder):
    found = pyarrow.dataset.dataset(folder / "rows", partitioning="hive").to_table().to_pandas()
    return found.sort_values(["scenario", "mode", "criterion", "seed"], kind="stable", ignore_index=True)


def without_time(found):
    cost = {key: value for key, value in found["cost"].items() if key != "cpu_s_per_million_updates"}
    return found | {"cost": cost}


# --- the numbers ------------------------------------------------------------------------------------------------------


def test_the_same_bytes_whoever_works(tmp_path, small_blocks):
    summaries = [el.campaign(settings(), tmp_path / "here", processes=1)]
    summaries.append(el.campaign(settings(), tmp_path / "two", processes=2))
    with ThreadPoolExecutor(3) as executor:
        summaries.append(el.campaign(settings(), tmp_path / "executor", executor=executor))
    first, *others = (files(tmp_path / name) for name in ("here", "two", "executor"))
    assert len(first) == 2 * 3  # seeds 10 to 129 in batches of 50, for two cases
    assert all(other == first for other in others)
    assert all(without_time(one) == without_time(summaries[0]) for one in summaries)
    assert json.loads((tmp_path / "here" / "summary.json").read_text()) == summaries[0]


def test_a_run_is_a_function_of_scenario_settings_and_seed(tmp_path, monkeypatch):
    """Of the seeds asked for, blocks and other settings nothing but these."""
    el.campaign(settings(), tmp_path / "all", processes=1)
    monkeypatch.setattr(plans, "BLOCK_UPDATES", 1)
    some = settings(
        scenarios=["orbit", "free"],
        seeds={"first": 47, "count": 5},
        estimator={"mode": ["paper"], "criterion": ["trace"]},
    )
    el.campaign(some, tmp_path / "some", processes=1)
    found, whole = rows(tmp_path / "some"), rows(tmp_path / "all")
    found = found[found.scenario == "free"].reset_index(drop=True)
    same = whole[(whole["mode"] == "paper") & (whole.criterion == "trace") & (whole.scenario == "free")]
    same = same[same.seed.between(47, 51)].reset_index(drop=True)
    assert len(found) == 5 * 8
    assert found.astype(str).equals(same.astype(str))


@pytest.mark.parametrize("scenario", ["gyro", "orbit"])
def test_rows_are_what_the_filter_says_update_by_update(tmp_path, scenario):
    """The filter told each measurement by itself, its extent and SciPy's angles; not by what campaigns call."""
    given = settings(scenarios=[scenario], bound_deg=[1.0], noise=["common"], seeds={"count": 3}, estimator={})
    el.campaign(given, tmp_path, processes=1)
    found = rows(tmp_path)
    case = Case(scenario, "two", 1.0, "common")
    of = plants.plant(case)
    draws = np.random.default_rng(np.random.SeedSequence(0, spawn_key=tuple(case.name.encode())))
    starts = adversary.draw_starts(of, 50, draws)
    errors = adversary.draw_errors(of, "common", starts, 8, draws)
    motion = of.motion(starts, errors)
    measured = adversary.measure(of, motion, errors)
    for seed in range(3):
        start, begin = None, 1
        if not starts.from_measurement[seed]:
            start = el.StateEllipsoid(starts.attitudes[seed], starts.vectors[seed], starts.shapes[seed])
            begin = 0
        estimator = el.GuaranteedFilter(of.guaranteed_flow(), start, time=begin * of.interval)
        for update in range(1, 9):
            if update > begin:
                gyro = {"gyro": measured.rates[seed, update - 1]} if of.has_gyro else {}
                estimator.predict(update * of.interval, **gyro)
            rate = {} if of.has_gyro else {"angular_velocity": measured.rates[seed, update], "rate_bound": of.bound}
            estimator.update(measured.directions[seed, update], of.reference, of.bound, **rate)
            row = found[(found.seed == seed) & (found["update"] == update)].iloc[0]
            assert (row.outcome, row.escaped, row["mode"], row.policy) == (
                "set", False, "guaranteed", "drop_measurement",
            )  # fmt: skip
            ellipsoid = estimator.ellipsoid
            np.testing.assert_allclose(row.largest_angle_rad, ellipsoid.extent().largest_angle, rtol=2e-6)
            np.testing.assert_allclose(row.trace, np.trace(ellipsoid.shape), rtol=2e-6)
            error = Rotation.from_matrix(ellipsoid.attitude.T @ motion.attitudes[seed, update]).magnitude()
            np.testing.assert_allclose(row.error_angle_rad, error, rtol=1e-5, atol=1e-9)
            assert 0.0 <= row.form <= 1.0


def test_counts_are_those_of_the_rows(tmp_path, small_blocks):
    given = settings(scenarios=["free", "orbit"], bound_deg=[20.0])
    total = el.campaign(given, tmp_path, processes=1)
    found = rows(tmp_path)
    assert len(found) == total["cost"]["rows"] == 2 * 4 * 120 * 8
    stored = sum(map(len, files(tmp_path).values()))
    assert total["cost"]["bytes"] == stored
    np.testing.assert_allclose(total["cost"]["bytes_per_row"], stored / len(found))
    assert total["cost"]["cpu_s_per_million_updates"] > 0.0
    assert total["modes"]["paper"]["escapes"] > 0
    assert total["modes"]["guaranteed"]["escapes"] == total["faults_of_guaranteed_mode"] == 0
    for case in total["cases"]:
        own = found[
            (found.scenario == case["scenario"])
            & (found["mode"] == case["mode"])
            & (found.criterion == case["criterion"])
        ]
        assert (case["runs"], case["updates"]) == (120, len(own)) == (120, 960)
        assert case["escapes"] == own.escaped.sum() == (own.form > 1.0).sum()
        assert case["refused"] == (own.outcome == "refused").sum()
        assert case["used"] == own.prediction_used.sum()
        worst = own[(own.seed == case["worst"]["seed"]) & (own["update"] == case["worst"]["update"])]
        assert worst.form.item() == own.form.max() == np.float32(case["worst"]["form"])
        widths = np.rad2deg(own.largest_angle_rad)
        for name, share in (("median", 0.5), ("p95", 0.95)):
            exact = np.quantile(widths, share, method="inverted_cdf")
            assert exact * (1.0 - 1e-6) <= case["largest_angle_deg"][name] <= 1.13 * exact
        means = widths.groupby(own["update"]).mean()
        np.testing.assert_allclose(case["mean_largest_angle_deg_by_update"], means, rtol=1e-6)


def test_rows_of_runs(tmp_path):
    el.campaign(settings(), tmp_path / "updates", processes=1)
    el.campaign(settings(rows="runs"), tmp_path / "runs", processes=1)
    updates, runs = rows(tmp_path / "updates"), rows(tmp_path / "runs")
    assert len(runs) == len(updates) / 8 == 2 * 4 * 120
    by_run = updates.groupby(["scenario", "mode", "criterion", "seed"], observed=True, sort=False)
    np.testing.assert_array_equal(runs.escapes, by_run.escaped.sum())
    np.testing.assert_array_equal(runs.sets, by_run.form.count())
    np.testing.assert_array_equal(runs.predictions_used, by_run.prediction_used.sum())
    np.testing.assert_array_equal(runs.largest_form, by_run.form.max())
    np.testing.assert_array_equal(runs.last_largest_angle_rad, by_run.largest_angle_rad.last())
    settled = updates[updates["update"] >= 6].groupby(["scenario", "mode", "criterion", "seed"], observed=True)
    np.testing.assert_allclose(runs.mean_trace, settled.trace.mean(), rtol=1e-6)


def test_errors_larger_than_their_bounds(tmp_path, small_blocks):
    """Nothing is promised then; the same draws, and the same truth at 1 as without the key."""
    given = settings(scenarios=["orbit"], estimator={"mode": ["guaranteed"], "policy": ["drop_measurement", "restart"]})
    large = el.campaign(given | {"errors_over_bounds": [1.0, 3.0]}, tmp_path / "large", processes=1)
    el.campaign(given, tmp_path / "kept", processes=1)
    found, kept = rows(tmp_path / "large"), rows(tmp_path / "kept")
    order = ["policy", "seed", "update"]
    inside = found[found.errors_over_bounds == 1.0].sort_values(order, ignore_index=True)
    assert inside.astype(str).equals(kept.sort_values(order, ignore_index=True).astype(str))
    beyond = found[found.errors_over_bounds == 3.0]
    assert not inside.escaped.any()
    assert (inside.outcome == "set").all()
    assert beyond.escaped.any()
    assert (beyond.outcome == "refused").any()
    # The policies differ only after a contradiction.
    for size, differ in ((inside, False), (beyond, True)):
        one, other = (size[size.policy == policy].form.to_numpy() for policy in ("drop_measurement", "restart"))
        assert (one.shape == other.shape and np.array_equal(one, other, equal_nan=True)) != differ
    assert large["faults_of_guaranteed_mode"] == 0
    assert large["modes"]["guaranteed"]["escapes"] == beyond.escaped.sum()


def test_a_scenario_of_ones_own(tmp_path):
    (tmp_path / "top.toml").write_text(
        """
        inertia = [1.0, 1.2, 0.9]
        potential = { kind = "free" }
        attitude0 = "identity"
        rate0 = [0.1, 0.2, 0.3]
        step = 0.05
        steps_between_measurements = 2
        measurements = 5
        bound_deg = [1.0]
        estimate0 = { attitude = "first measurement" }
        [directions]
        pair = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
        """
    )
    (tmp_path / "campaign.toml").write_text(
        'scenarios = ["top.toml"]\ndirections = ["pair"]\nbound_deg = [1]\nseeds = { count = 2 }\nupdates = 3\n'
    )
    found = el.campaign(tmp_path / "campaign.toml", tmp_path / "out", processes=1)
    assert [case["scenario"] for case in found["cases"]] == ["top"]
    assert found["modes"] == {
        "guaranteed": {"runs": 2, "updates": 6, "escapes": 0, "refused": 0, "failed": 0, "without_set": 0}
    }
    assert found["own_scenarios"]["top"]["rate0"] == [0.1, 0.2, 0.3]
    assert list(rows(tmp_path / "out").scenario.unique()) == ["top"]


def test_blocks_hold_each_seed_once_and_line_up():
    for first, count in ((0, 1), (49, 2), (50, 50), (7, 12_345)):
        plan = read_plan(settings(seeds={"first": first, "count": count}))
        for case in plan.cases:
            blocks = [block for block in plan.blocks() if block.case == case]
            seeds = np.concatenate([np.arange(block.first, block.first + block.count) for block in blocks])
            np.testing.assert_array_equal(seeds, np.arange(first, first + count))
        assert len({block.path for block in plan.blocks()}) == len(list(plan.blocks()))
        # Another campaign over more seeds has the whole blocks of this one.
        longer = read_plan(settings(seeds={"first": 0, "count": first + count + 5_000}))
        assert {block for block in plan.blocks() if block.count == 1550} <= set(longer.blocks())


# --- interruptions ----------------------------------------------------------------------------------------------------


def start(config, out, *more):
    return subprocess.Popen(
        [*PROGRAM, "campaign", str(config), "--out", str(out), *more],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


@pytest.fixture(scope="module")
def long_campaign(tmp_path_factory):
    """A file with twelve blocks of a third of a second, beside what a single process makes of it undisturbed."""
    config = tmp_path_factory.mktemp("long") / "long.toml"
    config.write_text(
        'scenarios = ["gyro"]\ndirections = ["two", "three"]\nbound_deg = [1.0, 7.0]\n'
        'noise = ["inside", "common", "alternating"]\nseeds = { count = 400 }\n'
        'estimator = { mode = ["guaranteed", "paper"] }\n'
    )
    el.campaign(config, config.with_name("undisturbed"), processes=1)
    return config


def wait_for_blocks(out, count=1):
    deadline = time.monotonic() + 120.0
    while len(list(out.rglob("*.parquet"))) < count:
        assert time.monotonic() < deadline
        time.sleep(0.01)


def assert_undisturbed(config, out):
    """What is there is what it would be without interruption, and no more."""
    undisturbed = config.with_name("undisturbed")
    assert files(out) == files(undisturbed)
    found, expected = (json.loads((folder / "summary.json").read_text()) for folder in (out, undisturbed))
    assert without_time(found) == without_time(expected)
    assert found["cost"]["timed_updates"] == expected["cost"]["timed_updates"] == 12 * 400 * 20 * 2
    assert not list(out.rglob("*.tmp"))
    assert sorted(file.name for file in out.iterdir()) == [
        "campaign.json",
        "rows",
        "summary.html",
        "summary.json",
        "timings.csv",
    ]


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_an_interrupted_campaign_goes_on(tmp_path, long_campaign, how):
    out = tmp_path / "out"
    process = start(long_campaign, out, "--processes", "2")
    wait_for_blocks(out)
    if how == signal.SIGINT:
        os.killpg(process.pid, how)  # as a terminal does, to all processes
    else:
        process.send_signal(how)
    output, errors = process.communicate(timeout=300)
    assert process.returncode == {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGKILL: -9}[how], errors
    assert output == ""
    assert [line for line in errors.splitlines() if "so far" not in line] in ([], ["Aborted."])
    begun = files(out)
    assert 0 < len(begun) < 12
    assert not (out / "summary.json").exists()
    resumed = start(long_campaign, out, "--processes", "2")
    _, errors = resumed.communicate(timeout=300)
    assert resumed.returncode == 0, errors
    assert all("so far" in line for line in errors.splitlines())
    assert_undisturbed(long_campaign, out)


def test_a_block_that_is_there_was_timed(tmp_path, monkeypatch):
    """Whenever the process ends: else what a campaign that goes on says of its cost is of fewer blocks than it has."""
    plan = read_plan(settings())
    block = next(iter(plan.blocks()))

    def ended(*_, **__):
        raise KeyboardInterrupt

    with store.open_store(tmp_path / "out", plan) as opened:
        monkeypatch.setattr(csv, "writer", ended)
        with pytest.raises(KeyboardInterrupt):
            opened.keep(block, types.SimpleNamespace(file=b"", cpu_s=1.0, wall_s=1.0, began=0.0, worker="1"))
        assert not opened.file(block).exists()


def test_a_full_disk_ends_a_campaign_that_goes_on_later(tmp_path, long_campaign):
    """The system refuses files of more than 200 KB: those of blocks, not the others."""
    out = tmp_path / "out"

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))

    failed = subprocess.run(
        [*PROGRAM, "campaign", long_campaign, "--out", out, "--processes", "2"],
        preexec_fn=limit,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert failed.returncode == 1
    assert "not written: File too large" in failed.stderr.replace("\n", "")
    assert files(out) == {}
    assert not list(out.rglob("*.tmp"))
    el.campaign(long_campaign, out, processes=1)
    assert_undisturbed(long_campaign, out)


def test_a_folder_in_use(tmp_path, long_campaign):
    out = tmp_path / "out"
    process = start(long_campaign, out, "--processes", "1")
    wait_for_blocks(out)
    with pytest.raises(FileError, match="another process works on this campaign"):
        el.campaign(long_campaign, out, processes=1)
    process.kill()
    process.communicate()
    el.campaign(long_campaign, out, processes=1)
    assert (out / "summary.html").exists()


def test_a_campaign_that_is_done_is_not_run_again(tmp_path, monkeypatch):
    first = el.campaign(settings(), tmp_path, processes=1)
    monkeypatch.setattr(simulate, "plant", None)
    assert el.campaign(settings(), tmp_path, processes=1) == first


def test_lines_of_time_that_were_cut_off_cost_nothing(tmp_path):
    first = el.campaign(settings(), tmp_path, processes=1)
    with (tmp_path / store.TIMINGS).open("a") as timings:
        timings.write("scenario=gyro/dir")
    assert el.campaign(settings(), tmp_path, processes=1) == first


# --- what is refused --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"scenarios": ["orbits"]}, "campaign: scenarios[0]: no scenario 'orbits', did you mean 'orbit'?"),
        ({"scenarios": []}, "campaign: scenarios: must have at least 1 value(s)"),
        ({"scenarios": ["orbit", "orbit"]}, "campaign: scenarios: must not name anything twice"),
        ({"scenarios": ["moon.toml"]}, "moon.toml: no such file"),
        ({"directions": ["four"]}, "campaign: scenarios[0]: gyro has the directions two, three, five, not 'four'"),
        ({"seeds": {"first": 0, "count": 0}}, "campaign: seeds.count: must be at least 1, not 0"),
        ({"seeds": {"first": -1, "count": 5}}, "campaign: seeds.first: must be at least 0, not -1"),
        ({"seeds": {}}, "campaign: seeds.count: missing"),
        ({"bound_deg": [0.0]}, "campaign: bound_deg[0]: must be at least 0.001, not 0.0"),
        ({"bound_deg": [float("nan")]}, "campaign: bound_deg[0]: must be"),
        ({"bound_deg": [7.0, 7.0000001]}, "campaign: bound_deg: must not name anything twice"),
        ({"bound_deg": [61.0]}, "campaign: bound_deg[0]: must be at most 60, not 61.0"),
        ({"noise": ["search"]}, "campaign: noise[0]: must be 'inside', 'perpendicular', 'common' or 'alternating'"),
        ({"errors_over_bounds": [11.0]}, "campaign: errors_over_bounds[0]: must be at most 10, not 11.0"),
        (
            {"bound_deg": [50.0], "errors_over_bounds": [2.0]},
            "campaign: bound_deg times errors_over_bounds must be at most 90 degrees, not 100",
        ),
        ({"updates": 0}, "campaign: updates: must be at least 1, not 0"),
        ({"estimator": {"mode": ["best"]}}, "campaign: estimator.mode[0]: must be"),
        ({"estimator": {"modes": ["paper"]}}, "campaign: estimator.modes: no such key, did you mean 'mode'?"),
        ({"rows": "all"}, "campaign: rows: must be 'updates' or 'runs', not 'all'"),
    ],
)
def test_settings_that_do_not_fit(tmp_path, changed, words):
    with pytest.raises(FileError) as failed:
        el.campaign(settings(**changed), tmp_path / "out")
    assert words in str(failed.value)
    assert not (tmp_path / "out").exists()


def test_workers_that_are_none(tmp_path):
    with pytest.raises(ValueError, match="processes: 0 is not at least 1"):
        el.campaign(settings(), tmp_path / "out", processes=0)
    with pytest.raises(
        TypeError, match=r"executor: a int is neither a concurrent.futures.Executor nor a distributed.Client"
    ):
        el.campaign(settings(), tmp_path / "out", executor=4)
    assert not (tmp_path / "out").exists()


def test_the_folder_of_another_campaign(tmp_path):
    el.campaign(settings(), tmp_path, processes=1)
    before = files(tmp_path)
    with pytest.raises(FileError) as failed:
        el.campaign(settings(seeds={"first": 10, "count": 121}, bound_deg=[7.0, 1.0]), tmp_path)
    assert "holds another campaign: bound_deg is [7.0] there and [7.0, 1.0] here; seeds.count is 120 there and 121" in (
        str(failed.value)
    )
    stored = json.loads((tmp_path / "campaign.json").read_text())
    (tmp_path / "campaign.json").write_text(json.dumps(stored | {"elliptude": "0.0.1"}))
    with pytest.raises(FileError, match=r'elliptude is "0.0.1" there and "'):
        el.campaign(settings(), tmp_path)
    for text in ("[]", "{", ""):
        (tmp_path / "campaign.json").write_text(text)
        with pytest.raises(FileError, match=r"campaign.json: not a campaign's: choose a new folder"):
            el.campaign(settings(), tmp_path)
    assert files(tmp_path) == before


def test_a_folder_with_other_files(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(FileError, match="holds files, but no campaign"):
        el.campaign(settings(), tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["notes.txt"]


def test_a_folder_that_cannot_be_written(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(simulate, "plant", None)  # before any work
    with pytest.raises(FileError, match="within a file, where a folder is needed"):
        el.campaign(settings(), tmp_path / "file" / "out")


def test_a_block_that_is_no_block(tmp_path):
    el.campaign(settings(), tmp_path, processes=1)
    block = next((tmp_path / "rows").rglob("*.parquet"))
    block.write_bytes(b"PAR1")
    with pytest.raises(FileError, match="not a block of a campaign; remove it, and the same command makes it anew"):
        el.campaign(settings(), tmp_path, processes=1)
    block.unlink()
    el.campaign(settings(), tmp_path, processes=1)


def test_a_worker_with_another_version():
    plan = read_plan(settings())
    with pytest.raises(RuntimeError, match=r"on a worker, 0\.0\.1 where the campaign was started"):
        simulate.simulate_block(plan, next(plan.blocks()), "0.0.1")


def test_faults_are_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(summary, "FAULTS", ("updates",))
    found = el.campaign(settings(), tmp_path, processes=1)
    assert found["faults_of_guaranteed_mode"] == 2 * 2 * 120 * 8
