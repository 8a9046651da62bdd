# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from neugrasp_ros.geometry.finger_joint import tip_advance_at
from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.manipulation.closing import (
    CLEARANCE,
    RAISE,
    STEPS,
    least_opening,
    raised,
)
from neugrasp_ros.robot.obstacles import SolidBox

HAND = load_gripper("robotiq_2f85")
TOP = 0.70
TABLE = SolidBox(translation(0.5, 0.0, TOP - 0.015), np.array([0.6, 0.8, 0.03]))


def down_at(height, x=0.5):
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[:3, 3] = x, 0.0, TOP + height
    return T


@pytest.mark.parametrize("height", [0.003, 0.006, 0.010])
def test_the_tips_stop_a_millimetre_over_the_table(height):
    found = least_opening(HAND, down_at(height), [TABLE])
    step = HAND.max_opening / (STEPS - 1)
    room = height - CLEARANCE
    assert tip_advance_at(HAND, found) <= room
    assert tip_advance_at(HAND, found - 1.01 * step) > room


def tilted(tilt, width):
    """The lowest hand whose tips touch the table at a width, its jaws level."""
    c, s = np.cos(tilt), np.sin(tilt)
    T = np.eye(4)
    T[:3, :3] = np.stack([[c, 0.0, s], [0.0, -1.0, 0.0], [s, 0.0, -c]], axis=1)
    down = tip_advance_at(HAND, width) * c + HAND.finger_thickness / 2 * s
    T[:3, 3] = 0.5, 0.0, TOP + down
    return T


@pytest.mark.parametrize("tilt", np.deg2rad([0.0, 30.0, 57.0, 80.0]))
@pytest.mark.parametrize("width", [0.03, 0.045, 0.06, 0.07, 0.08])
def test_a_tilted_hand_gets_as_much_room(tilt, width):
    lowest = tilted(tilt, width)
    assert least_opening(HAND, lowest, [TABLE]) > 0.0
    T = raised(HAND, lowest, [TABLE])
    assert T[:3, 3] - lowest[:3, 3] == pytest.approx([0.0, 0.0, RAISE])
    assert least_opening(HAND, T, [TABLE]) < width - 0.002


def test_at_a_wall_the_hand_goes_back():
    wall = SolidBox(translation(0.55, 0.0, TOP), np.array([0.1, 2.0, 2.0]))
    T = tilted(np.pi / 2, 0.04)
    T[:3, 3] = 0.5 - float(tip_advance_at(HAND, 0.04)), 0.0, TOP
    moved = raised(HAND, T, [wall])
    assert moved[:3, 3] - T[:3, 3] == pytest.approx([-RAISE, 0.0, 0.0])
    assert least_opening(HAND, moved, [wall]) < 0.04 - 0.002


@pytest.mark.parametrize("width", [0.01, 0.03, 0.06])
def test_there_is_room_down_to_the_width_that_a_grasp_is_for(width):
    lowest = down_at(float(tip_advance_at(HAND, width)))  # as the sampler leaves it
    T = raised(HAND, lowest, [TABLE])
    assert T[:3, 3] - lowest[:3, 3] == pytest.approx([0.0, 0.0, RAISE])
    assert least_opening(HAND, T, [TABLE]) < width - 0.002


def test_a_grasp_with_room_stays_where_it_is():
    high = down_at(0.05)
    assert raised(HAND, high, [TABLE]) == pytest.approx(high)


def test_with_room_under_the_tips_the_jaws_may_close():
    assert least_opening(HAND, down_at(HAND.tip_advance + 0.002), [TABLE]) == 0.0
    assert least_opening(HAND, down_at(0.003), []) == 0.0
    assert least_opening(HAND, down_at(0.003, x=2.0), [TABLE]) == 0.0, "beside it"


def test_jaws_that_slide_do_not_advance():
    slide = replace(HAND, tip_advance=0.0)
    assert least_opening(slide, down_at(0.003), [TABLE]) == 0.0


def test_jaws_that_are_blocked_all_the_way_cannot_close():
    assert least_opening(HAND, down_at(-0.005), [TABLE]) == HAND.max_opening
