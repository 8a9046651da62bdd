# SPDX-License-Identifier: Apache-2.0
"""Compiled trial of whole ways: the posture at the grasp, then straight back and up."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from neugrasp_ros.robot.contact import FREE, HAND, Scope, contact
from neugrasp_ros.robot.ik import IkProblem, follow_way, make_scratch
from neugrasp_ros.robot.posing import World, make_buffers

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BROKEN, UNTRIED = -1, -2
"""Beside the kinds of contact: the arm cannot follow the line; nobody asked."""


class WayProblem(NamedTuple):
    """What stays the same for all ways of one arm.

    Attributes:
        world: Robot and obstacles.
        scope: What the arm can bring into contact.
        joints: Where its joints stand in a configuration, shape (n,).
        ik: Its inverse kinematics.
        max_change: Largest change of a joint between two poses in [rad] or [m].
        held_radius: Points this near to the TCP travel with the hand in a lift, [m].
    """

    world: World
    scope: Scope
    joints: IntArray
    ik: IkProblem
    max_change: float
    held_radius: float


class Ways(NamedTuple):
    """Ways to try, K of them, those of one grasp from the best to the worst.

    Attributes:
        grasps: Number of the grasp, shape (K,).
        arms: Number of the arm, shape (K,).
        starts: Configurations that hold all other joints, shape (K, J).
        q: Joint values at the grasp, the widest arm's n of them, shape (K, n).
        targets: Poses ``T_base_tip`` at the grasp, shape (K, 4, 4).
        behind: Tip positions on the way back in [m], shape (K, S, 3).
        above: Tip positions on the way up in [m], shape (K, L, 3).
    """

    grasps: IntArray
    arms: IntArray
    starts: FloatArray
    q: FloatArray
    targets: FloatArray
    behind: FloatArray
    above: FloatArray


class WayAnswers(NamedTuple):
    """Answers for K ways.

    Attributes:
        at_grasp: First contact at the grasp, or ``UNTRIED``, shape (K,).
        on_way: First contact on the way, or ``BROKEN``; of no meaning where there is
            contact at the grasp, shape (K,).
        retreats: Joint values from the grasp backwards, without the grasp, (K, S, n).
        lifts: Joint values from the grasp upwards, without the grasp, (K, L, n).
    """

    at_grasp: IntArray
    on_way: IntArray
    retreats: FloatArray
    lifts: FloatArray


def no_answers(ways: Ways) -> WayAnswers:
    """Return room for the answers."""
    count, width = ways.q.shape
    return WayAnswers(
        at_grasp=np.full(count, UNTRIED),
        on_way=np.full(count, BROKEN),
        retreats=np.full((count, ways.behind.shape[1], width), np.nan),
        lifts=np.full((count, ways.above.shape[1], width), np.nan),
    )


@njit(cache=True, error_model="numpy")
def _follow_line(problem, target, points, q, way, poses, scratch):  # type: ignore[no-untyped-def]
    """Follow a line of points with the target's rotation; return whether it holds."""
    for s in range(points.shape[0]):
        for i in range(3):
            poses[s, i, 3] = points[s, i]
            for j in range(3):
                poses[s, i, j] = target[i, j]
    line = poses[: points.shape[0]]
    reached = follow_way(problem.ik, line, q, problem.max_change, way, scratch)
    return reached == points.shape[0]


@njit(cache=True, error_model="numpy")
def _contact_on(problem, way, full, known, held, buffers):  # type: ignore[no-untyped-def]
    """Return the first contact on a way, from its far end, where most has moved."""
    joints = problem.joints
    for s in range(way.shape[0] - 1, -1, -1):
        for k in range(joints.shape[0]):
            full[joints[k]] = way[s, k]
        code, _ = contact(problem.world, problem.scope, full, known, held, buffers)
        if code != FREE:
            return code
    return FREE


@njit(cache=True, error_model="numpy")
def _try_way(problem, ways, i, answers, known, buffers):  # type: ignore[no-untyped-def]
    """Try way ``i``; its answers become known."""
    n = problem.joints.shape[0]
    full, target = ways.starts[i].copy(), ways.targets[i]
    behind, above = ways.behind[i], ways.above[i]
    q = ways.q[i, :n].copy()
    back, up = np.empty((behind.shape[0], n)), np.empty((above.shape[0], n))
    held = np.zeros(4)
    here = _contact_on(problem, q.reshape(1, n), full, known, held, buffers)
    answers.at_grasp[i], answers.on_way[i] = here, BROKEN
    if here != FREE:
        return
    poses = np.empty((max(behind.shape[0], above.shape[0]), 4, 4))
    scratch = make_scratch(n)
    if not _follow_line(problem, target, behind, q, back, poses, scratch):
        return
    if not _follow_line(problem, target, above, q, up, poses, scratch):
        return
    code = _contact_on(problem, back, full, known, held, buffers)
    if code == FREE:
        held[:3], held[3] = target[:3, 3], problem.held_radius
        code = _contact_on(problem, up, full, known, held, buffers)
    answers.on_way[i] = code
    answers.retreats[i, :, :n], answers.lifts[i, :, :n] = back, up


@njit(cache=True, error_model="numpy")
def try_ways(problems, ways, closed, answers):  # type: ignore[no-untyped-def]
    """Try the ways of each grasp until one is free, or the hand hits the scene.

    Where the hand itself hits the scene, no other way helps.

    Args:
        problems: One ``WayProblem`` for each arm, a tuple.
        ways: The ways.
        closed: Grasps that are not asked about; those settled here join, shape (N,).
        answers: From ``no_answers``; receives the answers.
    """
    pairs = 0
    for arm in range(len(problems)):
        pairs = max(pairs, problems[arm].scope.pairs.shape[0])
    # one posed world serves all arms; what separated a pair is a guess, so it may mix
    buffers = make_buffers(problems[0].world, pairs)
    known = np.full(ways.starts.shape[1], np.nan)
    for i in range(ways.grasps.shape[0]):
        grasp = ways.grasps[i]
        if closed[grasp]:
            continue
        _try_way(problems[ways.arms[i]], ways, i, answers, known, buffers)
        here, on_way = answers.at_grasp[i], answers.on_way[i]
        if here == HAND or here == FREE and (on_way == FREE or on_way == HAND):
            closed[grasp] = True
