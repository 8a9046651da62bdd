# SPDX-License-Identifier: Apache-2.0
import threading

import pytest
import torch

from neugrasp_ros.scene.workers import shared, torch_threads


@pytest.mark.parametrize("threads", [1, 2])
def test_results_come_in_the_order_of_the_items(threads):
    assert shared(lambda n: n * n, range(7), threads) == [n * n for n in range(7)]
    assert shared(lambda n: n, [], threads) == []


def test_two_items_are_worked_on_at_the_same_time():
    both = threading.Barrier(2, timeout=10)
    assert sorted(shared(lambda _: both.wait(), [0, 1], 2)) == [0, 1]


@pytest.mark.parametrize("threads", [1, 2])
def test_each_call_has_one_thread_of_torch_and_no_gradients(threads):
    before = torch.get_num_threads()

    def run(_):
        return torch.get_num_threads(), torch.is_grad_enabled()

    assert shared(run, range(4), threads) == [(1, False)] * 4
    assert torch.get_num_threads() == before
    assert torch.is_grad_enabled()


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
