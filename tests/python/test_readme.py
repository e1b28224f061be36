"""The README's programs and numbers."""

import re
from pathlib import Path

import elliptude as el
import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str, count: int) -> list[str]:
    found = re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)
    assert len(found) == count
    return [str(one) for one in found]


def test_the_guaranteed_program_runs(capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(blocks("python", 2)[0], "README.md", "exec"), {})
    claim, angle = capsys.readouterr().out.split()
    assert claim == "unconditional"
    assert 1 < float(angle) < 5


def test_the_python_program_runs_and_holds_the_truth(capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(blocks("python", 2)[1], "README.md", "exec"), {})
    inside, angle = capsys.readouterr().out.split()
    assert inside == "True"
    assert 0 < float(angle) < 3


def test_the_cpp_program_is_the_example_that_ctest_runs() -> None:
    assert blocks("cpp", 1)[0] == (ROOT / "cpp" / "examples" / "filter.cpp").read_text(encoding="utf-8")


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


def test_the_files_that_it_names_exist() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert (ROOT / target).exists(), target
