# SPDX-License-Identifier: Apache-2.0
"""Hands are turned and stretched with the scenes that they are in."""

import numpy as np
import pytest

from neugrasp_ros.training.hands import drawn_hands, turned_axes, twinned, unknown_hand
from neugrasp_ros.training.occupancy import turn_points
from neugrasp_ros.training.stretching import (
    draw_stretch,
    stretched_axes,
    stretched_points,
)

AXES = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0][None]
AXES = AXES.astype(np.float32)
CENTER = np.float32([[0.3, 0.6, 0.4]])


@pytest.mark.parametrize("turn", range(8))
def test_an_axis_points_where_a_turned_point_on_it_is(turn):
    ends = CENTER + 0.1 * AXES[0].T  # one on each axis
    there = turn_points(ends, turn) - turn_points(CENTER, turn)
    np.testing.assert_allclose(there.T, 0.1 * turned_axes(AXES, turn)[0], atol=1e-6)


def test_an_axis_points_where_a_stretched_point_on_it_is():
    stretch = draw_stretch(np.random.default_rng(1), spread=0.1)
    ends = CENTER + 0.1 * AXES[0].T
    there = stretched_points(ends, stretch) - stretched_points(CENTER, stretch)
    np.testing.assert_allclose(
        there.T, 0.1 * stretched_axes(AXES, stretch)[0], atol=1e-6
    )


def test_a_twin_keeps_its_approach():
    many = np.repeat(AXES, 200, axis=0)
    twins = twinned(many, np.random.default_rng(0))
    np.testing.assert_array_equal(twins[..., 2], many[..., 2])
    signs = twins[..., :2] / many[..., :2]
    np.testing.assert_array_equal(signs[..., 0], signs[..., 1])
    assert 60 < (signs[:, 0, 0] < 0).sum() < 140


def test_a_scene_without_hands_gives_some_that_are_not_known():
    hands = drawn_hands(unknown_hand(3), 5, np.random.default_rng(0))
    assert hands.centers.shape == (5, 3)
    assert not hands.known.any()
