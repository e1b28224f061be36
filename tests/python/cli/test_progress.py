"""How far a command is, in a file and in a terminal."""

import io
import threading
import time

import pytest
from elliptude.cli import progress
from elliptude.cli.progress import progress_on, progress_with_time_left, steps
from rich.console import Console


@pytest.fixture
def soon(monkeypatch):
    """Lines every hundredth of a second."""
    monkeypatch.setattr(progress, "FIRST_LINE_S", 0.01)
    monkeypatch.setattr(progress, "LONGEST_WAIT_S", 0.01)


def until(happened):
    deadline = time.monotonic() + 60.0
    while not happened():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_file_gets_plain_lines_while_a_step_takes_long(soon):
    file = io.StringIO()
    with progress_on(Console(file=file), "{task.completed:,} rows") as shown:
        task = shown.add_task("Reading", total=None)
        shown.update(task, advance=12_000)
        until(lambda: file.getvalue().count("\n") >= 3)  # nothing is said by the work in the meantime
        shown.update(task, description="Estimating")
        until(lambda: "Estimating" in file.getvalue())
    lines = file.getvalue().splitlines()
    assert "Reading 12,000 rows, 0 s so far" in lines
    assert lines[-1].startswith("Estimating 12,000 rows, ")
    assert not set("\r\x1b") & set(file.getvalue())
    time.sleep(0.05)
    assert file.getvalue().splitlines() == lines  # it ends with the work


def test_waits_grow(monkeypatch):
    waits = []

    class Event:
        def wait(self, seconds):
            waits.append(seconds)
            return len(waits) > 8

        def clear(self):
            pass

        set = clear

    monkeypatch.setattr(threading, "Event", Event)
    shown = progress_on(Console(file=io.StringIO()))
    shown._write_lines()
    assert waits == [2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0, 60.0, 60.0]


def test_short_work_says_nothing():
    file = io.StringIO()
    with progress_on(Console(file=file)) as shown:
        shown.advance(shown.add_task("Reading", total=2))
    assert file.getvalue() == ""


def test_the_share_and_the_time_left(soon):
    file = io.StringIO()
    with progress_with_time_left(Console(file=file)) as shown:
        task = shown.add_task("Running", total=None)
        until(lambda: "\n" in file.getvalue())
        shown.update(task, completed=1, total=4)
        time.sleep(0.02)
        shown.update(task, completed=2)
        until(lambda: "50%" in file.getvalue())
        shown.update(task, completed=4)
        time.sleep(0.05)
    assert file.getvalue().startswith("Running, 0 s so far\n")
    assert "Running 50%, 0 s so far, " in file.getvalue()
    assert " left" in file.getvalue()
    assert "100%" not in file.getvalue()


def test_the_clock_ends_with_an_error(soon):
    shown = progress_on(Console(file=io.StringIO()))
    with pytest.raises(ValueError, match="at fault"), shown:
        raise ValueError("at fault")
    assert not any(one.name == "progress" for one in threading.enumerate())


@pytest.mark.parametrize(("seconds", "text"), [(0.4, "0 s"), (59.0, "59 s"), (61.0, "1:01"), (3723.0, "1:02:03")])
def test_times(seconds, text):
    assert progress._time(seconds) == text


def test_on_a_terminal_it_is_a_bar():
    assert type(progress_on(Console(file=io.StringIO(), force_terminal=True))).__name__ == "Progress"


def test_steps_are_counted_and_named(soon):
    """The share is that of the steps that are done."""
    file = io.StringIO()
    with steps(Console(file=file), 2) as step:
        step("Reading")
        until(lambda: "Reading (step 1 of 2) 0%" in file.getvalue())
        step("Judging")
        until(lambda: "Judging (step 2 of 2) 50%" in file.getvalue())


def test_a_single_step_has_no_number(soon):
    file = io.StringIO()
    with steps(Console(file=file), 1) as step:
        step("Checking")
        until(lambda: "Checking 0%" in file.getvalue())
    assert "step" not in file.getvalue()
