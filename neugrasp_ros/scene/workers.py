# SPDX-License-Identifier: Apache-2.0
"""Work shared among threads, each of which computes with one torch thread.

Torch's own threads divide every small operation and then wait for the next one in a
loop, which keeps a core from the compiled kernels. Whole pieces of work divide better.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import lru_cache
from typing import TypeVar

import torch

Item = TypeVar("Item")
Result = TypeVar("Result")


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Let torch divide the operations of this thread among ``count``, no gradients."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        with torch.no_grad():
            yield
    finally:
        torch.set_num_threads(before)


@lru_cache(maxsize=4)
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="neugrasp-worker")


def shared(
    run: Callable[[Item], Result], items: Sequence[Item], threads: int
) -> list[Result]:
    """Call ``run`` on each item, some at the same time, without gradients.

    All calls have ended when this returns or raises. A call must not share work itself.

    Args:
        run: What is done with an item; it may release Python's lock.
        items: In the order in which they are begun.
        threads: How many are worked on at the same time; 1 = here, one after another.

    Returns:
        What ``run`` returned, in the order of the items.
    """

    def alone(item: Item) -> Result:
        with torch_threads(1):
            return run(item)

    with torch_threads(1):
        if threads <= 1 or len(items) < 2:
            return [alone(item) for item in items]
        futures = [_pool(threads).submit(alone, item) for item in items]
        wait(futures)
        return [future.result() for future in futures]
