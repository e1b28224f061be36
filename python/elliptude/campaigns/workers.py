"""Processes of this machine that work for this one.

Not `concurrent.futures.ProcessPoolExecutor`: if one of its processes dies, the work of the others is lost with it, and
it does not say which was to blame; if it dies while it hands over a result, the pool waits for ever. Here each process
has a pipe of its own, which ends when either side does.
"""

import multiprocessing
import signal
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any

from elliptude.campaigns.pieces import Failures, Piece
from elliptude.io.files import FileError

ATTEMPTS = 3
"""How often the process of one piece may die before the piece is given up."""
_AHEAD = 2
"""Pieces that a process is given at a time, so that it need not wait for this one."""


@dataclass(eq=False)
class _Worker:
    """A process, and the pieces that it has, the one that it works on first."""

    process: Any
    pipe: Connection
    pieces: deque[Piece] = field(default_factory=deque)

    def end(self) -> None:
        """End the process, whatever it does."""
        self.pipe.close()
        self.process.kill()
        self.process.join()


class Workers:
    """Some processes that call a function for pieces of work, with another one in the place of each that dies."""

    def __init__(self, function: Callable[..., Any], waiting: deque[Piece], processes: int) -> None:
        self.function, self.waiting, self.processes = function, waiting, processes
        self.workers: dict[Connection, _Worker] = {}
        self.deaths: Counter[str] = Counter()
        self.failures = Failures()
        self.has_result = False

    def results(self) -> Iterator[tuple[str, Any]]:
        """Name and result of each piece, as they are ready; FileError in the end if some failed."""
        try:
            while self._hand_out():
                for pipe in wait(self.workers):
                    assert isinstance(pipe, Connection)
                    worker = self.workers[pipe]
                    try:
                        is_done, result = pipe.recv()
                    except (EOFError, OSError):
                        self._bury(worker)
                        continue
                    piece = worker.pieces.popleft()
                    self._give(worker)
                    if is_done:
                        self.has_result = True
                        yield piece.name, result
                    else:
                        self.failures.add(piece, result)
        finally:
            for worker in self.workers.values():
                worker.end()
        self.failures.complain()

    def _hand_out(self) -> bool:
        """Give work to all; whether anything is left to be done."""
        while self.waiting and len(self.workers) < self.processes:
            worker = self._start()
            self.workers[worker.pipe] = worker
            self._give(worker)
        return any(worker.pieces for worker in self.workers.values())

    def _start(self) -> _Worker:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=_work, args=(theirs, self.function), daemon=True)
        with _interrupts_wait():
            process.start()
        # Theirs alone is left, and closes with them.
        theirs.close()
        return _Worker(process, ours)

    def _give(self, worker: _Worker) -> None:
        while self.waiting and len(worker.pieces) < _AHEAD:
            piece = self.waiting.popleft()
            worker.pieces.append(piece)
            try:
                worker.pipe.send(piece.arguments)
            except OSError:  # it is dead, which its pipe says next
                return

    def _bury(self, worker: _Worker) -> None:
        """Take back what a process had that has died; the first piece is to blame."""
        del self.workers[worker.pipe]
        worker.end()
        if worker.pieces:
            blamed = worker.pieces[0]
            self.deaths[blamed.name] += 1
            if self.deaths[blamed.name] >= ATTEMPTS:
                self.failures.add(worker.pieces.popleft(), f"its process died {ATTEMPTS} times")
        self.waiting.extendleft(reversed(worker.pieces))
        if not self.has_result and self.deaths.total() >= ATTEMPTS * self.processes:
            raise FileError(
                f"{self.deaths.total()} processes died before any result. A program that starts a campaign does so "
                "below if __name__ == '__main__'"
            )


@contextmanager
def _interrupts_wait() -> Iterator[None]:
    """Ctrl-C waits until the block ends; a process that starts within it never hears of it."""
    # The first process would start it, and starting it lets interrupts in again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _work(pipe: Connection, function: Callable[..., Any]) -> None:
    """Call a function for each set of arguments from a pipe, until that ends."""
    while True:
        try:
            arguments = pipe.recv()
        except (EOFError, OSError):
            return
        try:
            answer = (True, function(*arguments))
        except Exception as error:
            answer = (False, f"{type(error).__name__}: {error}")
        try:
            pipe.send(answer)
        except OSError:
            return
