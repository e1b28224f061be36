"""`elliptude validate`, as typed."""

import json
import os
import signal
import subprocess
import sys
import time
from typing import get_args, get_type_hints

import elliptude
import guaranteed_stand_in
import pytest
from elliptude import cli
from elliptude.cli.trials import validate
from elliptude.results import GuaranteedLog
from elliptude.validation import adversary, monte_carlo, trial_kinds, trials
from typer.testing import CliRunner

PROGRAM = [sys.executable, "-c", "from elliptude.cli import main; main()"]
SMALL = ("--scenario", "free", "--directions", "two", "--bound-deg", 7, "--trials", 4, "--updates", 8)


def run(*arguments):
    return CliRunner().invoke(cli.make_app(), ["validate", *(str(argument) for argument in arguments)])


def test_table_files_and_picture(tmp_path):
    out = tmp_path / "new" / "folder"
    options = ["--scenario", "gyro", "--directions", "three", "--bound-deg", 1, "--bound-deg", 0.5, "--trials", 3]
    done = run("--out", out, "--mode", "paper", "--processes", 1, *options)
    assert done.exit_code == 0, done.output
    assert {file.name for file in out.iterdir()} == {"progress.json", "summary.json", "validation.png"}
    assert (out / "validation.png").read_bytes().startswith(b"\x89PNG")
    rows = [line.split() for line in done.stdout.splitlines() if line.strip().startswith("gyro")]
    assert [row[:8] for row in rows] == [["gyro", "three", bound, "300", "0", "0", "0", "0"] for bound in ("1", "0.5")]
    assert "Mode paper: 600 updates, the truth outside at 0" in done.stdout
    summary = json.loads((out / "summary.json").read_text())
    assert summary["total"]["updates"] == 600
    assert len(summary["cases"]) == 10
    assert {case["noise"] for case in summary["cases"]} == set(adversary.NOISES)
    for case in summary["cases"]:
        assert case["updates"] == 60
        assert case["worst"]["form"] < 1.0
        assert set(case["sizes"]) == {"updates", "own", "paper"}
        assert case["sizes"]["own"] == case["sizes"]["paper"]


def test_json_is_the_same_on_any_number_of_processes_and_a_second_time(tmp_path, monkeypatch):
    options = [*SMALL, "--mode", "first_order", "--seed", 3, "--json"]
    first = run("--out", tmp_path / "one", "--processes", 1, *options)
    assert first.exit_code == 0, first.output
    assert json.loads(first.stdout) == json.loads((tmp_path / "one" / "summary.json").read_text())
    # With processes that are spawned, as on any platform.
    side_by_side = subprocess.run(
        [*PROGRAM, "validate", "--out", str(tmp_path / "two"), "--processes", "2", *map(str, options)],
        check=True,
        capture_output=True,
        text=True,
    )
    assert side_by_side.stdout == first.stdout
    assert all(line.startswith("Validating ") for line in side_by_side.stderr.splitlines())
    monkeypatch.setattr(monte_carlo, "validate_chunk", None)  # nothing is left to do
    assert run("--out", tmp_path / "one", *options).stdout == first.stdout


def test_an_interrupted_run_goes_on_where_it_was(tmp_path):
    options = ["--scenario", "orbit", "--directions", "two", "--bound-deg", "7", "--mode", "paper", "--json"]
    options += ["--trials", "1400", "--updates", "3"]
    command = [*PROGRAM, "validate", "--out", str(tmp_path / "out"), "--processes", "2", *options]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    progress = tmp_path / "out" / "progress.json"
    deadline = time.monotonic() + 120
    while not progress.exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does, to all processes
    output, errors = process.communicate(timeout=300)
    assert process.returncode == 130, errors
    assert output == ""
    assert [line for line in errors.splitlines() if "so far" not in line] in ([], ["Aborted."])
    assert [file.name for file in progress.parent.iterdir()] == ["progress.json"]
    begun = set(json.loads(progress.read_text())["done"])
    assert 0 < len(begun) < 15
    resumed = subprocess.run(command, check=True, capture_output=True, text=True)
    whole = subprocess.run(
        [*PROGRAM, "validate", "--out", str(tmp_path / "whole"), *options], check=True, capture_output=True, text=True
    )
    assert resumed.stdout == whole.stdout


