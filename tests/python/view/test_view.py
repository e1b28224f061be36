"""`elliptude view`: what is in a recording for Rerun, read back by the SDK's own reader."""

import dataclasses
import sys

import numpy as np
import pytest
from elliptude import cli, view
from elliptude.report.estimated.reading import read_run
from scipy.spatial.transform import Rotation
from test_run_figures import angled, full_run
from test_runs import make_run
from typer.testing import CliRunner

rerun = pytest.importorskip("rerun")
RrdReader = pytest.importorskip("rerun.chunk").RrdReader
BOUND = np.deg2rad(7.0)
"""Of each direction of the simulated log."""


def run_cli(*arguments):
    return CliRunner().invoke(cli.make_app(), [str(argument) for argument in arguments])


class Recording:
    """A file of Rerun's: columns by the paths of what they are of, and by their names."""

    def __init__(self, path):
        rrd = RrdReader(path)
        (self.entry,) = rrd.recordings()
        self.blueprints = len(rrd.blueprints())
        self._batches = {}
        for chunk in rrd.stream().to_chunks():
            self._batches.setdefault((chunk.entity_path, chunk.is_static), []).append(chunk.to_record_batch())
        self.paths = {path for path, _ in self._batches}

    def column(self, path, name, *, is_static=False):
        """Its values, row by row in order of time."""
        return [
            value
            for batch in self._batches[path, is_static]
            if name in batch.schema.names
            for value in batch[name].to_pylist()
        ]

    def times(self, path):
        """s."""
        there = self._batches[path, False]
        return np.concatenate([batch["time"].cast("int64").to_numpy() for batch in there]) / 1e9

    def curves(self, path):
        """Curves by their names."""
        (names,) = self.column(path, "SeriesLines:names", is_static=True)
        return dict(zip(names, np.array(self.column(path, "Scalars:scalars")).T, strict=True))


@pytest.fixture(scope="module")
def written(simulated, tmp_path_factory):
    log, config, result = simulated
    path = tmp_path_factory.mktemp("view") / "view.rrd"
    done = run_cli("view", result, "--log", log, "--config", config, "--out", path)
    assert done.exit_code == 0, done.output
    assert "curves at all rows; the sphere at 21, evenly in time" in done.output
    return Recording(path)


def truth_of(log):
    """True attitudes (N, 3, 3) and measured directions (N, 3, 3), rows of the log, by NumPy's own reader."""
    table = np.genfromtxt(log, delimiter=",", skip_header=1, names=True)
    attitudes = Rotation.from_quat(np.column_stack([table[f"q{one}"] for one in "wxyz"]), scalar_first=True)
    measured = [[table[f"direction{i}_b{axis}"] for axis in "xyz"] for i in (1, 2, 3)]
    return attitudes.as_matrix(), np.array(measured).transpose(2, 0, 1)


def is_within(direction, rim):
    """Whether a direction is within a closed curve on the sphere: its angles about the direction add up to a turn."""
    first = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    first /= np.linalg.norm(first)
    turned = np.unwrap(np.arctan2(rim @ np.cross(direction, first), rim @ first))
    is_near = float(rim.mean(axis=0) @ direction) > 0.0
    return is_near and bool(abs(turned[-1] - turned[0]) > np.pi)


def test_the_truth_is_in_each_patch(simulated, written):
    true, _ = truth_of(simulated[0])
    for i, axis in enumerate("xyz"):
        rims = written.column(f"/sphere/may_point/{axis}/rim", "LineStrips3D:strips")
        assert len(rims) == len(true) == 21
        assert rims[0] == []  # within 128 degrees: too large to draw
        for row, strips in enumerate(rims[1:], start=1):
            (rim,) = np.array(strips)
            np.testing.assert_allclose(np.linalg.norm(rim, axis=1), 1.0, atol=1e-6)
            assert is_within(true[row][:, i], rim)
            # What is further out than the patch is wide is not.
            middle = rim.mean(axis=0)
            width = 2.0 * np.arccos(np.clip(rim @ middle / np.linalg.norm(middle), -1.0, 1.0)).max()
            aside = Rotation.from_rotvec(width * true[row][:, (i + 1) % 3]).apply(true[row][:, i])
            assert not is_within(aside, rim)


