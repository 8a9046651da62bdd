# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from neugrasp_ros.geometry.finger_joint import joint_at, opening_at
from neugrasp_ros.geometry.gripper import load_gripper

LINKAGE = load_gripper("robotiq_2f85")
SLIDE = replace(LINKAGE, tip_advance=0.0)


@pytest.mark.parametrize("gripper", [LINKAGE, SLIDE])
def test_there_and_back(gripper):
    for opening in np.linspace(0.0, gripper.max_opening, 9):
        joint = joint_at(gripper, float(opening))
        assert opening_at(gripper, joint) == pytest.approx(opening, abs=1e-9)


def test_open_is_zero_and_closed_is_where_the_2f85_stops():
    assert joint_at(LINKAGE, LINKAGE.max_opening) == pytest.approx(0.0, abs=1e-9)
    assert joint_at(LINKAGE, 0.0) == pytest.approx(0.79, abs=0.02)


def test_a_slide_counts_the_way_of_one_finger():
    assert joint_at(SLIDE, 0.0) == pytest.approx(SLIDE.max_opening / 2)


def test_beyond_its_ends_the_jaws_stay():
    assert opening_at(LINKAGE, -0.5) == LINKAGE.max_opening
    assert opening_at(LINKAGE, 2.0) == 0.0
