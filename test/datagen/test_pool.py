# SPDX-License-Identifier: Apache-2.0
import os
import subprocess
import sys
import time

import pytest
from label_work import square_or_die

from neugrasp_ros.datagen.pool import attempt, process_pool, run_dask, run_local

LONG_QUEUE = """
import multiprocessing, time
from neugrasp_ros.datagen.pool import process_pool
with process_pool(2) as pool:
    jobs = [pool.submit(time.sleep, 0.5) for _ in range(500)]
    jobs[3].result()
    print(*(child.pid for child in multiprocessing.active_children()), flush=True)
    jobs[-1].result()
"""


@pytest.mark.slow
def test_a_dead_process_loses_only_its_job():
    outcomes = {o.job: o for o in run_local(square_or_die, range(6), 2)}
    assert {job: o.result for job, o in outcomes.items() if not o.error} == {
        0: 0, 1: 1, 4: 16, 5: 25
    }  # fmt: skip
    assert "exit code 7" in outcomes[2].error
    assert "three is refused" in outcomes[3].error


def test_work_can_stay_in_this_process():
    outcomes = list(run_local(square_or_die, [4, 3, 5], 0))
    assert [o.result for o in outcomes] == [16, None, 25]


def test_errors_of_the_program_are_not_hidden():
    with pytest.raises(TypeError):
        attempt(square_or_die, "text")


def test_the_workers_of_a_killed_process_do_not_work_through_its_queue():
    owner = subprocess.Popen(
        [sys.executable, "-c", LONG_QUEUE], stdout=subprocess.PIPE, text=True
    )
    assert owner.stdout is not None
    workers = [int(pid) for pid in owner.stdout.readline().split()]
    assert len(workers) == 2 and all(map(_is_alive, workers))
    owner.kill()
    owner.communicate()
    deadline = time.monotonic() + 30.0  # the queue alone would take four times that
    while any(map(_is_alive, workers)):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_an_error_drops_what_has_not_begun():
    start = time.monotonic()
    with pytest.raises(ValueError, match="enough"), process_pool(1) as pool:
        for _ in range(500):
            pool.submit(time.sleep, 0.2)
        raise ValueError("enough")
    assert time.monotonic() - start < 60.0


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    with open(f"/proc/{pid}/stat") as file:  # a dead one that nobody has fetched
        return file.read().rpartition(")")[2].split()[0] != "Z"


def test_dask_does_the_same_work():
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        outcomes = run_dask(square_or_die, [3, 4, 5], cluster.scheduler_address)
        results = {o.job: (o.result, bool(o.error)) for o in outcomes}
    assert results == {3: (None, True), 4: (16, False), 5: (25, False)}
