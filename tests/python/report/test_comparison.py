"""`elliptude compare`: containment, errors and widths against figures got another way; what it writes for evo."""

import json
import runpy
from pathlib import Path

import numpy as np
import pytest
from elliptude import cli
from elliptude.estimation.containment import attitude_forms
from elliptude.io import column_files, tables
from elliptude.io.files import FileError
from elliptude.logs.reference_attitudes import Reference
from elliptude.report import comparison
from elliptude.report.estimated.reading import read_run
from elliptude.report.run import Run
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner


def run(*arguments):
    return CliRunner().invoke(cli.make_app(), ["compare", *(str(argument) for argument in arguments)])


@pytest.fixture
def made():
    """Ten rows whose references are turned by known ζ; the shapes are those of half-widths 2, 1 and 0.5 degrees."""
    rng = np.random.default_rng(5)
    times = 100.0 + 0.5 * np.arange(10)
    estimated = Rotation.random(10, rng=rng)
    zeta = np.zeros((10, 3))
    zeta[:, 0] = np.deg2rad(np.linspace(0.2, 2.0, 10))
    shapes = np.tile(np.diag([0.0] * 3 + [1e-4] * 3), (10, 1, 1))
    shapes[:, :3, :3] = np.diag(np.deg2rad([1.55, 1.0, 0.5]) ** 2)
    return times, estimated, zeta, shapes


