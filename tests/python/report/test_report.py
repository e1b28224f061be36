"""`elliptude report`: one file that needs nothing else, with numbers of all rows; what is wrong is said."""

import base64
import dataclasses
import json
import re
import sys

import numpy as np
import pytest
from elliptude import cli
from elliptude.report import curves
from elliptude.report import page as report
from elliptude.report.axes import sphere
from elliptude.report.page import tables
from elliptude.report.run import DroppedMeasurements
from scipy.spatial.transform import Rotation
from test_run_figures import angled, full_run
from test_runs import DROPPED, make_run, table_columns, write, write_guaranteed
from typer.testing import CliRunner


def run_cli(*arguments):
    return CliRunner().invoke(cli.make_app(), ["report", *(str(argument) for argument in arguments)])


def data_of(page):
    return json.loads(re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)[1])


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    report.write_report(full_run(), path, "A <run> & more", label="optical </script>")
    return path.read_text(encoding="utf-8")


def test_it_loads_nothing(page):
    own = page.replace(re.search(r"<script>\n(/\*\*\n\* plotly.*?)</script>", page, re.DOTALL)[1], "")
    assert not re.search(r"(?:src|href)\s*=", own)
    assert "http" not in own.replace("http-equiv", "")
    assert "default-src 'none'" in own
    assert "@" not in re.sub(r"@media[^{]*", "", own)


def test_names_are_no_markup(page):
    assert "<h1>A &lt;run&gt; &amp; more</h1>" in page
    assert page.count("</script>") == 3
    assert any(trace["name"] == "error against optical </script>" for trace in data_of(page)["plots"]["bands"]["data"])


def test_the_patch_is_the_image_of_the_set(page):
    """Unpacked again: at time 0 the x axis' rim reaches as far as turns about z (0.3 rad) and y (0.2 rad) take it."""
    frames = data_of(page)["frames"]
    numbers = np.frombuffer(base64.b64decode(frames["patches"]), "<i2").reshape(-1, 3, frames["vertices"], 3) / 32767.0
    rim = numbers[0, 0, : frames["meridians"]]
    np.testing.assert_allclose(np.linalg.norm(numbers[0], axis=-1), 1.0, atol=1e-4)
    assert np.abs(np.arctan2(rim[:, 1], rim[:, 0])).max() == pytest.approx(0.3, abs=2e-3)
    assert np.abs(np.arctan2(rim[:, 2], rim[:, 0])).max() == pytest.approx(0.2, abs=2e-3)
    assert len(frames["labels"]) == len(numbers) == 50
    assert frames["labels"][0] == "0.00 s, within 17.2°, claim: unconditional, reference 4.96° off, inside"
    assert frames["labels"][22] == "2.20 s: nothing is known"
    tips = np.frombuffer(base64.b64decode(frames["tips"]), "<i2").reshape(-1, 3, 3)
    assert (tips[22] == -32768).all()


def test_the_globe_opens_at_the_first_attitude():
    run = full_run()
    for values in (run.quaternions, run.shapes, run.half_widths, run.largest_angles, run.errors, run.forms):
        values[:7] = np.nan
    rows = np.arange(50)
    frames = sphere.sphere_frames(run, rows)
    assert frames["opens_at"] == 7
    assert "within" in frames["labels"][7]
    assert sphere.sphere_frames(run, rows[:5])["opens_at"] == 0


def test_no_patch_cuts_through_the_globe():
    run = make_run(3)
    frames = sphere.sphere_frames(dataclasses.replace(run, largest_angles=np.array([0.3, 1.2, 0.3])), np.arange(3))
    numbers = np.frombuffer(base64.b64decode(frames["patches"]), "<i2").reshape(3, -1)
    assert (numbers == -32768).all(axis=1).tolist() == [False, True, False]
    assert ["too large" in label for label in frames["labels"]] == [False, True, False]


