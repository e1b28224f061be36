"""Pictures of a run: bands, sizes, axes on the sphere, with gaps, claims and what was left out."""

import dataclasses

import matplotlib.colors
import matplotlib.image
import numpy as np
import pytest
from elliptude.monitoring import Limits, Monitored
from elliptude.report import figures, run_figures
from elliptude.report.axes import figure as axes
from elliptude.results import CLAIMS
from test_runs import make_run


def full_run():
    run = make_run(
        errors=np.full((50, 3), 0.05),
        forms=np.full(50, 0.3),
        claims=("unconditional",) * 20 + ("none",) * 5 + ("conditional",) * 25,
        dropped=("",) * 30 + ("star",) * 3 + ("",) * 17,
    )
    for values in (run.quaternions, run.shapes, run.half_widths, run.largest_angles, run.errors, run.forms):
        values[20:25] = np.nan
    return run


def legend_of(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_bands(tmp_path):
    run = dataclasses.replace(full_run(), axes="body")
    run.errors[40, 1], run.forms[40] = 0.22, 1.21
    figure = run_figures.bands_figure(run, "Run", label="optical attitude")
    *panels, strip = figure.axes
    assert [panel.get_ylabel() for panel in panels] == [f"about {axis} (deg)" for axis in "xyz"]
    assert strip.get_xlabel() == "time (s)"
    assert "outside the set: 1 of 45 rows" in panels[0].get_title()
    error = next(line for line in panels[1].lines if line.get_label() == "error against optical attitude")
    np.testing.assert_allclose(error.get_ydata(), np.rad2deg(run.errors[:, 1]))
    (marks,) = [line for line in panels[1].lines if line.get_label() == "outside the band"]
    assert marks.get_xdata().tolist() == [run.times[40]]
    # The band has a gap where nothing is known.
    band = panels[0].collections[0]
    assert len(band.get_paths()) == 2
    assert [text.get_text() for text in strip.get_yticklabels()] == ["claim", "star left out"]
    assert {"claim: unconditional", "claim: conditional", "claim: none", "outside the band"} <= set(legend_of(figure))
    figures.save(figure, tmp_path / "bands.png")
    assert matplotlib.image.imread(tmp_path / "bands.png").shape[1] == 1080


def test_bands_and_sizes_about_reference_axes():
    """A body that turns by 90 degrees about up takes its half-widths with it; about east and north they change."""
    run = dataclasses.replace(full_run(), frame="ENU")
    quarter = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    run.quaternions[:20], run.quaternions[25:] = [1.0, 0.0, 0.0, 0.0], quarter
    panels = run_figures.bands_figure(run, "Run").axes[:3]
    assert [panel.get_ylabel() for panel in panels] == ["about east (deg)", "about north (deg)", "about up (deg)"]
    assert panels[0].get_title().startswith("attitude error about east, north and up, and its bound")
    for i, (before, after) in enumerate(((0.1, 0.2), (0.2, 0.1), (0.3, 0.3))):
        edge = next(line for line in panels[i].lines if len(line.get_ydata()) == 50)
        np.testing.assert_allclose(np.abs(edge.get_ydata()[[0, 49]]), np.rad2deg([before, after]))
    # ζ = (0.05, 0.05, 0.05) rad in body axes; the body's x axis points to north then, its y axis to west.
    east, north, _ = (
        next(line for line in panel.lines if "error" in str(line.get_label())).get_ydata() for panel in panels
    )
    np.testing.assert_allclose(np.deg2rad([east[49], north[49]]), [-0.05, 0.05])
    labels = [line.get_label() for line in run_figures.size_figure(run, "Run").axes[0].lines]
    assert labels[:3] == ["half-width about east", "half-width about north", "half-width about up"]


def angled(run):
    """The run with roll, pitch and yaw within 0.1 rad; anything in a row, nothing where no attitude is known."""
    values = np.column_stack([np.linspace(-4.0, 4.0, 50), np.linspace(-1.0, 1.0, 50), np.linspace(0.0, 3.0, 50)])
    values = (values + np.pi) % (2.0 * np.pi) - np.pi
    angles = np.stack([values, values - 0.1, values + 0.1], axis=2).reshape(50, 9)
    angles[10, [1, 2]] = [-np.pi, np.pi]
    angles[20:25, 6:] = np.nan
    return dataclasses.replace(run, roll_pitch_yaw=angles)


def test_angles(tmp_path):
    figure = run_figures.angles_figure(angled(full_run()), "Run", label="optical attitude")
    *panels, strip = figure.axes
    assert [panel.get_ylabel() for panel in panels] == ["roll (deg)", "pitch (deg)", "yaw (deg)"]
    assert panels[0].get_ylim() == (-180.0, 180.0)
    bands = [[one for one in panel.collections if one.get_label() != figures.UNKNOWN] for panel in panels]
    assert [len(one) for one in bands] == [3, 1, 1]
    assert strip.get_xlabel() == "time (s)"
    assert {"where it may be", "as estimated", "optical attitude", "claim: none"} <= set(legend_of(figure))
    # The band of yaw has a gap where no attitude is known.
    assert len(panels[2].collections[0].get_paths()) == 2
    figures.save(figure, tmp_path / "angles.png")
    assert matplotlib.image.imread(tmp_path / "angles.png").shape[1] == 1080


def pictures_of(run):
    return {
        "angles": run_figures.angles_figure(angled(run), "Run"),
        "bands": run_figures.bands_figure(run, "Run"),
        "size": run_figures.size_figure(run, "Run"),
        "axes": axes.axes_figure(run, "Run"),
    }


def grey_spans(panel):
    """From when to when a panel is grey."""
    shades = [one for one in panel.collections if one.get_label() == figures.UNKNOWN]
    return [span.get_extents().intervalx.tolist() for shade in shades for span in shade.get_paths()]


def test_panels_are_grey_where_what_they_show_is_not_known():
    """Without a set there is no yaw, but roll and pitch where up is known."""
    run = full_run()
    gap = [[run.times[19], run.times[25]]]
    for with_claims in (True, False):
        shown = run if with_claims else dataclasses.replace(run, claims=None)
        for name, expected in (("angles", [[], [], gap]), ("bands", [gap] * 3), ("size", [gap])):
            figure = pictures_of(shown)[name]
            assert [grey_spans(panel) for panel in figure.axes[:-1]] == expected  # the last one is the strip
            assert figures.UNKNOWN in legend_of(figure)
    up = dataclasses.replace(run, up_bounds=np.full(50, 0.1))
    assert grey_spans(run_figures.size_figure(up, "Run").axes[0]) == []


def test_every_picture_says_that_bounds_are_proposals():
    run = full_run()
    for figure in pictures_of(run).values():
        assert "proposals" not in figure.get_suptitle()
    for figure in pictures_of(dataclasses.replace(run, bounds_from_recording="log.csv")).values():
        assert figure.get_suptitle().endswith("\nthe bounds are proposals from log.csv: no guarantee")
        assert "claim: unconditional" not in legend_of(figure)
    found = judged(0, -0.1, Limits())
    figure = run_figures.monitor_figure(found, "judged", proposed_from="log.csv")
    assert figure.get_suptitle() == "judged\nthe bounds are proposals from log.csv: no guarantee"
    assert "bound, unconditional, by proposals" in legend_of(figure)


def test_a_run_without_anything_else_has_no_strip():
    figure = run_figures.bands_figure(make_run(), "Run")
    assert len(figure.axes) == 3
    assert legend_of(figure) == ["bound"]
    assert "bound of the attitude error" in figure.axes[0].get_title()


def test_size():
    run = full_run()
    figure = run_figures.size_figure(run, "Run")
    panel, _ = figure.axes
    assert panel.get_yscale() == "log"
    assert panel.get_ylabel() == "angle (deg)"
    largest = next(line for line in panel.lines if line.get_label() == "largest angle in the set")
    np.testing.assert_allclose(largest.get_ydata(), np.rad2deg(run.largest_angles))


def test_axes_are_where_the_attitude_has_them(tmp_path):
    run = full_run()
    figure = axes.axes_figure(run, "Run", times=[0.0, 4.9], label="optical attitude")
    assert [axes.get_title() for axes in figure.axes] == ["0.00 s: within 17.2°", "4.90 s: within 17.2°"]
    assert legend_of(figure)[-1] == "optical attitude"
    # At time 0 the body's axes are the reference's, which come out of the sphere at grey dots.
    dots = [line for line in figure.axes[0].lines if line.get_marker() == "o"]
    grey = [line for line in figure.axes[0].lines if line.get_marker() == "."]
    for dot, end in zip(dots, grey, strict=True):
        np.testing.assert_allclose(dot.get_xydata(), end.get_xydata(), atol=1e-12)
    figures.save(figure, tmp_path / "axes.png")
    assert matplotlib.image.imread(tmp_path / "axes.png")[..., :3].std() > 0.05


def test_the_filled_area_is_the_share_of_the_sphere_that_the_axis_may_have():
    """Round sets of 52° and of 126°: the area in front is that of the cap seen from there."""
    for angle in (0.9, 2.2):
        run = make_run(1)
        run.shapes[:] = np.eye(3) * angle**2
        figure = axes.axes_figure(run, "")
        patches = [patch for patch in figure.axes[0].patches if patch.get_alpha() == 0.35]
        views = axes._view()
        inside = np.random.default_rng(1).standard_normal((2000, 3))
        inside /= np.linalg.norm(inside, axis=1, keepdims=True)
        inside = inside[inside[:, 2] > 0.15]  # towards the eye, in its axes
        for axis, patch in enumerate(patches):
            far = np.arccos(inside @ views[:, axis])
            told = np.array([patch.get_path().contains_point(point) for point in inside[:, :2]])
            clear = np.abs(far - angle) > 0.03
            assert (told == (far < angle))[clear].all()


@pytest.mark.parametrize("picture", [run_figures.bands_figure, run_figures.size_figure, axes.axes_figure])
def test_a_run_of_which_nothing_is_known(tmp_path, picture):
    run = make_run(3)
    for values in (run.quaternions, run.shapes, run.half_widths, run.largest_angles):
        values[:] = np.nan
    figures.save(picture(run, "Nothing"), tmp_path / "nothing.png")
    one = dataclasses.replace(make_run(1))
    figures.save(picture(one, "One row"), tmp_path / "one.png")


def test_magnified_sets_say_so():
    run = make_run()
    run.shapes[:] *= 0.01
    run.largest_angles[:] *= 0.1
    figure = axes.axes_figure(run, "Run")
    assert figure.get_suptitle() == "Run\nsets and errors drawn 10 times as large"
    large = axes.axes_figure(make_run(), "Run")
    assert large.get_suptitle() == "Run"
    # Magnified by 10, sets a tenth as large make the same picture.
    small_patch, large_patch = (one.axes[0].patches[-1].get_path().vertices for one in (figure, large))
    np.testing.assert_allclose(small_patch, large_patch, atol=1e-9)
    run.shapes[:], run.largest_angles[:] = np.eye(3) * 4.0**2, 4.0
    assert axes.axes_figure(run, "Run").axes[0].get_title() == "0.00 s: within 229°, too large to draw"


def judged(claims, least, limits):
    """A filter judged over ten rows in which nothing changes."""
    n = 10
    return Monitored(
        times=np.arange(n, dtype=float),
        judged=np.ones(n, dtype=bool),
        bounds=np.full((n, 3), 0.3),
        least=np.full((n, 3), least),
        claims=np.full((n, 3), claims, dtype=np.uint8),
        headings=np.full((n, 2), [-0.3, 0.3]),
        questions=("total", "tilt", "heading"),
        limits=limits,
    )


def lanes_of(figure):
    return [text.get_text() for text in figure.axes[-1].get_yticklabels()]


@pytest.mark.parametrize(("claim", "lane"), [("unconditional", "proved wrong"), ("conditional", "outside, no proof")])
def test_what_is_off_at_least_is_drawn_by_what_it_rests_on(claim, lane):
    """A conditional set proves nothing, and must not look as if it did."""
    figure = run_figures.monitor_figure(judged(CLAIMS.index(claim), 0.1, Limits()), "judged")
    colour = matplotlib.colors.to_rgba(run_figures.LEAST_COLOURS[claim])
    (filled,) = figure.axes[0].collections
    np.testing.assert_allclose(filled.get_facecolor()[0], colour)
    assert lanes_of(figure) == [lane]
    (bars,) = figure.axes[-1].collections
    np.testing.assert_allclose(bars.get_facecolor()[0], colour)
    assert run_figures.LEAST_COLOURS["conditional"] != run_figures.LEAST_COLOURS["unconditional"]


def test_only_lanes_of_alarms_that_there_are_are_drawn():
    calm = run_figures.monitor_figure(judged(0, -0.1, Limits()), "judged")
    assert len(calm.axes) == 3
    assert calm.axes[0].get_title() == "how far the estimate can be off; no alarm"
    within = run_figures.monitor_figure(judged(0, -0.1, Limits(tilt=0.5)), "judged")
    assert len(within.axes) == 3
    beyond = run_figures.monitor_figure(judged(0, -0.1, Limits(tilt=0.2)), "judged")
    assert lanes_of(beyond) == ["not within limit"]
