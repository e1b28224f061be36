"""How far off estimates may be: one name for a figure, in the terminal, the report and pictures."""

import dataclasses
import json
import re

import numpy as np
import pytest
import tomlkit
from elliptude.configuration import Configuration
from elliptude.estimation import guaranteed_result, sizes_in_words
from elliptude.estimation.guaranteed_run import run_guaranteed
from elliptude.io.tables import Result
from elliptude.logs import read_log
from elliptude.report.axes.sphere import frame_label
from elliptude.report.estimated.reading import read_run
from elliptude.results import CLAIMS
from test_guaranteed_run import recording, ruled, run


@pytest.fixture(scope="module")
def estimated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("estimated")
    (folder / "config.toml").write_text(tomlkit.dumps(ruled()))
    arguments = ("--config", folder / "config.toml", "--out", folder / "out", "--report", folder / "report.html")
    done = run("estimate", recording(folder), *arguments, "--best", "center")
    assert done.exit_code == 0, done.output
    return folder, done.output


def test_terminal_and_report_give_the_same_figures_of_the_same_name(estimated):
    folder, said = estimated
    page = (folder / "report.html").read_text(encoding="utf-8")
    result = Result.read(folder / "out" / "results.csv")
    columns = {
        sizes_in_words.LARGEST_ANGLE: result.largest_angles,
        sizes_in_words.TILT: result.tilt_bounds,
        sizes_in_words.HEADING: np.abs(result.headings).max(axis=1),
    }
    for name, angles in columns.items():
        known = np.rad2deg(angles[np.isfinite(result.largest_angles)])
        mean, most = f"{known.mean():.3g}", f"{known.max():.3g}"
        assert re.search(rf"^  {name} +{re.escape(mean)} \({re.escape(most)}\) ", said, re.MULTILINE), (name, said)
        assert f'<th scope="row">{name}</th><td>mean {mean}°, at most {most}°</td>' in page


def test_nothing_else_is_called_a_bound_of_the_heading(estimated):
    """Neither half-widths, nor bands of yaw, nor the center's figures once more."""
    folder, said = estimated
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "half-width" not in said
    assert '<th scope="row">half-width' not in page
    assert "of its band" not in page
    assert said.count("degrees: mean (at most)") == 1
    assert "  best estimate, the center of the set; mean error " in said


def test_half_widths_where_tilt_and_heading_are_not_known():
    part = {
        "with_set": 3,
        "largest_angle_deg": {"mean": 1.0, "max": 2.0},
        "tilt_bound_deg": None,
        "heading_bound_deg": None,
        "half_width_reference_deg": {"mean": [0.1, 0.2, 0.3], "max": [1.0, 1.5, 1.75]},
    }
    nothing = part | {"with_set": 0, "largest_angle_deg": None}
    lines = sizes_in_words.lines({"all": part, "at_rest": nothing}, ("east", "north", "up"))
    assert [re.split(r"  +", line) for line in lines] == [
        ["degrees: mean (at most)", "all, 3 rows"],
        ["largest angle in the set", "1 (2)"],
        ["half-width about east", "0.1 (1)"],
        ["half-width about north", "0.2 (1.5)"],
        ["half-width about up", "0.3 (1.75)"],
    ]
    assert sizes_in_words.lines({"all": nothing}, ("X", "Y", "Z")) == []


def test_it_says_where_the_tilt_is_above_the_set_and_by_which_claim(estimated):
    """Up by a stronger claim may be wider than the set, which rests on what was left out, too."""
    whole = read_run(estimated[0] / "out")[0]
    assert whole.tilt_beyond_set == 0
    row = int(np.argmax(whole.known))
    claims, tilts = list(whole.claims), whole.tilt_bounds.copy()
    claims[row], tilts[row] = "conditional", 1.5 * whole.largest_angles[row]
    changed = dataclasses.replace(whole, claims=tuple(claims), tilt_bounds=tilts)
    assert changed.tilt_beyond_set == 1
    label = frame_label(changed, row, True)
    assert "up within" in label
    assert "° (unconditional), claim: conditional" in label
    assert "(unconditional)" not in frame_label(whole, row, True)
    # By the same claim it is rounding.
    assert dataclasses.replace(changed, claims=whole.claims).tilt_beyond_set == 0
    assert "at 1 row the bound of the tilt is above" in sizes_in_words.tilt_beyond_set(1)


def test_yaw_takes_the_smaller_tilt_that_its_claim_allows(tmp_path):
    path, configuration = recording(tmp_path), Configuration.model_validate(ruled())
    found = run_guaranteed(read_log(path, configuration), configuration)
    wide = dataclasses.replace(found.vertical, tilt_bounds=2.0 * found.sets.attitude_bounds.tilt)
    wider = dataclasses.replace(found, vertical=wide)
    own = dataclasses.replace(found, vertical=dataclasses.replace(wide, tilt_bounds=found.sets.attitude_bounds.tilt))
    of_wider, of_own = (guaranteed_result.result_of(one, configuration).roll_pitch_yaw for one in (wider, own))
    assert CLAIMS[int(found.sets.claims[-1])] == "unconditional"
    np.testing.assert_array_equal(of_wider[:, 6:], of_own[:, 6:])


def test_the_summary_counts_rows_with_a_tilt_above_the_set(estimated):
    summary = json.loads((estimated[0] / "out" / "summary.json").read_text())
    assert summary["tilt_beyond_set_rows"] == 0
    assert summary["sizes"]["all"]["largest_angle_deg"]["max"] == pytest.approx(summary["largest_angle_deg"]["max"])


@pytest.mark.parametrize(("count", "said"), [(1, "1 row"), (2, "2 rows")])
def test_one_row_is_a_row(count, said):
    part = {"with_set": count, "largest_angle_deg": {"mean": 1.0, "max": 1.0}}
    part |= {"tilt_bound_deg": None, "heading_bound_deg": None}
    part["half_width_reference_deg"] = {"mean": [0.1] * 3, "max": [0.2] * 3}
    assert sizes_in_words.lines({"all": part}, ("X", "Y", "Z"))[0].endswith(f"all, {said}")
