"""`elliptude compare --delta-rows, --delta-s, --align`: against evo's own pairs, errors and alignment."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from elliptude import cli
from elliptude.io import column_files, tables
from elliptude.logs.reference_attitudes import Reference
from elliptude.report import comparison
from elliptude.report.run import Run
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

STATISTICS = (("mean", "mean"), ("rms", "rmse"), ("max", "max"))
"""Our names and evo's."""


def made(times, seed=3, frame=None):
    """A run whose estimates drift from a reference, and that reference in a frame of its own."""
    rng = np.random.default_rng(seed)
    count = len(times)
    true = Rotation.from_rotvec(np.cumsum(0.1 * rng.standard_normal((count, 3)), axis=0))
    estimated = true * Rotation.from_rotvec(np.cumsum(0.01 * rng.standard_normal((count, 3)), axis=0))
    run = Run(
        times=times, quaternions=estimated.as_quat(canonical=True, scalar_first=True),
        shapes=np.tile(0.01 * np.eye(3), (count, 1, 1)), half_widths=np.full((count, 3), 0.1),
        largest_angles=np.full(count, 0.1), used=("up",) * count, refused=("",) * count,
        claims=("unconditional",) * count,
    )  # fmt: skip
    return run, Reference(times, true if frame is None else frame * true)


def invoke(*arguments):
    return CliRunner().invoke(cli.make_app(), ["compare", *(str(argument) for argument in arguments)])


def write(folder, run, reference):
    """Both as files that the command reads."""
    count = len(run.times)
    shapes = np.tile(np.eye(6) * 1e-4, (count, 1, 1))
    results = tables.Result(
        times=run.times, quaternions=run.quaternions, vector="bias", vectors=np.zeros((count, 3)), shapes=shapes,
        half_widths=np.full((count, 6), 0.01), largest_angles=np.full(count, 0.01), used=["up"] * count,
        refused=[""] * count, shares=np.zeros(count), margins=np.zeros(count),
    )  # fmt: skip
    folder.mkdir(exist_ok=True)
    column_files.write_columns(
        folder / "results.csv", "results", results.columns() | {"claim": ["unconditional"] * count}
    )
    quaternions = reference.attitudes.as_quat(scalar_first=True)
    columns = {"time_s": reference.times} | dict(zip(tables.QUATERNION, quaternions.T, strict=True))
    column_files.write_columns(folder / "reference.csv", "measurements", columns)
    return folder / "results.csv", folder / "reference.csv"


def trajectories(times, *attitudes):
    """evo's, whose place is the time: a path over so many metres is one over so many seconds."""
    trajectory = pytest.importorskip("evo.core.trajectory")
    places = np.column_stack([times, np.zeros((len(times), 2))])
    return tuple(trajectory.PoseTrajectory3D(places, one.as_quat(scalar_first=True), times) for one in attitudes)


def evo_pairs_and_errors(times, estimated, true, delta, unit, all_pairs):
    """evo's pairs and its error of each, degrees."""
    metrics = pytest.importorskip("evo.core.metrics")
    pair = trajectories(times, true, estimated)
    relation = metrics.PoseRelation.rotation_angle_deg
    rpe = metrics.RPE(relation, delta=delta, delta_unit=getattr(metrics.Unit, unit), all_pairs=all_pairs)
    rpe.process_data(pair)
    return metrics.id_pairs_from_delta(pair[1].poses_se3, delta, rpe.delta_unit, 0.1, all_pairs), rpe.error


@pytest.mark.parametrize("all_pairs", [False, True])
@pytest.mark.parametrize("rows", [1, 7, 50, 398])
def test_over_rows_as_evo(rows, all_pairs):
    run, reference = made(np.sort(np.random.default_rng(1).uniform(0.0, 40.0, 400)))
    compared = comparison.compare(run, reference)
    _, errors = evo_pairs_and_errors(run.times, compared.estimated, compared.true, rows, "frames", all_pairs)
    ours = np.rad2deg(compared.relative(rows=rows, all_pairs=all_pairs))
    np.testing.assert_allclose(ours, errors, atol=1e-6)  # evo's angle is an arccosine's or a logarithm's


