"""A Dask cluster as an executor that says of every piece of work what became of it."""

from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import distributed


class ClusterExecutor(Executor):
    """Submits work to a Dask client.

    Dask has such an executor, too. Its futures never end if a worker dies with a result that nobody has fetched yet
    and the piece then fails elsewhere: Dask raises that where nobody waits for it. Here a thread waits.

    Parameters
    ----------
    client : distributed.Client
        Stays open.
    """

    def __init__(self, client: "distributed.Client") -> None:
        self._client = client

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