def test_the_patch_is_a_surface_within_its_rim(written):
    (corners,) = written.column("/sphere/may_point/x", "Mesh3D:triangle_indices", is_static=True)
    vertices = written.column("/sphere/may_point/x", "Mesh3D:vertex_positions")
    rims = written.column("/sphere/may_point/x/rim", "LineStrips3D:strips")
    for patch, strips in zip(vertices[1:], rims[1:], strict=True):
        assert np.max(corners) < len(patch)
        # The directions of its triangles' middles.
        middles = np.array(patch)[np.array(corners)].mean(axis=1)
        assert all(is_within(one, np.array(strips[0])) for one in middles[::7])


def test_the_truth_points_what_was_measured_into_each_circle(simulated, written):
    true, measured = truth_of(simulated[0])
    run, _ = read_run(simulated[2])
    estimated = Rotation.from_quat(run.quaternions, scalar_first=True).as_matrix()
    for i in range(3):
        path, reference = f"/sphere/measured/direction{i + 1}", np.eye(3)[i]
        circles = written.column(f"{path}/within", "LineStrips3D:strips")
        points = written.column(path, "Points3D:positions")
        assert (circles[0], points[0]) == ([], [])  # nothing is measured at time 0
        for row in range(1, 21):
            (circle,), (point,) = np.array(circles[row]), np.array(points[row])
            np.testing.assert_allclose(np.arccos(circle @ reference), BOUND, atol=1e-5)
            assert is_within(true[row] @ measured[row, i], circle)
            np.testing.assert_allclose(point, estimated[row] @ measured[row, i], atol=1e-6)


def test_axes_and_marks_are_estimate_and_truth(simulated, written):
    true, _ = truth_of(simulated[0])
    run, _ = read_run(simulated[2])
    estimated = Rotation.from_quat(run.quaternions, scalar_first=True).as_matrix()
    np.testing.assert_allclose(written.times("/sphere/body/x"), run.times, atol=1e-9)
    for i, axis in enumerate("xyz"):
        tips = np.array(written.column(f"/sphere/body/{axis}", "Arrows3D:vectors"))[:, 0]
        np.testing.assert_allclose(tips, estimated[:, :, i], atol=1e-6)
    marks = np.array(written.column("/sphere/compared_with/truth", "Points3D:positions"))
    np.testing.assert_allclose(marks, true.swapaxes(1, 2), atol=1e-6)
    # What is drawn of the axes and the reference's names is there too, and a layout.
    assert {"/sphere/globe", "/sphere/reference/names", "/notes", "/now"} <= written.paths
    assert (written.entry.application_id, written.blueprints) == ("elliptude", 1)


def test_curves_are_those_of_the_results(simulated, written):
    run, _ = read_run(simulated[2])
    np.testing.assert_allclose(written.curves("/size")["largest angle in the set"], np.rad2deg(run.largest_angles))
    shown = run.about_axes()
    for i, name in enumerate("XYZ"):
        curves = written.curves(f"/bounds/{name}")
        np.testing.assert_allclose(curves["most"], np.rad2deg(shown.half_widths[:, i]))
        np.testing.assert_allclose(curves["least"], -curves["most"])
        np.testing.assert_allclose(curves["error against truth"], np.rad2deg(shown.errors[:, i]))


def test_gaps_claims_and_angles(tmp_path):
    """Nothing is drawn where nothing is known, and each claim from its first row to the next one's."""
    run = angled(full_run())
    view.write_view(run, tmp_path / "view.rrd", "Run", label="optical attitude")
    found = Recording(tmp_path / "view.rrd")
    for name, column in {"body": "Arrows3D:vectors", "may_point": "Mesh3D:vertex_positions"}.items():
        lengths = np.array([len(one) for one in found.column(f"/sphere/{name}/x", column)])
        assert (np.flatnonzero(lengths == 0) == np.arange(20, 25)).all()
    claims = found.column("/claims/claim", "StateChange:state")
    assert claims == [["unconditional"], ["none"], ["conditional"]]
    np.testing.assert_allclose(found.times("/claims/claim"), run.times[[0, 20, 25]], atol=1e-9)
    assert found.column("/now", "TextDocument:text")[22] == ["2.20 s: nothing is known"]
    (said,) = found.column("/left_out", "TextLog:text")
    assert said == ["star: 3 left out up to 3.200 s; they contradicted the prediction or one another"]
    largest = found.curves("/size")["largest angle in the set"]
    assert np.isnan(largest[20:25]).all()
    assert np.isfinite(np.delete(largest, np.arange(20, 25))).all()
    pitch = found.curves("/angles/pitch/estimate")
    np.testing.assert_allclose(
        np.column_stack([pitch["estimate"], pitch["least"], pitch["most"]]), np.rad2deg(run.roll_pitch_yaw[:, 3:6])
    )
    # Roll goes from one end of the circle to the other, twice: a gap there, and no line across the plot.
    roll, times = found.curves("/angles/roll/estimate")["estimate"], found.times("/angles/roll/estimate")
    assert len(roll) == 52
    assert np.nanmax(np.abs(np.diff(roll))) < 180.0
    np.testing.assert_allclose(np.unique(times), run.times, atol=1e-9)
    assert "optical attitude" in found.curves("/angles/roll/reference")


