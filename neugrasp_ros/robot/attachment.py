# SPDX-License-Identifier: Apache-2.0
"""What a hand carries, as one more body of the arm that must not hit anything.

Of the object only its seen side is known. Its box holds that side, reaches down to
what the object stood on, and is centred between the jaws that closed on it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from neugrasp_ros.geometry.support import ABOVE_SUPPORT
from neugrasp_ros.geometry.transform import apply, invert, make_transform
from neugrasp_ros.robot.bodies import body_poses, joint_tree, pack_hulls
from neugrasp_ros.robot.collision import CollisionChecker
from neugrasp_ros.robot.model import gripper_from_tcp

FloatArray = NDArray[np.float64]

LINK = "carried"  # name of the body in contacts
REACH = (0.08, 0.0475, 0.10)  # [m]; of the object from the TCP along x, y, z of a hand
GAP = 0.012  # [m]; seen points further apart are of two objects
BETWEEN = 0.02  # [m]; points so near to the axis between the jaws are surely its own
LEAST_POINTS = 10


class CarriedBox(NamedTuple):
    """A box fixed to a hand.

    Attributes:
        center: Of the box in the gripper frame in [m], shape (3,).
        size: Full edge lengths along the axes of that frame in [m], shape (3,).
    """

    center: FloatArray
    size: FloatArray


def carried_box(
    points_base: FloatArray,
    T_base_gripper: FloatArray,
    opening: float,
    *,
    radius: float = 0.12,
) -> CarriedBox | None:
    """Return a box around what jaws closed on, from what was seen before.

    Args:
        points_base: Seen surface in the base frame, whose z is up, in [m], (M, 3).
        T_base_gripper: The grasp, shape (4, 4).
        opening: Of the jaws that hold it in [m].
        radius: Distance from the TCP up to which the support is looked for in [m].

    Returns:
        None where too little was seen between the jaws.
    """
    near = np.linalg.norm(points_base - T_base_gripper[:3, 3], axis=1) < radius
    points = points_base[near]
    if not len(points):
        return None
    support = points[:, 2].min()
    points = points[points[:, 2] > support + ABOVE_SUPPORT]
    local = apply(invert(T_base_gripper), points)
    points = points[(np.abs(local) < REACH).all(axis=1)]
    points = _held_part(points, T_base_gripper)
    if len(points) < LEAST_POINTS:
        return None
    feet = points.copy()
    feet[:, 2] = support
    local = apply(invert(T_base_gripper), np.concatenate([points, feet]))
    low, high = local.min(axis=0), local.max(axis=0)
    half = max(opening, high[1] - low[1]) / 2
    low[1], high[1] = -half, half
    return CarriedBox((low + high) / 2, high - low)


def _held_part(points: FloatArray, T_base_gripper: FloatArray) -> FloatArray:
    """Return the points that hang together with those between the jaws."""
    if not len(points):
        return points
    local = apply(invert(T_base_gripper), points)
    between = np.hypot(local[:, 0], np.maximum(local[:, 2], 0.0)) < BETWEEN
    links = cKDTree(points).sparse_distance_matrix(cKDTree(points), GAP)
    _, labels = connected_components(links, directed=False)
    return points[np.isin(labels, labels[between])]


def loaded_checker(
    bare: CollisionChecker, arm: str, box: CarriedBox
) -> CollisionChecker:
    """Return a collision checker whose robot carries something.

    Args:
        bare: The checker of the robot with empty hands; it is left as it is.
        arm: Planning group whose hand carries.
        box: What it carries; it may touch the hand.
    """
    robot = bare.robot
    body = int(robot.group_indices(arm)[-1])
    signs = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), axis=-1).reshape(-1, 3)
    T = _pose_in_body(bare, arm, body)
    hull = pack_hulls([(body, T, box.center + signs * box.size)])
    hand = f"gripper_{robot.description.groups[arm].gripper}_"
    return bare.with_hull(hull, LINK, lambda link: link.startswith(hand))


def _pose_in_body(checker: CollisionChecker, arm: str, body: int) -> FloatArray:
    """Return the gripper's pose in the frame of the arm's last body, shape (4, 4)."""
    robot, q = checker.robot, np.array(checker.robot.home, dtype=np.float64)
    rotations, positions = np.empty((len(q) + 1, 3, 3)), np.empty((len(q) + 1, 3))
    body_poses(joint_tree(robot), q, rotations, positions)
    T_base_body = make_transform(rotations[body], positions[body])
    frame = robot.description.groups[arm].tcp_frame
    return invert(T_base_body) @ gripper_from_tcp(robot.frame_pose(q, frame))
