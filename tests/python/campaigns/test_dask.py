"""Campaigns on a real Dask cluster: a scheduler and two workers, each a process, one of which is killed."""

import json
import os
import signal
import subprocess
import sys
import textwrap
import time

import elliptude as el
import pytest
from elliptude import cli
from typer.testing import CliRunner

pytest.importorskip("distributed")

ELLIPTUDE = [sys.executable, "-c", "from elliptude.cli import main; main()"]
DASK = [sys.executable, "-m", "dask"]
BLOCKS = 12


@pytest.fixture
def cluster(tmp_path, request):
    """The scheduler's file, the scheduler and two workers, which a nanny replaces if a test asks for it."""
    file, processes = tmp_path / "scheduler.json", []
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}

    def begin(*arguments):
        with (tmp_path / f"dask_{len(processes)}.log").open("w") as log:
            processes.append(
                subprocess.Popen([*DASK, *arguments], env=environment, stdout=log, stderr=log, cwd=tmp_path)
            )
        return processes[-1]

    try:
        scheduler = begin("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", file)
        nanny = "--nanny" if getattr(request, "param", None) == "nanny" else "--no-nanny"
        alone = (nanny, "--nthreads", "1", "--memory-limit", "0", "--no-dashboard")
        workers = [begin("worker", "--scheduler-file", file, "--host", "127.0.0.1", *alone) for _ in range(2)]
        yield file, scheduler, workers
    finally:
        for process in processes:
            process.kill()
            process.wait()


@pytest.fixture
def config(tmp_path):
    file = tmp_path / "campaign.toml"
    file.write_text(
        'scenarios = ["gyro"]\ndirections = ["two", "three"]\nbound_deg = [1.0, 7.0]\n'
        'noise = ["inside", "common", "alternating"]\nseeds = { count = 400 }\n'
        'estimator = { mode = ["guaranteed", "paper"] }\n'
    )
    return file


def blocks(folder):
    return {str(file.relative_to(folder)): file.read_bytes() for file in (folder / "rows").rglob("*.parquet")}


def wait_until(condition):
    deadline = time.monotonic() + 120.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_worker_is_killed_in_the_middle(tmp_path, cluster, config):
    file, _, workers = cluster
    wait_until(file.exists)
    out = tmp_path / "out"
    process = subprocess.Popen(
        [*ELLIPTUDE, "campaign", config, "--out", out, "--dask", file, "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_until(lambda: len(blocks(out)) >= 2)
    workers[0].send_signal(signal.SIGKILL)
    killed_after = len(blocks(out))
    output, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors
    assert killed_after < BLOCKS
    found = json.loads(output)
    assert found["cost"]["blocks"] == BLOCKS
    # Each block was taken once: what was timed is what there is.
    assert found["cost"]["timed_updates"] == BLOCKS * 400 * 20 * 2
    assert len((out / "timings.csv").read_text().splitlines()) == 1 + BLOCKS
    expected = el.campaign(config, tmp_path / "here", processes=1)
    assert blocks(out) == blocks(tmp_path / "here")
    assert found["cases"] == expected["cases"]


def test_a_scheduler_that_ends_ends_the_campaign_with_a_message(tmp_path, cluster, config):
    """And the same command goes on, on this machine."""
    file, scheduler, _ = cluster
    wait_until(file.exists)
    out = tmp_path / "out"
    process = subprocess.Popen(
        [*ELLIPTUDE, "campaign", config, "--out", out, "--dask", file],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_until(lambda: len(blocks(out)) >= 1)
    scheduler.kill()
    _, errors = process.communicate(timeout=300)
    assert process.returncode == 1
    assert "the same command goes on from there" in " ".join(errors.split())


def run_pieces(file, call, before="pass"):
    """What `engine.results` says of eight pieces, and those that came back; `before` is a statement to begin with.

    In a process of its own, because Dask's threads outlive the test.
    """
    program = f"""
        import functools
        import campaign_work
        from distributed import Client
        from elliptude.campaigns import cluster, engine
        from elliptude.campaigns.pieces import Piece
        from elliptude.io.files import FileError

        found = []
        with Client(scheduler_file={str(file)!r}) as client:
            {before}
            pieces = [Piece(f"piece {{n}}", (n,)) for n in range(8)]
            try:
                found.extend(engine.results({call}, pieces, executor=client))
            except FileError as error:
                print(error)
        print(sorted(square for _, (_, square) in found))
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    said, found = done.stdout.splitlines()
    return said, json.loads(found)


WAIT_FOR_NANNIES = "campaign_work.wait_for_nannies(client, 2)"


@pytest.mark.parametrize("cluster", ["nanny"], indirect=True)
def test_a_piece_that_kills_its_workers_is_named(cluster):
    """After the others are done."""
    file, _, _ = cluster
    wait_until(file.exists)
    said, found = run_pieces(file, "campaign_work.die_at_three", before=WAIT_FOR_NANNIES)
    assert said.startswith("1 piece of the work failed: piece 3: KilledWorker: ")
    assert found == [n * n for n in range(8) if n != 3]


def test_a_cluster_that_has_lost_all_workers_ends_the_work(cluster):
    """The piece kills both, and no nanny replaces them; Dask waits for ever then."""
    file, _, _ = cluster
    wait_until(file.exists)
    said, found = run_pieces(file, "campaign_work.die_at_three", before="cluster.WITHOUT_WORKERS_S = 3.0")
    assert said == (
        "the executor has broken (BrokenExecutor: the cluster has had no worker for 3 s); "
        "the same command goes on from there"
    )
    assert 9 not in found


def test_a_piece_whose_result_is_lost_and_that_fails_then_is_named(tmp_path, cluster):
    """Dask's own executor would wait for it for ever."""
    file, _, _ = cluster
    wait_until(file.exists)
    call = f"functools.partial(campaign_work.die_with_the_result_and_fail_again, folder={str(tmp_path)!r})"
    said, found = run_pieces(file, call)
    assert (tmp_path / "died").exists()
    assert said.startswith("1 piece of the work failed: piece 3: ArithmeticError: 3 again. ")
    assert found == [n * n for n in range(8) if n != 3]


def test_dasks_own_executor_is_refused(tmp_path, config):
    from distributed.cfexecutor import ClientExecutor

    with pytest.raises(TypeError, match=r"executor: Dask's ClientExecutor waits for ever .* give the client itself"):
        el.campaign(config, tmp_path / "out", executor=ClientExecutor(None))


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (["--dask", "tcp://127.0.0.1:9"], 1, "tcp://127.0.0.1:9: no scheduler answers"),
        (["--dask", "nowhere"], 1, "nowhere: no scheduler answers"),
        (["--dask", "no.json"], 1, "no.json: no such file"),
        (["--dask", "tcp://127.0.0.1:9", "--processes", "2"], 2, "with --dask the cluster says how many"),
    ],
)
def test_no_scheduler(tmp_path, monkeypatch, config, options, code, words):
    monkeypatch.setattr("elliptude.cli.trials.campaign._ANSWERS_WITHIN", 1)
    failed = CliRunner().invoke(cli.make_app(), ["campaign", str(config), "--out", str(tmp_path / "out"), *options])
    assert failed.exit_code == code, failed.output
    assert words in " ".join(failed.stderr.replace("│", " ").split())
    assert not (tmp_path / "out").exists()
