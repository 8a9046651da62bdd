# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.geometry.transform import make_transform
from neugrasp_ros.robot.contact import FREE, HAND, SCENE
from neugrasp_ros.robot.model import tcp_from_gripper
from neugrasp_ros.robot.obstacles import make_obstacles
from neugrasp_ros.robot.ways import (
    BROKEN,
    UNTRIED,
    WayProblem,
    Ways,
    no_answers,
    try_ways,
)

LEFT = "arm_left_torso"
DOWN = np.diag([-1.0, 1.0, -1.0])  # approach downwards, closing along y
STEPS = np.array([0.03, 0.06, 0.10])  # [m]
GRASP = make_transform(DOWN, np.array([0.6, 0.2, 0.80]))


PALM = np.array([[0.034, 0.052, -0.06, 1.0]]) @ GRASP.T  # its corner
ABOVE = PALM[:, :3] + [0, 0, 0.10]  # at no link, until the hand comes up


@pytest.fixture(scope="module")
def posture(reach):
    answer = reach.check(GRASP[None], arms=[LEFT])
    assert answer.reachable[0] and not answer.flipped[0]
    return answer.approach[0, -1:]


def walk(reach, q, points=None, *, back=STEPS, up=STEPS, closed=None, **options):
    """Try one way, the approach being from straight above."""
    arm = reach.arms[LEFT]
    problem = WayProblem(
        world=reach.collisions.world(make_obstacles(points)),
        scope=reach.collisions.scope(LEFT),
        joints=arm.indices,
        ik=arm.problem,
        **{"max_change": 0.5, "held_radius": 0.0, **options},
    )
    behind, above = (
        GRASP[None, None, :3, 3] + np.asarray(steps)[None, :, None] * [0, 0, 1]
        for steps in (back, up)
    )
    one, target = np.zeros(1, dtype=np.int64), tcp_from_gripper(GRASP[None])
    ways = Ways(one, one, reach.robot.home[None], q, target, behind, above)
    answers = no_answers(ways)
    closed = np.zeros(1, dtype=bool) if closed is None else closed
    try_ways((problem,), ways, closed, answers)
    return answers


def test_a_free_way_goes_back_and_up(reach, left, posture):
    answers = walk(reach, posture)
    assert (answers.at_grasp[0], answers.on_way[0]) == (FREE, FREE)
    for way in (answers.retreats[0], answers.lifts[0]):
        reached = left.forward(way)
        assert reached[:, :3, 3] - GRASP[:3, 3] == pytest.approx(
            np.outer(STEPS, [0, 0, 1]), abs=1e-4
        )
        assert reached[:, :3, :3] == pytest.approx(np.array([DOWN] * 3), abs=1e-4)


def test_contact_at_the_grasp_is_told_from_contact_on_the_way(reach, posture):
    assert walk(reach, posture, PALM[:, :3]).at_grasp[0] == HAND
    above = walk(reach, posture, ABOVE)
    assert (above.at_grasp[0], above.on_way[0]) == (FREE, HAND)


def test_what_is_near_the_tcp_travels_with_the_hand_in_the_lift_only(reach, posture):
    point, still = ABOVE, np.array([0.001])
    assert walk(reach, posture, point, back=still).on_way[0] == HAND
    assert walk(reach, posture, point, back=still, held_radius=0.2).on_way[0] == FREE
    assert walk(reach, posture, point, held_radius=0.2).on_way[0] == HAND


def test_a_line_that_the_arm_cannot_follow_is_broken(reach, posture):
    far = walk(reach, posture, up=np.array([0.3, 0.9, 1.8]))
    assert (far.at_grasp[0], far.on_way[0]) == (FREE, BROKEN)
    stiff = walk(reach, posture, max_change=1e-3)
    assert stiff.on_way[0] == BROKEN


def test_an_elbow_in_the_scene_is_not_the_hand(robot, reach, left, posture):
    q = robot.home.copy()
    q[left.indices] = posture[0]
    elbow = robot.frame_pose(q, "arm_left_4_link")[:3, 3]
    assert walk(reach, posture, elbow[None]).at_grasp[0] == SCENE


def test_a_settled_grasp_is_closed_and_not_tried_again(reach, posture):
    closed = np.zeros(1, dtype=bool)
    walk(reach, posture, max_change=1e-3, closed=closed)
    assert not closed[0]  # another posture may follow the line
    walk(reach, posture, closed=closed)
    assert closed[0]
    assert walk(reach, posture, closed=closed).at_grasp[0] == UNTRIED
    hopeless = np.zeros(1, dtype=bool)
    walk(reach, posture, PALM[:, :3], closed=hopeless)
    assert hopeless[0]