def test_no_curve_leads_over_a_gap_between_rows(tmp_path):
    run = dataclasses.replace(angled(full_run()), longest_step=0.15)
    run = dataclasses.replace(run, times=np.where(np.arange(len(run.times)) < 10, run.times, run.times + 3.0))
    view.write_view(run, tmp_path / "view.rrd", "Run", label="optical attitude")
    found = Recording(tmp_path / "view.rrd")
    middle = 0.5 * (run.times[9] + run.times[10])
    for path in ("/size", "/angles/pitch/estimate"):
        times, curves = found.times(path), found.curves(path)
        for values in curves.values():
            assert np.isnan(values[np.argmin(np.abs(times - middle))])
    # The lane of a claim ends there, and begins anew.
    np.testing.assert_allclose(found.times("/claims/claim")[:3], [run.times[0], middle, run.times[10]], atol=1e-9)


def test_small_sets_are_magnified_and_the_notes_say_so(tmp_path):
    run = make_run(5, errors=np.full((5, 3), 1e-5), forms=np.full(5, 0.5))
    run = dataclasses.replace(run, shapes=run.shapes * 1e-6, largest_angles=run.largest_angles * 1e-3)
    assert run.magnification(np.arange(5)) == 1000
    seen = np.linalg.inv(run.attitudes) @ [np.cos(0.01), np.sin(0.01), 0.0]
    references = np.tile([1.0, 0.0, 0.0], (5, 1, 1))
    measured = view.MeasuredDirections(("sun",), seen[:, None], references, np.full((5, 1), 0.015))
    drawn = view.write_view(run, tmp_path / "view.rrd", "Run", measured=measured)
    # By the circle: 50 times 0.015 rad are 43 degrees, and 100 times more than 45.
    assert drawn.magnification == 50
    found = Recording(tmp_path / "view.rrd")
    ((point,), *_) = found.column("/sphere/measured/sun", "Points3D:positions")
    np.testing.assert_allclose(point, [np.cos(0.5), np.sin(0.5), 0.0], atol=1e-6)
    ((circle,), *_) = found.column("/sphere/measured/sun/within", "LineStrips3D:strips")
    np.testing.assert_allclose(np.arccos(np.array(circle)[:, 0]), 0.75, atol=1e-6)
    ((notes,),) = found.column("/notes", "TextDocument:text", is_static=True)
    assert "50 times as large" in notes


def test_the_notes_say_what_sets_rest_on(tmp_path):
    run = dataclasses.replace(make_run(3), implausible=("up is down",), bounds_from_recording="hand.csv")
    run = dataclasses.replace(run, suspicious=("a gyro in degrees",))
    run = dataclasses.replace(run, why_not_measured="measured.csv is damaged")
    view.write_view(run, tmp_path / "view.rrd", "Run")
    ((notes,),) = Recording(tmp_path / "view.rrd").column("/notes", "TextDocument:text", is_static=True)
    assert "Implausible, gone on regardless:** up is down" in notes
    assert "Suspicious:** a gyro in degrees" in notes
    assert "no guarantee:** their bounds are proposals from hand.csv" in notes
    assert "Drawn are curves at all rows" in notes
    assert "Not drawn:** measured.csv is damaged" in notes


def test_what_was_left_out_is_red(tmp_path):
    run = make_run(4, dropped=("", "sun", "", ""))
    names = ("sun", "star")
    seen = np.linalg.inv(run.attitudes)[:, None, :, 0].repeat(2, axis=1)
    measured = view.MeasuredDirections(names, seen, np.tile([1.0, 0.0, 0.0], (4, 2, 1)), np.full((4, 2), 0.2))
    measured.angles[2, 1] = np.nan  # against its own bound
    view.write_view(run, tmp_path / "view.rrd", "Run", measured=measured)
    found = Recording(tmp_path / "view.rrd")
    sun, star = ([one for (one,) in found.column(f"/sphere/measured/{name}", "Points3D:colors")] for name in names)
    assert sun[0] == sun[2] == sun[3] != sun[1]
    assert star[0] == star[1] == star[3] != star[2]
    assert sun[1] == star[2]
    assert sun[1] >> 24 > 200
    lengths = [len(one) for one in found.column("/sphere/measured/star/within", "LineStrips3D:strips")]
    assert lengths == [1, 1, 0, 1]