def test_roll_pitch_and_yaw_are_the_first_picture(page, tmp_path):
    assert 'id="h-angles"' in page
    assert "angles" not in data_of(page)["plots"]
    assert re.search(r'aria-labelledby="h-angles" hidden', page)
    report.write_report(angled(full_run()), tmp_path / "report.html", "Angles", label="optical attitude")
    written = (tmp_path / "report.html").read_text(encoding="utf-8")
    plots = data_of(written)["plots"]
    assert next(iter(plots)) == "angles"
    assert written.index('id="h-angles"') < written.index('id="h-sphere"')
    traces = plots["angles"]["data"]
    assert [trace["name"] for trace in traces if trace["showlegend"]] == [
        "where it may be",
        "as estimated",
        "optical attitude",
    ]
    assert "half of its band" not in written
    yaw = next(trace for trace in traces if trace["name"] == "as estimated" and trace["yaxis"] == "y3")
    assert yaw["y"][20:25] == [None] * 5
    assert plots["angles"]["layout"]["yaxis"]["range"] == [-180.0, 180.0]
    assert "range" not in plots["angles"]["layout"]["yaxis2"]


@pytest.mark.parametrize(
    ("frame", "said"),
    [(None, "X, Y, Z"), ("ENU", "X (east), Y (north), Z (up)"), ("NED", "X (north), Y (east), Z (down)")],
)
def test_the_globe_says_what_its_axes_are(tmp_path, frame, said):
    report.write_report(dataclasses.replace(make_run(), frame=frame), tmp_path / "report.html", "Run")
    assert f"in reference axes {said}, that" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_plots_are_grey_where_what_they_show_is_not_known(page, tmp_path):
    run = angled(full_run())
    report.write_report(run, tmp_path / "angles.html", "Angles")
    plots = data_of((tmp_path / "angles.html").read_text(encoding="utf-8"))["plots"]
    for name, height in (("bands", "paper"), ("size", "y domain"), ("angles", "y3 domain")):  # of the angles, yaw
        shapes = plots[name]["layout"]["shapes"]
        (grey,) = [one for one in shapes if one["fillcolor"] == curves.GREY]
        assert any(one["fillcolor"] == curves.AMBER for one in shapes) == ("conditional" in run.claims)
        assert (grey["yref"], grey["x0"], grey["x1"]) == (height, run.times[19], run.times[25])
    assert page.count("Where it is grey, what is shown is not known.") == 2  # of bands and of the size
    report.write_report(make_run(), tmp_path / "report.html", "Whole")
    whole = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert data_of(whole)["plots"]["bands"]["layout"]["shapes"] == []
    assert "Where it is grey" not in whole


def test_the_page_says_at_its_top_that_bounds_are_proposals(page, tmp_path):
    assert "are proposals" not in page
    run = dataclasses.replace(full_run(), bounds_from_recording="a<b.csv")
    report.write_report(run, tmp_path / "report.html", "Proposed")
    written = (tmp_path / "report.html").read_text(encoding="utf-8")
    said = "The bounds are proposals from a&lt;b.csv: the sets are no guarantee."
    assert written.index("<h1>") < written.index(said) < written.index('id="h-summary"')
    assert "hold the truth if the claims do." in page
    assert "hold the truth if the claims and the proposed bounds do." in written
    assert "claim: unconditional<" in page
    assert "claim: unconditional, by proposals<" in written
    assert "claim: unconditional<" not in written
    lanes = {trace["name"] for trace in data_of(written)["plots"]["strip"]["data"]}
    assert {"claim: unconditional, by proposals", "claim: conditional, by proposals", "claim: none"} <= lanes
    labels = data_of(written)["frames"]["labels"]
    assert labels[0] == "0.00 s, within 17.2°, claim: unconditional, by proposals, reference 4.96° off, inside"


def test_bands_have_gaps(page):
    band, error, *_ = data_of(page)["plots"]["bands"]["data"]
    assert band["x"].count(None) == 2
    assert error["y"][20:25] == [None] * 5
    assert error["y"][0] == pytest.approx(np.rad2deg(0.05), rel=1e-5)


def test_the_plots_are_plotlys(page):
    plotly = pytest.importorskip("plotly.graph_objects")
    for plot in data_of(page)["plots"].values():
        plotly.Figure(plot)  # refuses what Plotly does not know


