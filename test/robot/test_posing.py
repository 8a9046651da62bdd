# SPDX-License-Identifier: Apache-2.0
"""Where bodies, hulls and balls are, in closed form and against themselves."""

import numpy as np
import pytest

from neugrasp_ros.robot.bodies import body_balls, joint_tree, robot_hulls
from neugrasp_ros.robot.model import load_robot
from neugrasp_ros.robot.obstacles import make_obstacles
from neugrasp_ros.robot.posing import World, make_buffers, pose_world

NAMES = ("rotations", "positions", "centers", "axes", "balls")
SLIDE, SWING, SPIN = 0, 1, 2
BASE, LOWER = 0, 1  # hulls of the toy


def world_of(robot) -> World:
    hulls, _ = robot_hulls(robot)
    balls = body_balls(hulls, len(robot.joint_names))
    return World(joint_tree(robot), hulls, balls, make_obstacles())


@pytest.fixture(scope="module")
def toy(toy_files):
    return world_of(load_robot(toy_files / "toy.yaml"))


def posed(world, q, buffers=None, known=None):
    buffers = make_buffers(world, 0) if buffers is None else buffers
    known = np.full(len(q), np.nan) if known is None else known
    pose_world(world, np.asarray(q, dtype=float), known, buffers)
    return buffers, known


@pytest.mark.parametrize("slide", [0.0, 0.2])
@pytest.mark.parametrize("swing", [0.0, 0.4, -1.1])
def test_a_swinging_box_is_where_its_angle_says(toy, slide, swing):
    (_, _, centers, axes, balls, *_), _ = posed(toy, [slide, swing, 0.0])
    s, c = np.sin(swing), np.cos(swing)
    # 30 cm up to the joint, from there 50 cm and 40 cm along the arm
    assert centers[LOWER] == pytest.approx([0.0, slide - 0.9 * s, 0.3 + 0.9 * c])
    assert balls[SPIN] == pytest.approx(centers[LOWER])
    along = np.abs(axes[LOWER].T @ [0.0, -s, c])
    assert sorted(along) == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert centers[BASE] == pytest.approx([0.0, 0.0, 0.0])


def test_the_balls_hold_the_corners_of_their_boxes(toy):
    half_diagonal = np.linalg.norm([0.05, 0.05, 0.1])
    assert toy.body_balls[SPIN, 3] == pytest.approx(half_diagonal)
    assert toy.body_balls[-1, 3] == pytest.approx(np.linalg.norm([0.1, 0.1, 0.05]))
    assert not toy.body_balls[[SLIDE, SWING], 3].any(), "bodies without hulls"


def test_only_what_a_changed_joint_carries_is_placed_anew(toy):
    buffers, known = posed(toy, [0.1, 0.2, 0.3])
    posed(toy, [0.1, 0.5, 0.3], buffers, known)
    assert buffers[-1].tolist() == [False, True, True, False]
    assert known.tolist() == [0.1, 0.5, 0.3]
    posed(toy, [0.1, 0.5, 0.3], buffers, known)
    assert not buffers[-1].any()


def test_step_by_step_gives_what_posing_afresh_gives(robot, rng):
    world = world_of(robot)
    q = np.array(robot.home)
    buffers, known = posed(world, q)
    limits = robot.limits
    for _ in range(40):
        joint = rng.integers(len(q))
        q[joint] = rng.uniform(limits.lower[joint], limits.upper[joint])
        posed(world, q, buffers, known)
        fresh, _ = posed(world, q)
        for name, mine, theirs in zip(NAMES, buffers, fresh, strict=False):
            np.testing.assert_allclose(mine, theirs, atol=1e-12, err_msg=name)


def test_bodies_are_where_pinocchio_has_the_hands(robot):
    world = world_of(robot)
    (rotations, positions, *_), _ = posed(world, robot.home)
    body = robot.joint_names.index("arm_left_7_joint")
    T = robot.frame_pose(robot.home, "arm_left_7_link")
    assert positions[body] == pytest.approx(T[:3, 3], abs=1e-9)
    assert rotations[body][:, 2] == pytest.approx(T[:3, 2], abs=1e-9), (
        "the joint's axis"
    )