def test_a_long_run_is_thinned_and_keeps_its_extremes(tmp_path):
    count = 30_000
    run = dataclasses.replace(make_run(count), times=np.arange(count) / 100.0)
    run.largest_angles[12_345] = 0.9
    drawn = view.write_view(run, tmp_path / "view.rrd", "Run")
    assert drawn.rows == count
    assert 2000 <= drawn.rows_of_curves < 10_000
    assert 2000 <= drawn.times_on_sphere <= 2002
    found = Recording(tmp_path / "view.rrd")
    largest = found.curves("/size")["largest angle in the set"]
    assert len(largest) == drawn.rows_of_curves
    at = found.times("/size")[np.argmax(largest)]
    np.testing.assert_allclose([largest.max(), at], [np.rad2deg(0.9), 123.45])
    ((notes,),) = found.column("/notes", "TextDocument:text", is_static=True)
    assert f"{drawn.rows_of_curves} of 30000 rows" in notes


@pytest.mark.parametrize("known", [True, False])
def test_one_row(tmp_path, known):
    run = make_run(1)
    if not known:
        run.largest_angles[:], run.quaternions[:] = np.nan, np.nan
    view.write_view(run, tmp_path / "view.rrd", "Run")
    assert Recording(tmp_path / "view.rrd").times("/now").tolist() == [0.0]


def test_times_since_1970_are_dates(tmp_path):
    run = dataclasses.replace(make_run(3), times=1.7e9 + np.array([0.0, 0.25, 0.5]))
    view.write_view(run, tmp_path / "view.rrd", "Run")
    found = Recording(tmp_path / "view.rrd")
    np.testing.assert_allclose(found.times("/now"), run.times, rtol=0.0, atol=1e-6)
    index = next(batch for (path, _), (batch, *_) in found._batches.items() if path == "/now")["time"]
    assert str(index.type) == "timestamp[ns]"


def test_python(simulated, tmp_path):
    log, config, result = simulated
    drawn = view.to_rerun(result, tmp_path / "view.rrd", log=log, config=config, axes="body")
    assert drawn == view.Drawn(rows=21, rows_of_curves=21, times_on_sphere=21, magnification=1)
    assert {"/bounds/x", "/sphere/measured/direction1"} <= Recording(tmp_path / "view.rrd").paths
    with pytest.raises(ValueError, match="belong together"):
        view.to_rerun(result, tmp_path / "other.rrd", log=log)


def test_the_modes_of_first_order(simulated, tmp_path):
    """Their start may come after rows of the log; their measurements are refused together."""
    log, config, _ = simulated
    changed = tmp_path / "config.toml"
    changed.write_text(config.read_text().replace('mode = "guaranteed"', 'mode = "first_order"'))
    assert run_cli("estimate", log, "--config", changed, "--out", tmp_path / "result").exit_code == 0
    done = run_cli("view", tmp_path / "result", "--log", log, "--config", changed, "--out", tmp_path / "view.rrd")
    assert done.exit_code == 0, done.output
    found = Recording(tmp_path / "view.rrd")
    assert "/claims/claim" not in found.paths
    ((circle,), *_) = found.column("/sphere/measured/direction2/within", "LineStrips3D:strips")[1:]
    np.testing.assert_allclose(np.arccos(np.array(circle)[:, 1]), BOUND, atol=1e-5)


# --- what it is compared with -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def without_truth(simulated, tmp_path_factory):
    """The same log without its truth: its results, its configuration, and the truth in a file of its own."""
    log, config, _ = simulated
    folder = tmp_path_factory.mktemp("without_truth")
    (folder / "config.toml").write_text(config.read_text().split("[truth]")[0] + '[estimator]\nmode = "guaranteed"\n')
    table = np.genfromtxt(log, delimiter=",", skip_header=1, names=True)
    truth = np.column_stack([table[name] for name in ("time_s", "qw", "qx", "qy", "qz")])
    np.savetxt(folder / "camera.csv", truth, delimiter=",", header="time_s,qw,qx,qy,qz", comments="")
    done = run_cli("estimate", log, "--config", folder / "config.toml", "--out", folder / "result")
    assert done.exit_code == 0, done.output
    return folder / "result", folder / "config.toml", folder / "camera.csv"


