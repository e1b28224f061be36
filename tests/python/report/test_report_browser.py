"""The report in Chromium without a network: it draws, says nothing on the console, and its slider moves the patches."""

import dataclasses
import time

import matplotlib.image
import numpy as np
import pytest
from browsers import chromium, offline, screenshots
from elliptude.report import page as report
from elliptude.report.estimated.stored import MeasuredSensor
from elliptude.report.run import DroppedMeasurements
from test_run_figures import full_run

PATCH = (
    "() => [3, 4, 5].map((i) => ['x', 'y', 'z'].map((c) => Array.from(document.getElementById('sphere').data[i][c])))"
)
WAIT_S = 120


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    run = full_run()
    run.forms[40], run.errors[40, 0] = 4.0, 0.2
    listed = DroppedMeasurements(
        times=np.array([0.5, 0.7, 4.0]),
        places=("line 8", "line 10", "line 43"),
        sensors=("star", "sun", "star"),
        contradicts=("prediction", "prediction", "own_bound"),
        margins=np.array([-0.4, -0.2, -1.5]),
        units=("", "", "m/s^2"),
    )
    used, tilt = (np.arange(50) % 7 > 2).astype(float), np.full(50, 0.08)
    times, swing = run.times, np.linspace(-50.0, 50.0, 50)[:, None] * [1.0, 0.5, -0.9]
    field = MeasuredSensor("field", "magnetometer", "µT", times, swing, [], np.empty(0))
    gyro = MeasuredSensor("gyro", "", "deg/s", times, 16.0 * swing, [], np.empty(0))
    run = dataclasses.replace(run, listed=listed, prediction_used=used, tilt_bounds=tilt, measured=(gyro, field))
    report.write_report(run, path, "A_run_with_a_gap", label="optical attitude")
    return path


@pytest.fixture
def opened(browser, written, request):
    """The page, with all that it said and asked for."""
    settings = getattr(request, "param", {"viewport": {"width": 1100, "height": 900}})
    with offline(browser, **settings) as page:
        page.set_default_timeout(1000 * WAIT_S)
        page.goto(written.as_uri())
        until(page, "document.documentElement.dataset.ready === 'true'")
        yield page


def shot(page, name, folder):
    """The picture of the page, as an array."""
    path = screenshots(folder) / name
    page.screenshot(path=path, full_page=True)
    return matplotlib.image.imread(path)


def until(page, condition):
    """Wait for a condition. Playwright's own way evaluates text in the page, which its security policy refuses."""
    end = time.monotonic() + WAIT_S
    while not page.evaluate(condition):
        assert time.monotonic() < end, f"not so after {WAIT_S} s: {condition}"
        page.wait_for_timeout(50)


def at(page, seconds):
    until(page, f"document.getElementById('now').textContent.startsWith('{seconds}')")


def test_the_slider_moves_the_patches(opened, tmp_path):
    at(opened, "0.00 s, within 17.2°")
    before = np.array(opened.evaluate(PATCH))
    opened.locator("#time").focus()
    opened.keyboard.press("End")
    at(opened, "4.90 s")
    opened.wait_for_timeout(300)
    after = np.array(opened.evaluate(PATCH))
    assert before.shape == after.shape == (3, 3, 144)
    np.testing.assert_allclose(np.linalg.norm(after, axis=1), 1.004, atol=1e-3)
    # The middle of each patch, its last ring, is the estimated axis: the attitude turned by 4.9 s of the rate.
    turn = np.linalg.norm([0.2, -0.4, 0.3]) * 4.9
    axis = np.array([0.2, -0.4, 0.3]) / np.linalg.norm([0.2, -0.4, 0.3])
    for i, patch in enumerate(after):
        e = np.eye(3)[i]
        expected = e * np.cos(turn) + np.cross(axis, e) * np.sin(turn) + axis * (axis @ e) * (1.0 - np.cos(turn))
        np.testing.assert_allclose(patch[:, -1], 1.004 * expected, atol=1e-3)
        np.testing.assert_allclose(before[i][:, -1], 1.004 * e, atol=1e-3)
    opened.keyboard.press("ArrowLeft")
    at(opened, "4.80 s")
    picture = shot(opened, "report.png", tmp_path)
    # Something was drawn: the three colours of the patches are there.
    for colour in ((213, 94, 0), (0, 158, 115), (0, 114, 178)):
        assert (np.abs(picture[..., :3] * 255.0 - colour).max(axis=-1) < 12.0).sum() > 300


def test_where_nothing_is_known_there_is_no_patch(opened):
    opened.evaluate(
        "() => { const s = document.getElementById('time'); s.value = '22'; s.dispatchEvent(new Event('input')); }"
    )
    at(opened, "2.20 s: nothing is known")
    opened.wait_for_timeout(300)
    assert not np.any(opened.evaluate(PATCH))


def test_play_and_pause_by_keyboard(opened):
    opened.locator("#play").focus()
    opened.keyboard.press("Enter")
    until(opened, "Number(document.getElementById('time').value) >= 2")
    opened.keyboard.press("Space")
    assert opened.locator("#play").text_content() == "Play"
    opened.wait_for_timeout(300)
    stopped = opened.locator("#time").input_value()
    opened.wait_for_timeout(300)
    assert opened.locator("#time").input_value() == stopped


ROWS = "() => Array.from(document.querySelectorAll('#each-table tbody tr')).map((tr) => tr.innerText.split('\\t'))"


