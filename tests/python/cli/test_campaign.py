"""`elliptude campaign`, as typed."""

import json

import elliptude as el
import pytest
from elliptude import cli
from elliptude.campaigns import summary
from elliptude.campaigns.plan import Settings, read_plan, template
from typer.testing import CliRunner

SMALL = """
scenarios = ["gyro", "free"]
directions = ["two"]
bound_deg = [7.0]
noise = ["perpendicular"]
updates = 6
seeds = { count = 50 }
estimator = { mode = ["guaranteed", "paper"] }
"""


def run(*arguments):
    return CliRunner().invoke(cli.make_app(), ["campaign", *(str(argument) for argument in arguments)])


@pytest.fixture
def config(tmp_path):
    file = tmp_path / "small.toml"
    file.write_text(SMALL)
    return file


def test_files_and_figures(tmp_path, config):
    out = tmp_path / "new" / "folder"
    done = run(config, "--out", out, "--processes", 1)
    assert done.exit_code == 0, done.output
    lines = done.stdout.splitlines()
    assert lines[0] == (
        "Mode guaranteed: 100 runs, 600 updates, the truth outside at 0; 0 refused, 0 without a set, 0 failed."
    )
    assert lines[1].startswith("Mode paper: 100 runs, 600 updates, the truth outside at ")
    assert "s of a processor for a million updates" in lines[2]
    assert lines[3:] == [str(out / name) for name in ("rows", "summary.json", "summary.html")]
    assert done.stderr == ""
    again = run(config, "--out", out, "--processes", 1, "--json")
    assert json.loads(again.stdout) == json.loads((out / "summary.json").read_text())


def test_the_page_says_what_the_summary_says(tmp_path, config):
    found = el.campaign(config, tmp_path / "out", processes=1)
    page = (tmp_path / "out" / "summary.html").read_text()
    assert page.count("<tr>") == 1 + len(found["cases"]) + 2 + 2 + 3  # heads, cases, runs and seeds, modes, costs
    assert "200 of 6 updates each" in page
    for case in found["cases"]:
        assert f'<td class="number">{case["worst"]["form"]:.6g}</td>' in page
    assert f"{found['cost']['bytes_per_row']:.3g} bytes each" in page
    assert "<script" not in page
    assert "http:" not in page
    assert "https:" not in page
    assert page.count("data:image/png;base64,") == 1
    assert "@" not in page.split("data:image/png", maxsplit=1)[0].split("</style>", maxsplit=1)[1]


def test_the_template_is_a_campaign(tmp_path):
    shown = run("--template")
    assert shown.exit_code == 0
    assert shown.stdout == template()
    (tmp_path / "campaign.toml").write_text(shown.stdout)
    plan = read_plan(tmp_path / "campaign.toml")
    assert (plan.runs, plan.updates) == (3200, 64_000)
    for key in (*Settings.model_fields, *Settings.model_fields["estimator"].annotation.model_fields):
        assert key in shown.stdout


def test_exit_code_of_the_guaranteed_mode(tmp_path, config, monkeypatch):
    monkeypatch.setattr(summary, "FAULTS", ("updates",))
    done = run(config, "--out", tmp_path / "out", "--processes", 1)
    assert done.exit_code == 1
    assert 'class="warn">600 updates' in (tmp_path / "out" / "summary.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ([], 2, "a configuration and --out are needed"),
        (["small.toml"], 2, "a configuration and --out are needed"),
        (["none.toml", "--out", "out"], 1, "none.toml: no such file or folder"),
        (["small.toml", "--out", "out", "--processes", 0], 2, "--processes"),
        (["small.toml", "--out", "small.toml/out"], 1, "within a file, where a folder is needed"),
        (["small.toml", "--out", "."], 1, "holds files, but no campaign (campaign.json): choose a new folder"),
    ],
)
def test_wrong_command_line(tmp_path, monkeypatch, config, arguments, code, words):
    monkeypatch.chdir(tmp_path)
    failed = run(*arguments)
    assert failed.exit_code == code
    assert words in " ".join(failed.stderr.replace("│", " ").split())
    assert [file.name for file in tmp_path.iterdir()] == ["small.toml"]
