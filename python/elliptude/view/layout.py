"""How the viewer is laid out at first: the sphere beside curves over time."""

from typing import Any

from elliptude.report.run import Run
from elliptude.view.curves import ANGLES, Curves
from elliptude.view.stream import TIMELINE, Stream


def layout(stream: Stream, run: Run, curves: Curves, magnification: int) -> Any:
    """The blueprint for a run's recording.

    Parameters
    ----------
    stream : Stream
    run : Run
    curves : Curves
        What there is over time.
    magnification : int
        By which the sphere draws sets too large.

    Returns
    -------
    rerun.blueprint.Blueprint
    """
    rrb, boundary = stream.rr.blueprint, stream.rr.TimeRangeBoundary.absolute
    whole = stream.rr.TimeRange(*(boundary(seconds=time) for time in (run.times[0], run.times[-1])))
    # Axes that are linked would show half a minute about the cursor.
    axis = rrb.TimeAxis(link="Independent", view_range=whole)

    def plot(origin: str, name: str, has_legend: bool = True) -> Any:
        legend = rrb.PlotLegend(visible=has_legend)
        return rrb.TimeSeriesView(origin=origin, name=name, axis_x=axis, plot_legend=legend)

    large = "" if magnification == 1 else f", sets and errors {magnification} times as large"
    sphere = rrb.Spatial3DView(
        origin="sphere",
        name=f"Where the body's axes may point{large}",
        line_grid=False,
        eye_controls=rrb.EyeControls3D(position=[2.2, 1.6, 1.2], look_target=[0.0, 0.0, 0.0]),
    )
    texts = [rrb.TextDocumentView(origin="now", name="Now"), rrb.TextDocumentView(origin="notes", name="Notes")]
    if curves.left_out:
        texts.insert(1, rrb.TextLogView(origin="left_out", name="Measurements left out"))
    what = "Error and its bound about" if run.compared.any() else "Bound of the error about"
    # The legend of the first panel is that of all.
    bands = (plot(f"bounds/{name}", f"{what} {name} (°)", i == 0) for i, name in enumerate(curves.bands))
    tabs = [rrb.Vertical(*bands, name="Bounds about axes")]
    if curves.angles:
        panels = (plot(f"angles/{name}", f"{name.capitalize()} (°)", i == 0) for i, name in enumerate(ANGLES))
        tabs.insert(0, rrb.Vertical(*panels, name="Roll, pitch, yaw"))
    if curves.sensors:
        panels = (plot(path, name, i == 0) for i, (path, name) in enumerate(curves.sensors))
        tabs.append(rrb.Vertical(*panels, name="What the sensors measured"))
    right = [rrb.Tabs(*tabs, active_tab=0), plot("size", "How far the attitude may be off (°)")]
    if curves.claims:
        right.append(rrb.StateTimelineView(origin="claims", name="Claims", time_view=axis))
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(sphere, rrb.Tabs(*texts, active_tab=0), row_shares=[6, 1]),
            rrb.Vertical(*right, row_shares=[12, 4, 3][: len(right)]),
        ),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="Paused"),
        collapse_panels=True,
    )