def test_another_validation_is_not_overwritten(tmp_path):
    assert run("--out", tmp_path, "--mode", "paper", *SMALL).exit_code == 0
    other = run("--out", tmp_path, "--mode", "paper", "--seed", 1, *SMALL)
    assert other.exit_code == 1
    assert "is of a validation with other arguments; --force starts over" in other.stderr.replace("\n", "")
    before = (tmp_path / "summary.json").read_text()
    assert run("--out", tmp_path, "--mode", "paper", "--seed", 1, "--force", *SMALL).exit_code == 0
    assert (tmp_path / "summary.json").read_text() != before
    for text in ("{", "[]", '{"arguments": 1}', "\x00"):
        (tmp_path / "progress.json").write_text(text)
        broken = run("--out", tmp_path, "--mode", "paper", *SMALL)
        assert broken.exit_code == 1
        assert "is not a validation's; --force starts over" in broken.stderr.replace("\n", "")


@pytest.mark.parametrize(
    ("settings", "code"), [({}, 0), ({"scale": 0.1}, 1), ({"claim": "conditional"}, 1), ({"claim": "none"}, 0)]
)
def test_exit_code_of_the_guaranteed_mode(tmp_path, monkeypatch, settings, code):
    guaranteed_stand_in.install(monkeypatch, **settings)
    done = run("--out", tmp_path, "--processes", 1, *SMALL)
    assert done.exit_code == code, done.output
    assert "Mode guaranteed: 160 updates" in done.stdout
    assert (tmp_path / "summary.json").exists()


def test_kinds(tmp_path):
    options = ["--scenario", "gyro", "--directions", "two", "--bound-deg", 1, "--trials", 6, "--processes", 1]
    done = run("--out", tmp_path, "--kind", "liar", "--kind", "bias", "--kind", "honest", *options)
    assert done.exit_code == 0, done.output
    lines = [line.split() for line in done.stdout.splitlines()]
    assert [line[:5] for line in lines if line[:2] in (["liar", "gyro"], ["bias", "gyro"])] == [
        [kind, "gyro", "two", "1", "480"] for kind in ("liar", "bias")
    ]
    assert [line[:4] for line in lines if line[:2] == ["gyro", "two"]] == [["gyro", "two", "1", "600"]]
    assert "24 trials with liars, 0 not got over" in done.stdout
    assert "…" not in done.stdout  # nothing is cut off
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert {case["kind"] for case in summary["cases"]} == {"honest", "liar", "bias"}
    assert summary["total"]["updates"] == 1560
    assert summary["total"]["liars"] == 24
    heading = summary["total"]["questions"]["heading"]
    assert [line for line in lines if line[:1] == ["heading"]] == [
        ["heading", str(heading["updates"]), "0", f"{heading['largest']['share']:.5g}"]
    ]
    # A set that rests on a lie promises no answer.
    assert 960 <= heading["updates"] <= 1560
    assert ["question", "answers", "escapes", "share", "in", "gyro"] in lines


def test_a_wrong_answer_makes_the_exit_code_1(tmp_path, monkeypatch):
    right = GuaranteedLog.extents
    monkeypatch.setattr(
        GuaranteedLog, "extents", lambda log: right(log)._replace(largest_angles=0.5 * right(log).largest_angles)
    )
    done = run("--out", tmp_path, "--processes", 1, *SMALL)
    assert done.exit_code == 1, done.output
    total = json.loads((tmp_path / "summary.json").read_text())["total"]
    assert total["escapes"] == 0
    wrong = total["questions"]["largest angle"]["escapes"]
    assert wrong > 0
    assert f"{9 * 160} answers to single questions, the truth outside of {wrong}." in done.stdout


