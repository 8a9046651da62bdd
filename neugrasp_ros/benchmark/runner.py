# SPDX-License-Identifier: Apache-2.0
"""Run the rounds of a suite, or probe its scenes, in one process or in several."""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import TypeVar

from neugrasp_ros.benchmark.probes import N_CANDIDATES, ProbeRecord, probe_scene
from neugrasp_ros.benchmark.protocol import Policy, Suite, Watcher, run_round
from neugrasp_ros.benchmark.records import RoundRecord
from neugrasp_ros.errors import SimulationError

Record = TypeVar("Record")
Setup = Callable[[], tuple[Policy, Watcher | None]]
"""Makes a policy, and who watches it; runs once in every worker, so it must pickle."""

_worker: dict[str, tuple[Policy, Watcher | None]] = {}


def run_suite(
    suite: Suite, indices: Sequence[int], setup: Setup, workers: int = 1
) -> Iterator[RoundRecord]:
    """Run rounds; see ``run_jobs``."""
    return run_jobs(run_round, suite, indices, setup, workers)


def run_probes(
    suite: Suite,
    indices: Sequence[int],
    setup: Setup,
    workers: int = 1,
    *,
    n_candidates: int = N_CANDIDATES,
) -> Iterator[ProbeRecord]:
    """Probe scenes with so many random candidates each; see ``run_jobs``."""
    work = partial(_probe, n_candidates=n_candidates)
    return run_jobs(work, suite, indices, setup, workers)


def _probe(
    suite: Suite, index: int, policy: Policy, _: Watcher | None, n_candidates: int
) -> ProbeRecord:
    return probe_scene(suite, index, policy, n_candidates=n_candidates)


def run_jobs(
    work: Callable[[Suite, int, Policy, Watcher | None], Record],
    suite: Suite,
    indices: Sequence[int],
    setup: Setup,
    workers: int = 1,
) -> Iterator[Record]:
    """Work on the rounds of a suite; the records do not depend on the workers.

    Args:
        work: Makes the record of one round; a function that processes can import.
        suite: What is benchmarked.
        indices: Numbers of the rounds.
        setup: Makes the policy in each worker.
        workers: Processes; 1 stays in this one.

    Yields:
        The records, in the order of the indices.

    Raises:
        SimulationError: If a worker dies.
    """
    if workers <= 1:
        policy, watch = setup()
        for index in indices:
            yield work(suite, index, policy, watch)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, _start_worker, (setup,)) as pool:
        try:
            jobs = [
                pool.submit(_run_in_worker, work, suite, index) for index in indices
            ]
            for job in jobs:
                yield job.result()
        except BrokenProcessPool as error:
            raise SimulationError("a benchmark worker died; see its output") from error


def _start_worker(setup: Setup) -> None:
    _worker["setup"] = setup()


def _run_in_worker(
    work: Callable[[Suite, int, Policy, Watcher | None], Record],
    suite: Suite,
    index: int,
) -> Record:
    policy, watch = _worker["setup"]
    return work(suite, index, policy, watch)
