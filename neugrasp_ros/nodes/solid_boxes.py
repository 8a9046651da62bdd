# SPDX-License-Identifier: Apache-2.0
"""Known solid boxes, such as furniture, from cube markers."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from visualization_msgs.msg import Marker, MarkerArray

from neugrasp_ros.errors import ConfigError
from neugrasp_ros.nodes.conversions import from_pose
from neugrasp_ros.nodes.outcomes import DetectionError
from neugrasp_ros.nodes.transforms import Transforms
from neugrasp_ros.robot.obstacles import SolidBox

TOPIC = "collision_boxes"


class PlacedBox(NamedTuple):
    """A box where its marker puts it.

    Attributes:
        frame_id: Frame of the marker.
        T_frame_box: Pose of its centre, shape (4, 4).
        size: Full edge lengths in [m], shape (3,).
    """

    frame_id: str
    T_frame_box: NDArray[np.float64]
    size: NDArray[np.float64]


def from_box_markers(message: MarkerArray) -> tuple[PlacedBox, ...]:
    """Return the cubes of a message; other markers are passed over.

    Raises:
        ConfigError: If a cube has no frame, no pose, or an edge that is not positive.
    """
    boxes = []
    for marker in message.markers:
        if marker.action != Marker.ADD or marker.type != Marker.CUBE:
            continue
        name, frame_id = f"box {marker.text!r}", marker.header.frame_id
        size = np.array([marker.scale.x, marker.scale.y, marker.scale.z])
        if not (size > 0).all():
            raise ConfigError(f"{name}: edges must be > 0, got {size}")
        if not frame_id.strip("/"):
            raise ConfigError(f"{name}: its frame id is empty")
        boxes.append(PlacedBox(frame_id, from_pose(marker.pose, name), size))
    return tuple(boxes)


class KnownBoxes:
    """The boxes of the last good message, seen from where the robot stands now.

    The message is latched: it comes once, perhaps before the first transform, and holds
    while the base drives. So the boxes are transformed each time they are used.

    Args:
        base_frame: The robot's base.
        transforms: From other frames to it.
    """

    def __init__(self, base_frame: str, transforms: Transforms) -> None:
        self._base, self._transforms = base_frame, transforms
        self._placed: tuple[PlacedBox, ...] = ()

    def remember(self, message: MarkerArray) -> None:
        """Take the boxes of a message in place of those before.

        Raises:
            ConfigError: As ``from_box_markers``; those before stay.
        """
        self._placed = from_box_markers(message)

    def in_base(self) -> tuple[SolidBox, ...]:
        """Return the boxes in the robot's base frame.

        Raises:
            DetectionError: If the frame of one is not connected to the base now.
        """
        placed = self._placed
        try:
            T_base_frames = {
                frame: self._transforms(self._base, frame, 0)
                for frame in dict.fromkeys(box.frame_id for box in placed)
            }
        except DetectionError as error:
            raise DetectionError(error.code, f"{TOPIC}: {error.sentence}") from error
        return tuple(
            SolidBox(T_base_frames[box.frame_id] @ box.T_frame_box, box.size)
            for box in placed
        )
