# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import MotionError
from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.manipulation.escape import plan_escape
from neugrasp_ros.manipulation.mover import Surroundings
from neugrasp_ros.robot.obstacles import SolidBox

BOXES = (SolidBox(translation(0.6, 0.0, 1.3), np.array([0.4, 0.8, 0.03])),)
AROUND = Surroundings(np.array([[0.6, 0.0, 0.8]]), boxes=BOXES)


class Mover:
    """Plans shifts, which are their own motions."""

    def __init__(self, reaches=lambda shift: True, free=lambda shift: True):
        self._reaches, self._free = reaches, free
        self.asked = []

    def plan_shift(self, q, arm, shift):
        if not self._reaches(shift):
            raise MotionError("the arm follows the line for 8 of 10 poses")
        return shift.tolist()

    def leads_free(self, q, arm, motion, around, carried):
        self.asked.append((around, carried))
        return self._free(motion)


def escape(mover):
    return plan_escape(mover, np.zeros(3), "arm", 0.1, around=AROUND, carried="mug")


def test_up_comes_first_and_known_boxes_are_all_that_counts():
    mover = Mover()
    assert escape(mover) == [0.0, 0.0, 0.1]
    (around, carried), *more = mover.asked
    assert not more and carried == "mug"
    assert around.boxes == BOXES and not len(around.points)


def test_under_a_board_the_hand_goes_out_towards_the_robot():
    assert escape(Mover(free=lambda motion: motion[2] == 0.0)) == [-0.1, 0.0, 0.0]


def test_where_the_arm_reaches_no_farther_half_the_way_will_do():
    short = Mover(reaches=lambda shift: np.linalg.norm(shift) < 0.06)
    assert escape(short) == [0.0, 0.0, 0.05]


def test_a_hand_that_cannot_get_out_says_why():
    stuck = Mover(lambda shift: shift[2] > 0.0, lambda motion: False)
    with pytest.raises(MotionError, match=r"8 of 10.*it leads into a box"):
        escape(stuck)