def test_dropped_measurements_are_sorted_chosen_and_found_on_the_sphere(opened):
    rows = opened.evaluate(ROWS)
    assert [(row[0], row[2]) for row in rows] == [("0.5", "star"), ("0.7", "sun"), ("4", "star")]
    heading = opened.locator("#each-table th button", has_text="margin")
    heading.click()
    assert [row[4] for row in opened.evaluate(ROWS)] == ["-1.5 m/s²", "-0.4", "-0.2"]
    heading.click()
    assert [row[4] for row in opened.evaluate(ROWS)] == ["-0.2", "-0.4", "-1.5 m/s²"]
    opened.locator("#each-table td button", has_text="4").click()
    at(opened, "4.00 s")
    opened.locator("#each-sensor").select_option("sun")
    assert [row[0] for row in opened.evaluate(ROWS)] == ["0.7"]
    assert opened.locator("#each-count").text_content() == "1 measurement"


@pytest.mark.parametrize("opened", [{"viewport": {"width": 360, "height": 740}, "color_scheme": "dark"}], indirect=True)
def test_on_a_phone_in_the_dark(opened, tmp_path):
    assert opened.evaluate("document.documentElement.scrollWidth") <= 360
    picture = shot(opened, "report-phone.png", tmp_path)
    assert np.median(picture[..., :3]) < 0.2
    assert opened.evaluate("document.getElementById('size').layout.font.color") == "#e8e8e8"
    # Names in white on the globe, which is dark, and so are none of its patches.
    globe, patch = opened.evaluate(
        "['surface', 'mesh3d'].map((kind) => document.getElementById('sphere').data"
        ".findLast((one) => one.type === kind)).map((one) => one.colorscale ?? one.color)"
    )
    assert (globe, patch) == ([[0, "#4a4f58"], [1, "#4a4f58"]], "#56B4E9")
    # The blue of white paper cannot be read on black.
    assert opened.evaluate("document.getElementById('bands').data[0].line.color") == "#56B4E9"
    assert opened.evaluate("document.getElementById('sphere').data.at(-1).textfont?.color") != "#0072B2"
    widths = opened.evaluate(
        "Array.from(document.querySelectorAll('[aria-labelledby=h-dropped] table')).map("
        "(table) => table.scrollWidth - table.closest('section').clientWidth)"
    )
    assert len(widths) == 2
    assert max(widths) <= 0  # nothing to scroll


@pytest.mark.parametrize(
    "opened", [{"viewport": {"width": width, "height": 844}} for width in (390, 1200)], indirect=True
)
def test_no_title_is_on_a_number(opened):
    """Nor is a plot narrower than it need be, or a long name broken within a word."""
    covered = opened.evaluate(
        "Array.from(document.querySelectorAll('.plot')).flatMap((plot) => {"
        "  const boxes = (what) => Array.from(plot.querySelectorAll(what)).map((one) => one.getBoundingClientRect());"
        "  const numbers = boxes('[class$=\"tick\"] text').filter((one) => one.width > 0);"
        "  return boxes('[class^=\"g-y\"] text').filter((title) => numbers.some((one) => one.left < title.right + 2"
        "    && title.left < one.right - 1 && one.top < title.bottom - 1 && title.top < one.bottom - 1))"
        "    .map((one) => [plot.id, one.top]);"
        "})"
    )
    assert covered == []
    margins = opened.evaluate(
        "['angles', 'size', 'bands', 'strip', 'measured'].map((id) => document.getElementById(id))"
        ".filter((plot) => plot.layout).map((plot) => plot._fullLayout._size.l)"
    )
    assert len(set(margins)) == 1
    assert margins[0] <= 95
    heading = opened.evaluate("document.querySelector('h1').innerHTML")
    assert (heading, opened.title()) == ("A_<wbr>run_<wbr>with_<wbr>a_<wbr>gap", "A_run_with_a_gap - elliptude")


@pytest.mark.parametrize("opened", [{"viewport": {"width": 390, "height": 844}}], indirect=True)
def test_no_number_is_broken_on_a_phone(opened, tmp_path):
    """Nor is a name on the globe too small to be a letter, or hidden by that of another axis."""
    broken = opened.evaluate(
        "Array.from(document.querySelectorAll('td')).filter((td) => {"
        "  const walk = document.createTreeWalker(td, NodeFilter.SHOW_TEXT), range = document.createRange();"
        "  while (walk.nextNode()) {"
        "    for (const found of walk.currentNode.data.matchAll(/[-\\d.]+/g)) {"
        "      range.setStart(walk.currentNode, found.index);"
        "      range.setEnd(walk.currentNode, found.index + found[0].length);"
        "      if (new Set(Array.from(range.getClientRects()).map((one) => one.top)).size > 1) { return true; }"
        "    }"
        "  }"
        "  return false;"
        "}).map((td) => td.textContent)"
    )
    assert broken == []
    assert opened.evaluate("document.documentElement.scrollWidth") <= 390
    fonts = opened.evaluate(
        "document.getElementById('sphere').data.filter((one) => one.textfont)"
        ".map((one) => [one.textfont.size, one.textposition])"
    )
    assert len(fonts) == 4
    assert min(size for size, _ in fonts) >= 20
    names, *tips = [position for _, position in fonts]
    assert names not in tips
    shot(opened, "report-phone-light.png", tmp_path)
