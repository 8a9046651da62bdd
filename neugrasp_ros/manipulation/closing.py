# SPDX-License-Identifier: Apache-2.0
"""How far jaws may close where their tips would press onto what the object stands on.

The tips of a linkage gripper move ahead while it closes, by 13 mm on a 2F-85. A grasp
leaves room for that down to the width of its object, and no more; jaws that close on
nothing would press the hand against a table with some 60 N.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.finger_joint import tip_advance_at
from neugrasp_ros.geometry.gripper import Gripper
from neugrasp_ros.geometry.transform import apply, invert
from neugrasp_ros.robot.obstacles import SolidBox

FloatArray = NDArray[np.float64]

CLEARANCE = 0.001  # [m]; between tips and boxes: a tip that touches meets 60 N
RAISE = 0.002  # [m]; by which a grasp so low is carried out away from it
STEPS = 60


def least_opening(
    gripper: Gripper, T_base_gripper: FloatArray, boxes: Sequence[SolidBox]
) -> float:
    """Return how far open jaws can close before a tip comes to a box, in [m].

    Args:
        gripper: The gripper.
        T_base_gripper: Where the hand stands, shape (4, 4).
        boxes: Solid boxes in the base frame.

    Returns:
        0 where nothing is in the way, ``max_opening`` where they cannot close at all;
        what is in the way of open jaws is for the check of the approach.
    """
    if not boxes or gripper.tip_advance <= 0.0:
        return 0.0
    openings = np.linspace(0.0, gripper.max_opening, STEPS)
    corners = apply(T_base_gripper, _tip_corners(gripper, openings).reshape(-1, 3))
    hit = np.zeros(len(corners), dtype=bool)
    for box in boxes:
        local = np.abs(apply(invert(box.T_base_box), corners))
        hit |= (local < np.asarray(box.size) / 2 + CLEARANCE).all(axis=1)
    blocked = np.asarray(hit.reshape(STEPS, -1).any(axis=1))
    blocked[-1] = False
    return float(openings[np.flatnonzero(blocked)[-1] + 1]) if blocked.any() else 0.0


def raised(
    gripper: Gripper, T_base_gripper: FloatArray, boxes: Sequence[SolidBox]
) -> FloatArray:
    """Return a grasp (4, 4) moved away by 2 mm where closing tips come to a box.

    A sampler lets the tips touch what the object stands on at its width, so that
    without this the jaws would stop short of it. The hand goes straight up, or back
    where that gives more room, as at a wall.
    """
    T = np.array(T_base_gripper, dtype=np.float64)
    if least_opening(gripper, T, boxes) <= 0.0:
        return T
    up, back = T.copy(), T.copy()
    up[2, 3] += RAISE
    back[:3, 3] -= RAISE * T[:3, 2]
    return min(up, back, key=lambda moved: least_opening(gripper, moved, boxes))


def _tip_corners(gripper: Gripper, openings: FloatArray) -> FloatArray:
    """Return the tips' corners in the gripper frame at openings (S,), (S, 8, 3)."""
    half = gripper.finger_thickness / 2
    corners = np.array(
        [
            (x, side, outer)
            for x in (-half, half)
            for side in (-1.0, 1.0)
            for outer in (0.0, gripper.finger_width)
        ]
    )
    tips = np.empty((len(openings), len(corners), 3))
    tips[:, :, 0] = corners[:, 0]
    tips[:, :, 1] = corners[:, 1] * (openings[:, None] / 2 + corners[:, 2])
    tips[:, :, 2] = tip_advance_at(gripper, openings)[:, None]
    return tips
