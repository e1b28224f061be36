"""What results say of themselves, and when they are equal."""

import elliptude as el
import numpy as np


def test_extents_are_equal_if_their_numbers_are():
    small, large = (el.StateEllipsoid(np.eye(3), np.zeros(3), scale * np.eye(6)) for scale in (0.01, 0.04))
    assert small.extent() == small.extent()
    assert not small.extent() != small.extent()  # noqa: SIM202 - a tuple has its own
    assert small.extent() != large.extent()
    assert small.extent() != tuple(small.extent())
    empty = el.Extents(np.full((2, 6), np.nan), np.full((2, 3), np.nan), np.full(2, np.nan))
    assert empty == el.Extents(*(part.copy() for part in empty))


def test_filters_and_logs_are_a_line():
    flow = el.GuaranteedGyroFlow(0.01)
    guaranteed = el.GuaranteedFilter(flow, vector_bound=0.01)
    assert repr(guaranteed) == "<GuaranteedFilter: time 0 s, claim 'none'>"
    log = guaranteed.run(
        [0.0, 0.5],
        gyro=np.zeros((2, 3)),
        directions=np.tile(np.eye(3), (2, 1, 1)),
        reference=np.eye(3),
        bounds=[0.1] * 3,
    )
    assert repr(log) == "<GuaranteedLog: 2 rows, 0 to 0.5 s; claims: unconditional 100 %, conditional 0 %, none 0 %>"
    assert repr(guaranteed).startswith("<GuaranteedFilter: time 0.5 s, claim 'unconditional', within ")
    start = el.StateEllipsoid(np.eye(3), np.zeros(3), 0.01 * np.eye(6))
    first_order = el.AttitudeFilter(el.GyroFlow(0.01), start)
    assert repr(first_order) == "<AttitudeFilter: time 0 s, mode 'first_order', within 5.73°>"
    log = first_order.run([0.0, 0.5], gyro=np.zeros((2, 3)))
    assert repr(log) == "<FilterLog: 2 rows, 0 to 0.5 s>"


def test_logs_are_a_line_and_a_plot_in_notebooks():
    start = el.StateEllipsoid(np.eye(3), np.zeros(3), 0.01 * np.eye(6))
    times, gyro = np.arange(700.0), np.zeros((700, 3))
    first_order = el.AttitudeFilter(el.GyroFlow(1e-6), start).run(times, gyro=gyro)
    seen = np.full((700, 3, 3), np.nan)
    seen[50] = np.eye(3)
    guaranteed = el.GuaranteedFilter(el.GuaranteedGyroFlow(1e-6), vector_bound=1e-6).run(
        times, gyro=gyro, directions=seen, reference=np.eye(3), bounds=[0.1] * 3
    )
    for log in (first_order, guaranteed):
        page = log._repr_html_()
        assert repr(log).strip("<>") in page
        assert page.count("<svg") == 1
        assert "largest angle, 0° to " in page
        assert "nan" not in page
        assert len(page) < 100_000
    nothing = el.GuaranteedFilter(el.GuaranteedGyroFlow(1e-6), vector_bound=1e-6).run([0.0, 1.0], gyro=np.zeros((2, 3)))
    assert "<svg" not in nothing._repr_html_()
    assert "<svg" not in first_order.since(700)._repr_html_()