def test_summary():
    run = full_run()
    run.forms[[3, 45]] = 2.0
    summary = report.summarize(run, "optical attitude")
    assert summary["rows"] == 50
    assert summary["rows_with_a_set"] == 45
    assert summary["median_rate_hz"] == pytest.approx(10.0)
    assert summary["claims"] == {"unconditional": 20, "conditional": 25, "none": 5}
    assert summary["half_width_deg"]["y"]["largest"] == pytest.approx(np.rad2deg(0.2))
    assert list(summary["half_width_reference_deg"]) == ["X", "Y", "Z"]
    assert summary["left_out"] == {"dropped": 3, "refused": 0}
    assert (summary["rows_compared"], summary["escapes"]) == (45, 2)
    assert summary["escapes_by_claim"] == {"unconditional": 1, "conditional": 1, "none": 0}
    assert summary["first_escape_s"] == pytest.approx(0.3)
    assert summary["error_deg"]["mean"] == pytest.approx(np.rad2deg(0.05 * np.sqrt(3.0)))
    json.dumps(summary, allow_nan=False)
    alone = report.summarize(make_run(), "truth")
    assert alone["compared_with"] is None
    assert alone["left_out"] == {"refused": 0}


def test_about_which_axes(tmp_path):
    """By default the reference's, with names if the frame is known; figures of the body's stay as they were."""
    run = dataclasses.replace(full_run(), frame="ENU", heading_from_start=True)
    found = {}
    for axes in ("reference", "body"):
        path = tmp_path / f"{axes}.html"
        found[axes] = report.write_report(dataclasses.replace(run, axes=axes), path, "Run")
        page = path.read_text(encoding="utf-8")
        plots = data_of(page)["plots"]
        names = ["X", "Y", "up"] if axes == "reference" else ["x", "y", "z"]
        layout = plots["bands"]["layout"]
        assert [layout[f"yaxis{i}"]["title"]["text"] for i in ("", 2, 3)] == [f"about {name} (deg)" for name in names]
        assert [trace["name"] for trace in plots["size"]["data"][:3]] == [f"half-width about {name}" for name in names]
        assert all(f'<th scope="row">half-width about {name}</th>' in page for name in names)
        assert ("X and Y are horizontal, by the heading that counts from the first row" in page) == (
            axes == "reference"
        )
    assert found["reference"] == found["body"] | {"axes": "reference"}


@pytest.mark.parametrize("known", [True, False])
def test_one_row_and_nothing_known(tmp_path, known):
    run = make_run(1)
    if not known:
        for values in (run.quaternions, run.shapes, run.half_widths, run.largest_angles):
            values[:] = np.nan
    summary = report.write_report(run, tmp_path / "report.html", "One row")
    assert summary["rows_with_a_set"] == int(known)


def test_a_plot_of_nothing_is_not_there(tmp_path):
    run = make_run()
    for values in (run.quaternions, run.shapes, run.half_widths, run.largest_angles):
        values[:] = np.nan
    report.write_report(run, tmp_path / "report.html", "Nothing")
    text = (tmp_path / "report.html").read_text()
    assert {"size", "bands"}.isdisjoint(data_of(text)["plots"])
    for name in ("size", "bands"):
        assert f'<section aria-labelledby="h-{name}" hidden>' in text


def test_a_long_run_stays_small(tmp_path):
    run = make_run(200_000, errors=np.full((200_000, 3), 0.05), forms=np.full(200_000, 0.3))
    summary = report.write_report(run, tmp_path / "report.html", "Long")
    assert (tmp_path / "report.html").stat().st_size < 10e6
    assert summary["drawn"]["rows_of_curves"] < 5000
    assert summary["drawn"]["times_on_sphere"] <= sphere.FRAMES + 2
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert f"The curves are drawn at {summary['drawn']['rows_of_curves']} of them" in page


