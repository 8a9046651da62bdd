# SPDX-License-Identifier: Apache-2.0
"""Where the pads of a grasp are going to touch, read off the occupancy field."""

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.finger_joint import tip_advance_at
from neugrasp_ros.geometry.grid import ScalarGrid, march
from neugrasp_ros.geometry.gripper import Gripper
from neugrasp_ros.geometry.transform import apply

FloatArray = NDArray[np.float64]

RAYS_ACROSS = 5  # over a pad's thickness
RAY_SPACING = 0.004  # [m], along a pad
BAND = 0.001  # [m]; a pad touches all that is this little behind its first touch


def expected_contacts(
    field: ScalarGrid,
    T_task_grippers: FloatArray,
    gripper: Gripper,
    *,
    threads: int = 1,
) -> FloatArray:
    """Close the jaws of each grasp, from fully open, until both pads touch.

    Each pad moves along y and, on a linkage, forward as the jaws close
    (``tip_advance_at``). The contact is the middle of what a pad touches first; that
    the object may be pushed meanwhile is not taken into account.

    Args:
        field: Occupancy logits, positive inside, in the task frame.
        T_task_grippers: Grasp poses, shape (G, 4, 4).
        gripper: The gripper.
        threads: Worker threads.

    Returns:
        Contact of the +y and of the -y pad in the task frame in [m], shape (G, 2, 3);
        both NaN where a pad meets nothing, or starts wholly inside of something.
    """
    poses = np.asarray(T_task_grippers, dtype=np.float64)
    contacts = np.full((len(poses), 2, 3), np.nan)
    if not len(poses):
        return contacts
    pad = _pad_points(gripper)
    for column, side in enumerate((1.0, -1.0)):
        heights = _met(field, poses, pad * [1.0, side, 1.0], side, threads)
        opening = 2 * np.clip(heights, 0.0, None)
        tip = tip_advance_at(gripper, opening)
        covered = (pad[:, 2] <= tip) & (pad[:, 2] >= tip - gripper.finger_depth)
        heights[~covered] = -np.inf
        first = heights.max(axis=1)
        touching = heights >= first[:, None] - BAND
        touching[~np.isfinite(first)] = False
        for row in np.flatnonzero(touching.any(axis=1)):
            there = pad[touching[row]]
            there[:, 1] = side * heights[row, touching[row]]
            contacts[row, column] = apply(poses[row], there).mean(axis=0)
    contacts[np.isnan(contacts).any(axis=(1, 2))] = np.nan
    return contacts


def _pad_points(gripper: Gripper) -> FloatArray:
    """Return points on the open +y pad and where it comes on its way, shape (P, 3)."""
    x = np.linspace(-0.5, 0.5, RAYS_ACROSS) * gripper.finger_thickness
    length = gripper.finger_depth + gripper.tip_advance
    steps = round(length / RAY_SPACING) + 1
    z = np.linspace(-gripper.finger_depth, gripper.tip_advance, steps)
    points = np.full((len(x) * len(z), 3), gripper.max_opening / 2)
    points[:, 0], points[:, 2] = (g.ravel() for g in np.meshgrid(x, z))
    return points


def _met(
    field: ScalarGrid,
    poses: FloatArray,
    starts: FloatArray,
    side: float,
    threads: int,
) -> FloatArray:
    """Return how far out on its side each ray (G, P) meets something; -inf = nothing.

    Args:
        field: The field.
        poses: Grasp poses, shape (G, 4, 4).
        starts: Where rays begin in the gripper frame in [m], shape (P, 3).
        side: +1 or -1, the pad's side of the y axis.
        threads: Worker threads.
    """
    half = abs(starts[0, 1])
    origins = np.einsum("gij,pj->gpi", poses[:, :3, :3], starts)
    origins += poses[:, None, :3, 3]
    inward = np.broadcast_to(-side * poses[:, None, :3, 1], origins.shape)
    distances = march(
        field, origins.reshape(-1, 3), inward.reshape(-1, 3), threads=threads
    ).reshape(len(poses), -1)
    heights = half - distances
    heights[~(distances <= 2 * half)] = -np.inf
    return np.asarray(heights)
