# SPDX-License-Identifier: Apache-2.0
"""What the first motion of a process would have to wait for, done once before."""

import numpy as np

from neugrasp_ros.manipulation.mover import ArmMover, Surroundings
from neugrasp_ros.robot.attachment import CarriedBox

FAR = np.array([[2.0, 0.0, 0.5]])  # [m]; an obstacle in nobody's way
BOX = CarriedBox(np.zeros(3), np.full(3, 0.02))


def try_once(mover: ArmMover) -> None:
    """Check a grasp, a posture with something in the hand, and a straight line.

    One arm stands for all: compiled code does not tell them apart.
    """
    q, robot = mover.robot.home, mover.checker
    arm, kinematics = next(iter(robot.arms.items()))
    own, T = q[kinematics.indices], mover.hand_pose(q, arm)
    robot.check(T[None], arms=(arm,), start=q)
    kinematics.solve(T[None], near=own)
    kinematics.follow(
        T[None, None], own[None], max_change=robot.config.max_joint_change
    )
    robot.collisions.off_robot(FAR, q)
    mover.is_free(q, arm, own, Surroundings(FAR), BOX)