def test_without_any_reference(simulated, without_truth, tmp_path):
    """Sets, circles and bounds as with one, and nothing of a truth."""
    result, config, _ = without_truth
    out = tmp_path / "view.rrd"
    done = run_cli("view", result, "--log", simulated[0], "--config", config, "--out", out)
    assert done.exit_code == 0, done.output
    found = Recording(out)
    assert {"/sphere/may_point/x", "/sphere/measured/direction1/within", "/size"} <= found.paths
    assert not any(
        "compared_with" in path or path.endswith("/reference") for path in found.paths - {"/sphere/reference"}
    )
    assert set(found.curves("/bounds/X")) == {"least", "most"}
    ((notes,),) = found.column("/notes", "TextDocument:text", is_static=True)
    assert "Violet" not in notes


def test_another_reference(simulated, without_truth, written, tmp_path):
    """A reference of its own draws what the truth in the log does, by its own name and with its own error."""
    result, _, camera = without_truth
    arguments = ("view", result, "--reference", camera, "--reference-error-deg", "0.5")
    done = run_cli(*arguments, "--out", tmp_path / "view.rrd")
    assert done.exit_code == 0, done.output
    found = Recording(tmp_path / "view.rrd")
    ours, theirs = (
        np.array(one.column(f"/sphere/compared_with/{name}", "Points3D:positions")[1:])
        for one, name in ((found, "camera.csv"), (written, "truth"))
    )
    np.testing.assert_allclose(ours, theirs, atol=1e-6)
    np.testing.assert_allclose(
        found.curves("/bounds/X")["error against camera.csv"],
        written.curves("/bounds/X")["error against truth"],
        atol=1e-5,
    )
    ((notes,),) = found.column("/notes", "TextDocument:text", is_static=True)
    assert "Violet is camera.csv, which may itself be off by 0.5°." in notes
    done = run_cli(*arguments, "--label", "optical", "--out", tmp_path / "named.rrd")
    assert done.exit_code == 0, done.output
    assert "/sphere/compared_with/optical" in Recording(tmp_path / "named.rrd").paths


def test_a_log_as_the_reference(simulated, without_truth, tmp_path):
    """Its configuration says which columns are its truth, and how far that may be off."""
    log, config, _ = simulated
    stated = tmp_path / "truth.toml"
    stated.write_text(config.read_text().replace("[truth]", "[truth]\nerror_deg = 0.25"))
    view.to_rerun(without_truth[0], tmp_path / "view.rrd", reference=log, reference_config=stated)
    found = Recording(tmp_path / "view.rrd")
    assert "error against measurements.csv" in found.curves("/bounds/X")
    ((notes,),) = found.column("/notes", "TextDocument:text", is_static=True)
    assert "Violet is measurements.csv, which may itself be off by 0.25°." in notes
    view.to_rerun(
        without_truth[0],
        tmp_path / "other.rrd",
        reference=log,
        reference_config=stated,
        reference_error=np.deg2rad(2.0),
    )
    ((notes,),) = Recording(tmp_path / "other.rrd").column("/notes", "TextDocument:text", is_static=True)
    assert "which may itself be off by 2°." in notes


def test_a_reference_that_is_none(without_truth, tmp_path):
    result, _, camera = without_truth
    lines = camera.read_text().splitlines()
    numbers = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])

    def reference(name, changed):
        np.savetxt(tmp_path / name, changed, delimiter=",", header=lines[0], comments="")
        return tmp_path / name

    out = tmp_path / "view.rrd"
    for arguments, code, message in (
        (
            ("--reference", reference("later.csv", np.add(numbers, [1000, 0, 0, 0, 0]))),
            1,
            "later.csv: no row with a set has",
        ),
        (
            ("--reference", reference("inverse.csv", numbers * [1, -1, 1, 1, 1])),
            1,
            "its quaternions are not as declared",
        ),
        (("--reference", tmp_path / "none.csv"), 1, "none.csv: no such file"),
        (("--reference-error-deg", "1"), 2, "is of a --reference"),
        (("--reference-config", camera), 2, "says what the columns of a --reference are"),
    ):
        done = run_cli("view", result, *arguments, "--out", out)
        assert done.exit_code == code
        assert message in " ".join(done.output.replace("│", " ").split())
        assert not out.exists()
    with pytest.raises(ValueError, match="are of a reference: give it, too"):
        view.to_rerun(result, out, reference_error=0.1)


