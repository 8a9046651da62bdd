# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import torch
from torch.nn.functional import binary_cross_entropy_with_logits

from neugrasp_ros.training.losses import (
    affordance_loss,
    focal_loss,
    known_entropy,
    overlap_loss,
)

TARGETS = torch.tensor([[1.0, 0.0], [0.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
ALL = torch.ones(4, dtype=torch.bool)


def logits_of(p: float) -> float:
    return float(np.log(p / (1 - p)))


def test_a_perfect_answer_costs_nothing():
    logits = 40.0 * (2 * TARGETS - 1)
    assert affordance_loss(logits, TARGETS, ALL) == pytest.approx(0.0, abs=1e-5)


def test_an_even_answer_costs_log_two_and_half_a_dice():
    # p = 1/2, t = 1 for half: S(pt) = n/4, S(p+t) = n, twice: dice = 1 - 1/4 - 1/4
    loss = affordance_loss(torch.zeros(4, 2), TARGETS, ALL)
    assert loss == pytest.approx(2 * (np.log(2) + 0.5), rel=1e-5)


def test_one_grasp_costs_what_the_formula_says():
    p = 0.8
    loss = affordance_loss(torch.tensor([[logits_of(p)]]), torch.ones(1, 1), ALL[:1])
    # no negative: the second quotient is (0 + e) / (1 - p + e)
    assert loss == pytest.approx(-np.log(p) + 1 - p / (1 + p), rel=1e-4)


def test_what_is_not_known_counts_in_neither_term():
    known = torch.tensor([True, False, True, True])
    logits = torch.tensor([[1.0, -2.0], [0.0, 0.0], [0.3, 0.1], [-1.0, 2.0]])
    loss = affordance_loss(logits, TARGETS, known)
    torch.testing.assert_close(
        loss, affordance_loss(logits[known], TARGETS[known], ALL[:3])
    )
    wild = logits.clone()
    wild[1] = torch.tensor([50.0, -50.0])
    torch.testing.assert_close(affordance_loss(wild, TARGETS, known), loss)


def test_entropy_counts_rows_that_are_known():
    known = torch.tensor([True, False, True, True])
    logits = torch.randn(
        4, TARGETS.shape[1], generator=torch.Generator().manual_seed(1)
    )
    expected = binary_cross_entropy_with_logits(logits[known], TARGETS[known])
    torch.testing.assert_close(known_entropy(logits, TARGETS, known), expected)
    column = known_entropy(logits[:, 0], TARGETS[:, 0], known)
    expected = binary_cross_entropy_with_logits(logits[known, 0], TARGETS[known, 0])
    torch.testing.assert_close(column, expected)
    assert known_entropy(logits, TARGETS, known & False) == 0.0


def test_nothing_known_costs_nothing_and_pulls_nowhere():
    logits = torch.randn(4, 2, requires_grad=True)
    loss = affordance_loss(logits, TARGETS, ~ALL)
    loss.backward()
    assert loss == 0.0
    assert torch.equal(logits.grad, torch.zeros(4, 2))


def test_a_class_without_positives_stays_finite():
    logits = torch.full((4, 1), -30.0, requires_grad=True)
    loss = affordance_loss(logits, torch.zeros(4, 1), ALL)
    loss.backward()
    assert torch.isfinite(loss)
    assert logits.grad.abs().max() < 1.0


def test_the_overlap_is_what_both_fill_over_what_either_fills():
    occupied = torch.zeros(2, 100)
    occupied[:, :40] = 1
    logits = torch.full((2, 100), -40.0)
    logits[0, :40] = 40.0  # all of it
    logits[1, 20:60] = 40.0  # half of it, and as much beside it
    every = torch.ones(2, 100, dtype=torch.bool)
    lost = overlap_loss(logits, occupied, every)
    assert lost == pytest.approx((0 + 1 - 21 / 61) / 2, abs=1e-4)


def test_only_points_that_count_overlap():
    occupied = torch.tensor([[1.0, 1.0, 0.0, 0.0]])
    logits = torch.tensor([[40.0, -40.0, -40.0, 40.0]])
    counted = torch.tensor([[True, False, True, False]])
    assert overlap_loss(logits, occupied, counted) == pytest.approx(0, abs=1e-4)


def test_the_focal_loss_is_its_formula():
    logits = torch.tensor([[0.0, 2.0], [-1.0, 3.0]])
    targets = torch.tensor([[1.0, 0.0], [0.0, 1.0]])
    right = torch.where(targets > 0, logits, -logits).sigmoid()
    wanted = (-((1 - right) ** 2) * right.log()).sum(dim=1).mean()
    torch.testing.assert_close(focal_loss(logits, targets), wanted)
