# SPDX-License-Identifier: Apache-2.0
"""A robot that stands and looks at a point: its joints and its head camera."""

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.transform import apply, invert
from neugrasp_ros.robot.model import RobotModel

FloatArray = NDArray[np.float64]

AIM_STEPS = 8
DIFFERENCE = 1e-4  # [rad]
CLOSE = 1e-4  # [rad] of the optical axis


def aim_head(
    robot: RobotModel,
    q: FloatArray,
    point_base: FloatArray,
    *,
    camera_frame: str,
    head_joints: tuple[str, str],
) -> FloatArray:
    """Turn pan and tilt until the camera looks at a point.

    Newton's method on where the point appears in the image; joint limits hold, so a
    point beyond them is looked at as nearly as they allow.

    Args:
        robot: The robot.
        q: Configuration, shape (J,).
        point_base: The point in the base frame in [m], shape (3,).
        camera_frame: Optical frame.
        head_joints: Names of pan and tilt.

    Returns:
        Configuration with the head turned, shape (J,).
    """
    joints = [robot.joint_names.index(name) for name in head_joints]
    lower, upper = robot.limits.lower[joints], robot.limits.upper[joints]

    def error(angles: FloatArray) -> FloatArray:
        turned = q.copy()
        turned[joints] = angles
        x, y, z = apply(invert(robot.frame_pose(turned, camera_frame)), point_base)
        return np.array([np.arctan2(x, z), np.arctan2(y, z)])

    angles = q[joints].copy()
    for _ in range(AIM_STEPS):
        miss = error(angles)
        if np.abs(miss).max() < CLOSE:
            break
        slopes = [
            (error(angles + DIFFERENCE * e) - miss) / DIFFERENCE for e in np.eye(2)
        ]
        step = np.linalg.lstsq(np.stack(slopes, axis=1), miss, rcond=None)[0]
        angles = np.clip(angles - step, lower, upper)
    aimed = q.copy()
    aimed[joints] = angles
    return aimed
