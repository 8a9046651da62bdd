# SPDX-License-Identifier: Apache-2.0
"""What all policies share: how they see, find candidates, and answer."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.benchmark.protocol import Look, Plan
from neugrasp_ros.benchmark.shots import CUBE
from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.fusion.tsdf import empty_volume, integrate
from neugrasp_ros.grasp.ranking import quality_after_failures
from neugrasp_ros.grasp.types import GraspSet
from neugrasp_ros.pipeline import EncodedScene, GraspPlanner

FloatArray = NDArray[np.float64]

MIN_QUALITY = 0.5  # below it a grasp is not worth trying (method sheet, a8)
REPEAT_DISTANCE = 0.02  # [m], of the TCP, and
REPEAT_ANGLE = 0.35  # [rad], of the approach: nearer is the grasp that failed before


@dataclass
class Planning:
    """What the policies share: one planner per gripper, a volume, candidates.

    Attributes:
        config: The planner's.
        extra_voxels: How much longer than the network's cube the volume is along x
            and y [voxel].
        planner: The newest gripper's.
        revision: Of the newest volume.
    """

    config: PlannerConfig
    extra_voxels: int = 0
    planner: GraspPlanner | None = None
    revision: int = 0

    def encode(self, look: Look) -> tuple[GraspPlanner, EncodedScene]:
        """Encode what is seen."""
        if self.planner is None or self.planner.gripper != look.gripper:
            self.planner = GraspPlanner(self.config, look.gripper)
        planner = self.planner
        planner.timings.clear()
        self.revision += 1
        view = look.view
        cube = planner.resolution
        wide = cube + self.extra_voxels
        volume = empty_volume((wide, wide, cube), CUBE * wide / cube)
        volume = integrate(volume, view.depth, view.intrinsics, view.T_task_camera)
        scene = planner.encode(volume, self.revision, support_height=look.table_height)
        return planner, scene

    def candidates(
        self, look: Look, rng: np.random.Generator
    ) -> tuple[GraspPlanner, EncodedScene, GraspSet]:
        """Encode what is seen and sample grasps that have not failed before."""
        planner, scene = self.encode(look)
        return planner, scene, sample(planner, look, scene, rng)


def sample(
    planner: GraspPlanner, look: Look, scene: EncodedScene, rng: np.random.Generator
) -> GraspSet:
    """Sample grasps that have not failed before."""
    grasps = planner.sample(
        scene,
        support_height=look.table_height,
        seed=int(rng.integers(2**31)),
    )
    return grasps.take(~repeats(grasps.poses, look.failed))


def repeats(poses: FloatArray, failed: tuple[FloatArray, ...]) -> NDArray[np.bool_]:
    """Tell which poses (G, 4, 4) are nearly one that failed in this round."""
    repeat = np.zeros(len(poses), dtype=bool)
    for bad in failed:
        near = np.linalg.norm(poses[:, :3, 3] - bad[:3, 3], axis=1) < REPEAT_DISTANCE
        cosine = poses[:, :3, 2] @ bad[:3, 2]
        repeat |= near & (cosine > np.cos(REPEAT_ANGLE))
    return repeat


def worth_trying(scored: GraspSet, failed: tuple[FloatArray, ...]) -> GraspSet:
    """Return the grasps that are good enough, in the order to try them.

    Args:
        scored: Scored grasps.
        failed: Poses that failed in this round, each (4, 4).
    """
    points = np.array([pose[:3, 3] for pose in failed]).reshape(-1, 3)
    left = quality_after_failures(scored.poses[:, :3, 3], scored.quality, points)
    order = np.argsort(-left, kind="stable")
    return scored.take(order[left[order] >= MIN_QUALITY])


def answer(
    look: Look,
    grasps: GraspSet,
    planner: GraspPlanner,
    scene: EncodedScene,
    candidates: GraspSet,
) -> Plan:
    """Return grasps with what they were chosen from.

    Args:
        look: What was seen.
        grasps: Best first.
        planner: Who looked; its timings are those of this answer.
        scene: The look, encoded.
        candidates: What the grasps were chosen from.
    """
    return Plan(
        grasps=grasps,
        timings=dict(planner.timings),
        n_candidates=len(candidates),
        classes=planner.affordances,
        candidates=candidates,
        surface=planner.surface(scene, look.table_height).points,
        field=scene.field,
    )
