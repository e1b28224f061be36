"""What the pages about Basilisk show runs, as far as it needs no Basilisk, and what needs it says so."""

import doctest
import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


def test_the_examples_of_the_reference_run():
    failed, tried = doctest.testfile(str(ROOT / "docs" / "reference" / "basilisk.rst"), module_relative=False)
    assert (failed, tried) == (0, 10)


def test_the_programs_of_the_page_run(capsys):
    programs = re.findall(
        r"```python\n(.*?)```", (ROOT / "docs" / "basilisk.md").read_text(encoding="utf-8"), re.DOTALL
    )
    estimator, conversions = programs
    exec(conversions, {})
    assert capsys.readouterr().out == "[0. 1. 0.] [0.    0.    0.414]\n"
    compile(estimator, "docs/basilisk.md", "exec")


INSTALL = "needs Basilisk: pip install 'elliptude[basilisk]'"


@pytest.mark.parametrize(
    ("command", "status", "says"),
    [
        (["-c", "import elliptude.basilisk as b; b.AttitudeEstimator"], 1, f"AttitudeEstimator {INSTALL}"),
        (["-c", "import elliptude.basilisk as b; b.Estimator"], 1, "'elliptude.basilisk' has no attribute 'Estimator'"),
        (["-m", "elliptude.basilisk"], 2, f"error: this {INSTALL}"),
        (["-m", "elliptude.basilisk", "--step", "1"], 2, "--seed from 1 to 1000, not 1.0 and 1"),
        (["-m", "elliptude.basilisk", "--out", "nowhere/orbit.png"], 2, "--out: cannot write into nowhere"),
    ],
)
def test_without_basilisk_it_says_what_to_install(tmp_path, command, status, says):
    """In a process that cannot import it, whether it is installed or not."""
    hidden = "raise ModuleNotFoundError(\"No module named 'Basilisk'\", name='Basilisk')\n"
    (tmp_path / "Basilisk.py").write_text(hidden)
    program = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); sys.argv = {command!r}\n"
    program += (
        "import runpy; sys.argv = sys.argv[1:]; runpy.run_module(sys.argv[0], run_name='__main__', alter_sys=True)"
        if command[0] == "-m"
        else command[1]
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == status
    assert says in done.stderr
    assert command[0] == "-c" or "Traceback" not in done.stderr


def test_the_first_program_of_the_page_builds_the_module():
    """With Basilisk: it makes an estimator, linked to sensors and a controller."""
    if importlib.util.find_spec("Basilisk") is None:
        pytest.skip("no Basilisk: pip install 'elliptude[basilisk]'")
    from Basilisk.fswAlgorithms import attTrackingError
    from elliptude.basilisk.orbit import SUN_NORMALS, Orbit

    page = (ROOT / "docs" / "basilisk.md").read_text(encoding="utf-8")
    names = {}
    exec(re.search(r"```python\n(.*?)```", page, re.DOTALL).group(1), names)
    orbit, error = Orbit(0.5, estimator=False), attTrackingError.attTrackingError()
    made = names["add_estimator"](
        orbit.simulation, orbit._gyro, orbit._tracker, orbit._sun_sensors, SUN_NORMALS, orbit._sun, error
    )
    orbit.execute(60.0)
    assert made.claim == "unconditional"
    assert made.navAttOutMsg.read().timeTag == made.time == 60.0
    assert error.attNavInMsg.isSubscribedTo(made.navAttOutMsg) == 1
