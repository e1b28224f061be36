"""The programs and numbers of the README, of docs/library.md and of docs/conventions.md."""

import re
from pathlib import Path

import elliptude as el
import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
LIBRARY = ROOT / "docs" / "library.md"
CONVENTIONS = ROOT / "docs" / "conventions.md"
EXAMPLES = ROOT / "cpp" / "examples"


def blocks(page: Path, language: str, count: int) -> list[str]:
    found = re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert len(found) == count
    return [str(one) for one in found]


def printed(program: str, capsys: pytest.CaptureFixture[str]) -> tuple[str, float]:
    """Run a program that prints a word and an angle in degrees."""
    exec(compile(program, "a page's program", "exec"), {})
    word, angle = capsys.readouterr().out.split()
    return word, float(angle)


def test_the_readme_programs_run(capsys: pytest.CaptureFixture[str]) -> None:
    programs = blocks(README, "python", 2)
    claim, roll = printed(programs[0], capsys)
    assert claim == "unconditional"
    assert 0 < roll < 10
    claim, angle = printed(programs[1], capsys)
    assert claim == "unconditional"
    assert 5 < angle < 15


def test_the_one_call_of_the_library_runs(capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(blocks(LIBRARY, "python", 13)[0], "one call", "exec"), {})
    claim, angles = capsys.readouterr().out.split(maxsplit=1)
    assert claim == "unconditional"
    roll, pitch, yaw = (float(one) for one in angles.strip("[]\n").split())
    assert 0 < roll < 10
    assert 0 < pitch < 10
    assert 0 < yaw < 40


def test_the_guaranteed_program_of_the_library_runs(capsys: pytest.CaptureFixture[str]) -> None:
    claim, angle = printed(blocks(LIBRARY, "python", 13)[1], capsys)
    assert claim == "unconditional"
    assert 1 < angle < 5


def test_the_programs_of_single_questions_run(capsys: pytest.CaptureFixture[str]) -> None:
    programs = blocks(LIBRARY, "python", 13)
    exec(compile(programs[2], "bounds", "exec"), {})
    tilt, least, most = (float(one) for one in capsys.readouterr().out.strip("[]\n").split())
    assert (tilt, least, most) == pytest.approx((2.0, -15.0, 15.0), rel=0.02)  # the cones alone
    exec(compile(programs[3], "turn, rate and own set", "exec"), {})
    said = capsys.readouterr().out.replace("[", "").replace("]", "").split()
    least, most, fastest, *own = (float(one) for one in said)
    # Each direction bounds the turn about the camera's axis by itself; the set's half-widths are 0.14 and 0.2.
    assert (least, most, fastest) == pytest.approx((-0.1, 0.1, 0.1), rel=0.01)
    assert own == pytest.approx([0.1 * np.sqrt(2.0), 0.1 * np.sqrt(2.0), 0.1], rel=0.01)
    exec(compile(programs[4], "up", "exec"), {})
    said = capsys.readouterr().out
    assert said == "[-0.479  0.     0.878] 2.57 unconditional\n"  # -sin 0.5, cos 0.5; 2 degrees and 0.01 rad


def test_the_first_order_program_of_the_library_holds_the_truth(capsys: pytest.CaptureFixture[str]) -> None:
    inside, angle = printed(blocks(LIBRARY, "python", 13)[5], capsys)
    assert inside == "True"
    assert 0 < angle < 3


def test_the_potentials_of_the_library_predict_and_state_what_is_true() -> None:
    names: dict[str, object] = {}
    for program in blocks(LIBRARY, "python", 13)[6:9]:
        exec(compile(program, "a potential", "exec"), names)
    panel, estimator = names["panel"], names["estimator"]
    assert isinstance(panel, el.StatedTorque)
    assert isinstance(estimator, el.GuaranteedFilter)
    estimator.update(np.eye(3), np.eye(3), np.full(3, 0.01), angular_velocity=[0, 0, 1e-3], rate_bound=1e-3)
    estimator.predict(10.0)
    assert estimator.claim == "unconditional"
    rng = np.random.default_rng(1)
    sharpest = 0.0
    for _ in range(300):
        attitude, turn = (el.exp(rng.uniform(-1, 1, 3)) for _ in range(2))
        zeta = el.log(turn)
        rest = panel.torque(attitude @ turn) - panel.torque(attitude) - panel.torque_jacobian(attitude) @ zeta
        sharpest = max(sharpest, float(np.linalg.norm(rest) / (panel.error + panel.curvature * zeta @ zeta)))
    assert 0.1 < sharpest <= 1.0


