"""Work on processes that die, on executors that break, and none of it lost or done twice."""

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import closing
from multiprocessing import get_context
from pathlib import Path

import campaign_work
import pytest
from elliptude.campaigns import engine, pieces
from elliptude.campaigns.pieces import Piece
from elliptude.io.files import FileError


def numbered(count, *more):
    return [Piece(f"piece {n}", (n, *more)) for n in range(count)]


def test_each_piece_comes_back_once_whoever_works():
    expected = sorted((f"piece {n}", n * n) for n in range(40))
    processes = {}
    with ThreadPoolExecutor(3) as executor:
        for name, options in {
            "here": {"processes": 1},
            "two": {"processes": 2},
            "other": {"executor": executor},
        }.items():
            found = list(engine.results(campaign_work.square, numbered(40), **options))
            assert sorted((piece, square) for piece, (_, square) in found) == expected
            processes[name] = {process for _, (process, _) in found}
        assert executor.submit(abs, -1).result() == 1  # it stays open
    assert processes["here"] == processes["other"] == {os.getpid()}
    assert len(processes["two"]) == 2
    assert os.getpid() not in processes["two"]


def test_nothing_to_do():
    assert list(engine.results(campaign_work.square, [])) == []


def test_large_results():
    found = dict(engine.results(campaign_work.large, numbered(6), processes=2))
    assert {name: result[-1] for name, result in found.items()} == {f"piece {n}": n for n in range(6)}


def test_a_process_that_dies_once_costs_nothing(tmp_path):
    found = list(engine.results(campaign_work.die_once, numbered(20, tmp_path), processes=2))
    assert sorted(square for _, (_, square) in found) == [n * n for n in range(20)]
    assert (tmp_path / "died").exists()


def test_a_piece_that_kills_its_processes_is_named_after_the_others_are_done():
    found = []
    with pytest.raises(FileError, match=r"^1 piece of the work failed: piece 3: its process died 3 times\. What is"):
        found.extend(engine.results(campaign_work.die_at_three, numbered(20), processes=2))
    assert sorted(square for _, (_, square) in found) == [n * n for n in range(20) if n != 3]


def test_processes_that_cannot_even_start():
    with pytest.raises(FileError, match=r"processes died before any result.*__main__"):
        list(engine.results(campaign_work.die, numbered(50), processes=2))


@pytest.mark.parametrize("options", [{"processes": 1}, {"processes": 2}, {"executor": None}])
def test_pieces_that_fail_are_named(options):
    with ThreadPoolExecutor(2) as executor:
        if "executor" in options:
            options = {"executor": executor}
        found = []
        with pytest.raises(FileError) as failed:
            found.extend(engine.results(campaign_work.fail_at_odd, numbered(8), **options))
    assert sorted(found) == [(f"piece {n}", n) for n in range(0, 8, 2)]
    assert str(failed.value).startswith("4 pieces of the work failed: piece ")
    assert "ArithmeticError: " in str(failed.value)
    assert "; and 1 more. What is done is kept, and the same command tries again" in str(failed.value)


def test_a_fault_that_is_elsewhere_ends_the_work_soon():
    found = []
    with pytest.raises(FileError, match=f"^{pieces.MOST_FAILED} pieces"):
        found.extend(engine.results(campaign_work.fail_at_odd, numbered(1000), processes=1))
    assert len(found) == pieces.MOST_FAILED


class KilledWorker(Exception):
    """As Dask's, which also says it of work that waited on a worker when other work killed it."""


class Blaming(Executor):
    """Blames pieces 2 and 3 for what 3 does; notes what else was under way when each began."""

    def __init__(self):
        self.under_way, self.begun = set(), []

    def submit(self, function, /, *arguments, **options):
        (number,) = arguments
        future = Future()
        is_blamed = number == 3 or (number == 2 and 2 not in [before for before, _ in self.begun])
        self.begun.append((number, set(self.under_way)))
        self.under_way.add(number)
        future.add_done_callback(lambda _: self.under_way.discard(number))

        def end():
            if is_blamed:
                future.set_exception(KilledWorker("four times"))
            else:
                future.set_result(function(number))

        threading.Timer(0.2, end).start()
        return future


def test_who_is_blamed_for_a_dead_worker_is_tried_alone():
    """So that the innocent come back, and the one that kills is named."""
    executor, found = Blaming(), []
    with pytest.raises(FileError, match=r"^1 piece of the work failed: piece 3: KilledWorker: four times"):
        found.extend(engine.results(abs, numbered(6), executor=executor))
    assert sorted(result for _, result in found) == [0, 1, 2, 4, 5]
    assert len(executor.begun) == 8
    assert sorted(executor.begun[6:]) == [(2, set()), (3, set())]


def test_an_executor_that_breaks():
    with (
        ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor,
        pytest.raises(FileError, match=r"the executor has broken \(BrokenProcessPool: .*the same command goes on"),
    ):
        list(engine.results(campaign_work.die, numbered(5), executor=executor))


def is_running(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    # One that nobody has waited for yet is as good as gone.
    return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"


def wait_until(condition, seconds=60.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_processes_end_at_once_when_the_work_is_given_up(tmp_path):
    with closing(engine.results(campaign_work.die_once, numbered(50, tmp_path), processes=2)) as results:
        _, (process, _) = next(results)
    assert not is_running(process)


def test_processes_end_with_the_one_that_started_them(tmp_path):
    """By SIGKILL, so that it cannot clean up; they finish what they have."""
    program = f"""
        import campaign_work
        from elliptude.campaigns import engine
        from elliptude.campaigns.pieces import Piece
        if __name__ == "__main__":
            pieces = [Piece(str(n), (n, {str(tmp_path)!r})) for n in range(1000)]
            work = campaign_work.note_and_work_shortly
            list(engine.results(work, pieces, processes=2))
    """
    script = tmp_path / "program.py"
    script.write_text(textwrap.dedent(program))
    notes = tmp_path / "notes"
    notes.mkdir()
    path = os.pathsep.join([str(Path(campaign_work.__file__).parent), *sys.path])
    process = subprocess.Popen([sys.executable, script], env=os.environ | {"PYTHONPATH": path})
    wait_until(lambda: len(list(notes.iterdir())) == 2)
    workers = [int(note.name) for note in notes.iterdir()]
    assert all(map(is_running, workers))
    process.send_signal(signal.SIGKILL)
    process.wait()
    wait_until(lambda: not any(map(is_running, workers)), 20.0)
