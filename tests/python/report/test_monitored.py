"""`elliptude monitor`: what it reads, writes, says and refuses; frames, headings, and quaternions that are misread."""

import dataclasses
import json

import numpy as np
import pytest
import tomlkit
from datasets import broad, needs_datasets
from elliptude import cli
from elliptude.io import column_files, tables
from elliptude.logs.reference_attitudes import Reference, attitudes_at, has_sample_at
from elliptude.monitoring import Limits
from elliptude.report import monitored
from elliptude.report.estimated.reading import read_run
from recorders import write_ulog
from scipy.spatial.transform import Rotation
from test_proposals import made
from typer.testing import CliRunner

NED = Rotation.from_matrix([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
WIDTH = np.deg2rad(10.0)


def run(*arguments):
    return CliRunner().invoke(cli.make_app(), ["monitor", *(str(argument) for argument in arguments)])


def words(done):
    return " ".join(done.output.split())


def quaternions(rotations):
    return rotations.as_quat(canonical=True, scalar_first=True)


def write_estimate(path, times, rotations):
    columns = {"time_s": times} | dict(zip(tables.QUATERNION, quaternions(rotations).T, strict=True))
    column_files.write_columns(path, "measurements", columns)
    return path


@pytest.fixture
def result(tmp_path):
    """400 rows of balls within 10 degrees, up within 3, the last ten without a set; and their centers."""
    n = 400
    times = 0.1 * np.arange(n)
    centers = Rotation.from_rotvec(np.cumsum(0.05 * np.random.default_rng(3).normal(size=(n, 3)), axis=0))
    shape = (2.0 * np.tan(0.5 * WIDTH)) ** 2
    shapes = np.full((n, 6, 6), np.nan)
    shapes[:, :3, :3] = shape * np.eye(3)
    widths = np.full((n, 6), np.nan)
    widths[:, :3] = WIDTH
    claims = ["unconditional"] * 380 + ["conditional"] * 10 + ["none"] * 10
    columns = tables.Result(
        times=times, quaternions=quaternions(centers), vector="bias", vectors=np.full((n, 3), np.nan), shapes=shapes,
        half_widths=widths, largest_angles=np.full(n, WIDTH), used=["up"] * n, refused=[""] * n,
        shares=np.full(n, np.nan), margins=np.zeros(n), chart="gibbs", claims=claims,
        prediction_used=np.ones(n), dropped=[""] * n, tilt_bounds=np.full(n, np.deg2rad(3.0)),
    ).columns()  # fmt: skip
    lost = np.arange(n) >= 390
    for name, values in columns.items():
        if isinstance(values, np.ndarray) and name != "time_s":
            columns[name] = np.where(lost, np.nan, values)
    column_files.write_columns(tmp_path / "results.csv", "results", columns)
    return tmp_path / "results.csv", times, centers


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_table_picture_and_summary(tmp_path, result, suffix):
    table, times, centers = result
    turns = np.zeros((400, 3))
    turns[100:200, 0] = np.deg2rad(8.0)  # more than up allows
    turns[200:300, 2] = np.deg2rad(15.0)  # more than the set allows
    estimate = write_estimate(tmp_path / "estimate.csv", times, Rotation.from_rotvec(turns) * centers)
    out = tmp_path / "out"
    done = run(table, "--estimate", estimate, "--out", out, "--format", suffix, "--limit-tilt-deg", 5)
    assert done.exit_code == 1, done.output
    assert {file.name for file in out.iterdir()} == {f"monitor.{suffix}", "monitor.png", "monitor.json"}
    assert (out / "monitor.png").stat().st_size > 10_000
    bounds, texts = [f"{q}_{w}" for w in ("bound", "least") for q in ("total", "tilt", "heading")], (
        "claim", "tilt_claim", "alarm", "outside", "over_limit",
    )  # fmt: skip
    read = column_files.read_columns(out / f"monitor.{suffix}", optional=[(name,) for name in bounds], texts=texts)
    np.testing.assert_array_equal(read["time_s"], times)
    tilt = np.rad2deg(read["tilt_bound"])
    np.testing.assert_allclose(tilt[:100], 3.0, atol=1e-6)
    np.testing.assert_allclose(tilt[100:200], 11.0, atol=1e-6)
    np.testing.assert_allclose(np.rad2deg(read["tilt_least"][100:200]), 5.0, atol=1e-6)
    np.testing.assert_allclose(np.rad2deg(read["heading_least"][200:300]), 5.0, atol=1e-6)
    np.testing.assert_allclose(np.rad2deg(read["heading_bound"][200:300]), 25.0, atol=1e-5)
    assert np.isnan(read["total_bound"][390:]).all()
    words = {name: [str(word or "") for word in read[name]] for name in texts}
    assert words["alarm"][:100] == [""] * 100
    assert set(words["alarm"][100:200]) == {"proof limit"}
    assert set(words["outside"][100:200]) == {"total tilt"}
    assert set(words["over_limit"][100:200]) == {"tilt"}
    assert set(words["alarm"][200:300]) == {"proof"}
    assert set(words["outside"][200:300]) == {"total heading"}
    # What is conditional or unknown is not shown to be within a limit.
    assert set(words["alarm"][380:]) == {"limit"}
    assert (words["claim"][385], words["tilt_claim"][395]) == ("conditional", "none")
    summary = json.loads((out / "monitor.json").read_text())
    assert (summary["rows_with_proof"], summary["rows_with_alarm"], summary["judged"]) == (200, 220, 400)
    assert summary["first_proof_s"] == 10.0
    assert summary["tilt"]["not_within_limit"] == 120
    assert summary["total"]["bound_deg"]["conditional"]["rows"] == 10
    assert "proved wrong at 200 rows, first at 10.000000 s" in done.output
    again = run(table, "--estimate", estimate, "--out", out, "--format", suffix)
    assert again.exit_code == 1
    assert "--force replaces it" in again.output
    said = run(table, "--estimate", estimate, "--limit-tilt-deg", 5, "--json")
    assert json.loads(said.stdout) == summary


def test_without_alarms_the_exit_code_is_0(tmp_path, result):
    table, times, centers = result
    estimate = write_estimate(tmp_path / "estimate.csv", times[:380], centers[:380])
    for limits in ([], ["--limit-deg", 10.1, "--limit-tilt-deg", 3.1, "--limit-heading-deg", 10.1]):
        done = run(table, "--estimate", estimate, *limits)
        assert done.exit_code == 0, done.output
        assert "380 of 400 rows" in done.output
        assert "no summary.json beside the table says from where the sets' heading counts" in done.output
    # With a summary that says it, the heading is not judged.
    (table.parent / "summary.json").write_text('{"heading": "from the first row"}')
    done = run(table, "--estimate", estimate)
    assert done.exit_code == 0, done.output
    assert "the sets' counts from the first row: the tilt alone is judged" in done.output
    (table.parent / "summary.json").unlink()
    done = run(table, "--estimate", estimate, "--limit-deg", 9.9)
    assert done.exit_code == 1
    said = (
        "total: at 380 of 380 rows no unconditional bound is within the limit of 9.9 degrees: the error may be larger"
    )
    assert said in words(done)
    assert "very time" not in words(done)


def test_what_is_outside_a_conditional_set_is_no_proof(tmp_path, result):
    table, times, centers = result
    turned = Rotation.from_rotvec([0.0, 0.0, 1.0]) * centers
    estimate = write_estimate(tmp_path / "estimate.csv", times[380:], turned[380:])
    done = run(table, "--estimate", estimate, "--json")
    assert done.exit_code == 0, done.output
    summary = json.loads(done.stdout)
    assert summary["rows_with_proof"] == 0
    assert summary["heading"]["wrong_if_condition_holds"] == 10
    assert summary["heading"]["without_bound"] == 10


def test_a_free_heading(tmp_path, result):
    table, times, centers = result
    estimate = write_estimate(tmp_path / "estimate.csv", times, Rotation.from_rotvec([0.0, 0.0, -2.0]) * centers)
    done = run(table, "--estimate", estimate)
    assert done.exit_code == 1
    assert "--heading-free judges the tilt alone" in " ".join(done.output.split())
    done = run(table, "--estimate", estimate, "--heading-free", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert "the heading is free: the tilt alone is judged" in done.output
    assert json.loads((tmp_path / "out" / "monitor.json").read_text())["total"] is None
    for limit in ("--limit-deg", "--limit-heading-deg"):
        assert run(table, "--estimate", estimate, "--heading-free", limit, 5).exit_code == 2


def test_another_frame(tmp_path, result):
    table, times, centers = result
    estimate = write_estimate(tmp_path / "estimate.csv", times, NED * centers)
    done = run(table, "--estimate", estimate)
    assert done.exit_code == 1
    assert "with --frame ENU --estimate-frame NED they are not: the reference frames differ" in words(done)
    assert "with --estimate-frame NED they are not" in words(run(table, "--estimate", estimate, "--frame", "ENU"))
    # No proof is needed for that, nor a vertical's tilt; and other axes of the body are none of the frame.
    between = write_estimate(tmp_path / "between.csv", times + 5e-7, NED * centers)
    done = run(table, "--estimate", between)
    assert done.exit_code == 0
    assert "400 of the 400 rows have no sample of the estimate at their very time" in words(done)
    assert "with --frame ENU --estimate-frame NED they are not" in words(done)
    nwu = write_estimate(tmp_path / "nwu.csv", times, Rotation.from_euler("z", -90, degrees=True) * centers)
    assert "with --frame ENU --estimate-frame NWU they are not" in words(run(table, "--estimate", nwu))
    other_body = write_estimate(tmp_path / "body.csv", times, centers * Rotation.from_euler("x", 90, degrees=True))
    done = run(table, "--estimate", other_body)
    assert "has the estimate the same body axes and reference frame?" in words(done)
    done = run(table, "--estimate", estimate, "--estimate-frame", "NED", "--frame", "ENU", "--json")
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["tilt"]["bound_deg"]["unconditional"]["max"] == pytest.approx(3.0, abs=1e-6)
    # From NWU to NED: the estimate's x axis, north, is the sets' x axis.
    nwu = Rotation.from_matrix([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    in_ned = monitored.in_frame(monitored.Reference(times, nwu * centers), (NED * nwu.inv()).as_matrix()).attitudes
    assert np.max((in_ned.inv() * NED * centers).magnitude()) < 1e-12
    assert np.allclose((NED * nwu.inv()).apply([1.0, 0, 0]), [1.0, 0, 0])
    done = run(table, "--estimate", estimate, "--estimate-frame", "NED")
    assert done.exit_code == 2
    assert "needs --frame" in " ".join(done.output.split())


def test_quaternions_that_are_misread(tmp_path, result):
    table, times, centers = result
    inverse = write_estimate(tmp_path / "inverse.csv", times, centers.inv())
    done = run(table, "--estimate", inverse)
    assert done.exit_code == 1
    assert "as far when read as turns = 'reference_to_body'" in " ".join(done.output.split())
    # Said how they are, they are read so, in any format.
    np.savez(tmp_path / "other.npz", t=times, q=centers.inv().as_quat())
    (tmp_path / "other.toml").write_text(
        tomlkit.dumps(
            {
                "time_column": "t",
                "truth": {
                    "attitude_columns": [f"q[{i}]" for i in range(4)],
                    "order": "xyzw",
                    "turns": "reference_to_body",
                },
            }
        )
    )
    read = run(table, "--estimate", tmp_path / "other.npz", "--estimate-config", tmp_path / "other.toml", "--json")
    assert read.exit_code == 0, read.output
    assert json.loads(read.stdout)["estimate_misread"] is None
    compared = CliRunner().invoke(
        cli.make_app(), ["compare", str(table), str(tmp_path / "other.npz"), "--config", str(tmp_path / "other.toml")]
    )
    assert compared.exit_code == 0, compared.output
    # What is there is checked as ever.
    text = (tmp_path / "other.toml").read_text()
    (tmp_path / "other.toml").write_text(text.replace("xyzw", "zyxw"))
    wrong = run(table, "--estimate", tmp_path / "other.npz", "--estimate-config", tmp_path / "other.toml")
    assert wrong.exit_code == 1
    assert "truth.order" in wrong.output


@pytest.mark.parametrize("frame", ["NED", "NWU"])
def test_compare_names_the_frame_that_a_reference_is_in(tmp_path, result, frame):
    table, times, centers = result
    turn = Rotation.from_matrix(monitored.frame_to_frame("ENU", frame))
    path = write_estimate(tmp_path / "other.csv", times, turn * centers)
    done = CliRunner().invoke(cli.make_app(), ["compare", str(table), str(path)])
    assert f"as {frame}, which the sets are not: the reference frames differ" in " ".join(done.output.split())
    assert f"--frame ENU --estimate-frame {frame}" in " ".join(done.output.split())
    same = CliRunner().invoke(cli.make_app(), ["compare", str(table), str(write_estimate(path, times, centers))])
    assert "reference frames" not in same.output


def test_estimates_at_other_times(tmp_path, result):
    table, times, centers = result
    estimate = write_estimate(tmp_path / "estimate.csv", times[:350:2], centers[:350:2])
    assert json.loads(run(table, "--estimate", estimate, "--json").stdout)["judged"] == 175
    between = run(table, "--estimate", estimate, "--largest-gap-s", 0.21, "--json")
    assert json.loads(between.stdout)["judged"] == 349
    # What is judged there is the attitude half-way.
    read = read_run(table)[0]
    reference = monitored.Reference(times[:350:2], centers[:350:2])
    found = monitored.judge(read, reference, has_vertical=True, heading="same", limits=Limits(), largest_gap=0.21)
    half_way = centers[0] * Rotation.from_rotvec(0.5 * (centers[0].inv() * centers[2]).as_rotvec())
    expected = (half_way.inv() * centers[1]).magnitude() + WIDTH
    assert found.bounds[1, 0] <= expected + 1e-6
    late = write_estimate(tmp_path / "late.csv", times + 1000.0, centers)
    done = run(table, "--estimate", late)
    assert done.exit_code == 1
    assert "no row has an estimate at its time; rows are from 0 s to 39.9 s" in " ".join(done.output.split())


def test_what_is_interpolated_proves_nothing(result):
    """Between its samples a filter may have been anywhere."""
    table, times, centers = result
    wrong = Rotation.from_rotvec([np.deg2rad(60.0), 0.0, 0.0]) * centers
    reference = monitored.Reference(times[:300:2], wrong[:300:2])
    found = monitored.judge(
        read_run(table)[0], reference, has_vertical=True, heading="same", limits=Limits(), largest_gap=0.21
    )
    np.testing.assert_array_equal(found.alarms.proved[:299].any(axis=1), np.arange(299) % 2 == 0)
    assert (found.bounds[:299, 0] > np.deg2rad(50.0)).all()


def test_proposals_prove_nothing(result):
    table, times, centers = result
    wrong = monitored.Reference(times, Rotation.from_rotvec([np.deg2rad(60.0), 0.0, 0.0]) * centers)
    read = read_run(table)[0]
    for proposed in (None, "log.npz"):
        run_of = dataclasses.replace(read, bounds_from_recording=proposed)
        found = monitored.judge(run_of, wrong, has_vertical=True, heading="same", limits=Limits())
        assert found.alarms.proved.any() == (proposed is None)
        assert found.alarms.conditional[:380].any(axis=1).all() == (proposed is not None)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
@pytest.mark.parametrize("origin", [0, 1_700_000_000])
def test_a_table_of_proposals_says_so_alone(tmp_path, result, suffix, origin):
    """Far from the summary that was beside it."""
    table, times, centers = result
    columns = tables.Result.read(table).columns()
    alone, name = tmp_path / f"alone.{suffix}", 'the "first"; run\n.npz'
    with column_files.writing_columns(alone, "results", proposed_from=name) as write:
        write(columns, origin)
    assert column_files.column_names(alone, "results") == tuple(columns)
    assert column_files.time_origin(alone) == origin
    read = read_run(alone)[0]
    assert read.bounds_from_recording == name
    wrong = monitored.Reference(times, Rotation.from_rotvec([np.deg2rad(60.0), 0.0, 0.0]) * centers)
    found = monitored.judge(read, wrong, has_vertical=True, heading="same", limits=Limits())
    assert not found.alarms.proved.any()
    assert found.alarms.conditional[:380].any(axis=1).all()
    estimate = write_estimate(tmp_path / "estimate.csv", times + origin, wrong.attitudes)
    done = run(alone, "--estimate", estimate)
    assert "no alarm is a proof" in words(done)
    assert "taken as stated" not in words(done)
    assert json.loads(run(alone, "--estimate", estimate, "--json").stdout)["bounds_of_sets"] == "proposals"


def test_a_table_that_says_nothing_is_taken_as_stated_and_that_is_said(tmp_path, result):
    table, times, centers = result
    estimate = write_estimate(tmp_path / "estimate.csv", times, centers)
    said = "neither the table nor a summary.json beside it says that its bounds are proposals: taken as stated"
    assert said in words(run(table, "--estimate", estimate))
    assert json.loads(run(table, "--estimate", estimate, "--json").stdout)["bounds_of_sets"] == "not known"
    (table.parent / "summary.json").write_text("{}")
    assert said not in words(run(table, "--estimate", estimate))
    assert json.loads(run(table, "--estimate", estimate, "--json").stdout)["bounds_of_sets"] == "stated"


def test_what_is_refused(tmp_path, result):
    table, times, centers = result
    estimate = write_estimate(tmp_path / "estimate.csv", times, centers)

    def refused(*arguments, code=1):
        done = run(*arguments, "--out", tmp_path / "never")
        assert done.exit_code == code, done.output
        assert not isinstance(done.exception, (ValueError, KeyError, IndexError))
        assert not (tmp_path / "never").exists()
        return " ".join(done.output.split())

    assert "no such file" in refused(table, "--estimate", tmp_path / "none.csv")
    assert "no such file" in refused(tmp_path / "none.csv", "--estimate", estimate)
    (tmp_path / "empty.csv").write_text("")
    refused(table, "--estimate", tmp_path / "empty.csv")
    (tmp_path / "header.csv").write_text("time_s,qw,qx,qy,qz\n")
    assert "no rows" in refused(table, "--estimate", tmp_path / "header.csv")
    (tmp_path / "long.csv").write_text("time_s,qw,qx,qy,qz\n0,2,0,0,0\n")
    assert "2 long, not 1" in refused(table, "--estimate", tmp_path / "long.csv")
    (tmp_path / "nan.csv").write_text("time_s,qw,qx,qy,qz\n0,nan,0,0,0\n")
    refused(table, "--estimate", tmp_path / "nan.csv")
    (tmp_path / "blank.csv").write_text("time_s,qw,qx,qy,qz\n0,,,,\n")
    assert "no attitude" in refused(table, "--estimate", tmp_path / "blank.csv")
    for option in ("--limit-deg", "--limit-tilt-deg", "--limit-heading-deg", "--largest-gap-s"):
        for value in ("-1", "nan", "inf", "x"):
            refused(table, "--estimate", estimate, option, value, code=2)
    refused(table, "--estimate", estimate, "--estimate-frame", "J2000", code=2)
    refused(table, code=2)
    lines = table.read_text().splitlines()
    names = lines[1].split(",")
    kept = [i for i, name in enumerate(names) if name not in {"claim", "chart"}]
    plain = [",".join(line.split(",")[i] for i in kept) for line in lines[1:]]
    (tmp_path / "plain.csv").write_text("\n".join([lines[0], *plain]) + "\n")
    assert "no guarantee" in refused(tmp_path / "plain.csv", "--estimate", estimate)
    (tmp_path / "first.toml").write_text(
        tomlkit.dumps(
            {
                "flow": {"kind": "gyro", "columns": ["a", "b", "c"], "noise_deg_per_s": 1.0},
                "start": {"kind": "given", "attitude_qw_qx_qy_qz": [1.0, 0.0, 0.0, 0.0], "P_diagonal": [1.0] * 6},
                "estimator": {"mode": "first_order"},
            }
        )
    )
    said = refused(table, "--config", tmp_path / "first.toml", "--estimate", estimate)
    assert "monitor needs 'guaranteed', not 'first_order'" in said


def configuration(**changes):
    def columns(name, count=3):
        return [f"{name}[{i}]" for i in range(count)]

    return {
        "time_column": "t",
        "rule": {"kind": "hand_held", "anchor_s": 4.0},
        "flow": {"kind": "gyro", "columns": columns("gyr"), "unit": "rad/s"},
        "directions": [
            {"name": "up", "kind": "accelerometer", "columns": columns("acc"), "unit": "m/s^2"},
            {"name": "field", "kind": "magnetometer", "columns": columns("mag"), "unit": "uT"},
        ],
        "estimator": {"mode": "guaranteed", "policy": "drop_measurement"},
        "truth": {"attitude_columns": columns("q_ref", 4)},
    } | changes


def test_a_log_judges_as_its_results_do(tmp_path):
    """The truth is never an alarm, its error 0 within every bound; a log with its configuration, or what it gave."""
    made_up = made(field_late=0.012)
    np.savez(
        tmp_path / "log.npz", t=made_up.times, gyr=made_up.angular_velocities, acc=made_up.specific_forces,
        mag=made_up.fields, q_ref=made_up.attitudes,
    )  # fmt: skip
    (tmp_path / "config.toml").write_text(tomlkit.dumps(configuration()))
    log, config = tmp_path / "log.npz", tmp_path / "config.toml"
    truth = Rotation.from_quat(made_up.attitudes, scalar_first=True)
    estimate = write_estimate(tmp_path / "estimate.csv", made_up.times, truth)
    done = run(log, "--config", config, "--estimate", estimate, "--json")
    assert done.exit_code == 0, done.output
    of_log = json.loads(done.stdout)
    # The log's own truth is an estimate, too.
    same = json.loads(run(log, "--config", config, "--estimate", log, "--estimate-config", config, "--json").stdout)
    assert same["total"]["bound_deg"]["unconditional"]["max"] == pytest.approx(
        of_log["total"]["bound_deg"]["unconditional"]["max"], rel=1e-9
    )
    app = cli.make_app()
    estimated = CliRunner().invoke(app, ["estimate", str(log), "--config", str(config), "--out", str(tmp_path / "out")])
    assert estimated.exit_code == 0, estimated.output
    of_results = json.loads(run(tmp_path / "out", "--estimate", estimate, "--json").stdout)
    assert {k: v for k, v in of_results.items() if k != "log"} == {k: v for k, v in of_log.items() if k != "log"}
    ned = write_estimate(tmp_path / "ned.csv", made_up.times, NED * truth)
    in_ned = run(log, "--config", config, "--estimate", ned, "--estimate-frame", "NED", "--json")
    assert in_ned.exit_code == 0, in_ned.output
    assert run(log, "--config", config, "--frame", "ENU", "--estimate", ned).exit_code == 2
    # Without a magnetometer the sets' own heading counts from the first row, and the tilt alone is judged.
    without = configuration(directions=configuration()["directions"][:1])
    (tmp_path / "without.toml").write_text(tomlkit.dumps(without))
    done = run(log, "--config", tmp_path / "without.toml", "--estimate", estimate)
    assert done.exit_code == 0, done.output
    assert "the heading is free; the sets' counts from the first row: the tilt alone is judged" in " ".join(
        done.output.split()
    )


def test_the_attitude_that_an_autopilot_logs(tmp_path):
    """A ULog is log and estimate at once: NED, the estimate with stamps of its own between those of the gyro."""
    pytest.importorskip("pyulog")
    n = 300
    stamps = 3_000_000 + 5_000 * np.arange(n)  # µs
    turns = Rotation.from_rotvec(np.tile([0.1, -0.2, 0.3], (n, 1)) * (1e-6 * (stamps - stamps[0]))[:, None])
    up, field = turns.inv().apply([0.0, 0.0, -9.80665]), turns.inv().apply([2e-5, 0.0, 4e-5])
    imu = {"timestamp": stamps, "gyro_rad": np.tile([0.1, -0.2, 0.3], (n, 1)), "accelerometer_m_s2": up, "field": field}
    late = stamps[:-1] + 2_000
    ekf = turns[:-1] * Rotation.from_rotvec(np.array([0.1, -0.2, 0.3]) * 0.002)
    attitude = {"timestamp": late, "q": ekf.as_quat(scalar_first=True)}
    write_ulog(tmp_path / "log.ulg", [("sensor_combined", 0, imu), ("vehicle_attitude", 0, attitude)])

    def columns(name, count=3):
        return [f"{name}[{i}]" for i in range(count)]

    (tmp_path / "config.toml").write_text(
        tomlkit.dumps({
            "reference_frame": "NED",
            "flow": {"kind": "gyro", "columns": columns("sensor_combined.gyro_rad"), "noise_deg_per_s": 0.5},
            "directions": [
                {
                    "name": "up", "kind": "accelerometer", "unit": "m/s^2", "bound_deg": 3.0,
                    "columns": columns("sensor_combined.accelerometer_m_s2"),
                },
                {
                    "name": "field", "bound_deg": 10.0,
                    "columns": columns("sensor_combined.field"), "reference": [2e-5, 0.0, 4e-5],
                },
            ],
            "estimator": {"mode": "guaranteed", "policy": "drop_measurement"},
            "truth": {"attitude_columns": columns("vehicle_attitude.q", 4)},
        })
    )  # fmt: skip
    log, config = tmp_path / "log.ulg", tmp_path / "config.toml"
    done = run(
        log, "--config", config, "--estimate", log, "--estimate-config", config, "--largest-gap-s", 0.01, "--json"
    )
    assert done.exit_code == 0, done.output
    summary = json.loads(done.stdout)
    assert summary["tilt"]["bound_deg"]["unconditional"]["rows"] > 290
    assert 2.0 < summary["tilt"]["bound_deg"]["unconditional"]["mean"] < 4.0
    assert summary["heading"]["bound_deg"]["unconditional"]["mean"] < 40.0


@needs_datasets
@pytest.mark.parametrize("trial", ["02", "30"])
def test_a_fault_in_a_real_recording_is_proved(tmp_path, trial):
    """The optical attitude is no alarm; with 45 degrees of tilt it is; bounds hold for both."""
    with np.load(broad(trial)) as file:
        times, columns = np.asarray(file["t"], dtype=float), np.asarray(file["q_ref"], dtype=float)
    known = np.isfinite(columns).all(axis=1)
    optical = Rotation.from_quat(columns[known], scalar_first=True)
    (tmp_path / "config.toml").write_text(tomlkit.dumps(configuration()))
    arguments = (broad(trial), "--config", tmp_path / "config.toml", "--json")
    estimate = write_estimate(tmp_path / "optical.csv", times[known], optical)
    done = run(*arguments, "--estimate", estimate)
    assert done.exit_code == 0, done.output
    fault = Rotation.from_rotvec([np.deg2rad(45.0), 0.0, 0.0]) * optical
    done = run(*arguments, "--estimate", write_estimate(tmp_path / "fault.csv", times[known], fault))
    assert done.exit_code == 1
    tilt = json.loads(done.stdout)["tilt"]
    assert tilt["proved_wrong"] > 0.9 * tilt["bound_deg"]["unconditional"]["rows"]
    assert 40.0 < tilt["largest_least_deg"] < 45.5


@pytest.mark.parametrize(("later", "same"), [(0.0, True), (1e-9, True), (-1e-9, True), (1e-8, False), (9e-7, False)])
def test_a_proof_needs_a_sample_at_the_very_time(later, same):
    """A sample within a microsecond counts as the row's; but a body turns in that time, so that it proves nothing."""
    times = 3.0 + 0.01 * np.arange(100)
    reference = Reference(times + later, Rotation.identity(100))
    assert (has_sample_at(reference, times) == same).all()
    rows, _ = attitudes_at(reference, times, np.arange(100), 0.0)
    assert len(rows) == 100


@pytest.mark.parametrize("axis", [0, 2])
@pytest.mark.parametrize("later", [1.9e-9, -1.9e-9])
@pytest.mark.parametrize("speed", [5.0, 35.0, 5e4])
def test_an_estimate_that_is_right_at_its_own_stamp_is_not_proved_wrong(result, axis, later, speed):
    """In nanoseconds a body turns by more than what rounding is granted: the truth was on the set's boundary."""
    read = read_run(result[0])[0]
    n, half = 5, 1e-3
    turned = np.zeros(3)
    turned[axis] = 1.0
    shapes = np.tile((2.0 * np.tan(0.5 * half)) ** 2 * (1.0 + 1e-12) * np.eye(3), (n, 1, 1))
    still = dataclasses.replace(
        read, times=np.arange(n) * 1.0, quaternions=np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)), shapes=shapes,
        claims=("unconditional",) * n, tilt_bounds=None,
    )  # fmt: skip

    def judged(more):
        at = Rotation.from_rotvec(np.tile((half + more) * turned, (n, 1)))
        estimate = Reference(still.times + later, at)
        assert has_sample_at(estimate, still.times).all()
        return monitored.judge(still, estimate, has_vertical=True, heading="same", limits=Limits())

    assert not judged(speed * abs(later)).alarms.proved.any()
    # No more is granted than the fastest body turns.
    assert judged(1.01e5 * abs(later)).alarms.proved[:, 0].all()


def test_seconds_since_1970_are_the_same_or_prove_nothing():
    """A step of such a number is 240 ns; three of them are no very time, though the rows are within a microsecond."""
    times = 1.7e9 + np.arange(5)
    for steps, same in ((0, True), (1, False), (3, False)):
        reference = Reference(times + steps * np.spacing(1.7e9), Rotation.identity(5))
        assert (has_sample_at(reference, times) == same).all()
        assert len(attitudes_at(reference, times, np.arange(5), 0.0)[0]) == 5
