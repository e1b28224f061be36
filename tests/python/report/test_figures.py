"""Figures: made whole, their axes labelled, with and without something to compare with."""

import dataclasses

import elliptude
import matplotlib.image
import numpy as np
import pytest
from elliptude import estimation, logs, simulation
from elliptude.configuration import Configuration
from elliptude.io.files import FileError
from elliptude.report import figures
from elliptude.report.estimated import picture
from elliptude.simulation import fermi, scenarios
from elliptude.simulation.configured import configuration_tables
from scipy.spatial.transform import Rotation


@pytest.fixture(scope="module")
def results():
    scenario = scenarios.load("pendulum")
    simulated = simulation.simulate(scenario, directions="two", bound_deg=7.0)
    configuration = Configuration.model_validate(configuration_tables(scenario, simulated))
    return estimation.estimate(logs.log_of(simulated.measurements), configuration).result


def without_truth(results):
    return dataclasses.replace(results, errors=None, forms=None)


def without_rate_truth(results):
    errors = results.errors.copy()
    errors[:, 3:] = np.nan
    return dataclasses.replace(results, errors=errors, vector="bias")


@pytest.mark.parametrize(
    ("change", "above", "below", "times"),
    [(lambda results: results, 6, 2, 2), (without_truth, 2, 1, 1), (without_rate_truth, 4, 2, 1)],
)
def test_estimate_figure(tmp_path, results, change, above, below, times):
    """Errors have a panel for each axis, bounds without errors one for all; how much of them is used has one, too.

    Two panels are side by side only where those above are.
    """
    figure = picture.estimate_figure(change(results), "Pendulum")
    assert len(figure.axes) == above + below
    for axes in figure.axes:
        assert "deg" in axes.get_ylabel() or axes.get_ylabel() == "of its bound (%)"
    assert [axes.get_xlabel() for axes in figure.axes].count("time (s)") == times
    figures.save(figure, tmp_path / "figure.png")
    image = matplotlib.image.imread(tmp_path / "figure.png")
    assert image.shape[1] == 1080
    assert image[..., :3].std() > 0.05
    assert [file.name for file in tmp_path.iterdir()] == ["figure.png"]


def test_attitude_errors_are_about_reference_axes_unless_body_axes_are_wanted(results):
    """The band and the error about each axis, found again from P and from the turn in reference axes."""
    attitudes, errors = results.attitudes, results.errors[:, :3]
    about_reference = Rotation.from_matrix(attitudes @ elliptude.exp(errors) @ attitudes.swapaxes(1, 2)).as_rotvec()
    in_reference = attitudes @ results.shapes[:, :3, :3] @ attitudes.swapaxes(1, 2)
    widths = np.sqrt(np.diagonal(in_reference, axis1=1, axis2=2))
    for options, heading, labels, shown, bounds in (
        ({}, "attitude error about the reference axes", "XYZ", about_reference, widths),
        ({"frame": "NED"}, "attitude error about north, east and down", ["north", "east", "down"], about_reference,
         widths),
        ({"axes": "body"}, "attitude error about the body axes", "xyz", errors, results.half_widths[:, :3]),
    ):  # fmt: skip
        panels = picture.estimate_figure(results, "Pendulum", **options).axes[:6:2]
        assert panels[0].get_title() == heading
        assert [panel.get_ylabel() for panel in panels] == [f"about {label} (deg)" for label in labels]
        for i, panel in enumerate(panels):
            line = next(line for line in panel.lines if "error" in str(line.get_label()))
            np.testing.assert_allclose(line.get_ydata(), np.rad2deg(shown[:, i]), atol=1e-9)
            edge = panel.collections[0].get_paths()[0].vertices[:, 1]
            assert edge.max() == pytest.approx(np.rad2deg(bounds[:, i]).max(), rel=1e-9)


def with_angles(results):
    """Results whose roll goes around, with bands of 0.2 rad; nothing is known of yaw in a row."""
    angles = np.zeros((len(results.times), 9))
    angles[:, 0] = (np.linspace(0.0, 9.0, len(results.times)) + np.pi) % (2.0 * np.pi) - np.pi
    for i in range(3):
        angles[:, 3 * i + 1], angles[:, 3 * i + 2] = angles[:, 3 * i] - 0.2, angles[:, 3 * i] + 0.2
    angles[5, 6:] = np.nan
    return dataclasses.replace(results, roll_pitch_yaw=angles)


