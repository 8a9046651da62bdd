# SPDX-License-Identifier: Apache-2.0
import pytest

from neugrasp_ros.nodes.pace import BATCH, FIRST, Pace


def scored(
    budget: float | None, cost: float, candidates: int
) -> tuple[list[int], float]:
    """Score with a clock of its own; return batches and when that ended."""
    now = [5.0]
    pace = Pace(None if budget is None else 5.0 + budget, lambda: now[0])
    batches: list[int] = []
    while candidates > sum(batches) and (n := pace.next(candidates - sum(batches))):
        batches.append(n)
        now[0] += cost * n
    return batches, now[0] - 5.0


def test_without_a_budget_batches_are_large():
    assert scored(None, 1.0, 2 * BATCH + 5)[0] == [BATCH, BATCH, 5]


def test_all_is_scored_where_the_budget_allows_it():
    assert scored(10.0, 0.001, 300)[0] == [FIRST, BATCH, BATCH, 300 - FIRST - 2 * BATCH]


@pytest.mark.parametrize("budget", [0.05, 0.11, 0.2, 0.33])
def test_an_even_cost_fills_the_budget_and_does_not_overrun_it(budget):
    cost = 0.001
    batches, spent = scored(budget, cost, 1000)
    assert budget - 2 * cost < spent <= budget + 1e-9
    assert sum(batches) == pytest.approx(budget / cost, abs=2)


def test_the_first_batch_is_scored_however_short_the_budget():
    batches, spent = scored(0.001, 0.01, 100)
    assert batches == [FIRST]
    assert spent == pytest.approx(0.01 * FIRST)


def test_fewer_candidates_than_a_batch_are_one_batch():
    assert scored(0.001, 0.01, 7)[0] == [7]
    assert scored(0.001, 0.01, 0)[0] == []


def test_a_batch_dearer_than_the_one_before_is_the_only_overrun():
    now, costs = [0.0], iter([0.001, 0.002, 0.002])
    pace = Pace(0.1, lambda: now[0])
    left = 500
    while n := pace.next(left):
        left -= n
        now[0] += n * next(costs)
    # 32 took 32 ms, so 68 were begun with 68 ms left and took twice as long
    assert 500 - left == 100
    assert now[0] == pytest.approx(0.032 + 68 * 0.002)
