# SPDX-License-Identifier: Apache-2.0
import pytest
from bench_policies import setup_nothing

from neugrasp_ros.benchmark.protocol import Suite
from neugrasp_ros.benchmark.runner import run_suite

SUITE = Suite(scene="packed", count=1, protocol="strict", part="val")


@pytest.mark.slow
def test_records_do_not_depend_on_the_number_of_workers():
    alone = list(run_suite(SUITE, [3, 5], setup_nothing))
    shared = list(run_suite(SUITE, [3, 5], setup_nothing, workers=2))
    assert [record.index for record in alone] == [3, 5]
    assert alone == shared
