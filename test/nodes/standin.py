# SPDX-License-Identifier: Apache-2.0
"""A planner and a robot in closed form, for what the nodes do around them."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from neugrasp_ros.fusion.tsdf import TsdfVolume, seen_surface
from neugrasp_ros.geometry.transform import canonical_gripper, make_transform
from neugrasp_ros.grasp.types import GraspSet
from neugrasp_ros.nodes.grasp_list import Reach
from neugrasp_ros.nodes.reach_stage import Checked
from neugrasp_ros.nodes.shared_planner import SharedPlanner

DOWN = np.diag([1.0, -1.0, -1.0])  # z approach points down
CELL = 0.05  # [m]; one candidate per occupied cell


@dataclass(frozen=True, eq=False)
class Encoded:
    volume: TsdfVolume
    revision: int


class SurfacePlanner:
    """Grasps straight down onto what was seen; the higher, the better."""

    seeds: list[int] = []  # that any of them was given

    def __init__(self, affordances: tuple[str, ...] = ()) -> None:
        self.affordances = affordances
        self.encoder_passes = 0
        self.timings: dict[str, float] = {}
        self._encoded: Encoded | None = None
        self.prepared: list[int] = []  # revisions that got ready for scores
        self.supports: list[float] = []  # heights that it was told to encode above [m]

    def encode(
        self, volume: TsdfVolume, revision: int, *, support_height: float
    ) -> Encoded:
        self.supports.append(support_height)
        known = self._encoded
        if known is None or known.revision != revision:
            self.encoder_passes += 1
            self.timings["encoding"] = 0.001
            self._encoded = Encoded(volume, revision)
        return self._encoded

    def prepare(self, scene: Encoded) -> None:
        self.prepared.append(scene.revision)

    def render(self, scene: Encoded) -> SimpleNamespace:
        points, normals = seen_surface(scene.volume)
        return SimpleNamespace(points=points, normals=normals)

    def sample(self, scene, *, support_height, roi, max_candidates, seed):
        self.seeds.append(seed)
        points = self.render(scene).points
        points = points[points[:, 2] > support_height + 0.02]
        if roi is not None:
            points = points[((points >= roi[0]) & (points <= roi[1])).all(axis=1)]
        if not len(points):
            return GraspSet(np.zeros((0, 4, 4)), np.zeros(0))
        cells = np.unique(np.floor(points / CELL).astype(int), axis=0)
        near = [points[(np.floor(points / CELL) == c).all(axis=1)] for c in cells]
        tops = np.array([p.mean(axis=0) for p in near])[:max_candidates]
        poses = make_transform(np.broadcast_to(DOWN, (len(tops), 3, 3)), tops)
        self.timings["sampling"] = 0.001
        return GraspSet(canonical_gripper(poses), np.full(len(tops), 0.06))

    def contacts(self, scene, grasps):
        """Return points half a width to both sides of the TCP."""
        sideways = grasps.poses[:, None, :3, 1] * grasps.widths[:, None, None] / 2
        middle = grasps.poses[:, None, :3, 3]
        return np.concatenate([middle + sideways, middle - sideways], axis=1)

    def evaluate(self, scene, grasps, *, support_height):
        height = grasps.poses[:, 2, 3] - support_height
        quality = np.clip(0.6 + 4 * height, 0.0, 1.0)
        shares = np.linspace(0.9, 0.1, len(self.affordances))
        self.timings["quality"] = 0.001
        return grasps.with_scores(quality, np.tile(shares, (len(grasps), 1)))


def make_standin(config) -> SharedPlanner:
    return SharedPlanner(SurfacePlanner(), config.gripper)


class SideChecker:
    """Reaches what lies on the side of each arm: left y >= 0, right y < 0."""

    base_frame = "base_footprint"
    joint_names = ("left_joint", "right_joint")
    arms = ("arm_left_torso", "arm_right_torso")

    def check(self, T_base_grippers, arms, start, points, boxes=()):
        left = T_base_grippers[:, 1, 3] >= 0
        wanted = np.where(left, self.arms[0], self.arms[1])
        reached = np.isin(wanted, arms)
        reach = Reach(
            codes=np.where(reached, 1, 2).astype(np.uint8),
            arms=tuple(np.where(reached, wanted, "").tolist()),
            manipulability=np.where(reached, 0.5, np.nan),
            joints=tuple(np.array([0.1, 0.2]) if r else np.zeros(0) for r in reached),
        )
        return Checked(reach, np.zeros(len(reached), dtype=bool))

    def suggest_base(self, T_base_grippers, arms, start, points, boxes=()):
        """Half a metre to the side of the arm that was asked for."""
        T = np.eye(4)
        T[1, 3] = -0.5 if "arm_left_torso" in arms else 0.5
        return T

    def tcp_frame(self, arm):
        return f"gripper_{arm.split('_')[1]}_tcp"


def make_side_checker(config) -> SideChecker:
    return SideChecker()
