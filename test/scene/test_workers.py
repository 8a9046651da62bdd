# SPDX-License-Identifier: Apache-2.0
import os
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
import torch

from neugrasp_ros.scene.workers import shared, torch_threads, usual_threads


@pytest.mark.parametrize("threads", [1, 2])
def test_results_come_in_the_order_of_the_items(threads):
    assert shared(lambda n: n * n, range(7), threads) == [n * n for n in range(7)]
    assert shared(lambda n: n, [], threads) == []


def test_two_items_are_worked_on_at_the_same_time():
    both = threading.Barrier(2, timeout=10)
    assert sorted(shared(lambda _: both.wait(), [0, 1], 2)) == [0, 1]


@pytest.mark.parametrize("threads", [1, 2])
def test_each_call_has_one_thread_of_torch_and_no_gradients(threads):
    def run(_):
        return torch.get_num_threads(), torch.is_grad_enabled()

    before = torch.get_num_threads()
    with torch_threads(3), torch.enable_grad():
        assert shared(run, range(4), threads) == [(1, False)] * 4
        assert torch.get_num_threads() == 3
        assert torch.is_grad_enabled()
    assert torch.get_num_threads() == before


@pytest.mark.parametrize("threads", [2, 5])  # the second is a new pool
def test_a_pool_does_not_change_the_threads_that_come_after_it(threads):
    with torch_threads(3):
        shared(abs, range(6), threads)
        with ThreadPoolExecutor(1) as new:
            assert new.submit(torch.get_num_threads).result() == 3


@pytest.mark.parametrize(("asked", "count"), [("3", 3), ("4,2", 4), (" 2 ", 2)])
def test_the_usual_threads_are_those_of_the_environment(monkeypatch, asked, count):
    monkeypatch.setenv("OMP_NUM_THREADS", asked)
    with torch_threads(7):
        assert usual_threads() == count


@pytest.mark.parametrize("asked", ["", "0", "many"])
def test_the_usual_threads_are_else_as_many_as_cores(monkeypatch, asked):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 2, 5})
    monkeypatch.setenv("OMP_NUM_THREADS", asked)
    assert usual_threads() == 3


def test_an_error_comes_out_when_all_have_ended():
    ended = []

    def run(item):
        if item == 0:
            raise ValueError("the first")
        ended.append(item)

    with pytest.raises(ValueError, match="the first"):
        shared(run, range(6), 2)
    assert sorted(ended) == [1, 2, 3, 4, 5]


def test_the_threads_of_torch_come_back():
    before = torch.get_num_threads()
    with torch_threads(before + 1):
        assert torch.get_num_threads() == before + 1
    assert torch.get_num_threads() == before
