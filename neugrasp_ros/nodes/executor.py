# SPDX-License-Identifier: Apache-2.0
"""An executor of several threads whose end waits for the callbacks that run."""

import concurrent.futures
import threading
from collections.abc import Callable
from typing import Any

from rclpy.executors import MultiThreadedExecutor

DRAIN_TIME = 2.0  # [s] that callbacks get to end by themselves


class _Pool(concurrent.futures.ThreadPoolExecutor):
    """A thread pool that knows what it has not finished."""

    def __init__(self, threads: int) -> None:
        super().__init__(threads, thread_name_prefix="callback")
        self._unfinished: set[concurrent.futures.Future[Any]] = set()
        self._changing = threading.Lock()

    def submit(
        self, work: Callable[..., Any], /, *args: Any, **kwargs: Any
    ) -> "concurrent.futures.Future[Any]":
        """Run work in a thread."""
        future = super().submit(work, *args, **kwargs)
        with self._changing:
            self._unfinished.add(future)
        future.add_done_callback(self._forget)
        return future

    def _forget(self, future: "concurrent.futures.Future[Any]") -> None:
        with self._changing:
            self._unfinished.discard(future)

    def drain(self, timeout: float | None) -> bool:
        """Take nothing more; tell whether all that was taken has ended in time [s]."""
        self.shutdown(wait=False)
        with self._changing:
            left = set(self._unfinished)
        return not concurrent.futures.wait(left, timeout).not_done


class PatientExecutor(MultiThreadedExecutor):
    """Runs callbacks in threads, and ends them before what they use is gone.

    rclpy's own ``shutdown`` does not wait, although it says so: callbacks that still
    run find their handles destroyed. Nobody may spin it any more when it is ended.

    Args:
        num_threads: Callbacks that may run at once, at least 2.
        context: As of rclpy's executors.
    """

    def __init__(self, num_threads: int, **context: Any) -> None:
        super().__init__(num_threads, **context)
        self._executor = self._pool = _Pool(num_threads)
        self._draining = False

    @property
    def draining(self) -> bool:
        """Whether callbacks that wait should return: no more are taken."""
        return self._draining

    def drain(self, timeout: float = DRAIN_TIME) -> bool:
        """Take no more callbacks and wait for those taken, at most ``timeout`` [s].

        Returns:
            Whether all have ended.
        """
        self._draining = True
        return self._pool.drain(timeout)

    def shutdown(self, timeout_sec: float | None = DRAIN_TIME) -> bool:
        """Wait for the callbacks that run, then end; tell whether all have ended."""
        self._draining = True
        drained = self._pool.drain(timeout_sec)
        return bool(super().shutdown(timeout_sec)) and drained
