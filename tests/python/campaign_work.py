"""Pieces of work for tests of the engine of campaigns: worker processes import them by name."""

import os
import signal
import time
from pathlib import Path


def square(number):
    return os.getpid(), number * number


def large(number):
    """More than a pipe holds, so that the worker waits until it is read."""
    return bytes(1 << 20) + bytes([number])


def die_at_three(number):
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return square(number)


def die_once(number, folder):
    """At piece 3, and only the first time."""
    marker = Path(folder) / "died"
    if number == 3 and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return square(number)


class Lost:
    """A result that kills the worker which is asked for it."""

    def __reduce__(self):
        os.kill(os.getpid(), signal.SIGKILL)


def die_with_the_result_and_fail_again(number, folder):
    """At piece 3."""
    if number != 3:
        return square(number)
    marker = Path(folder) / "died"
    if not marker.exists():
        marker.touch()
        return os.getpid(), Lost()
    raise ArithmeticError("3 again")


def die(number):
    os._exit(1)


def fail_at_odd(number):
    if number % 2:
        raise ArithmeticError(f"{number} is odd")
    return number


def note_and_work_shortly(number, folder):
    (Path(folder) / "notes" / f"{os.getpid()}").touch()
    time.sleep(0.2)


def wait_for_nannies(client, count):
    """Until so many of a Dask cluster watch their workers: one does not replace a worker that dies before."""
    client.wait_for_workers(count)
    while (watching := client.run(_status, nanny=True)) != dict.fromkeys(watching, "running"):
        time.sleep(0.01)


def _status(dask_worker):
    return dask_worker.status.name