def test_the_programs_of_many_problems_and_filters_run(capsys: pytest.CaptureFixture[str]) -> None:
    programs = blocks(LIBRARY, "python", 13)
    exec(compile(programs[9], "many attitudes", "exec"), {})
    *shape, cost, condition = capsys.readouterr().out.replace("(", "").replace(")", "").replace(",", "").split()
    assert shape == ["10000", "3", "3"]
    assert float(cost) < 1e-28
    assert float(condition) == pytest.approx(1.0)
    exec(compile(programs[10], "many filters of first order", "exec"), {})
    said = capsys.readouterr().out
    assert said.startswith("True (1000, 6, 6) <AttitudeFilter: time 0.1 s, mode 'first_order', within ")
    assert 1 < float(said.split()[-1].rstrip("°>")) < 2
    exec(compile(programs[11], "many filters", "exec"), {})
    angles = [float(one) for one in capsys.readouterr().out.strip("[]\n").split()]
    assert len(angles) == 4
    assert 0 < angles[0] < angles[1] < angles[2] < angles[3] < 8


def test_the_fixed_lag_of_the_library_runs(capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(blocks(LIBRARY, "python", 13)[12], "a fixed lag", "exec"), {})
    time, claim, angle = capsys.readouterr().out.split()
    assert time == "0.0"
    assert claim == "unconditional"
    assert 0.5 < float(angle) < 2  # a measurement half a second later knows it within 0.6 degrees


def test_the_cpp_program_of_the_library_is_the_example_that_ctest_runs() -> None:
    assert blocks(LIBRARY, "cpp", 2)[0] == (EXAMPLES / "filter.cpp").read_text(encoding="utf-8")


def test_the_cpp_lines_of_the_readme_are_lines_of_the_example_in_its_order() -> None:
    example = (EXAMPLES / "guaranteed_filter.cpp").read_text(encoding="utf-8")
    remaining = [line.strip() for line in example.splitlines()]
    for line in filter(None, map(str.strip, blocks(README, "cpp", 1)[0].splitlines())):
        assert line in remaining, line
        remaining = remaining[remaining.index(line) + 1 :]


def test_the_conventions_have_these_numbers() -> None:
    quarter = el.exp([0, 0, np.pi / 2])
    np.testing.assert_allclose(quarter @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(el.quaternion_from_rotation(quarter), [0.5**0.5, 0, 0, 0.5**0.5], atol=1e-15)
    shape = np.diag([1e-4] * 6)
    assert np.degrees(el.StateEllipsoid(np.eye(3), np.zeros(3), shape).extent().half_widths_body[0]) == pytest.approx(
        0.573, abs=5e-4
    )
    gravity = el.UniformGravity(1.0, 9.81, [0, 0, 0.3])
    hanging = gravity.energy(np.eye(3))
    assert all(gravity.energy(el.exp(turn)) > hanging for turn in np.eye(3)[:2])


@pytest.mark.parametrize("page", [README, *sorted((ROOT / "docs").glob("**/*.md"))], ids=lambda page: page.name)
def test_the_files_and_headings_that_a_page_links_to_exist(page: Path) -> None:
    # A function without a name in C++, [](...), is no link.
    text = re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target, heading in re.findall(r"\]\((?!https?:)([^)#]*)(?:#([^)]+))?\)", text):
        file = page.parent / target if target else page
        assert file.exists(), target
        if heading:
            titles = re.findall(r"^#+ (.*)$", file.read_text(encoding="utf-8"), flags=re.MULTILINE)
            assert heading in {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}, heading


def test_the_readme_is_two_screens() -> None:
    assert len(README.read_text(encoding="utf-8").splitlines()) <= 125
