# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.geometry.transform import make_transform
from neugrasp_ros.robot.contact import FREE, HAND, SCENE
from neugrasp_ros.robot.model import tcp_from_gripper
from neugrasp_ros.robot.obstacles import make_obstacles
from neugrasp_ros.robot.posing import make_buffers
from neugrasp_ros.robot.ways import BROKEN, Line, WayProblem, make_way, try_way

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
    return answer.approach[0, -1]


def walk(reach, q, points=None, *, back=STEPS, up=STEPS, **options):
    """Try one way, the approach being from straight above.

    Returns:
        Contact at the grasp, contact on the way, and the way.
    """
    arm = reach.arms[LEFT]
    problem = WayProblem(
        scope=reach.collisions.scope(LEFT),
        joints=arm.indices,
        ik=arm.problem,
        **{"max_change": 0.5, "held_radius": 0.0, **options},
    )
    behind, above = (
        GRASP[None, :3, 3] + np.asarray(steps)[:, None] * [0, 0, 1]
        for steps in (back, up)
    )
    start = reach.robot.home
    line = Line(tcp_from_gripper(GRASP), behind, above, start)
    world = reach.collisions.world(make_obstacles(points))
    buffers = make_buffers(world, len(problem.scope.pairs))
    way = make_way(len(back), len(up), len(q), len(start))
    place = (world, np.full(len(start), np.nan), buffers)
    return *try_way(problem, line, q, way, place), way


def ends(reach, q, points=None, **options):
    """Return contact at the grasp and contact on the way."""
    return walk(reach, q, points, **options)[:2]


def test_a_free_way_goes_back_and_up(reach, left, posture):
    at_grasp, on_way, way = walk(reach, posture)
    assert (at_grasp, on_way) == (FREE, FREE)
    for values in (way.retreat, way.lift):
        reached = left.forward(values)
        assert reached[:, :3, 3] - GRASP[:3, 3] == pytest.approx(
            np.outer(STEPS, [0, 0, 1]), abs=1e-4
        )
        assert reached[:, :3, :3] == pytest.approx(np.array([DOWN] * 3), abs=1e-4)


def test_contact_at_the_grasp_is_told_from_contact_on_the_way(reach, posture):
    assert ends(reach, posture, PALM[:, :3])[0] == HAND
    assert ends(reach, posture, ABOVE) == (FREE, HAND)


def test_what_is_near_the_tcp_travels_with_the_hand_in_the_lift_only(reach, posture):
    point, still = ABOVE, np.array([0.001])
    assert ends(reach, posture, point, back=still) == (FREE, HAND)
    assert ends(reach, posture, point, back=still, held_radius=0.2) == (FREE, FREE)
    assert ends(reach, posture, point, held_radius=0.2) == (FREE, HAND)


def test_a_line_that_the_arm_cannot_follow_is_broken(reach, posture):
    assert ends(reach, posture, up=np.array([0.3, 0.9, 1.8])) == (FREE, BROKEN)
    assert ends(reach, posture, max_change=1e-3) == (FREE, BROKEN)


def test_an_elbow_in_the_scene_is_not_the_hand(robot, reach, left, posture):
    q = robot.home.copy()
    q[left.indices] = posture
    elbow = robot.frame_pose(q, "arm_left_4_link")[:3, 3]
    assert ends(reach, posture, elbow[None])[0] == SCENE