def test_roll_pitch_and_yaw_come_first(tmp_path, results):
    figure = picture.estimate_figure(with_angles(results), "Pendulum")
    assert len(figure.axes) == 11
    assert [panel.get_ylabel() for panel in figure.axes[:3]] == ["roll (deg)", "pitch (deg)", "yaw (deg)"]
    roll, pitch, _ = figure.axes[:3]
    assert roll.get_ylim() == (-180.0, 180.0)
    assert len(roll.collections) == 3  # what goes beyond half a turn comes in at the other side
    assert len(pitch.collections) == 1
    estimated, true = roll.lines
    assert np.nanmax(np.abs(np.diff(estimated.get_ydata()))) < 180.0
    assert np.isnan(estimated.get_ydata()).sum() == 1  # from half a turn to minus half a turn
    assert np.isfinite(true.get_ydata()).sum() == len(results.times)
    assert {"where it may be", "as estimated", "truth"} <= {text.get_text() for text in figure.legends[0].get_texts()}
    figures.save(figure, tmp_path / "figure.png")
    assert matplotlib.image.imread(tmp_path / "figure.png").shape[1] == 1080


def look(handle):
    """What an entry of a legend looks like."""
    if hasattr(handle, "get_linestyle") and hasattr(handle, "get_color"):
        return "line", handle.get_color(), handle.get_linestyle() == "-"
    return "patch", tuple(np.ravel(handle.get_facecolor()))


def test_no_two_entries_of_the_legend_look_alike(results):
    results = with_angles(results)
    largest = results.largest_angles.copy()
    largest[10:15] = np.nan
    results = dataclasses.replace(results, largest_angles=largest)
    for shown in (results, without_truth(results)):
        (legend,) = picture.estimate_figure(shown, "Pendulum").legends
        looks = [look(handle) for handle in legend.legend_handles]
        assert len(looks) >= 3
        assert len(set(looks)) == len(looks)


def test_each_angle_is_grey_where_it_is_not_known(results):
    """Without a set there is no yaw, but roll and pitch where up is known."""
    results, largest = with_angles(results), results.largest_angles.copy()
    largest[10:15] = np.nan
    angles = results.roll_pitch_yaw.copy()
    angles[10:15, 6:] = np.nan
    shown = dataclasses.replace(results, largest_angles=largest, roll_pitch_yaw=angles)
    panels = picture.estimate_figure(shown, "Pendulum").axes[:3]
    greys = [[one for one in panel.collections if one.get_label() == figures.UNKNOWN] for panel in panels]
    assert greys[:2] == [[], []]
    ((grey,),) = greys[2:]
    spans = [span.get_extents().intervalx.tolist() for span in grey.get_paths()]
    assert [results.times[9], results.times[15]] in spans


def test_each_panel_shows_where_it_rests_on_what_was_left_out(results):
    """The heading does from the tenth row on; up is followed by itself, and does not."""
    results, count = with_angles(results), len(results.times)
    claims = tuple("conditional" if row >= 10 else "unconditional" for row in range(count))
    shown = dataclasses.replace(results, claims=claims, up_claims=("unconditional",) * count)
    figure = picture.estimate_figure(shown, "Pendulum")
    shaded = [any(one.get_label() == figures.CONDITIONAL for one in panel.collections) for panel in figure.axes[:4]]
    assert shaded == [False, False, True, True]
    (amber,) = [one for one in figure.axes[2].collections if one.get_label() == figures.CONDITIONAL]
    assert amber.get_paths()[0].get_extents().x0 == results.times[9]
    (legend,) = figure.legends
    assert figures.CONDITIONAL in [text.get_text() for text in legend.get_texts()]


def test_the_picture_says_that_bounds_are_proposals(results):
    assert picture.estimate_figure(results, "Pendulum").get_suptitle() == "Pendulum"
    said = picture.estimate_figure(results, "Pendulum", proposed_from="log.csv").get_suptitle()
    assert said == "Pendulum\nthe bounds are proposals from log.csv: no guarantee"


def test_angles_of_the_truth_are_those_of_the_aerospace_sequence():
    rng = np.random.default_rng(3)
    attitudes, errors = Rotation.random(20, rng=rng), rng.uniform(-0.5, 0.5, (20, 3))
    errors[4] = np.nan
    angles = figures.true_roll_pitch_yaw(attitudes.as_matrix(), errors)
    assert np.isnan(angles[4]).all()
    known = np.arange(20) != 4
    true = attitudes[known] * Rotation.from_rotvec(errors[known])
    np.testing.assert_allclose(angles[known], true.as_euler("ZYX")[:, ::-1], atol=1e-12)


