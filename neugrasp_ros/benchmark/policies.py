# SPDX-License-Identifier: Apache-2.0
"""Who chooses the grasps: the network, and the two floors it must rise above."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.benchmark.protocol import Look, Plan, Policy
from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.errors import UnknownNameError
from neugrasp_ros.fusion.tsdf import empty_volume, integrate
from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.grasp.types import GraspSet
from neugrasp_ros.pipeline import EncodedScene, GraspPlanner

FloatArray = NDArray[np.float64]

MIN_QUALITY = 0.5  # below it a grasp is not worth trying (method sheet, a8)
REPEAT_DISTANCE = 0.02  # [m], of the TCP, and
REPEAT_ANGLE = 0.35  # [rad], of the approach: nearer is the grasp that failed before

POLICIES = ("neugrasp", "random", "geometry", "scored")


@dataclass
class _Planning:
    """What the policies share: one planner per gripper, a volume, candidates."""

    config: PlannerConfig
    planner: GraspPlanner | None = None
    revision: int = 0

    def candidates(
        self, look: Look, rng: np.random.Generator
    ) -> tuple[GraspPlanner, EncodedScene, GraspSet]:
        """Encode what is seen and sample grasps that have not failed before."""
        if self.planner is None or self.planner.gripper != look.gripper:
            self.planner = GraspPlanner(self.config, look.gripper)
        planner = self.planner
        planner.timings.clear()
        self.revision += 1
        view = look.view
        volume = empty_volume(planner.resolution)
        volume = integrate(volume, view.depth, view.intrinsics, view.T_task_camera)
        scene = planner.encode(volume, self.revision)
        grasps = planner.sample(
            scene,
            support_height=look.table_height,
            seed=int(rng.integers(2**31)),
        )
        return planner, scene, grasps.take(~repeats(grasps.poses, look.failed))


def repeats(poses: FloatArray, failed: tuple[FloatArray, ...]) -> NDArray[np.bool_]:
    """Tell which poses (G, 4, 4) are nearly one that failed in this round."""
    repeat = np.zeros(len(poses), dtype=bool)
    for bad in failed:
        near = np.linalg.norm(poses[:, :3, 3] - bad[:3, 3], axis=1) < REPEAT_DISTANCE
        cosine = poses[:, :3, 2] @ bad[:3, 2]
        repeat |= near & (cosine > np.cos(REPEAT_ANGLE))
    return repeat


def _plan(
    answer: GraspSet, planner: GraspPlanner, scene: EncodedScene, candidates: GraspSet
) -> Plan:
    """Return an answer with what it was chosen from."""
    return Plan(
        grasps=answer,
        timings=dict(planner.timings),
        n_candidates=len(candidates),
        classes=planner.affordances,
        candidates=candidates,
        surface=planner.render(scene).points,
        field=scene.field,
    )


def neugrasp_policy(config: PlannerConfig) -> Policy:
    """Return the policy that ranks by predicted quality and refuses poor grasps."""
    planning = _Planning(config)

    def choose(look: Look, rng: np.random.Generator) -> Plan:
        planner, scene, grasps = planning.candidates(look, rng)
        scored = planner.evaluate(scene, grasps, support_height=look.table_height)
        good = scored.take(scored.quality >= MIN_QUALITY).ranked()
        return _plan(good, planner, scene, grasps)

    return choose


def scored_policy(config: PlannerConfig) -> Policy:
    """Return the policy that answers every candidate with its scores, unranked."""
    planning = _Planning(config)

    def choose(look: Look, rng: np.random.Generator) -> Plan:
        planner, scene, grasps = planning.candidates(look, rng)
        scored = planner.evaluate(scene, grasps, support_height=look.table_height)
        return _plan(scored, planner, scene, grasps)

    return choose


def random_policy(config: PlannerConfig) -> Policy:
    """Return the floor that takes any collision-free candidate of the same sampler."""
    planning = _Planning(config)

    def choose(look: Look, rng: np.random.Generator) -> Plan:
        planner, scene, grasps = planning.candidates(look, rng)
        shuffled = grasps.take(rng.permutation(len(grasps)))
        return _plan(shuffled, planner, scene, grasps)

    return choose


def geometry_policy(config: PlannerConfig) -> Policy:
    """Return the floor that takes the best antipodal score on the completed cloud.

    The sampler returns its candidates by that score, so the first one is taken.
    """
    planning = _Planning(config)

    def choose(look: Look, rng: np.random.Generator) -> Plan:
        planner, scene, grasps = planning.candidates(look, rng)
        return _plan(grasps, planner, scene, grasps)

    return choose


def make_policy(name: str, config: PlannerConfig) -> Policy:
    """Return a policy by name.

    Raises:
        UnknownNameError: If it is none of ``POLICIES``.
    """
    makers: dict[str, Callable[[PlannerConfig], Policy]] = {
        "neugrasp": neugrasp_policy,
        "random": random_policy,
        "geometry": geometry_policy,
        "scored": scored_policy,
    }
    if name not in makers:
        raise UnknownNameError("policy", name, makers)
    load_gripper(config.gripper)
    return makers[name](config)
