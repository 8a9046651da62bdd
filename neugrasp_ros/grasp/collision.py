# SPDX-License-Identifier: Apache-2.0
"""Does the hand fit: against a point cloud, and against the plane things stand on.

In: grasp poses (TCP frames) with jaw openings, surface points, a plane height.
Out: masks and clearances. The hand is three boxes (two fingers, palm), and all tests
take the straight approach into account: a box is swept backwards to the pre-grasp.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from neugrasp_ros.geometry.grid import run_in_parts
from neugrasp_ros.geometry.gripper import Gripper

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@njit(cache=True, nogil=True)
def _swept_free(
    poses: FloatArray,
    openings: FloatArray,
    points: FloatArray,
    hand: FloatArray,
    inflation: float,
    retreat: float,
    free: BoolArray,
) -> None:
    """Write False for the poses whose hand meets a point on its way."""
    half_thickness, finger_width, depth, palm_x, palm_y, palm_z = hand
    for g in range(len(poses)):
        pose = poses[g]
        inner = openings[g] / 2 - inflation
        outer = openings[g] / 2 + finger_width + inflation
        rear = -depth - retreat
        for i in range(len(points)):
            dx = points[i, 0] - pose[0, 3]
            dy = points[i, 1] - pose[1, 3]
            dz = points[i, 2] - pose[2, 3]
            x = abs(dx * pose[0, 0] + dy * pose[1, 0] + dz * pose[2, 0])
            if x > palm_x + inflation:
                continue
            z = dx * pose[0, 2] + dy * pose[1, 2] + dz * pose[2, 2]
            if z > inflation or z < rear - palm_z:
                continue
            y = abs(dx * pose[0, 1] + dy * pose[1, 1] + dz * pose[2, 1])
            in_palm = y < palm_y + inflation and z < inflation - depth
            in_finger = inner < y < outer and z > rear
            if in_palm or (in_finger and x < half_thickness + inflation):
                free[g] = False
                break


def hand_measures(gripper: Gripper) -> FloatArray:
    """Return the measures that the kernels read, in [m], shape (6,).

    Half finger thickness, finger width, finger depth, half palm x, half palm y, palm z.
    """
    palm_x, palm_y, palm_z = gripper.palm_size
    return np.array(
        [
            gripper.finger_thickness / 2,
            gripper.finger_width,
            gripper.finger_depth,
            palm_x / 2,
            palm_y / 2,
            palm_z,
        ]
    )


def approach_is_free(
    T_task_gripper: FloatArray,
    openings: FloatArray,
    points: FloatArray,
    gripper: Gripper,
    inflation: float = 0.002,
    retreat: float = 0.10,
    threads: int = 1,
) -> BoolArray:
    """Tell for which grasps the hand meets no point between pre-grasp and grasp.

    Args:
        T_task_gripper: Grasp poses, shape (G, 4, 4).
        openings: Distance of the inner pad faces on the way in [m], shape (G,).
        points: Surface points in the task frame in [m], shape (N, 3).
        gripper: The hand.
        inflation: Added to every side of its boxes in [m]; covers the gaps between
            points and a surface that physics makes fatter than it looks.
        retreat: Distance of the pre-grasp behind the grasp in [m].
        threads: Worker threads.

    Returns:
        Mask of shape (G,), True = free.
    """
    poses = np.ascontiguousarray(T_task_gripper, dtype=np.float64)
    openings = np.ascontiguousarray(openings, dtype=np.float64)
    points = np.ascontiguousarray(points, dtype=np.float64)
    hand = hand_measures(gripper)
    free = np.ones(len(poses), dtype=np.bool_)

    def run(part: slice) -> None:
        _swept_free(
            poses[part], openings[part], points, hand, inflation, retreat, free[part]
        )

    run_in_parts(run, len(poses), threads)
    return free


def support_clearance(
    T_task_gripper: FloatArray,
    openings: FloatArray,
    gripper: Gripper,
    support_height: float,
) -> FloatArray:
    """Return the height of each hand's lowest corner above the support plane.

    Args:
        T_task_gripper: Grasp poses, shape (G, 4, 4).
        openings: Jaw openings in [m], shape (G,).
        gripper: The hand.
        support_height: Height of the plane in the task frame in [m].

    Returns:
        Clearances in [m], shape (G,); negative = the hand cuts the plane.
    """
    lift = lowest_corner(T_task_gripper[:, 2, :3], openings, gripper)
    return np.asarray(T_task_gripper[:, 2, 3] + lift - support_height)


def lowest_corner(
    axes_z: FloatArray, openings: FloatArray, gripper: Gripper
) -> FloatArray:
    """Return the height of a hand's lowest corner above its TCP.

    A box's lowest corner lies at ``z . c - |z| . h`` for centre c and half extents h,
    with z the task frame's vertical seen in the gripper frame.

    Args:
        axes_z: Third rows of the rotations ``R_task_gripper``, shape (G, 3).
        openings: Jaw openings in [m], shape (G,).
        gripper: The hand.

    Returns:
        Heights in [m], shape (G,), at most 0.
    """
    reach = np.abs(axes_z)
    depth = gripper.finger_depth
    lateral = openings / 2 + gripper.finger_width
    fingers = (
        -axes_z[:, 2] * depth / 2
        - reach[:, 2] * depth / 2
        - reach[:, 1] * lateral
        - reach[:, 0] * gripper.finger_thickness / 2
    )
    half = np.array(gripper.palm_size) / 2
    palm = -axes_z[:, 2] * (depth + half[2]) - reach @ half
    return np.asarray(np.minimum(fingers, palm))
