"""Runs pieces of work on this machine's cores, or on any executor: a cluster's, too.

What a piece gives does not depend on who works, and each comes back once. One that fails is named in the end, after the
others are done.
"""

import os
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from typing import TYPE_CHECKING, Any

from elliptude.campaigns.cluster import ClusterExecutor
from elliptude.campaigns.pieces import Failures, Piece
from elliptude.campaigns.workers import Workers
from elliptude.io.files import FileError

if TYPE_CHECKING:
    import distributed

AT_ONCE = 1000
"""How many pieces an executor is given at a time: more than a cluster has workers."""


def cores() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0))


def require_workers(executor: object, processes: int | None) -> None:
    """Raise TypeError or ValueError unless `results` takes these."""
    kind = type(executor)
    if kind.__module__.startswith("distributed.") and kind.__name__ == "ClientExecutor":
        raise TypeError(
            "executor: Dask's ClientExecutor waits for ever for a result that was lost; give the client itself"
        )
    if executor is not None and not isinstance(executor, Executor) and not _is_dask_client(executor):
        raise TypeError(
            f"executor: a {kind.__name__} is neither a concurrent.futures.Executor nor a distributed.Client"
        )
    if processes is not None and processes < 1:
        raise ValueError(f"processes: {processes} is not at least 1")


def _is_dask_client(executor: object) -> bool:
    kinds = type(executor).__mro__
    return any(kind.__module__ == "distributed.client" and kind.__name__ == "Client" for kind in kinds)


def results(
    function: Callable[..., Any],
    pieces: Iterable[Piece],
    *,
    executor: "Executor | distributed.Client | None" = None,
    processes: int | None = None,
) -> Generator[tuple[str, Any], None, None]:
    """Call a function for each piece of work.

    Parameters
    ----------
    function : callable
        Importable by its name, as workers are other processes.
    pieces : iterable of Piece
        Their names differ.
    executor : concurrent.futures.Executor or distributed.Client, optional
        Who works. It stays open. If left out, processes of this machine, which end with this call.
    processes : int, optional
        How many of these; one for each core if left out. A single one is this process.

    Yields
    ------
    name : str
    result
        What the function returned, in the order in which it is ready.

    Raises
    ------
    FileError
        After all others are done, if pieces failed, naming them; at once if the executor is broken, or if so many
        fail that the fault is elsewhere.
    """
    waiting = deque(pieces)
    processes = min(cores() if processes is None else processes, len(waiting))
    if executor is not None:
        workers = executor if isinstance(executor, Executor) else ClusterExecutor(executor)
        yield from _on_executor(function, waiting, workers)
    elif processes > 1:
        yield from Workers(function, waiting, processes).results()
    else:
        yield from _here(function, waiting)


def _here(function: Callable[..., Any], pieces: Iterable[Piece]) -> Iterator[tuple[str, Any]]:
    failures = Failures()
    for piece in pieces:
        try:
            result = function(*piece.arguments)
        except Exception as error:
            failures.add(piece, _reason(error))
            continue
        yield piece.name, result
    failures.complain()


def _on_executor(function: Callable[..., Any], waiting: deque[Piece], executor: Executor) -> Iterator[tuple[str, Any]]:
    running: dict[Future[Any], Piece] = {}
    suspects: deque[Piece] = deque()  # Dask blames what waits on a worker that dies, too: alone, it is seen who kills
    failures = Failures()
    try:
        while waiting or running or suspects:
            are_alone = not waiting and not running
            source, most = (suspects, 1) if are_alone else (waiting, AT_ONCE)
            while source and len(running) < most:
                running[executor.submit(function, *source[0].arguments)] = source[0]
                source.popleft()
            for future in _done(running, executor):
                piece = running.pop(future)
                try:
                    result = future.result()
                except (BrokenExecutor, CancelledError):
                    raise
                except Exception as error:
                    if type(error).__name__ == "KilledWorker" and not are_alone:
                        suspects.append(piece)
                    else:
                        failures.add(piece, _reason(error))
                    continue
                yield piece.name, result
    except (BrokenExecutor, CancelledError) as error:
        raise FileError(f"the executor has broken ({_reason(error)}); the same command goes on from there") from error
    finally:
        for future in running:
            future.cancel()
    failures.complain()


def _done(running: Iterable[Future[Any]], executor: Executor) -> set[Future[Any]]:
    """Those that are done, as soon as any is; BrokenExecutor if a cluster has lost its workers for good."""
    while not (done := wait(running, timeout=1.0, return_when=FIRST_COMPLETED).done):
        if isinstance(executor, ClusterExecutor):
            executor.require_worker()
    return done


def _reason(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}"
