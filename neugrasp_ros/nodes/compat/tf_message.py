# SPDX-License-Identifier: Apache-2.0
"""Poses as transform messages."""

import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray
from rclpy.time import Time

from neugrasp_ros.geometry.transform import to_position_quaternion

FloatArray = NDArray[np.float64]


def to_transform(
    T_parent_child: FloatArray, parent: str, child: str, stamp: int
) -> TransformStamped:
    """Return a pose, shape (4, 4), as a message stamped ``stamp`` [ns]."""
    position, quaternion = to_position_quaternion(T_parent_child)
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.header.stamp = Time(nanoseconds=stamp).to_msg()
    for target, values in (
        (message.transform.translation, position),
        (message.transform.rotation, quaternion),
    ):
        for axis, value in zip("xyzw", values, strict=False):
            setattr(target, axis, float(value))
    return message
