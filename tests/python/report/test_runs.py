"""What pictures show of a run: read with and without gaps and claims, compared with a reference, decimated."""

import json
from dataclasses import replace

import numpy as np
import pytest
from elliptude.io import column_files, tables
from elliptude.io.files import FileError
from elliptude.logs.reference_attitudes import Reference
from elliptude.report import thinning
from elliptude.report.axes.body_axes import axis_outlines
from elliptude.report.estimated.reading import read_run
from elliptude.report.run import Refusal, Run
from elliptude.results import CLAIMS
from scipy.spatial.transform import Rotation


def make_run(count=50, *, chart="exponential", **more):
    times = np.linspace(0.0, 4.9, count)
    attitudes = Rotation.from_rotvec(np.outer(times, [0.2, -0.4, 0.3]))
    return Run(
        times=times,
        quaternions=attitudes.as_quat(scalar_first=True),
        shapes=np.tile(np.diag([0.1, 0.2, 0.3]) ** 2, (count, 1, 1)),
        half_widths=np.tile([0.1, 0.2, 0.3], (count, 1)),
        largest_angles=np.full(count, 0.3),
        used=("sun star",) * count,
        refused=("",) * count,
        chart=chart,
        **more,
    )


def table_columns(run):
    columns = {"time_s": run.times}
    columns |= dict(zip(tables.QUATERNION, run.quaternions.T, strict=True))
    columns |= {f"bias_{axis}": np.zeros(len(run.times)) for axis in "xyz"}
    shapes = np.zeros((len(run.times), 6, 6))
    shapes[:, :3, :3] = run.shapes
    columns |= {f"P{i + 1}{j + 1}": shapes[:, i, j] for i in range(6) for j in range(i, 6)}
    columns |= {f"half_width_r{axis}": run.half_widths[:, i] for i, axis in enumerate("xyz")}
    columns |= {f"half_width_bias_{axis}": np.zeros(len(run.times)) for axis in "xyz"}
    columns |= {"largest_angle": run.largest_angles, "used": list(run.used), "refused": list(run.refused)}
    return columns | {"share": np.full(len(run.times), np.nan), "margin": np.full(len(run.times), np.nan)}


def write(folder, columns):
    folder.mkdir(exist_ok=True)
    column_files.write_columns(folder / "results.csv", "results", columns)
    return folder / "results.csv"


def test_a_table_of_the_estimator_of_today(tmp_path):
    run, label = read_run(write(tmp_path, table_columns(make_run())))
    assert label == "truth"
    np.testing.assert_array_equal(run.shapes, make_run().shapes)
    np.testing.assert_array_equal(run.quaternions, make_run().quaternions)
    assert run.claims is None
    assert run.dropped is None
    assert run.errors is None
    assert run.known.all()
    assert not run.compared.any()
    assert list(run.refusals()) == []


def test_spans_without_a_set():
    times = np.arange(6.0)
    for has_set, expected in (
        ([1, 1, 1, 1, 1, 1], []),
        ([0, 0, 0, 0, 0, 0], [(0.0, 5.0)]),
        ([0, 1, 1, 0, 1, 0], [(0.0, 1.0), (2.0, 5.0)]),
        ([1, 0, 0, 1, 1, 1], [(0.0, 3.0)]),
    ):
        assert thinning.spans_unknown(times, np.array(has_set, dtype=bool)) == expected
    many = np.arange(20_000) % 2 == 0
    assert len(thinning.spans_unknown(np.arange(20_000.0), many)) <= 1000
    assert thinning.spans_unknown(np.zeros(1), np.array([False])) == [(0.0, 0.0)]


@pytest.mark.parametrize("text", ["{", "", "[]", '"said"'])
def test_a_damaged_summary_is_not_passed_over(tmp_path, text):
    """It may say that the sets are no guarantee. Without one the table is read alone."""
    write(tmp_path, table_columns(make_run()))
    (tmp_path / "summary.json").write_text(text)
    with pytest.raises(FileError, match=r"summary\.json: damaged, not the summary that `estimate` wrote"):
        read_run(tmp_path)
    (tmp_path / "summary.json").unlink()
    assert read_run(tmp_path)[1] == "truth"


