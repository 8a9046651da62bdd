# SPDX-License-Identifier: Apache-2.0
"""Straight motion of the hand: the approach along its axis, the lift upwards."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import MotionError
from neugrasp_ros.motion.limits import Limits, Trajectory
from neugrasp_ros.motion.planner import FreeCheck
from neugrasp_ros.motion.timing import time_points

FloatArray = NDArray[np.float64]
Follow = Callable[[FloatArray, FloatArray], FloatArray]
"""Solves poses (S, 4, 4) one from the other, beginning near joint values (n,); returns
as many postures (S' <= S, n) as it reached."""


def line_poses(
    T_base_gripper: FloatArray, shift_base: FloatArray, spacing: float = 0.01
) -> FloatArray:
    """Return poses along a straight shift, without the first.

    Args:
        T_base_gripper: Pose at the beginning, shape (4, 4).
        shift_base: Shift in the base frame in [m], shape (3,).
        spacing: Largest distance of two poses in [m].

    Returns:
        Poses with the same orientation, shape (S, 4, 4).
    """
    distance = float(np.linalg.norm(shift_base))
    count = max(1, int(np.ceil(distance / spacing - 1e-9)))
    poses = np.repeat(T_base_gripper[None], count, axis=0)
    poses[:, :3, 3] += np.linspace(0, 1, count + 1)[1:, None] * np.asarray(shift_base)
    return poses


def move_straight(
    q_start: FloatArray,
    poses: FloatArray,
    follow: Follow,
    limits: Limits,
    joint_names: tuple[str, ...],
    *,
    is_free: FreeCheck | None = None,
) -> Trajectory:
    """Move the hand through poses on a straight line, from rest to rest.

    Args:
        q_start: Joint values at the beginning of the line, shape (n,).
        poses: The line, see ``line_poses``, shape (S, 4, 4).
        follow: Inverse kinematics along the line.
        limits: Bounds of the joints.
        joint_names: Their names.
        is_free: Collision check; None = the line is known to be free.

    Raises:
        MotionError: If the arm cannot follow, hits something, or leaves its limits.
    """
    path = follow(poses, q_start)
    if len(path) < len(poses):
        raise MotionError(
            f"the arm follows the line for {len(path)} of {len(poses)} poses"
        )
    points = np.concatenate([q_start[None], path])
    if is_free is not None:
        free = is_free(points)
        if not free.all():
            raise MotionError(
                f"the line is in collision at pose {int(np.argmin(free))} "
                f"of {len(points)}"
            )
    return time_points(points, limits, joint_names)
