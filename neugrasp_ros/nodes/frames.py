# SPDX-License-Identifier: Apache-2.0
"""Conventions at the ROS edge: gripper axes and origins of other software.

Inside the library a gripper frame has z approach, y closing, and its origin at the TCP.
``axes`` are the constants of ``GraspArray``:

    0  x approach, y closing   REP 120, PAL's grasping frame, GPD, GraspNet (default)
    1  z approach, y closing   VGN, GIGA, Franka hand, this library
    2  z approach, x closing   Contact-GraspNet, ros2_robotiq_gripper
"""

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import ConfigError
from neugrasp_ros.geometry.transform import translation

FloatArray = NDArray[np.float64]

R_GRIPPER_AXES = (  # columns: the message's axes, seen in our gripper frame
    np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]),
    np.eye(3),
    np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
)
TCP_AHEAD = {  # [m] along approach, from the origin that others publish to the TCP
    "vgn": 0.0502,  # root of the Panda's fingers
    "giga": 0.0502,
    "contact_graspnet": 0.1034,  # Panda hand link, tips at the contact line
}


def to_axes(T_a_gripper: FloatArray, axes: int) -> FloatArray:
    """Return poses of our gripper frame, (..., 4, 4), as poses with other axes.

    Raises:
        ConfigError: If ``axes`` is none of 0, 1, 2.
    """
    return _turned(T_a_gripper, _rotation(axes))


def from_axes(T_a_other: FloatArray, axes: int) -> FloatArray:
    """Return poses given with other axes, (..., 4, 4), as poses of our gripper frame.

    Raises:
        ConfigError: If ``axes`` is none of 0, 1, 2.
    """
    return _turned(T_a_other, _rotation(axes).T)


def _rotation(axes: int) -> FloatArray:
    if axes not in range(len(R_GRIPPER_AXES)):
        raise ConfigError(f"axes must be 0, 1 or 2, got {axes}")
    return R_GRIPPER_AXES[axes]


def _turned(T: FloatArray, rotation: FloatArray) -> FloatArray:
    turned = np.array(T, dtype=np.float64)
    turned[..., :3, :3] = T[..., :3, :3] @ rotation
    return turned


def tcp_from_model(
    T_a_model: FloatArray, ahead: float | tuple[float, float, float]
) -> FloatArray:
    """Return TCP poses of a model whose gripper frame has another origin.

    Args:
        T_a_model: Poses with z approach and y closing, shape (..., 4, 4).
        ahead: The TCP in that frame in [m]; one number is along the approach.
    """
    x, y, z = (0.0, 0.0, ahead) if isinstance(ahead, float) else ahead
    return np.asarray(T_a_model @ translation(x, y, z))
