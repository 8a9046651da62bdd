# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

pytest.importorskip("rclpy")

from builtin_interfaces.msg import Time  # noqa: E402
from visualization_msgs.msg import Marker  # noqa: E402

from neugrasp_ros.geometry.gripper import load_gripper  # noqa: E402
from neugrasp_ros.geometry.transform import translation  # noqa: E402
from neugrasp_ros.grasp.types import GraspSet  # noqa: E402
from neugrasp_ros.nodes.grasp_list import GraspInfo, GraspList  # noqa: E402
from neugrasp_ros.nodes.markers import (  # noqa: E402
    jaw_lines,
    quality_color,
    to_markers,
    workspace_marker,
)

GRIPPER = load_gripper("robotiq_2f85")


def test_the_jaws_are_as_far_apart_as_the_width_and_end_at_the_tcp():
    ends = jaw_lines(0.04, GRIPPER)
    tips = ends[[3, 5]]
    np.testing.assert_allclose(np.ptp(tips, axis=0), [0, 0.04, 0])
    np.testing.assert_allclose(tips[:, 2], 0.0)
    assert ends[:, 2].min() < -GRIPPER.finger_depth


def test_all_grasps_are_one_marker_after_a_clearing_one():
    poses = np.array([translation(0, 0, 0.1), translation(0, 0, 0.2)])
    grasps = GraspSet(poses, np.array([0.02, 0.06]), np.array([1.0, np.nan]))
    array = to_markers(GraspList(GraspInfo(frame_id="base", stamp=5), grasps), GRIPPER)
    clear, lines = array.markers
    assert clear.action == Marker.DELETEALL
    assert lines.type == Marker.LINE_LIST and lines.header.frame_id == "base"
    assert len(lines.points) == len(lines.colors) == 16
    assert (lines.colors[0].r, lines.colors[0].g) == (0.0, 1.0)
    assert lines.colors[8].r == lines.colors[8].b == 0.5
    assert lines.points[3].z == pytest.approx(0.1)


def test_no_grasps_clear_what_was_drawn():
    grasps = GraspList(
        GraspInfo(frame_id="base"), GraspSet(np.zeros((0, 4, 4)), np.zeros(0))
    )
    assert [m.action for m in to_markers(grasps, GRIPPER).markers] == [Marker.DELETEALL]


def test_colours_run_from_red_over_yellow_to_green():
    assert quality_color(0.0) == (1.0, 0.0, 0.0)
    assert quality_color(0.5) == (1.0, 1.0, 0.0)
    assert quality_color(1.0) == (0.0, 1.0, 0.0)


def test_the_workspace_is_twelve_edges():
    size = np.array([0.3, 0.2, 0.1])
    marker = workspace_marker(translation(1, 0, 0), size, "base", Time())
    points = np.array([[p.x, p.y, p.z] for p in marker.points]).reshape(12, 2, 3)
    lengths = np.abs(points[:, 0] - points[:, 1]).sum(axis=1)
    np.testing.assert_allclose(np.sort(lengths), np.repeat([0.1, 0.2, 0.3], 4))
    assert marker.pose.position.x == 1.0
