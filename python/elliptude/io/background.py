"""Work that is done while other work is done: NumPy, Arrow and the core let other threads run."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")


def ahead(items: Iterator[Item]) -> Iterator[Item]:
    """The same items, the next one being made in the background while one is worked on.

    Parameters
    ----------
    items : iterator
        What it raises is raised here, where its next item would be.

    Yields
    ------
    item
    """
    end = object()
    with ThreadPoolExecutor(1) as pool:
        pending = pool.submit(next, items, end)
        while (item := pending.result()) is not end:
            pending = pool.submit(next, items, end)
            yield item  # type: ignore[misc]
