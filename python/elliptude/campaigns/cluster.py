"""A Dask cluster as an executor that says of every piece of work what became of it."""

import time
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import distributed

WITHOUT_WORKERS_S = 300.0
"""How long a cluster may be without any worker before work on it ends, s."""


class ClusterExecutor(Executor):
    """Submits work to a Dask client.

    Dask has such an executor, too. Its futures never end if a worker dies with a result that nobody has fetched yet
    and the piece then fails elsewhere: Dask raises that where nobody waits for it. Here a thread waits. Nor do they
    end if all workers have died for good, as they do when a piece kills each before its nanny watches it.

    Parameters
    ----------
    client : distributed.Client
        Stays open.
    """

    def __init__(self, client: "distributed.Client") -> None:
        self._client = client
        self._without_workers_since: float | None = None

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **options: Any) -> Future[Any]:
        """Have a worker call a function; each call is work of its own, also of the same arguments."""
        remote = self._client.submit(function, *arguments, **options, pure=False)
        local: Future[Any] = Future()

        def pass_on(_: object) -> None:
            try:
                result = remote.result()
            except CancelledError:
                local.cancel()
                local.set_running_or_notify_cancel()
            except Exception as error:
                local.set_exception(error)
            else:
                local.set_result(result)

        remote.add_done_callback(pass_on)
        local.add_done_callback(lambda _: remote.cancel() if local.cancelled() and not remote.done() else None)
        return local

    def require_worker(self) -> None:
        """Raise BrokenExecutor if the cluster has had no worker whenever this was asked, for too long."""
        try:
            has_worker = bool(self._client.nthreads())
        except OSError:  # no scheduler: Dask ends what waits for it
            has_worker = True
        now = time.monotonic()
        if has_worker:
            self._without_workers_since = None
        elif self._without_workers_since is None:
            self._without_workers_since = now
        elif now - self._without_workers_since > WITHOUT_WORKERS_S:
            raise BrokenExecutor(f"the cluster has had no worker for {WITHOUT_WORKERS_S:g} s")
