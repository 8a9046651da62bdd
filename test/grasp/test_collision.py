# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.geometry.finger_joint import tip_advance_at
from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.geometry.transform import apply, random_rotation, translation
from neugrasp_ros.grasp.collision import (
    approach_is_free,
    support_clearance,
)

PANDA = load_gripper("panda")
OPEN = np.array([PANDA.max_opening])
POSE = np.eye(4)[None]
LATERAL = (PANDA.max_opening + PANDA.finger_width) / 2


def free(point, opening=OPEN, **kwargs):
    return approach_is_free(POSE, opening, np.array([point]), PANDA, **kwargs)[0]


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((0.0, 0.0, -0.02), True),  # between the fingers
        ((0.0, LATERAL, -0.02), False),  # in the left finger
        ((0.0, -LATERAL, -0.02), False),  # in the right finger
        ((0.02, LATERAL, -0.02), True),  # beside the finger, in front of the palm
        ((0.0, 0.0, -0.06), False),  # in the palm
        ((0.0, LATERAL, -0.2), False),  # the finger came from there
        ((0.02, 0.0, -0.23), False),  # the palm came from there
        ((0.0, LATERAL, 0.01), True),  # beyond the tips
        ((0.0, 0.0, -0.3), True),  # behind the pre-grasp
    ],
)
def test_a_point_is_in_the_way_where_the_hand_passes(point, expected):
    assert free(point, inflation=0.0, retreat=0.1) == expected


def test_a_finger_moves_with_the_opening():
    assert free((0.0, 0.02, -0.02), inflation=0.0)
    assert not free((0.0, 0.02, -0.02), np.array([0.03]), inflation=0.0)


def test_inflation_reaches_past_the_boxes():
    point = (0.0, LATERAL, 0.0015)
    assert free(point, inflation=0.001)
    assert not free(point, inflation=0.002)


def test_clearance_is_that_of_the_lowest_corner():
    rng = np.random.default_rng(0)
    centers, half = PANDA.boxes()
    signs = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)]) * 2 - 1
    corners = (centers[:, None] + signs * half[:, None]).reshape(-1, 3)
    for _ in range(20):
        pose = translation(0.1, 0.2, 0.3)
        pose[:3, :3] = random_rotation(rng)
        expected = apply(pose, corners)[:, 2].min() - 0.05
        got = support_clearance(pose[None], OPEN, PANDA, 0.05)[0]
        assert got == pytest.approx(expected, abs=1e-12)


def test_tips_of_a_linkage_advance_as_they_close():
    robotiq = load_gripper("robotiq_2f85")
    openings = np.array([0.085, 0.06, 0.03, 0.011])
    advance = tip_advance_at(robotiq, openings)
    assert advance[0] == pytest.approx(0.0, abs=1e-12)
    assert (np.diff(advance) > 0).all()
    assert advance[-1] == pytest.approx(robotiq.tip_advance, abs=2e-4)
    assert (tip_advance_at(PANDA, openings) == 0.0).all()