def test_gaps_claims_and_dropped_sensors(tmp_path):
    columns = table_columns(make_run())
    for name, values in columns.items():
        if isinstance(values, np.ndarray) and name != "time_s":
            values[20:25] = np.nan
    columns["claim"] = ["unconditional"] * 10 + ["conditional"] * 10 + ["none"] * 5 + ["unconditional"] * 25
    columns["dropped"] = ["star" if 5 <= i < 8 else "" for i in range(50)]
    columns["refused"] = ["sun star" if i == 20 else "" for i in range(50)]
    columns["error_rx"], columns["error_ry"], columns["error_rz"] = np.zeros((3, 50))
    columns["form"] = np.where(np.arange(50) == 30, 1.5, 0.5)
    write(tmp_path, columns)
    (tmp_path / "summary.json").write_text(json.dumps({"compared_with": "optical attitude"}))
    run, label = read_run(tmp_path)
    assert label == "optical attitude"
    assert run.title is None
    (tmp_path / "summary.json").write_text(json.dumps({"compared_with": "optical attitude", "title": "log.csv"}))
    assert read_run(tmp_path)[0].title == "log.csv"
    assert np.flatnonzero(~run.known).tolist() == [20, 21, 22, 23, 24]
    assert [int(run.claimed(claim).sum()) for claim in CLAIMS] == [35, 10, 5]
    assert np.flatnonzero(run.escaped).tolist() == [30]
    assert run.compared.sum() == 45
    assert np.isnan(run.attitudes[20:25]).all()
    assert next(iter(run.refusals())) == Refusal(run.times[5], "star", "dropped")
    (star, both) = run.refusal_spells()
    assert (star.first, star.last, star.sensors, star.what, star.measurements) == (
        *run.times[[5, 7]],
        "star",
        "dropped",
        3,
    )
    assert (both.first, both.sensors, both.what) == (run.times[20], "sun star", "refused")


DROPPED = {
    "time_s": np.array([0.5, 0.5, 0.7, 4.0]),
    "place": ["line 8", "line 8", "line 10", "line 43"],
    "sensor": ["star", "sun", "star", "sun"],
    "contradicts": ["prediction", "prediction", "prediction", "own_bound"],
    "margin": np.array([-0.4, -0.4, -0.2, -1.5]),
    "unit": ["", "", "", "m/s^2"],
}


def write_guaranteed(folder):
    """What the guaranteed mode writes beside a table, and what it has more in the table."""
    columns = table_columns(make_run()) | {
        "claim": ["conditional"] * 50,
        "dropped": ["star sun" if i == 5 else "star" if i == 7 else "" for i in range(50)],
        "prediction_used": np.where(np.arange(50) < 10, 0.0, 1.0),
        "tilt_bound": np.linspace(0.05, 0.1, 50),
    }
    columns["prediction_used"][49] = np.nan
    write(folder, columns)
    column_files.write_columns(folder / "dropped.csv", "dropped", DROPPED)
    said = {"compared_with": "camera", "truth_error_deg": 0.5, "void": ["field"], "heading": "from the first row"}
    (folder / "summary.json").write_text(json.dumps(said))
    return columns