def test_the_command(tmp_path):
    folder = tmp_path / "hand"
    write(folder, table_columns(make_run()))
    out, pictures = tmp_path / "report.html", tmp_path / "pictures"
    done = run_cli(folder, "--out", out, "--pictures", pictures)
    assert done.exit_code == 0, done.output
    assert "50 rows, largest angle in the set 17.2 (17.2) degrees: mean (at most)" in done.output
    assert sorted(path.name for path in pictures.iterdir()) == ["axes.png", "bands.png", "size.png"]
    assert "<h1>hand</h1>" in out.read_text(encoding="utf-8")
    again = run_cli(folder, "--out", out)
    assert again.exit_code == 1
    assert "--force replaces it" in again.output
    asked = run_cli(folder / "results.csv", "--out", out, "--force", "--json")
    assert json.loads(asked.stdout)["rows"] == 50
    assert json.loads(asked.stdout)["report"] == str(out)
    # What `estimate` called its picture: the recording.
    (folder / "summary.json").write_text(json.dumps({"title": "log.csv"}))
    for options, title in (((), "log.csv"), (("--title", "Mine"), "Mine")):
        assert run_cli(folder, "--out", out, "--force", *options).exit_code == 0
        assert f"<h1>{title}</h1>" in out.read_text(encoding="utf-8")


def test_the_command_with_a_reference(tmp_path):
    write(tmp_path, table_columns(make_run()))
    lines = ["time_s,qw,qx,qy,qz"]
    turned = Rotation.from_quat(make_run().quaternions, scalar_first=True) * Rotation.from_rotvec([0.15, 0.0, 0.0])
    for time, quaternion in zip(make_run().times, turned.as_quat(scalar_first=True), strict=True):
        lines.append(",".join(repr(float(value)) for value in (time, *quaternion)))
    path = tmp_path / "camera.csv"
    path.write_text("\n".join(lines) + "\n")
    done = run_cli(tmp_path, "--reference", path, "--out", tmp_path / "report.html")
    assert done.exit_code == 0, done.output
    # 0.15 rad about x, where the set reaches 0.1 rad.
    assert "camera.csv outside the set at 50 of 50 rows" in done.output
    shifted = tmp_path / "later.csv"
    shifted.write_text("time_s,qw,qx,qy,qz\n1000,1,0,0,0\n")
    refused = run_cli(tmp_path, "--reference", shifted, "--out", tmp_path / "other.html")
    assert refused.exit_code == 1
    assert "no row with a set has a reference of its time" in " ".join(refused.output.split())
    assert not (tmp_path / "other.html").exists()


def test_what_the_guaranteed_mode_says_more(tmp_path):
    write_guaranteed(tmp_path / "hand")
    pictures = tmp_path / "pictures"
    done = run_cli(tmp_path / "hand", "--out", tmp_path / "report.html", "--pictures", pictures, "--json")
    assert done.exit_code == 0, done.output
    summary = json.loads(done.stdout)
    assert summary["left_out"] == {"dropped": 3, "refused": 0, "own bound": 1}
    assert summary["prediction_used_rows"] == 39
    assert summary["tilt_bound_deg"]["largest"] == pytest.approx(np.rad2deg(0.1))
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    for text in (
        "<td>39 rows, 78 % of those with a set</td>",
        '<th scope="row">left out from beginning to end</th><td>field</td>',
        "counts from the first row",
        "Claims and use of the prediction</h2>",
        "prediction used: some rows",
    ):
        assert text in page
    data = data_of(page)
    assert data["dropped"] == {
        "total": 4,
        "time": [0.5, 0.5, 0.7, 4.0],
        "place": DROPPED["place"],
        "sensor": DROPPED["sensor"],
        "why": ["the prediction"] * 3 + ["its own bound"],
        "margin": [-0.4, -0.4, -0.2, -1.5],
        "unit": ["", "", "", "m/s²"],
    }
    size = {trace["name"]: trace for trace in data["plots"]["size"]["data"]}
    assert size["bound of the tilt"]["y"][0] == pytest.approx(np.rad2deg(0.05), rel=1e-5)
    assert size["sun left out"]["x"] == [0.5, 4.0]
    assert size["sun left out"]["text"][1] == "line 43, 1.5 m/s² beyond its own bound"
    plotly = pytest.importorskip("plotly.graph_objects")
    for plot in data["plots"].values():
        plotly.Figure(plot)