def write(folder, made, claims=None, suffix="csv"):
    times, estimated, zeta, shapes = made
    results = tables.Result(
        times=times, quaternions=estimated.as_quat(canonical=True, scalar_first=True), vector="bias",
        vectors=np.zeros((10, 3)), shapes=shapes, half_widths=np.sqrt(np.diagonal(shapes, axis1=1, axis2=2)),
        largest_angles=np.full(10, np.deg2rad(1.55)), used=["up"] * 10, refused=[""] * 10, shares=np.zeros(10),
        margins=np.zeros(10),
    )  # fmt: skip
    extra = {} if claims is None else {"claim": claims}
    column_files.write_columns(folder / f"results.{suffix}", "results", results.columns() | extra)
    true = (estimated * Rotation.from_rotvec(zeta)).as_quat(scalar_first=True)
    columns = {"time_s": times} | dict(zip(tables.QUATERNION, true.T, strict=True))
    column_files.write_columns(folder / "reference.csv", "measurements", columns)
    return folder / f"results.{suffix}", folder / "reference.csv"


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_figures(tmp_path, made, suffix):
    result, reference = write(tmp_path, made, suffix=suffix)
    done = run(result, reference, "--json")
    assert done.exit_code == 0, done.output
    figures = json.loads(done.stdout)
    # ζ = 0.2, 0.4, ..., 2 degrees about the body's x axis, where the sets end at 1.55.
    angles = np.linspace(0.2, 2.0, 10)
    assert figures["all"]["inside"] == 7
    assert figures["all"]["error_deg"] == pytest.approx(
        {"mean": angles.mean(), "rms": np.sqrt((angles**2).mean()), "max": 2.0}
    )
    assert figures["all"]["half_width_body_deg"]["mean"] == pytest.approx([1.55, 1.0, 0.5])
    # Along the reference axis e the ellipsoid's half-width is the longest of its points' components e·Cζ.
    points = np.random.default_rng(0).standard_normal((200_000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    widths = [np.abs((points * [1.55, 1.0, 0.5]) @ matrix.T).max(axis=0) for matrix in made[1].as_matrix()]
    assert figures["all"]["half_width_reference_deg"]["mean"] == pytest.approx(np.mean(widths, axis=0), rel=1e-3)
    assert figures["by_claim"] is None
    with_error = json.loads(run(result, reference, "--json", "--reference-error-deg", 0.3).stdout)
    assert with_error["all"]["inside"] == 9  # up to 1.85 degrees


def test_only_an_unconditional_claim_can_be_broken(tmp_path, made):
    claims = ["unconditional"] * 7 + ["conditional", "conditional", "none"]
    result, reference = write(tmp_path, made, claims)
    done = run(result, reference, "--json")
    assert done.exit_code == 0, done.output
    by_claim = json.loads(done.stdout)["by_claim"]
    assert {claim: figures["inside"] for claim, figures in by_claim.items()} == {
        "unconditional": 7, "conditional": 0, "none": 0,
    }  # fmt: skip
    assert by_claim["unconditional"]["share_of_rows"] == 0.7
    (tmp_path / "bad").mkdir()
    result, reference = write(tmp_path / "bad", made, ["unconditional"] * 8 + ["none"] * 2)
    done = run(result, reference)
    assert done.exit_code == 1
    assert "1 rows claim" in done.output
    assert run(result, reference, "--reference-error-deg", 0.1).exit_code == 0


def test_gibbs_chart(made):
    """A turn of 100 degrees is 136.6 degrees in γ = 2 tan(θ/2) n."""
    for width, inside in ((136.0, False), (137.0, True)):
        shape = np.eye(3)[None] * np.deg2rad(width) ** 2
        estimates = Run(
            times=np.zeros(1), quaternions=np.array([[1.0, 0, 0, 0]]), shapes=shape, half_widths=np.zeros((1, 3)),
            largest_angles=np.ones(1), used=("",), refused=("",), chart="gibbs",
        )  # fmt: skip
        reference = Reference(np.zeros(1), Rotation.from_rotvec(np.deg2rad([[0.0, 100.0, 0.0]])))
        compared = comparison.compare(estimates, reference)
        assert bool(compared.inside[0]) is inside
        assert compared.half_widths_reference[0] == pytest.approx(2 * np.arctan(np.deg2rad(width) / 2))


def test_distance_from_an_ellipsoid():
    """Against a general minimiser."""
    rng = np.random.default_rng(2)
    for _ in range(20):
        factor = rng.standard_normal((3, 3)) * 10.0 ** rng.uniform(-1, 0, 3)
        point = 4.0 * rng.standard_normal(3)
        shape = factor @ factor.T
        if point @ np.linalg.solve(shape, point) <= 1.0:
            continue
        found = [
            minimize(
                lambda y: np.sum((y - point) ** 2),  # noqa: B023
                start,
                constraints={"type": "ineq", "fun": lambda y: 1.0 - y @ np.linalg.solve(shape, y)},  # noqa: B023
                options={"maxiter": 500, "ftol": 1e-14},
            ).fun
            for start in (np.zeros(3), 0.1 * point)
        ]
        distance = np.sqrt(min(found))
        assert attitude_forms(point[None], shape[None], 1.0001 * distance) <= 1.0
        assert attitude_forms(point[None], shape[None], 0.9999 * distance) > 1.0


def test_reference_between_samples(tmp_path, made):
    """At constant rate the interpolated attitude is the true one."""
    result, _ = write(tmp_path, made)
    times = np.arange(99.9, 106.0, 0.2)
    attitudes = Rotation.from_rotvec(np.outer(times, [0.1, 0.2, 0.3]))
    reference = Reference(times, attitudes)
    estimates, _ = read_run(result)
    with pytest.raises(ValueError, match="no row"):
        comparison.compare(estimates, Reference(times + 0.05, attitudes))
    compared = comparison.compare(estimates, reference, largest_gap=0.21)
    np.testing.assert_allclose(
        (compared.true.inv() * Rotation.from_rotvec(np.outer(compared.times, [0.1, 0.2, 0.3]))).magnitude(),
        0,
        atol=1e-9,
    )
    assert len(compared.times) == 10


def test_tum(tmp_path, made):
    """`timestamp tx ty tz qx qy qz qw`, and evo's figure from them where it is installed."""
    result, reference = write(tmp_path, made)
    done = run(result, reference, "--tum", tmp_path / "tum", "--json")
    assert done.exit_code == 0, done.output
    estimate, true = (np.loadtxt(tmp_path / "tum" / name) for name in ("estimate.tum", "reference.tum"))
    assert estimate.shape == (10, 8)
    np.testing.assert_array_equal(estimate[:, 0], made[0])
    assert not estimate[:, 1:4].any()
    relative = Rotation.from_quat(estimate[:, 4:]).inv() * Rotation.from_quat(true[:, 4:])
    np.testing.assert_allclose(relative.as_rotvec(), made[2], atol=1e-12)
    assert run(result, reference, "--tum", tmp_path / "tum").exit_code == 1
    assert run(result, reference, "--tum", tmp_path / "tum", "--force").exit_code == 0
    file_interface = pytest.importorskip("evo.tools.file_interface")
    metrics = pytest.importorskip("evo.core.metrics")
    ape = metrics.APE(metrics.PoseRelation.rotation_angle_deg)
    ape.process_data(
        tuple(file_interface.read_tum_trajectory_file(tmp_path / "tum" / f"{n}.tum") for n in ("reference", "estimate"))
    )
    said = json.loads(done.stdout)["all"]["error_deg"]
    for ours, theirs in (("mean", "mean"), ("rms", "rmse"), ("max", "max")):
        assert ape.get_all_statistics()[theirs] == pytest.approx(said[ours], rel=1e-6)


def test_reference_by_configuration(tmp_path):
    """A log whose truth stands in another order, reference to body; results of the same log."""
    folder = tmp_path / "log"
    runner, app = CliRunner(), cli.make_app()
    assert runner.invoke(app, ["simulate", "pendulum", "--directions", "two", "--out", str(folder)]).exit_code == 0
    log, config, out = folder / "measurements.csv", folder / "estimate.toml", tmp_path / "out"
    done = runner.invoke(app, ["estimate", str(log), "--config", str(config), "--out", str(out), "--json"])
    said = json.loads(done.stdout)
    compared = json.loads(run(out, log, "--config", config, "--json").stdout)
    assert compared["all"]["error_deg"]["mean"] == pytest.approx(said["attitude_error_deg"]["mean"], rel=1e-9)
    assert compared["all"]["share_of_rows"] == 1.0
    # A table in this format's own columns needs no configuration.
    assert json.loads(run(out, log, "--json").stdout)["all"] == compared["all"]
    measurements = tables.Measurements.read(log)
    turned = measurements.true_quaternions * [1, -1, -1, -1]
    np.savez(tmp_path / "turned.npz", t=measurements.times, q=turned[:, [1, 2, 3, 0]])
    text = config.read_text()
    text = text[: text.index("[truth]")].replace('"time_s"', '"t"', 1) + (
        '[truth]\nattitude_columns = ["q[0]", "q[1]", "q[2]", "q[3]"]\norder = "xyzw"\nturns = "reference_to_body"\n'
    )
    (tmp_path / "turned.toml").write_text(text)
    turned = json.loads(run(out, tmp_path / "turned.npz", "--config", tmp_path / "turned.toml", "--json").stdout)
    assert turned["all"]["error_deg"]["mean"] == pytest.approx(compared["all"]["error_deg"]["mean"], rel=1e-9)


def test_own_error_of_the_reference(tmp_path, made):
    """By the option, else by the configuration; up to 1.85 degrees are within 0.3 of sets that end at 1.55."""
    result, reference = write(tmp_path, made)
    config = tmp_path / "config.toml"
    config.write_text(
        '[flow]\nkind = "gyro"\ncolumns = ["a", "b", "c"]\nnoise_deg_per_s = 1.0\n'
        '[estimator]\nmode = "guaranteed"\n'
        '[truth]\nattitude_columns = ["qw", "qx", "qy", "qz"]\nerror_deg = 0.3\n'
    )
    for arguments, inside, error, source in (
        ((), 7, 0.0, None),
        (("--config", config), 9, 0.3, "truth.error_deg of the configuration"),
        (("--config", config, "--reference-error-deg", 0), 7, 0.0, "--reference-error-deg"),
        (("--config", config, "--reference-error-deg", 0.5), 10, 0.5, "--reference-error-deg"),
    ):
        said = json.loads(run(result, reference, *arguments, "--json").stdout)
        assert said["all"]["inside"] == inside
        assert (said["reference_error_deg"], said["reference_error_from"]) == (error, source)
        own_error = f"{error:g} degrees by {source}" if source else "not stated"
        assert f"own error: {own_error}; a row is inside" in " ".join(run(result, reference, *arguments).stdout.split())
    arguments = ["report", str(result), "--reference", str(reference), "--config", str(config)]
    done = CliRunner().invoke(cli.make_app(), [*arguments, "--out", str(tmp_path / "report.html")])
    assert done.exit_code == 0, done.output
    assert "reference.csv outside the set at 1 of 10 rows" in done.output
    assert "it may itself be off by 0.3°" in (tmp_path / "report.html").read_text(encoding="utf-8")
    done = CliRunner().invoke(cli.make_app(), ["report", str(result), "--reference-error-deg", "1"])
    assert done.exit_code == 2


def test_what_is_at_fault(tmp_path, made):
    result, reference = write(tmp_path, made)
    text = reference.read_text().splitlines()
    cells = text[4].split(",")
    (tmp_path / "long.csv").write_text(
        "\n".join([*text[:4], ",".join([cells[0], "2.0", *cells[2:]]), *text[5:]]) + "\n"
    )
    for arguments, message in (
        ((tmp_path / "none", reference), "no such file"),
        ((tmp_path, tmp_path / "none"), "no such file"),
        ((reference, reference), "a table of measurements, where one of results is needed"),
        ((result, tmp_path / "long.csv"), "long, not 1 within 0.01"),
    ):
        done = run(*arguments)
        assert done.exit_code == 1
        assert message in done.output.replace("\n", " ")
        assert "Traceback" not in done.output
    assert run(result, reference, "--reference-error-deg", "nan").exit_code == 2
    (tmp_path / "claims").mkdir()
    result, _ = write(tmp_path / "claims", made, ["sure"] * 10)
    with pytest.raises(FileError, match="'sure', not unconditional"):
        read_run(result)


def test_heading_is_aligned_once():
    """`tools/compare_vqf.py`: the heading of the first row is taken away, a tilt and what comes later is not."""
    pytest.importorskip("vqf")
    path = Path(__file__).parents[3] / "tools" / "compare_vqf.py"
    aligned_errors = runpy.run_path(str(path))["aligned_errors"]
    true = Rotation.random(4, rng=np.random.default_rng(1))
    offsets = Rotation.from_rotvec(np.deg2rad([[0, 0, 30], [0, 0, 30], [0, 0, 33], [0, 0, 30]]))
    tilts = Rotation.from_rotvec(np.deg2rad([[0, 0, 0], [0, 2, 0], [0, 0, 0], [0, 0, -4]]))
    np.testing.assert_allclose(aligned_errors(offsets * tilts * true, true), [0, 2, 3, 4], atol=1e-9)