def test_curves_are_cut_where_an_angle_goes_around():
    time, value, band = np.arange(4.0), np.array([170.0, 179.0, -179.0, -170.0]), np.arange(4.0)
    cut = figures.cut_at_wraps(time, value, band)
    np.testing.assert_array_equal(cut[0], [0.0, 1.0, 2.0, 2.0, 3.0])
    np.testing.assert_array_equal(cut[1], [170.0, 179.0, np.nan, -179.0, -170.0])
    np.testing.assert_array_equal(cut[2], [0.0, 1.0, np.nan, 2.0, 3.0])


def test_bands_and_errors_are_those_of_the_results(results):
    figure = picture.estimate_figure(results, "Pendulum")
    rate_axes = next(axes for axes in figure.axes if "omega_y" in axes.get_ylabel())
    error, zero = rate_axes.lines
    np.testing.assert_allclose(error.get_ydata(), np.rad2deg(results.errors[:, 4]))
    assert set(zero.get_ydata()) == {0.0}
    top = rate_axes.collections[0].get_datalim(rate_axes.transData).ymax
    assert top == pytest.approx(np.rad2deg(results.half_widths[:, 4].max()))
    used = next(axes for axes in figure.axes if axes.get_ylabel() == "of its bound (%)")
    assert used.get_title() == "how much of its bound the error uses; inside: 100 %"
    assert used.get_ylim()[1] > 100.0


def test_where_no_set_is_known_and_no_bias_is_estimated(tmp_path, results):
    """As in the guaranteed mode: the axis of errors is that of what is known, the times are those of the whole log."""
    half_widths, largest = results.half_widths.copy(), results.largest_angles.copy()
    half_widths[:, 3:] = np.nan
    half_widths[:, :3] = np.deg2rad(40.0)
    half_widths[5:], largest[5:] = np.nan, np.nan
    shapes = np.tile(np.eye(6) * np.deg2rad(40.0) ** 2, (len(half_widths), 1, 1))
    shapes[5:] = np.nan
    of_sets = {"half_widths": half_widths, "largest_angles": largest, "shapes": shapes}
    some = without_truth(dataclasses.replace(results, **of_sets, vector="bias"))
    figure = picture.estimate_figure(some, "A gap")
    assert len(figure.axes) == 2
    for panel in figure.axes[:1]:
        assert panel.get_ylim() == pytest.approx((0.0, 46.0))
        assert len(panel.lines) == 3
        assert panel.get_xlim() == (results.times[0], results.times[-1])
        shade = next(one for one in panel.collections if one.get_label() == figures.UNKNOWN)
        assert shade.get_paths()[0].get_extents().x0 == results.times[4]
    assert figure.axes[-1].get_title() == "how far the attitude may be off"
    figures.save(figure, tmp_path / "figure.png")


def test_the_edge_of_the_set_is_seen_beside_forms_far_out(results):
    forms = results.forms.copy()
    forms[3] = 2e4
    figure = picture.estimate_figure(dataclasses.replace(results, forms=forms), "Far out")
    used = next(axes for axes in figure.axes if axes.get_ylabel() == "of its bound (%)")
    assert used.get_yscale() == "log"
    low, high = used.get_ylim()
    assert low < 30.0
    assert high > 100.0 * np.sqrt(2e4)


def test_share_inside_counts_what_lies_outside(results):
    forms = results.forms.copy()
    forms[:15] = 2.0
    figure = picture.estimate_figure(dataclasses.replace(results, forms=forms), "Pendulum")
    used = next(axes for axes in figure.axes if axes.get_ylabel() == "of its bound (%)")
    assert "inside: 75 %" in used.get_title()
    assert used.get_ylim()[1] > 100.0 * np.sqrt(2.0)


