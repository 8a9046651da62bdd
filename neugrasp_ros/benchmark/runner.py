# SPDX-License-Identifier: Apache-2.0
"""Run the rounds of a suite, in this process or in several."""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

from neugrasp_ros.benchmark.protocol import Policy, Suite, Watcher, run_round
from neugrasp_ros.benchmark.records import RoundRecord
from neugrasp_ros.errors import SimulationError

Setup = Callable[[], tuple[Policy, Watcher | None]]
"""Makes a policy, and who watches it; runs once in every worker, so it must pickle."""

_worker: dict[str, tuple[Policy, Watcher | None]] = {}


def run_suite(
    suite: Suite, indices: Sequence[int], setup: Setup, workers: int = 1
) -> Iterator[RoundRecord]:
    """Run rounds; their records do not depend on the number of workers.

    Args:
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
            yield run_round(suite, index, policy, watch)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, _start_worker, (setup,)) as pool:
        try:
            jobs = [pool.submit(_run_in_worker, suite, index) for index in indices]
            for job in jobs:
                yield job.result()
        except BrokenProcessPool as error:
            raise SimulationError("a benchmark worker died; see its output") from error


def _start_worker(setup: Setup) -> None:
    _worker["setup"] = setup()


def _run_in_worker(suite: Suite, index: int) -> RoundRecord:
    policy, watch = _worker["setup"]
    return run_round(suite, index, policy, watch)