def test_heading_and_up_alone(tmp_path):
    """Bounds of heading and tilt in place of the axes of the body; up where there is no attitude."""
    columns = write_guaranteed(tmp_path / "hand")
    heading = np.linspace(0.2, 0.3, 50)
    columns |= {"heading_from": -heading, "heading_to": 0.5 * heading, "up_bound": np.full(50, 0.04)}
    columns["up_claim"] = ["unconditional"] * 50
    columns["claim"] = ["conditional"] * 40 + ["none"] * 10
    lost = np.arange(50) >= 40
    for name in ("qw", "qx", "qy", "qz", "largest_angle", "heading_from", "heading_to", "tilt_bound"):
        columns[name] = np.where(lost, np.nan, columns[name])
    write(tmp_path / "hand", columns)
    pictures = tmp_path / "pictures"
    done = run_cli(tmp_path / "hand", "--out", tmp_path / "report.html", "--pictures", pictures, "--json")
    assert done.exit_code == 0, done.output
    summary = json.loads(done.stdout)
    assert summary["rows_with_up_alone"] == 10
    assert summary["heading_bound_deg"]["largest"] == pytest.approx(np.rad2deg(heading[39]))
    assert summary["up_bound_deg"]["mean"] == pytest.approx(np.rad2deg(0.04))
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "10 rows without an attitude; up is known there all the same" in page
    assert "claim: unconditional" in page
    data = data_of(page)
    size = {trace["name"]: trace["y"] for trace in data["plots"]["size"]["data"]}
    assert not any(name.startswith("half-width") for name in size)
    np.testing.assert_allclose(size["bound of the heading"][:40], np.rad2deg(heading[:40]), rtol=1e-5)
    assert size["bound of the heading"][40:] == size["bound of the tilt"][40:] == [None] * 10
    assert size["up alone"][:40] == [None] * 40
    np.testing.assert_allclose(size["up alone"][40:], np.rad2deg(0.04), rtol=1e-5)
    lanes = {trace["name"] for trace in data["plots"]["strip"]["data"]}
    assert {"claim: none", "claim: conditional", "claim of up: unconditional"} <= lanes
    assert any("no attitude is known, up within 2.29°" in label for label in data["frames"]["labels"])


def test_of_very_many_dropped_measurements_the_farthest_off_are_listed(monkeypatch):
    monkeypatch.setattr(tables, "EACH_LISTED", 3)
    listed = DroppedMeasurements(
        np.arange(5.0), ("",) * 5, ("a",) * 5, ("prediction",) * 5, np.array([-1.0, -5, -2, -3, -4]), ("",) * 5
    )
    each = tables.each_left_out(listed)
    assert (each["total"], each["time"]) == (5, [1.0, 3.0, 4.0])
    run = make_run(500, listed=dataclasses.replace(listed, times=np.array([0.01, 0.02, 0.03, 0.04, 4.9])))
    monkeypatch.setattr(curves, "PIECES", 5)
    (marks,) = curves._drop_marks(run, run.listed)
    assert marks["x"] == [0.02, 4.9]


def test_times_since_1970_keep_their_digits(tmp_path):
    run = make_run(dropped=("",) * 30 + ("star",) + ("",) * 19)
    run.times[:] += 1.7e9
    report.write_report(run, tmp_path / "report.html", "Late")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "50, 1700000000 s to 1700000004.9 s" in page
    assert "<td>1700000003</td>" in page


def test_without_plotly_it_says_what_to_install(tmp_path, monkeypatch):
    write(tmp_path, table_columns(make_run()))
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    done = run_cli(tmp_path, "--out", tmp_path / "report.html")
    assert done.exit_code == 1
    assert "pip install 'elliptude[report]'" in done.output
    assert not (tmp_path / "report.html").exists()


@pytest.mark.parametrize("out", ["nowhere/report.html"])
def test_nothing_half_written(tmp_path, out):
    write(tmp_path, table_columns(make_run()))
    done = run_cli(tmp_path, "--out", tmp_path / out)
    assert done.exit_code == 1
    assert "not written" in done.output
    assert [path.name for path in tmp_path.iterdir()] == ["results.csv"]