def test_an_error_on_the_edge_uses_all_of_its_bound_whatever_its_direction(results):
    """The form of an error with a given share of the set's reach in its direction."""
    shares = np.linspace(0.1, 0.9, len(results.times))
    rng = np.random.default_rng(2)
    directions = rng.standard_normal((len(shares), 6))
    shapes = np.einsum("nij,nkj->nik", *2 * [rng.standard_normal((len(shares), 6, 6))])
    reach = 1.0 / np.sqrt(np.einsum("ni,nij,nj->n", directions, np.linalg.inv(shapes), directions))
    errors = (shares * reach)[:, None] * directions
    forms = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(shapes), errors)
    panel = figures.new_figure(2.0).add_subplot()
    figures.draw_bound_used(panel, results.times, [("", forms, "black")])
    np.testing.assert_allclose(panel.lines[1].get_ydata(), 100.0 * shares, rtol=1e-9)
    assert set(panel.lines[0].get_ydata()) == {100.0}  # the edge


def test_the_error_is_explained_in_the_legend(results):
    for shown in (results, with_angles(results)):
        (legend,) = picture.estimate_figure(shown, "Pendulum", label="the camera").legends
        assert "error against the camera" in [text.get_text() for text in legend.get_texts()]


@pytest.mark.parametrize("length", [5, 25, 200])
def test_no_legend_is_wider_than_its_figure(length):
    """It has fewer columns, at worst one."""
    figure = figures.new_figure(3.0)
    panel = figure.add_subplot()
    for i in range(5):
        panel.plot([0, 1], [0, i], label=f"{i} {'w' * length}")
    entries = {str(line.get_label()): line for line in panel.lines}
    figures.legend_below(figure, entries)
    figure.canvas.draw()
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == list(entries)
    assert legend._ncols == {5: 4, 25: 2, 200: 1}[length]
    if length < 200:
        assert legend.get_window_extent().width <= figure.bbox.width


def test_there_is_no_legend_of_nothing():
    figure = figures.new_figure(3.0)
    figures.legend_below(figure, {})
    assert figure.legends == []


def test_the_same_results_make_the_same_file(tmp_path, results):
    for name in ("one.png", "two.png"):
        figures.save(picture.estimate_figure(results, "Pendulum"), tmp_path / name)
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()


@pytest.mark.parametrize("low", [1e-9, 0.031, 0.5, 0.97, 3.0])
@pytest.mark.parametrize("ratio", [1.02, 1.3, 3.0, 9.0, 70.0, 1e5, 1e12])
def test_a_log_axis_says_two_numbers_at_least(low, ratio):
    """Within what is shown, each label another and not too many."""
    axes = figures.new_figure(3.0).add_subplot()
    axes.plot([0, 1], [low, low * ratio])
    figures.plain_log_axis(axes)
    axes.set_ylim(low, low * ratio)
    ticks = axes.yaxis.get_majorticklocs()
    shown = [tick for tick in ticks if low <= tick <= low * ratio]
    labels = [axes.yaxis.get_major_formatter()(tick) for tick in shown]
    assert 2 <= len(set(labels)) == len(labels) <= 14
    for tick, label in zip(shown, labels, strict=True):
        if "$" not in label:
            assert float(label) == pytest.approx(tick, rel=1e-5)


def test_validation_figure_of_forms_near_the_edge(tmp_path):
    """In the guaranteed mode, whose forms are all just below 1."""
    worst = {"form": 0.97}
    case = {"scenario": "orbit", "bound_deg": 7.0, "noise": "search", "worst": worst, "sizes": {}}
    other = case | {"noise": "inside", "worst": {"form": 1.0}}
    summary = {"mode": "guaranteed", "cases": [case, other], "total": {"escapes": 0, "updates": 40}}
    figure = figures.validation_figure(summary)
    figures.save(figure, tmp_path / "validation.png")
    low, high = figure.axes[0].get_ylim()
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels() if low <= label.get_position()[1] <= high]
    assert len([label for label in labels if label]) >= 2
    assert all("times" not in label for label in labels)


def test_about_line_figure(tmp_path, results):
    line = np.tile([1.0, 0.0, 0.0], (len(results.times), 1))
    runs = [(name, results, *fermi.half_widths_about(results, line)) for name in ("one", "two")]
    figure = figures.about_line_figure(results.times, runs, "Line", line="x axis", label="truth")
    widths, errors, form = figure.axes
    assert [len(axes.lines) for axes in (widths, errors, form)] == [4, 4, 3]
    assert all(axes.get_ylabel() for axes in figure.axes)
    assert form.get_xlabel() == "time (s)"
    figures.save(figure, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000


def test_a_folder_that_is_not_there(tmp_path, results):
    with pytest.raises(FileError, match="not written"):
        figures.save(picture.estimate_figure(results, "Pendulum"), tmp_path / "nowhere" / "figure.png")