def test_what_the_guaranteed_mode_says_more(tmp_path):
    columns = write_guaranteed(tmp_path)
    run, label = read_run(tmp_path)
    assert label == "camera"
    np.testing.assert_array_equal(run.tilt_bounds, columns["tilt_bound"])
    np.testing.assert_array_equal(run.prediction_used, columns["prediction_used"])
    assert run.reference_error == pytest.approx(np.deg2rad(0.5))
    assert (run.void, run.heading_from_start) == (("field",), True)
    # The list says more than the column does, and each measurement counts once.
    assert [(refusal.time, refusal.sensors, refusal.what) for refusal in run.refusals()] == [
        (0.5, "star", "dropped"),
        (0.5, "sun", "dropped"),
        (0.7, "star", "dropped"),
        (4.0, "sun", "own bound"),
    ]
    assert [(spell.sensors, spell.what, spell.measurements) for spell in run.refusal_spells()] == [
        ("star", "dropped", 2),
        ("sun", "dropped", 1),
        ("sun", "own bound", 1),
    ]
    shares = thinning.prediction_shares(run.prediction_used, thinning.pieces(50, 4))
    assert shares == ["some rows", "every row", "every row", "every row"]
    assert thinning.prediction_shares(np.array([0.0, 0.0, np.nan]), [slice(0, 2), slice(2, 3)]) == ["none", "none"]
    (tmp_path / "dropped.csv").write_text("# elliptude dropped 1\n" + ",".join(DROPPED) + "\n")
    assert len(read_run(tmp_path)[0].listed.times) == 0
    (tmp_path / "dropped.csv").write_text("# elliptude dropped 1\n" + ",".join(DROPPED) + "\n1,line 2,a,b,c,\n")
    with pytest.raises(FileError, match=r"dropped\.csv: line 3, column 5 \(margin\): not a number: 'c'"):
        read_run(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"claim": ["certain"] * 50},
            "row 1 below the header, column 'claim': 'certain', not unconditional, conditional",
        ),
        ({"chart": ["gibbs"] * 49 + ["exponential"]}, "column 'chart' changes"),
        ({"chart": ["polar"] * 50}, "'polar', not exponential or gibbs"),
    ],
)
def test_words_that_a_table_may_not_hold(tmp_path, change, message):
    with pytest.raises(FileError, match=message):
        read_run(write(tmp_path, table_columns(make_run()) | change))


def test_no_table(tmp_path):
    with pytest.raises(FileError, match=r"no results\.csv or results\.parquet"):
        read_run(tmp_path)
    with pytest.raises(FileError, match="no such file"):
        read_run(tmp_path / "nothing.csv")
    measurements = tmp_path / "measurements.csv"
    measurements.write_text("# elliptude measurements 1\ntime_s\n0\n")
    with pytest.raises(FileError, match="a table of measurements, where one of results"):
        read_run(measurements)
    write(tmp_path, table_columns(make_run()))
    column_files.write_columns(tmp_path / "results.parquet", "results", table_columns(make_run()))
    with pytest.raises(FileError, match="name the table"):
        read_run(tmp_path)


@pytest.mark.parametrize("chart", ["exponential", "gibbs"])
def test_compared_with_a_reference(chart):
    """A known turn about z beside each estimate: the error is that turn, the form its square over P's."""
    run, turn = make_run(chart=chart), 0.25
    fine = np.linspace(-1.0, 6.0, 7001)
    true = Rotation.from_rotvec(np.outer(fine, [0.2, -0.4, 0.3])) * Rotation.from_rotvec([0.0, 0.0, turn])
    compared = run.against(Reference(fine, true), 0.01)
    np.testing.assert_allclose(compared.errors, np.tile([0.0, 0.0, turn], (50, 1)), atol=1e-7)
    reach = turn if chart == "exponential" else 2.0 * np.tan(0.5 * turn)
    np.testing.assert_allclose(compared.forms, (reach / 0.3) ** 2, rtol=1e-6)
    axes = (Rotation.from_quat(run.quaternions, scalar_first=True) * Rotation.from_rotvec([0, 0, turn])).as_matrix()
    np.testing.assert_allclose(compared.true_axes(), axes, atol=1e-7)


