# SPDX-License-Identifier: Apache-2.0
"""tf2 where it is installed, our stand-in where it is not."""

import numpy as np
import yaml
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray

from neugrasp_ros.geometry.transform import pose_from
from neugrasp_ros.nodes.compat.tf_message import to_transform

try:
    from tf2_ros import (
        Buffer,
        ExtrapolationException,
        StaticTransformBroadcaster,
        TransformBroadcaster,
        TransformException,
        TransformListener,
    )
except ImportError:
    from neugrasp_ros.nodes.compat.tf_buffer import (
        Buffer,
        ExtrapolationException,
        StaticTransformBroadcaster,
        TransformBroadcaster,
        TransformException,
        TransformListener,
    )

__all__ = [
    "Buffer",
    "ExtrapolationException",
    "StaticTransformBroadcaster",
    "TransformBroadcaster",
    "TransformException",
    "TransformListener",
    "frame_names",
    "from_transform",
    "to_transform",
]


def frame_names(buffer: Buffer) -> tuple[str, ...]:
    """Return the names of all frames that a buffer knows, sorted."""
    text = buffer.all_frames_as_yaml()
    links = yaml.load(text, Loader=yaml.BaseLoader) or {}  # frame 1 is no number
    return tuple(sorted({*links, *(link["parent"] for link in links.values())}))


def from_transform(message: TransformStamped) -> NDArray[np.float64]:
    """Return ``T_target_source`` of a looked-up transform, shape (4, 4)."""
    p, q = message.transform.translation, message.transform.rotation
    return pose_from(np.array([p.x, p.y, p.z]), np.array([q.x, q.y, q.z, q.w]))
