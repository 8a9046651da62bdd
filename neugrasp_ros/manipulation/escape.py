# SPDX-License-Identifier: Apache-2.0
"""Straight ways out of a narrow place, for a hand that finds no other."""

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import MotionError
from neugrasp_ros.manipulation.mover import ArmMover, Surroundings
from neugrasp_ros.motion.limits import Trajectory
from neugrasp_ros.robot.attachment import CarriedBox

FloatArray = NDArray[np.float64]

SHIFTS = np.array(
    [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.5], [-0.5, 0.0, 0.0]]
)
"""Tried in this order, in the base frame: up, and out towards the robot."""


def plan_escape(
    mover: ArmMover,
    q: FloatArray,
    arm: str,
    distance: float,
    *,
    around: Surroundings,
    carried: CarriedBox | None = None,
) -> Trajectory:
    """Plan the hand out of where it has no way, up or towards the robot.

    Only known boxes count, not what was seen. Of these the hand may touch one where it
    is now, as long as the way leaves it and meets no other.

    Args:
        mover: Plans.
        q: Present configuration, shape (J,).
        arm: Planning group that moves.
        distance: The longest way in [m].
        around: The scene.
        carried: What the hand carries, if anything.

    Raises:
        MotionError: If each way is out of the arm's reach or into a box.
    """
    solid = Surroundings(boxes=around.boxes)
    reasons = []
    for shift in distance * SHIFTS:
        try:
            motion = mover.plan_shift(q, arm, shift)
        except MotionError as error:
            reasons.append(str(error))
            continue
        if mover.leads_free(q, arm, motion, solid, carried):
            return motion
        reasons.append("it leads into a box")
    raise MotionError(f"{arm} cannot get out: {'; '.join(reasons)}")
