# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.geometry.transform import apply, invert
from neugrasp_ros.robot.posture import aim_head

FRAME, HEAD = "head_front_camera_rgb_optical_frame", ("head_1_joint", "head_2_joint")


def seen(robot, q, point):
    x, y, z = apply(invert(robot.frame_pose(q, FRAME)), np.array(point))
    return np.arctan2(x, z), np.arctan2(y, z)


@pytest.mark.parametrize("point", [(0.6, 0.0, 0.7), (0.7, 0.3, 0.9), (0.5, -0.4, 0.8)])
def test_the_optical_axis_meets_the_point_and_nothing_else_turns(robot, point):
    before = robot.home.copy()
    q = aim_head(
        robot, robot.home, np.array(point), camera_frame=FRAME, head_joints=HEAD
    )
    np.testing.assert_allclose(seen(robot, q, point), 0.0, atol=1e-3)
    turned = {robot.joint_names[k] for k in np.flatnonzero(q != robot.home)}
    assert turned == set(HEAD)
    np.testing.assert_array_equal(robot.home, before)


def test_a_point_behind_the_robot_is_looked_at_as_nearly_as_the_neck_allows(robot):
    q = aim_head(
        robot,
        robot.home,
        np.array([-1.0, 0.5, 0.8]),
        camera_frame=FRAME,
        head_joints=HEAD,
    )
    rows = [robot.joint_names.index(name) for name in HEAD]
    inside = (q >= robot.limits.lower - 1e-9) & (q <= robot.limits.upper + 1e-9)
    assert inside[rows].all()
    assert (np.isclose(q, robot.limits.lower) | np.isclose(q, robot.limits.upper))[
        rows
    ].any()
