# SPDX-License-Identifier: Apache-2.0
"""Where the base would have to stand so that an arm reaches a grasp."""

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.transform import apply, invert
from neugrasp_ros.robot.obstacles import Obstacles, SolidBox, make_obstacles
from neugrasp_ros.robot.reachability import ReachabilityChecker

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

AHEAD = np.linspace(-0.6, 0.9, 16)  # [m]; how far the base may go, and in which steps
ASIDE = np.linspace(-0.6, 0.6, 13)  # [m]
TURNS = np.deg2rad([-60.0, -30.0, 0.0, 30.0, 60.0])
TURN_COST = 0.3  # [m/rad]; how far a turn counts as
EXAMINED = 10  # places that are checked in full
SAMPLED = 2  # grasps by which all places are compared
MAX_GRASPS = 16  # of those asked for; they are near to each other
NO_TURN = nullcontext()
BODY = ((0.05, 0.35, 0.28), (0.35, 1.2, 0.22))  # [m]; from, to, radius: base, torso


class BaseSuggestion(NamedTuple):
    """A place for the base.

    Attributes:
        T_base_place: Pose of the base there, seen from where it stands now, (4, 4).
        reachable: How many of the asked grasps are reached from it; 0 = no place found.
    """

    T_base_place: FloatArray
    reachable: int


def suggest_base(
    checker: ReachabilityChecker,
    T_base_grippers: FloatArray,
    *,
    arms: Sequence[str] = (),
    start: FloatArray | None = None,
    points_base: FloatArray | None = None,
    boxes: Sequence[SolidBox] = (),
    turn: AbstractContextManager[object] = NO_TURN,
) -> BaseSuggestion:
    """Find a near place from which most of the grasps are reached.

    Places lie on a grid about the present one; they are ranked by inverse kinematics
    and their distance, and the first are checked with all that a grasp needs.

    Args:
        checker: The robot.
        T_base_grippers: Gripper poses, the best first, shape (N, 4, 4).
        arms: Planning groups to try; empty = all.
        start: Present configuration, shape (J,).
        points_base: Seen surface in [m], shape (M, 3).
        boxes: Solid boxes.
        turn: Entered for each check, so that other users of the checker come between.
    """
    grasps = T_base_grippers[:MAX_GRASPS]
    points = np.empty((0, 3)) if points_base is None else points_base
    places = np.array(
        [
            T
            for T in (_place(*where) for where in product(AHEAD, ASIDE, TURNS))
            if _stands_free(T, points, boxes)
        ]
    ).reshape(-1, 4, 4)
    names = tuple(arms) or tuple(checker.arms)
    ranked = _rank(checker, places, grasps[:SAMPLED], names)
    best = BaseSuggestion(np.eye(4), 0)
    for T in ranked[:EXAMINED]:
        seen = _seen_from(T, points, boxes)
        with turn:
            result = checker.check(
                invert(T) @ grasps, arms=names, start=start, obstacles=seen
            )
        count = int(result.reachable.sum())
        if count > best.reachable:
            best = BaseSuggestion(T, count)
        if count == len(grasps):
            break
    return best


def _rank(
    checker: ReachabilityChecker,
    places: FloatArray,
    grasps: FloatArray,
    arms: Sequence[str],
) -> FloatArray:
    """Return places from which an arm reaches all of a way, most and nearest first."""
    way = np.repeat(grasps[:, None], 3, axis=1)  # grasp, pre-grasp, lifted
    way[:, 1, :3, 3] -= checker.config.pregrasp_distance * grasps[:, :3, 2]
    way[:, 2, 2, 3] += checker.config.lift_distance
    there = (invert(places)[:, None] @ way.reshape(1, -1, 4, 4)).reshape(-1, 4, 4)
    whole = np.zeros((len(places), len(grasps)), dtype=bool)
    for name in arms:
        reached = checker.arms[name].solve(there, seeds=2).reached
        whole |= reached.reshape(len(places), len(grasps), 3).all(axis=2)
    counts = whole.sum(axis=1)
    turns = np.arctan2(places[:, 1, 0], places[:, 0, 0])
    costs = np.hypot(places[:, 0, 3], places[:, 1, 3]) + TURN_COST * np.abs(turns)
    order = np.lexsort([costs, -counts])
    found: FloatArray = places[order[counts[order] > 0]]
    return found


def _place(x: float, y: float, turn: float) -> FloatArray:
    T = np.eye(4)
    c, s = np.cos(turn), np.sin(turn)
    T[:2, :2], T[:2, 3] = [[c, -s], [s, c]], (x, y)
    return T


def _seen_from(
    T: FloatArray, points: FloatArray, boxes: Sequence[SolidBox]
) -> Obstacles:
    back = invert(T)
    moved = [SolidBox(back @ box.T_base_box, box.size) for box in boxes]
    return make_obstacles(apply(back, points), boxes=moved)


def _stands_free(T: FloatArray, points: FloatArray, boxes: Sequence[SolidBox]) -> bool:
    """Return whether base and torso, as upright cylinders, touch nothing."""
    away = np.hypot(*(points[:, :2] - T[:2, 3]).T)
    for low, high, radius in BODY:
        level = (points[:, 2] > low) & (points[:, 2] < high)
        if np.any(away[level] < radius):
            return False
        for box in boxes:
            half = np.abs(box.T_base_box[:3, :3]) @ np.asarray(box.size) / 2
            center = box.T_base_box[:3, 3]
            if center[2] + half[2] < low or center[2] - half[2] > high:
                continue
            gap = np.maximum(np.abs(T[:2, 3] - center[:2]) - half[:2], 0.0)
            if np.hypot(*gap) < radius:
                return False
    return True