def test_a_reference_is_not_carried_over_gaps():
    run = make_run()
    attitudes = Rotation.from_quat(run.quaternions, scalar_first=True)
    some = np.r_[:10, 20:50]
    compared = run.against(Reference(run.times[some], attitudes[some]), 0.2)
    assert np.flatnonzero(~compared.compared).tolist() == list(range(10, 20))
    assert np.isnan(compared.errors[10:20]).all()
    one = run.against(Reference(run.times[7:8], attitudes[7:8]))
    assert np.flatnonzero(one.compared).tolist() == [7]
    none = run.against(Reference(run.times + 100.0, attitudes))
    assert not none.compared.any()


def test_a_flat_set_holds_only_what_lies_in_it():
    """Without volume: nothing that is measured lies in it, and the row counts as compared all the same."""
    run = make_run()
    run.shapes[:] = np.diag([0.1, 0.2, 0.0]) ** 2
    true = Rotation.from_quat(run.quaternions, scalar_first=True) * Rotation.from_rotvec([0.0, 0.0, 0.01])
    compared = run.against(Reference(run.times, true))
    assert compared.compared.all()
    assert compared.escaped.all()


def test_decimation_keeps_what_stands_out():
    count = 20_000
    rng = np.random.default_rng(0)
    run = make_run(count, errors=0.01 * rng.standard_normal((count, 3)), forms=rng.random(count))
    run.forms[12_345], run.errors[777, 1], run.largest_angles[4_321] = 7.0, 0.5, 2.0
    run.quaternions[15_001:15_003] = np.nan
    rows = thinning.chosen_rows(run, 100)
    assert len(rows) <= 800
    assert (np.diff(rows) > 0).all()
    assert {12_345, 777, 4_321, 15_001} <= set(rows.tolist())
    assert thinning.chosen_rows(run, count).tolist() == list(range(count))


def test_the_weakest_claim_of_a_piece_counts():
    claims = ("unconditional", "conditional", "unconditional", "none", "", "unconditional")
    assert thinning.worst_claims(claims, thinning.pieces(6, 3)) == ["conditional", "none", ""]


@pytest.mark.parametrize(("angle", "factor"), [(0.3, 1), (0.1, 2), (0.02, 10), (1e-4, 2000), (2.0, 1), (0.0, 50_000)])
def test_small_sets_are_magnified(angle, factor):
    run = make_run(errors=np.tile([0.0, 0.0, 1e-5], (50, 1)), forms=np.zeros(50))
    run.largest_angles[:] = angle
    assert run.magnification(np.arange(50)) == factor
    # The reference's error with it: x axes are turned about z by so many times 1e-5.
    x, y = run.attitudes[0][:, 0], run.attitudes[0][:, 1]
    np.testing.assert_allclose(run.true_axes(factor)[0][:, 0] @ y, np.sin(factor * 1e-5), atol=1e-12)
    np.testing.assert_allclose(run.true_axes(factor)[0][:, 0] @ x, np.cos(factor * 1e-5), atol=1e-12)


@pytest.mark.parametrize("chart", ["exponential", "gibbs"])
def test_what_is_just_inside_a_set_is_just_inside_the_magnified_one(chart):
    """Turns about z by 0.9999 of the largest in the set; sets are balls in their chart, whose rims are circles."""
    radius, magnification = 0.17, 2
    angle = 0.9999 * radius if chart == "exponential" else 2.0 * np.arctan(0.9999 * radius / 2.0)
    run = make_run(chart=chart, errors=np.tile([0.0, 0.0, angle], (50, 1)), forms=np.full(50, 0.9998))
    run = replace(run, shapes=np.tile(radius**2 * np.eye(3), (50, 1, 1)))
    outlines = axis_outlines(run.attitudes, magnification**2 * run.shapes, 0, chart=chart)
    estimated = run.attitudes[:, :, 0]
    rim = np.arccos(np.einsum("npi,ni->np", outlines, estimated)).min(axis=1)
    off = np.arccos((run.true_axes(magnification)[:, :, 0] * estimated).sum(axis=1))
    assert ((0.9995 * rim < off) & (off < rim)).all()