# --- the viewer -------------------------------------------------------------------------------------------------------


def test_without_a_file_the_viewer_is_opened(simulated, tmp_path, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":99")

    def spawn(*, recording, executable_path):
        assert executable_path.endswith("rerun")
        recording.save(tmp_path / "sent.rrd")

    monkeypatch.setattr(rerun, "spawn", spawn)
    done = run_cli("view", simulated[2])
    assert done.exit_code == 0, done.output
    assert {"/sphere/body/x", "/size", "/claims/claim"} <= Recording(tmp_path / "sent.rrd").paths


def test_a_viewer_that_does_not_open(simulated, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":99")

    def spawn(**_):
        raise RuntimeError("no such program")

    monkeypatch.setattr(rerun, "spawn", spawn)
    done = run_cli("view", simulated[2])
    assert done.exit_code == 1
    assert "Rerun's viewer does not open: no such program; write a recording (--out)" in done.output


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems have a display")
def test_no_display(simulated, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    done = run_cli("view", simulated[2])
    assert done.exit_code == 1
    assert "no display for Rerun's viewer: write a recording (--out)" in done.output


# --- what is wrong is said --------------------------------------------------------------------------------------------


def test_what_is_there_is_kept(simulated, tmp_path):
    path = tmp_path / "view.rrd"
    path.write_text("kept")
    done = run_cli("view", simulated[2], "--out", path)
    assert (done.exit_code, path.read_text()) == (1, "kept")
    assert "view.rrd is there already; --force replaces it" in done.output
    assert run_cli("view", simulated[2], "--out", path, "--force").exit_code == 0
    assert "/size" in Recording(path).paths


def test_a_log_of_other_results(simulated, tmp_path):
    log, config, result = simulated
    lines = log.read_text().splitlines(keepends=True)
    (tmp_path / "short.csv").write_text("".join(lines[:10]))
    done = run_cli("view", result, "--log", tmp_path / "short.csv", "--config", config, "--out", tmp_path / "view.rrd")
    assert done.exit_code == 1
    assert "short.csv: it has no row at" in done.output
    assert not (tmp_path / "view.rrd").exists()


def test_rerun_is_turned_off(simulated, tmp_path, monkeypatch):
    monkeypatch.setenv("RERUN", "off")
    done = run_cli("view", simulated[2], "--out", tmp_path / "view.rrd")
    assert done.exit_code == 1
    assert "the variable RERUN of the environment turns Rerun off" in done.output
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_cannot_be_finished_is_removed(simulated, tmp_path, monkeypatch):
    """As on a full disk, where the SDK's thread ends and says so when it is waited for."""

    def flush(self, **_):
        raise RuntimeError("no space left")

    monkeypatch.setattr(rerun.RecordingStream, "flush", flush)
    done = run_cli("view", simulated[2], "--out", tmp_path / "view.rrd")
    assert done.exit_code == 1
    assert "view.rrd: not written: no space left" in " ".join(done.output.split())
    assert list(tmp_path.iterdir()) == []


def test_what_the_sensors_measured_is_there_without_the_log(simulated, tmp_path):
    """Gaps are none of the curves, and what was left out is marked below them."""
    run, _ = read_run(simulated[2])
    assert [one.name for one in run.measured] == ["rate", "direction1", "direction2", "direction3"]
    sensor = dataclasses.replace(run.measured[1], left_out=run.times[[2, 5]])
    values = sensor.values.copy()
    values[7] = np.nan
    run = dataclasses.replace(run, measured=(run.measured[0], dataclasses.replace(sensor, values=values)))
    view.write_view(run, tmp_path / "view.rrd", "Run")
    found = Recording(tmp_path / "view.rrd")
    for one in run.measured:
        curves = found.curves(f"/measured/{one.name}/axes")
        np.testing.assert_array_equal(np.column_stack([curves[axis] for axis in "xyz"]), one.values)
        np.testing.assert_allclose(found.times(f"/measured/{one.name}/axes"), one.times, atol=1e-9)
    np.testing.assert_allclose(found.times("/measured/direction1/left_out"), run.times[[2, 5]], atol=1e-9)
    assert "/measured/rate/left_out" not in found.paths
    view.write_view(dataclasses.replace(run, measured=()), tmp_path / "old.rrd", "Run")
    assert not any(path.startswith("/measured") for path in Recording(tmp_path / "old.rrd").paths)
