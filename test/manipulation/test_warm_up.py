# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.manipulation.mover import ArmMover, Surroundings
from neugrasp_ros.manipulation.warm_up import try_once
from neugrasp_ros.robot.attachment import CarriedBox
from neugrasp_ros.robot.contact import path_contacts
from neugrasp_ros.robot.ik import follow_batch
from neugrasp_ros.robot.model import load_robot
from neugrasp_ros.robot.obstacles import make_obstacles
from neugrasp_ros.robot.postures import solve_batch
from neugrasp_ros.robot.reachability import ReachabilityChecker
from neugrasp_ros.robot.search import search_ways

KERNELS = (path_contacts, follow_batch, search_ways, solve_batch)


@pytest.fixture(scope="module")
def mover():
    return ArmMover(ReachabilityChecker(load_robot("tiago_dual")))


def signatures():
    return [set(kernel.signatures) for kernel in KERNELS]


def test_nothing_is_compiled_for_what_comes_after_it(mover):
    try_once(mover)
    before = signatures()
    assert all(before)
    q, arm = mover.robot.home, "arm_right_torso"
    own = q[mover.robot.group_indices(arm)]
    around = Surroundings(np.array([[0.9, 0.2, 0.8]]))
    T = mover.hand_pose(q, arm)
    mover.plan_shift(q, arm, np.array([0.0, 0.0, 0.02]))
    mover.is_free(q, arm, own, around)
    mover.is_free(q, arm, own, around, CarriedBox(np.zeros(3), np.full(3, 0.04)))
    mover.checker.check(
        T[None], arms=[arm], start=q, obstacles=make_obstacles(around.points)
    )
    assert signatures() == before
