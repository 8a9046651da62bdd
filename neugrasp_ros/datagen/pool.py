# SPDX-License-Identifier: Apache-2.0
"""Run jobs in processes of which any may die without hurting the others.

A pool of the standard library is lost as a whole when one of its processes crashes, as
a physics engine given a bad mesh may make it. Here each process has its own pipe: when
it dies, its one job is reported as failed and a new process takes its place.
"""

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from typing import Any, NamedTuple

from neugrasp_ros.errors import NeuGraspError

Work = Callable[[Any], Any]


class Outcome(NamedTuple):
    """What became of a job.

    Attributes:
        job: The job.
        result: What the work returned; None if it failed.
        error: Why it failed; empty if it did not.
    """

    job: Any
    result: Any
    error: str


def attempt(work: Work, job: Any) -> Outcome:
    """Do a job; errors that a bad object or file causes become a failed outcome."""
    try:
        return Outcome(job, work(job), "")
    except (NeuGraspError, OSError, ValueError, ArithmeticError) as error:
        return Outcome(job, None, f"{type(error).__name__}: {error}")


def _serve(work: Work, pipe: Connection) -> None:
    try:
        while (job := pipe.recv()) is not None:
            pipe.send(attempt(work, job))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return  # whoever asked is gone, and nobody else wants the result


class _Worker:
    """One process, its pipe, and the job that it is busy with."""

    def __init__(self, work: Work) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(work, theirs), daemon=True)
        self.process.start()
        theirs.close()  # so that the pipe breaks when the process dies
        self.job: Any = None

    def give(self, job: Any) -> None:
        """Send a job, None to end."""
        self.job = job
        self.pipe.send(job)

    def collect(self) -> Outcome:
        """Receive the outcome of its job, or learn that the process has died."""
        try:
            outcome: Outcome = self.pipe.recv()
        except (EOFError, ConnectionResetError):
            self.process.join()
            code = self.process.exitcode
            outcome = Outcome(self.job, None, f"the worker died with exit code {code}")
        self.job = None
        return outcome

    def is_alive(self) -> bool:
        """Tell whether the process runs."""
        return self.process.is_alive()

    def stop(self) -> None:
        """End the process, at once if it is busy."""
        if self.job is None and self.process.is_alive():
            self.give(None)
            self.process.join(timeout=5.0)
        self.process.terminate()
        self.process.join()
        self.pipe.close()


def run_local(work: Work, jobs: Sequence[Any], n_workers: int) -> Iterator[Outcome]:
    """Do jobs in processes of this machine; yield outcomes as they come.

    Args:
        work: Function of a module, for it is sent to the processes by name.
        jobs: Its arguments.
        n_workers: Processes; 0 works in this one.

    Yields:
        One outcome per job, in the order in which they end.
    """
    if n_workers == 0:
        for job in jobs:
            yield attempt(work, job)
        return
    waiting = list(reversed(jobs))
    workers = [_Worker(work) for _ in range(min(n_workers, len(jobs)))]
    try:
        for worker in workers:
            worker.give(waiting.pop())
        while busy := {w.pipe: w for w in workers if w.job is not None}:
            for pipe in wait(list(busy)):
                worker = busy[pipe]  # type: ignore[index]
                yield worker.collect()
                if not worker.is_alive():
                    workers.remove(worker)
                    worker.stop()
                    worker = _Worker(work)
                    workers.append(worker)
                if waiting:
                    worker.give(waiting.pop())
    finally:
        for worker in workers:
            worker.stop()


@contextmanager
def process_pool(n_workers: int) -> Iterator[ProcessPoolExecutor]:
    """Return processes for work that crashes none of them; for the rest, ``run_local``.

    What has not begun is dropped when the block ends with an error, and the processes
    end at once when the one that started them is killed, instead of working through
    the queue that it left.

    Args:
        n_workers: Processes.
    """
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(
        max(1, n_workers), mp_context=context, initializer=_end_with_parent
    ) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _end_with_parent() -> None:
    """Make this process end when the one that started it is gone."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, name="watch_parent", daemon=True).start()


def run_dask(work: Work, jobs: Sequence[Any], address: str) -> Iterator[Outcome]:
    """Do jobs on a Dask cluster, whose scheduler runs at ``address``.

    Every machine needs this package and the object files at the same paths. Dask
    itself repeats the jobs of a worker that died, and gives up a job that kills three.

    Yields:
        One outcome per job, in the order in which they end.
    """
    from distributed import Client, KilledWorker, as_completed

    with Client(address) as client:
        futures = {client.submit(attempt, work, job, pure=False): job for job in jobs}
        for future in as_completed(list(futures)):
            job = futures.pop(future)
            try:
                yield future.result()
            except KilledWorker as error:
                yield Outcome(job, None, f"it killed several workers: {error}")
