# SPDX-License-Identifier: Apache-2.0
"""The whole motion of a grasp: there, straight ahead, and up."""

from dataclasses import dataclass

from numpy import float64
from numpy.typing import NDArray

from neugrasp_ros.motion.limits import Limits, Trajectory
from neugrasp_ros.motion.planner import TransitPlanner
from neugrasp_ros.motion.timing import time_points

FloatArray = NDArray[float64]


@dataclass(frozen=True, slots=True, eq=False)
class GraspMotion:
    """Three motions, each from rest to rest, each beginning where the last one ends.

    Attributes:
        transit: From the present posture to the pre-grasp, jaws open.
        approach: Straight ahead to the grasp; then the jaws close.
        lift: Straight up with the object.
    """

    transit: Trajectory
    approach: Trajectory
    lift: Trajectory

    @property
    def duration(self) -> float:
        """Length without the time of the jaws in [s]."""
        return self.transit.duration + self.approach.duration + self.lift.duration


def plan_grasp(
    planner: TransitPlanner,
    start: FloatArray,
    approach: FloatArray,
    lift: FloatArray,
    limits: Limits,
    joint_names: tuple[str, ...],
) -> GraspMotion:
    """Plan and time the motion of a grasp that was found reachable.

    Args:
        planner: Finds the way to the pre-grasp.
        start: Present joint values of the arm's group, shape (n,).
        approach: Joint values from pre-grasp to grasp, checked, shape (S, n).
        lift: Joint values from the grasp upwards, checked, shape (L, n).
        limits: Bounds of the group's joints.
        joint_names: Their names.

    Raises:
        MotionError: If there is no way to the pre-grasp, or a path leaves the limits.
    """
    return GraspMotion(
        transit=planner.move(start, approach[0]),
        approach=time_points(approach, limits, joint_names),
        lift=time_points(lift, limits, joint_names),
    )
