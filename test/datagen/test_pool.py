# SPDX-License-Identifier: Apache-2.0
import pytest
from label_work import square_or_die

from neugrasp_ros.datagen.pool import attempt, run_dask, run_local


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


def test_dask_does_the_same_work():
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        outcomes = run_dask(square_or_die, [3, 4, 5], cluster.scheduler_address)
        results = {o.job: (o.result, bool(o.error)) for o in outcomes}
    assert results == {3: (None, True), 4: (16, False), 5: (25, False)}