def test_every_kind_may_be_asked_for(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(monte_carlo, "validate_chunk", lambda arguments, case, number: asked.append(case))
    run(
        "--out",
        tmp_path,
        "--kind",
        "all",
        "--noise",
        "inside",
        "--directions",
        "two",
        "--bound-deg",
        1,
        "--processes",
        1,
    )
    expected = {("honest", scenario) for scenario in adversary.SCENARIOS}
    expected |= {(name, scenario) for name, kind in trial_kinds.KINDS.items() for scenario in kind.scenarios}
    assert {(case.kind, case.scenario) for case in asked} == expected


@pytest.mark.parametrize("fault", ["escapes", "overclaimed", "refused", "failed", "stuck"])
def test_exit_code_of_a_kind(tmp_path, monkeypatch, fault):
    real = trials.try_kind
    monkeypatch.setattr(trials, "try_kind", lambda *arguments: real(*arguments) | {fault: 1})
    options = ["--scenario", "gyro", "--directions", "two", "--bound-deg", 1, "--trials", 2, "--noise", "inside"]
    assert run("--out", tmp_path, "--kind", "bias", "--processes", 1, *options).exit_code == 1


def test_escapes_of_other_modes_are_no_failure(tmp_path):
    done = run("--out", tmp_path, "--mode", "paper", "--scenario", "orbit", "--bound-deg", 20, "--directions", "two")
    assert done.exit_code == 0
    assert json.loads((tmp_path / "summary.json").read_text())["total"]["escapes"] > 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--mode", "paper"], "--out"),
        (["--out", "x", "--mode", "best"], "best"),
        (["--out", "x", "--mode", "paper", "--trials", 0], "--trials"),
        (["--out", "x", "--mode", "paper", "--updates", -1], "--updates"),
        (["--out", "x", "--mode", "paper", "--seed", -1], "--seed"),
        (["--out", "x", "--mode", "paper", "--bound-deg", 0], "0 is not from 0.001 to 60"),
        (["--out", "x", "--mode", "paper", "--bound-deg", 61], "61 is not from 0.001 to 60"),
        (["--out", "x", "--mode", "paper", "--bound-deg", "nan"], "nan is not from 0.001 to 60"),
        (["--out", "x", "--mode", "paper", "--scenario", "moon"], "moon"),
        (["--out", "x", "--mode", "paper", "--directions", "four"], "four"),
        (["--out", "x", "--mode", "paper", "--noise", "loud"], "loud"),
        (["--out", "x", "--mode", "paper", "--processes", 0], "--processes"),
        (["--out", "x", "--kind", "fraud"], "'fraud' is none of honest, liar, liars, gaps"),
        (["--out", "x", "--kind", "liar", "--mode", "paper"], "only mode guaranteed is tried with other kinds"),
        (["--out", "x", "--kind", "bias", "--scenario", "free"], "nothing is left to try: bias is of gyro"),
        (["--out", "x", "--kind", "gaps", "--noise", "search"], "none is searched"),
    ],
)
def test_wrong_command_line(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    failed = run(*arguments)
    assert failed.exit_code == 2
    assert words in " ".join(failed.stderr.replace("│", " ").split())
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    failed = run("--out", tmp_path / "file" / "out", "--mode", "paper", *SMALL)
    assert failed.exit_code == 1
    assert "within a file, where a folder is needed" in failed.stderr


def test_without_the_guaranteed_mode(tmp_path, monkeypatch):
    monkeypatch.delattr(elliptude, "GuaranteedFilter", raising=False)
    failed = run("--out", tmp_path / "out")
    assert failed.exit_code == 2
    assert "'guaranteed' is not in this version of elliptude" in " ".join(failed.stderr.replace("│", " ").split())


def test_choices_are_what_there_is():
    chosen = get_type_hints(validate.validate)
    assert get_args(chosen["scenario"]) == (*adversary.SCENARIOS, "all")
    assert get_args(chosen["directions"]) == (*adversary.DIRECTIONS, "all")
    assert get_args(chosen["noise"]) == (*adversary.NOISES, "all")


def _end_the_process(*arguments):
    os._exit(1)


def test_a_process_that_dies(tmp_path, monkeypatch):
    monkeypatch.setattr(monte_carlo, "validate_chunk", _end_the_process)
    failed = run("--out", tmp_path, "--mode", "paper", "--processes", 2, *SMALL)
    assert failed.exit_code == 1
    said = " ".join(failed.stderr.split())
    assert "processes died before any result" in said