@pytest.mark.parametrize("delta", [0.25, 1.0, 3.0])
def test_over_seconds_as_evo(delta):
    """Rows at irregular times with two gaps: evo's pairs along a path of so many metres."""
    rng = np.random.default_rng(2)
    times = np.cumsum(rng.uniform(0.02, 0.18, 400))
    times[150:] += 2.7
    times[300:] += 0.9
    run, reference = made(times)
    compared = comparison.compare(run, reference)
    attitudes = compared.estimated, compared.true
    _, errors = evo_pairs_and_errors(times, *attitudes, delta, "meters", True)
    assert 10 < len(errors) < 400
    ours = np.rad2deg(compared.relative(seconds=delta, all_pairs=True))
    np.testing.assert_allclose(ours, errors, atol=1e-6)
    # One after another evo takes pairs over gaps, too; those are longer than the tolerance that it has for all pairs.
    pairs, errors = evo_pairs_and_errors(times, *attitudes, delta, "meters", False)
    spans = np.array([times[last] - times[first] for first, last in pairs])
    assert (spans > 1.1 * delta).any()
    ours = np.rad2deg(compared.relative(seconds=delta))
    np.testing.assert_allclose(ours, errors[spans <= 1.1 * delta], atol=1e-6)


@pytest.mark.parametrize("start", [0.0, 100.1, 1.7e9])
def test_seconds_of_even_rows_are_rows(start):
    """0.01 s and its multiples are no binary fractions: rounding must not make a pair a row longer."""
    run, reference = made(start + np.arange(1000) * 0.01)
    compared = comparison.compare(run, reference)
    for seconds, rows in ((0.07, 7), (0.29, 29), (1.0, 100)):
        for all_pairs in (False, True):
            by_row = compared.relative(rows=rows, all_pairs=all_pairs)
            by_time = compared.relative(seconds=seconds, all_pairs=all_pairs)
            # Near the end, pairs that are up to a tenth shorter count, too, as evo's do.
            assert len(by_row) <= len(by_time) <= len(by_row) + (rows // 10 if all_pairs else 0)
            np.testing.assert_array_equal(by_time[: len(by_row)], by_row)
    with pytest.raises(ValueError, match="no two of the 1000 compared rows are 10 s apart"):
        compared.relative(seconds=10.0)
    with pytest.raises(ValueError, match="no two of the 1000 compared rows are 1000 compared rows apart"):
        compared.relative(rows=1000)


def test_alignment_as_evo():
    """At the origin by evo's own transformation; at all rows by its Umeyama, with the body's axes for points."""
    geometry = pytest.importorskip("evo.core.geometry")
    metrics = pytest.importorskip("evo.core.metrics")
    frame = Rotation.from_rotvec([0.7, -1.1, 2.0])
    run, reference = made(np.arange(300) / 10.0, frame=frame)
    plain = comparison.compare(run, reference)
    assert plain.inside is not None
    assert plain.broken_promises == 300
    for alignment in ("origin", "all"):
        compared = comparison.compare(run, reference, alignment=alignment)
        true, estimated = trajectories(run.times, reference.attitudes, compared.estimated)
        if alignment == "origin":
            estimated.align_origin(true)
        else:
            points = [np.concatenate([axes, -axes], axis=1) for axes in (
                np.concatenate(list(one.as_matrix()), axis=1) for one in (compared.estimated, reference.attitudes)
            )]  # fmt: skip
            rotation, _, _ = geometry.umeyama_alignment(*points)
            turn = np.eye(4)
            turn[:3, :3] = rotation
            estimated.transform(turn)
        ape = metrics.APE(metrics.PoseRelation.rotation_angle_deg)
        ape.process_data((true, estimated))
        np.testing.assert_allclose(np.rad2deg(compared.angles), ape.error, atol=1e-6)
        assert compared.angles.mean() < 0.1 * plain.angles.mean()
        # The sets have the errors of the estimate in common with such a reference.
        assert compared.inside is None
        assert compared.broken_promises == 0
        assert compared.turned == pytest.approx(frame.magnitude(), abs=0.2)
        np.testing.assert_allclose(compared.relative(rows=5), plain.relative(rows=5), atol=1e-12)


def test_command_and_what_evo_reads(tmp_path):
    """The figures of the command are those of `evo_ape` and `evo_rpe` from the files that it writes."""
    run, reference = made(np.arange(200) / 20.0, frame=Rotation.from_rotvec([0.0, 0.0, 1.0]))
    files = write(tmp_path, run, reference)
    tum = tmp_path / "tum"
    done = invoke(*files, "--json", "--align", "origin", "--delta-s", "0.5", "--all-pairs", "--tum", tum)
    assert done.exit_code == 0, done.output
    said = json.loads(done.stdout)
    assert (said["alignment"], said["relative"]["pairs"], said["relative"]["delta_s"]) == ("origin", 190, 0.5)
    assert said["all"]["inside"] is None
    assert said["by_claim"]["unconditional"]["inside_share"] is None
    pytest.importorskip("evo")
    for name, more, ours in (
        ("evo_ape", [], said["all"]["error_deg"]),
        ("evo_rpe", ["-d", "10", "-u", "f", "--all_pairs"], said["relative"]["error_deg"]),
    ):
        arguments = ["tum", str(tum / "reference.tum"), str(tum / "estimate.tum"), "-r", "angle_deg", *more]
        environment = {"HOME": str(tmp_path), "PATH": "/usr/bin:/bin"}
        program = Path(sys.executable).with_name(name)
        ran = subprocess.run([program, *arguments], capture_output=True, text=True, env=environment, check=True)
        theirs = dict(re.findall(r"^\s*(\w+)\s+(\d\S*)$", ran.stdout, flags=re.MULTILINE))
        for name_of_ours, name_of_theirs in STATISTICS:
            assert float(theirs[name_of_theirs]) == pytest.approx(ours[name_of_ours], abs=2e-6), name
    said = invoke(*files, "--align", "all", "--delta-rows", "10").stdout
    assert "turns over 10 rows (19 pairs): error" in " ".join(said.split())
    assert "onto the estimate over all compared rows: it takes on errors of the estimate" in " ".join(said.split())


def test_what_is_at_fault(tmp_path):
    run, reference = made(np.arange(20) / 20.0)
    files = write(tmp_path, run, reference)
    for arguments, code, message in (
        (["--delta-rows", 5, "--delta-s", 1], 2, "--delta-rows or --delta-s, not both"),
        (["--all-pairs"], 2, "needs --delta-rows or --delta-s"),
        (["--delta-rows", 0], 2, "1"),
        (["--delta-s", 0], 2, "0 is not from 0.001 to 1e+06"),
        (["--delta-s", 5], 1, "no two of the 20 compared rows are 5 s apart; they cover 0.95 s"),
        (["--align", "first"], 2, "'origin'"),
    ):
        done = invoke(*files, *arguments)
        assert done.exit_code == code, done.output
        assert message in " ".join(done.output.replace("│", " ").split())


def test_misread_although_aligned(tmp_path):
    """Any frame may be aligned, and a quaternion in the other order still does not turn as the estimate does."""
    run, reference = made(np.arange(400) / 20.0, frame=Rotation.from_rotvec([2.0, 0.0, 0.0]))
    assert invoke(*write(tmp_path / "right", run, reference), "--align", "all").exit_code == 0
    inverse = Reference(reference.times, reference.attitudes.inv())
    done = invoke(*write(tmp_path / "inverse", run, inverse), "--align", "all")
    assert done.exit_code == 1
    assert "as far when read as turns = 'reference_to_body'" in " ".join(done.output.split())
