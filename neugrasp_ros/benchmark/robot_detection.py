# SPDX-License-Identifier: Apache-2.0
"""Grasps that a robot reaches in what it sees: reach asked last, or first."""

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.fusion.tsdf import seen_surface
from neugrasp_ros.geometry.support import ABOVE_SUPPORT
from neugrasp_ros.geometry.transform import flip_gripper
from neugrasp_ros.grasp.ranking import distinct
from neugrasp_ros.grasp.types import GraspSet
from neugrasp_ros.manipulation.mover import Surroundings
from neugrasp_ros.manipulation.scene_watch import SeenScene
from neugrasp_ros.pipeline import GraspPlanner
from neugrasp_ros.robot.obstacles import Obstacles, make_obstacles
from neugrasp_ros.robot.reachability import Reach, ReachabilityChecker

FloatArray = NDArray[np.float64]

SUPPORT_HEIGHT = 0.05  # [m], of the support in the task frame
LEAST_POINTS = 20  # that make something to grasp
GOOD_QUALITY = 0.5
NEAR, TURNED = 0.02, float(np.deg2rad(20.0))  # [m], [rad]; nearer is the same grasp
MAX_CANDIDATES = 256


@dataclass(frozen=True, eq=False)
class Found:
    """What a detection gave.

    Attributes:
        poses: Gripper poses ``T_base_gripper``, best first, shape (G, 4, 4).
        quality: Shape (G,).
        arms: Planning group that reaches each.
        sampled: Candidates proposed.
        scored: Candidates that the network was asked about.
        codes: How often each reachability code came, by name.
        seconds: Time of each stage in [s].
        why: Why there is no grasp; empty if there is one.
    """

    poses: FloatArray = field(default_factory=lambda: np.zeros((0, 4, 4)))
    quality: FloatArray = field(default_factory=lambda: np.zeros(0))
    arms: tuple[str, ...] = ()
    sampled: int = 0
    scored: int = 0
    codes: Mapping[str, int] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    why: str = ""


class Detector:
    """Finds reachable grasps.

    Args:
        planner: Proposes and scores.
        checker: Knows what the robot reaches.
        candidates: How many to propose at most.
    """

    def __init__(
        self,
        planner: GraspPlanner,
        checker: ReachabilityChecker,
        candidates: int = MAX_CANDIDATES,
    ) -> None:
        self._planner, self._checker = planner, checker
        self._candidates = candidates

    def find(
        self,
        scene: SeenScene,
        around: Surroundings,
        q: FloatArray,
        *,
        seed: int,
        reach_first: bool = False,
        budget: float = 0.0,
    ) -> Found:
        """Propose, score and check, in the order asked for.

        Args:
            scene: What is seen.
            around: What the robot must not hit.
            q: Where it stands, shape (J,).
            seed: Of the sampler.
            reach_first: Score only candidates that can be reached.
            budget: After so many seconds since the candidates were there, no further
                batch is scored; 0 = no budget. A check that comes first counts, too.
        """
        points, _ = seen_surface(scene.volume)
        if np.sum(points[:, 2] > SUPPORT_HEIGHT + ABOVE_SUPPORT) < LEAST_POINTS:
            return Found(why="EMPTY_WORKSPACE")
        seconds: dict[str, float] = {}
        with _timed(seconds, "proposing"):
            encoded = self._planner.encode(scene.volume, scene.revision)
            grasps = self._planner.sample(
                encoded, max_candidates=self._candidates, seed=seed
            )
        sampled = len(grasps)
        if not sampled:
            return Found(seconds=seconds, why="NO_CANDIDATES")
        deadline = time.perf_counter() + budget if budget else None
        obstacles = make_obstacles(around.points, boxes=around.boxes)
        reach = _Reach(self._checker, scene.T_base_task, q, obstacles)
        if reach_first:
            with _timed(seconds, "reachability"):
                grasps = reach.cut(grasps)
        with _timed(seconds, "scoring"):
            grasps = self._planner.evaluate(encoded, grasps, deadline=deadline)
        scored = int(np.isfinite(grasps.quality).sum())
        grasps = _good(grasps)
        good = len(grasps)
        if not reach_first:
            with _timed(seconds, "reachability"):
                grasps = reach.cut(grasps)
        return Found(
            poses=scene.T_base_task @ grasps.poses,
            quality=grasps.quality,
            arms=tuple(reach.arms[name] for name in grasps.ids),
            sampled=sampled,
            scored=scored,
            codes=reach.codes,
            seconds=seconds,
            why="" if len(grasps) else _reason(good, reach.codes),
        )


class _Reach:
    """Cuts grasps to those that are reached, and remembers what it found.

    Attributes:
        arms: Planning group by the name of the grasp.
        codes: How often each code came, by name.
    """

    def __init__(
        self,
        checker: ReachabilityChecker,
        T_base_task: FloatArray,
        q: FloatArray,
        obstacles: Obstacles,
    ) -> None:
        self._checker, self._T, self._q = checker, T_base_task, q
        self._obstacles = obstacles
        self.arms: dict[str, str] = {}
        self.codes: dict[str, int] = {}

    def cut(self, grasps: GraspSet) -> GraspSet:
        """Return the reachable grasps, turned to the side that is reached."""
        result = self._checker.check(
            self._T @ grasps.poses, start=self._q, obstacles=self._obstacles
        )
        self.codes = {
            Reach(int(code)).name: int(count)
            for code, count in zip(
                *np.unique(result.codes, return_counts=True), strict=True
            )
        }
        self.arms = {name: result.arm_of(row) for row, name in enumerate(grasps.ids)}
        turned = np.where(
            result.flipped[:, None, None], flip_gripper(grasps.poses), grasps.poses
        )
        return replace(grasps, poses=turned).take(result.reachable)


def _good(grasps: GraspSet) -> GraspSet:
    """Return distinct grasps of good quality, best first."""
    grasps = grasps.take(np.nan_to_num(grasps.quality, nan=-1.0) >= GOOD_QUALITY)
    return grasps.take(distinct(grasps.poses, grasps.quality, NEAR, TURNED))


def _reason(good: int, codes: Mapping[str, int]) -> str:
    if good:
        return "NONE_REACHABLE"
    reached = codes.get(Reach.OK.name, 0) if codes else 1
    return "NONE_ABOVE_QUALITY" if reached else "NONE_REACHABLE"


@contextmanager
def _timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    begin = time.perf_counter()
    yield
    seconds[stage] = time.perf_counter() - begin
