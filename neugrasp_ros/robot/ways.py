# SPDX-License-Identifier: Apache-2.0
"""Compiled trial of a way: the posture at the grasp, then straight back and up."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from neugrasp_ros.robot.contact import FREE, Scope, contact
from neugrasp_ros.robot.ik import IkProblem, follow_way, make_scratch

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BROKEN = -1
"""Beside the kinds of contact: the arm cannot follow the line."""


class WayProblem(NamedTuple):
    """What stays the same for all ways of one arm.

    Attributes:
        scope: What the arm can bring into contact.
        joints: Where its joints stand in a configuration, shape (n,).
        ik: Its inverse kinematics.
        max_change: Largest change of a joint between two poses in [rad] or [m].
        held_radius: Points this near to the TCP travel with the hand in a lift, [m].
    """

    scope: Scope
    joints: IntArray
    ik: IkProblem
    max_change: float
    held_radius: float


class Way(NamedTuple):
    """One way, and room for it.

    Attributes:
        retreat: Joint values from the grasp backwards, without the grasp, (S, n).
        lift: Joint values from the grasp upwards, without the grasp, (L, n).
        poses: Scratch, shape (max(S, L), 4, 4).
        full: Scratch, shape (J,).
        scratch: As of ``ik.make_scratch``.
    """

    retreat: FloatArray
    lift: FloatArray
    poses: FloatArray
    full: FloatArray
    scratch: tuple[object, ...]


class Line(NamedTuple):
    """What a way is asked for.

    Attributes:
        target: Pose ``T_base_tip`` at the grasp, shape (4, 4).
        behind: Tip positions on the way back in [m], shape (S, 3).
        above: Tip positions on the way up in [m], shape (L, 3).
        start: Configuration that holds all other joints, shape (J,).
    """

    target: FloatArray
    behind: FloatArray
    above: FloatArray
    start: FloatArray


def make_way(back: int, up: int, joints: int, width: int) -> Way:
    """Return room for ways of so many poses, of an arm's and of all joints."""
    return Way(
        retreat=np.empty((back, joints)),
        lift=np.empty((up, joints)),
        poses=np.empty((max(back, up), 4, 4)),
        full=np.empty(width),
        scratch=make_scratch(joints),
    )


@njit(cache=True, error_model="numpy")
def _follow_line(problem, target, points, q, joint_way, way):  # type: ignore[no-untyped-def]
    """Follow a line of points with the target's rotation; return whether it holds."""
    poses = way.poses
    for s in range(points.shape[0]):
        for i in range(3):
            poses[s, i, 3] = points[s, i]
            for j in range(3):
                poses[s, i, j] = target[i, j]
    line = poses[: points.shape[0]]
    reached = follow_way(
        problem.ik, line, q, problem.max_change, joint_way, way.scratch
    )
    return reached == points.shape[0]


@njit(cache=True, error_model="numpy")
def _contact_on(problem, values, full, held, place):  # type: ignore[no-untyped-def]
    """Return the first contact on a way, from its far end, where most has moved."""
    world, known, buffers = place
    joints = problem.joints
    for s in range(values.shape[0] - 1, -1, -1):
        for k in range(joints.shape[0]):
            full[joints[k]] = values[s, k]
        code, _ = contact(world, problem.scope, full, known, held, buffers)
        if code != FREE:
            return code
    return FREE


@njit(cache=True, error_model="numpy")
def try_way(problem, line, q, way, place):  # type: ignore[no-untyped-def]
    """Try the way of one posture.

    Args:
        problem: The arm.
        line: Where the hand shall go.
        q: Joint values at the grasp, shape (n,).
        way: Receives the way, complete where it is not ``BROKEN``.
        place: The world, the configuration that the buffers hold, and the buffers, as
            of ``posing.pose_world``.

    Returns:
        First contact at the grasp, and on the way, or ``BROKEN``; the latter has no
        meaning where there is contact at the grasp.
    """
    way.full[:] = line.start
    held = np.zeros(4)
    here = _contact_on(problem, q.reshape(1, q.shape[0]), way.full, held, place)
    if here != FREE:
        return here, BROKEN
    if not _follow_line(problem, line.target, line.above, q, way.lift, way):
        return here, BROKEN
    if not _follow_line(problem, line.target, line.behind, q, way.retreat, way):
        return here, BROKEN
    code = _contact_on(problem, way.retreat, way.full, held, place)
    if code == FREE:
        held[:3], held[3] = line.target[:3, 3], problem.held_radius
        code = _contact_on(problem, way.lift, way.full, held, place)
    return here, code
