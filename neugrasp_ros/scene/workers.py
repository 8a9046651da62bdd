# SPDX-License-Identifier: Apache-2.0
"""Work shared among threads, each of which computes with one torch thread.

Torch's own threads divide every small operation and then wait for the next one in a
loop, which keeps a core from the compiled kernels. Whole pieces of work divide better.
"""

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import lru_cache
from typing import TypeVar

import torch

Item = TypeVar("Item")
Result = TypeVar("Result")


def usual_threads() -> int:
    """Return ``OMP_NUM_THREADS`` where it is set, else the cores of this process.

    Torch's own number is no answer: while another thread is within ``torch_threads``, a
    thread that asks for the first time is told that one's, and keeps it.
    """
    asked = os.environ.get("OMP_NUM_THREADS", "").split(",")[0].strip()
    if asked.isdecimal() and int(asked) > 0:
        return int(asked)
    return len(os.sched_getaffinity(0))


def use_threads(count: int) -> None:
    """Let the networks of this process use ``count`` threads."""
    torch.set_num_threads(count)


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
    """Return workers that have one torch thread each, for good; all have begun.

    Torch's number also becomes that of threads to come, so whoever asks for a pool must
    be within ``torch_threads``, which puts that back afterwards.
    """
    pool = ThreadPoolExecutor(
        threads, "neugrasp-worker", torch.set_num_threads, initargs=(1,)
    )
    begun = threading.Barrier(threads)
    wait([pool.submit(begun.wait) for _ in range(threads)])
    return pool


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
        with torch.no_grad():
            return run(item)

    with torch_threads(1):
        if threads <= 1 or len(items) < 2:
            return [run(item) for item in items]
        futures = [_pool(threads).submit(alone, item) for item in items]
        wait(futures)
        return [future.result() for future in futures]
