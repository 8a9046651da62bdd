# SPDX-License-Identifier: Apache-2.0
"""Grasps and workspace as markers: what a person sees in RViz."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from numpy.typing import NDArray
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from neugrasp_ros.geometry.gripper import Gripper
from neugrasp_ros.geometry.transform import apply
from neugrasp_ros.nodes.conversions import to_pose, to_stamp
from neugrasp_ros.nodes.grasp_list import GraspList

FloatArray = NDArray[np.float64]

JAW_LINE = 0.002  # [m]
WRIST_LENGTH = 0.04  # [m], the stub behind the palm
UNSCORED = (0.5, 0.5, 0.5)
WORKSPACE_COLOR = (0.2, 0.5, 1.0)
OBJECT_COLOR = (0.8, 0.6, 0.3)
CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
CUBE_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b) in (1, 2, 4)]


class LabelledBox(NamedTuple):
    """A box with a name: pose of its centre (4, 4), full edges in [m] (3,)."""

    name: str
    T_frame_box: FloatArray
    size: FloatArray


def quality_color(quality: float) -> tuple[float, float, float]:
    """Return red for 0, yellow for one half, green for 1, grey for not scored."""
    if not np.isfinite(quality):
        return UNSCORED
    share = min(max(quality, 0.0), 1.0)
    return min(1.0, 2 - 2 * share), min(1.0, 2 * share), 0.0


def jaw_lines(width: float, gripper: Gripper) -> FloatArray:
    """Return a gripper as line segments in its own frame.

    Args:
        width: Distance of the inner pad faces in [m].
        gripper: Its measures.

    Returns:
        Ends of palm, both fingers and wrist in [m], shape (8, 3).
    """
    half, root = width / 2, -gripper.finger_depth
    left, right = [0.0, half, root], [0.0, -half, root]
    return np.array(
        [
            left, right,
            left, [0.0, half, 0.0],
            right, [0.0, -half, 0.0],
            [0.0, 0.0, root], [0.0, 0.0, root - WRIST_LENGTH],
        ]
    )  # fmt: skip


def to_markers(grasps: GraspList, gripper: Gripper) -> MarkerArray:
    """Return all grasps as one line list at their true width, coloured by quality."""
    header = (grasps.info.frame_id, to_stamp(grasps.info.stamp))
    clear = _marker(*header, "grasps", 0)
    clear.action = Marker.DELETEALL
    markers = [clear]
    if len(grasps):
        lines = _marker(*header, "grasps", 0)
        lines.type = Marker.LINE_LIST
        lines.scale.x = JAW_LINE
        values = grasps.grasps
        for pose, width, quality in zip(
            values.poses, values.widths, values.quality, strict=True
        ):
            ends = apply(pose, jaw_lines(float(width), gripper))
            color = _color(quality_color(float(quality)))
            lines.points.extend(_points(ends))
            lines.colors.extend([color] * len(ends))
        markers.append(lines)
    return MarkerArray(markers=markers)


def workspace_marker(
    T_frame_task: FloatArray, size: FloatArray, frame_id: str, stamp: Time
) -> Marker:
    """Return the outline of the workspace, edges ``size`` (3,) in [m]."""
    marker = _marker(frame_id, stamp, "workspace", 0)
    marker.type = Marker.LINE_LIST
    marker.pose = to_pose(T_frame_task)
    marker.scale.x = JAW_LINE
    marker.color = _color(WORKSPACE_COLOR)
    corners = CUBE * size
    marker.points = _points(corners[[end for edge in CUBE_EDGES for end in edge]])
    return marker


def _marker(frame_id: str, stamp: Time, namespace: str, number: int) -> Marker:
    marker = Marker(ns=namespace, id=number, action=Marker.ADD)
    marker.header.frame_id = frame_id
    marker.header.stamp = stamp
    marker.pose.orientation.w = 1.0
    return marker


def _points(values: FloatArray) -> list[Point]:
    return [Point(x=p[0], y=p[1], z=p[2]) for p in np.asarray(values).tolist()]


def _color(color: tuple[float, float, float]) -> ColorRGBA:
    return ColorRGBA(r=color[0], g=color[1], b=color[2], a=1.0)


def box_markers(
    boxes: Sequence[LabelledBox], frame_id: str, stamp: Time
) -> MarkerArray:
    """Return named boxes, each one marker whose pose is the box's own frame."""
    clear = _marker(frame_id, stamp, "objects", 0)
    clear.action = Marker.DELETEALL
    markers = [clear]
    for number, box in enumerate(boxes):
        marker = _marker(frame_id, stamp, "objects", number)
        marker.type = Marker.CUBE
        marker.pose = to_pose(box.T_frame_box)
        marker.scale.x, marker.scale.y, marker.scale.z = box.size.tolist()
        marker.color = _color(OBJECT_COLOR)
        marker.color.a = 0.5
        marker.text = box.name
        markers.append(marker)
    return MarkerArray(markers=markers)
