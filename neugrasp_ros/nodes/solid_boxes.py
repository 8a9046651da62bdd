# SPDX-License-Identifier: Apache-2.0
"""Known solid boxes, such as furniture, from cube markers."""

import numpy as np
from visualization_msgs.msg import Marker, MarkerArray

from neugrasp_ros.errors import ConfigError
from neugrasp_ros.nodes.conversions import from_pose
from neugrasp_ros.nodes.transforms import Transforms
from neugrasp_ros.robot.obstacles import SolidBox

TOPIC = "collision_boxes"


def from_box_markers(
    message: MarkerArray, base_frame: str, transforms: Transforms
) -> tuple[SolidBox, ...]:
    """Return the cubes of a message in the robot's base frame.

    Args:
        message: Cube markers; others are passed over.
        base_frame: The robot's base.
        transforms: From other frames to it.

    Raises:
        ConfigError: If a cube has an edge that is not positive.
        DetectionError: If its frame is not connected to the base.
    """
    boxes = []
    for marker in message.markers:
        if marker.action != Marker.ADD or marker.type != Marker.CUBE:
            continue
        size = np.array([marker.scale.x, marker.scale.y, marker.scale.z])
        if not (size > 0).all():
            raise ConfigError(f"box {marker.text!r}: edges must be > 0, got {size}")
        T = transforms(base_frame, marker.header.frame_id, 0)
        boxes.append(SolidBox(T @ from_pose(marker.pose), size))
    return tuple(boxes)
