# SPDX-License-Identifier: Apache-2.0
"""What ``reachability_filter`` does, without its topics."""

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np
from neugrasp_msgs.msg import Grasp
from numpy.typing import NDArray

from neugrasp_ros.errors import ConfigError, RobotModelError
from neugrasp_ros.fusion.tsdf import seen_surface
from neugrasp_ros.geometry.transform import apply, flip_gripper
from neugrasp_ros.nodes.grasp_list import STAGE_REACHABLE, GraspList, Reach
from neugrasp_ros.nodes.params import LiveConfig
from neugrasp_ros.nodes.scene_view import SceneView
from neugrasp_ros.nodes.settings import ReachConfig
from neugrasp_ros.nodes.solid_boxes import KnownBoxes
from neugrasp_ros.nodes.transforms import Transforms
from neugrasp_ros.robot.obstacles import SolidBox, make_obstacles

FloatArray = NDArray[np.float64]

BATCH = 64  # grasps of a stream for whose check a request has to wait at most


class Checker(Protocol):
    """A robot that can say which grasps it reaches.

    Attributes:
        base_frame: Frame in which it takes poses.
        joint_names: Order of the joint positions that it returns.
        arms: Planning groups with a hand.
    """

    base_frame: str
    joint_names: tuple[str, ...]
    arms: tuple[str, ...]

    def check(
        self,
        T_base_grippers: FloatArray,
        arms: tuple[str, ...],
        start: Mapping[str, float],
        points: FloatArray | None,
        boxes: Sequence[SolidBox] = (),
    ) -> "Checked":
        """Check poses for any of the arms.

        Args:
            T_base_grippers: Gripper poses, shape (G, 4, 4).
            arms: Planning groups to try.
            start: Present joint values by name.
            points: Surface of the scene in the base frame (M, 3), None = unknown.
            boxes: Known solid boxes in the base frame.
        """

    def suggest_base(
        self,
        T_base_grippers: FloatArray,
        arms: tuple[str, ...],
        start: Mapping[str, float],
        points: FloatArray | None,
        boxes: Sequence[SolidBox] = (),
    ) -> FloatArray | None:
        """Return where the base would have to stand (4, 4), None if nowhere near.

        Args:
            T_base_grippers: Gripper poses, the best first, shape (G, 4, 4).
            arms: As of ``check``, like the others.
            start: Present joint values by name.
            points: Surface of the scene.
            boxes: Known solid boxes.
        """

    def tcp_frame(self, arm: str) -> str:
        """Return the TF frame of an arm's TCP."""


class Checked(NamedTuple):
    """What the robot makes of grasps, and which of them it takes half-turned (G,)."""

    reach: Reach
    flipped: NDArray[np.bool_]


MakeChecker = Callable[[ReachConfig], Checker]


class RobotChecker:
    """The robot's own reachability check behind the node's interface.

    Args:
        config: Robot, arms and limits.
    """

    def __init__(self, config: ReachConfig) -> None:
        from neugrasp_ros.robot.model import load_robot
        from neugrasp_ros.robot.reachability import ReachabilityChecker

        self._robot = load_robot(config.robot)
        self._checker = ReachabilityChecker(self._robot, config, config.ik)
        self._lock = threading.Lock()
        self.base_frame = self._robot.description.base_frame
        self.joint_names = self._robot.joint_names
        self.arms = tuple(self._checker.arms)
        self._try_once()

    def _try_once(self) -> None:
        """Check poses that are reached; the first check of a process compiles code.

        It is compiled anew for each number of arms.
        """
        from neugrasp_ros.robot.model import gripper_from_tcp

        tcps = [
            self._robot.frame_pose(self._robot.home, self.tcp_frame(arm))
            for arm in self.arms
        ]
        far = np.array([[2.0, 0.0, 0.5]])  # an obstacle in nobody's way [m]
        poses = gripper_from_tcp(np.array(tcps))
        for count in range(1, len(self.arms) + 1):
            self.check(poses, self.arms[:count], {}, far)

    def tcp_frame(self, arm: str) -> str:
        """Return the TF frame of an arm's TCP."""
        return self._robot.description.groups[arm].tcp_frame

    def check(
        self,
        T_base_grippers: FloatArray,
        arms: tuple[str, ...],
        start: Mapping[str, float],
        points: FloatArray | None,
        boxes: Sequence[SolidBox] = (),
    ) -> Checked:
        """Check poses (G, 4, 4), see ``Checker``."""
        q_start, points = self._now(start, points)
        obstacles = None
        if points is not None or boxes:
            obstacles = make_obstacles(points, boxes=boxes)
        with self._lock:
            result = self._checker.check(
                T_base_grippers, arms=arms, start=q_start, obstacles=obstacles
            )
        rows = range(len(result))
        nothing = np.zeros(0)
        reach = Reach(
            codes=result.codes.astype(np.uint8),
            arms=tuple(result.arm_of(row) for row in rows),
            manipulability=result.manipulability,
            joints=tuple(result.q[r] if result.reachable[r] else nothing for r in rows),
        )
        return Checked(reach, result.flipped & result.reachable)

    def suggest_base(
        self,
        T_base_grippers: FloatArray,
        arms: tuple[str, ...],
        start: Mapping[str, float],
        points: FloatArray | None,
        boxes: Sequence[SolidBox] = (),
    ) -> FloatArray | None:
        """Return where the base would have to stand, see ``Checker``."""
        from neugrasp_ros.robot.base_placement import suggest_base

        q_start, points = self._now(start, points)
        found = suggest_base(
            self._checker,
            T_base_grippers,
            arms=arms,
            start=q_start,
            points_base=points,
            boxes=boxes,
            turn=self._lock,
        )
        return found.T_base_place if found.reachable else None

    def _now(
        self, start: Mapping[str, float], points: FloatArray | None
    ) -> tuple[FloatArray, FloatArray | None]:
        """Return the present configuration, and the points that are not the robot."""
        q = self._robot.configuration(start, default=self._robot.home)
        if points is not None and len(points):
            points = points[self._checker.collisions.off_robot(points, q)]
        return q, points


def load_checker(config: ReachConfig) -> Checker:
    """Load the robot that the configuration names.

    Raises:
        NeuGraspError: If its description, a group or a frame is missing.
    """
    from neugrasp_ros.robot.description import load_description

    known = load_description(config.robot).arms
    unknown = sorted(set(config.arms) - set(known))
    if unknown:
        raise RobotModelError("arm", unknown[0], known)
    return RobotChecker(config)


class ReachStage:
    """Checks grasps against the robot.

    Args:
        checker: The robot.
        config: Live configuration.
        transforms: From other frames to the robot's base.
        joints: Returns the newest joint values by name.

    Attributes:
        boxes: Known solid boxes.
    """

    def __init__(
        self,
        checker: Checker,
        config: LiveConfig[ReachConfig],
        transforms: Transforms,
        joints: Callable[[], Mapping[str, float]],
    ) -> None:
        self._checker = checker
        self._config = config
        self._transforms = transforms
        self._joints = joints
        self._view: SceneView | None = None
        self.boxes = KnownBoxes(checker.base_frame, transforms)

    @property
    def base_frame(self) -> str:
        """Frame in which the robot takes poses."""
        return self._checker.base_frame

    def remember(self, view: SceneView) -> None:
        """Take the newest scene as what the robot must not hit."""
        self._view = view

    def require_arms(self, arms: tuple[str, ...]) -> None:
        """Refuse planning groups that the robot does not have.

        Raises:
            ConfigError: Naming one of them, and those there are.
        """
        unknown = sorted(set(arms) - set(self._checker.arms))
        if unknown:
            raise ConfigError(
                f"unknown arm {unknown[0]!r}; known: {', '.join(self._checker.arms)}"
            )

    def check(
        self,
        grasps: GraspList,
        arms: tuple[str, ...],
        start: Mapping[str, float] | None = None,
        before_batch: Callable[[], bool] | None = None,
    ) -> GraspList:
        """Return the grasps, in their order, with what the robot makes of each.

        Args:
            grasps: Grasps in any frame; none, with one arm, ask for that arm's hand:
                ``tcp_frame`` of what is returned.
            arms: Planning groups to try; empty = the configured ones.
            start: Joint values by name; empty = the newest that came.
            before_batch: Called before each ``BATCH`` of grasps, for who can wait;
                returns whether it did: what is left is then checked in the world as it
                is by that time. None = all are one batch.

        Raises:
            ConfigError: If an arm is unknown.
            DetectionError: If the frame, or that of a known box, is not connected to
                the robot's base.
        """
        self.require_arms(arms)
        info = grasps.info
        if not len(grasps):
            hand = self._checker.tcp_frame(arms[0]) if len(arms) == 1 else ""
            hand = hand or info.tcp_frame
            info = replace(info, stage=STAGE_REACHABLE, tcp_frame=hand)
            return replace(grasps, info=info)
        poses = grasps.grasps.poses
        size = BATCH if before_batch else len(poses)
        parts: list[Checked] = []
        for first in range(0, len(poses), size):
            waited = bool(before_batch and before_batch())
            if waited or not parts:
                T = self._transforms(
                    self._checker.base_frame, info.frame_id, info.stamp
                )
                world = (
                    arms or self._config.current.arms,
                    start or self._joints(),
                    self._obstacles(),
                    self.boxes.in_base(),
                )
            parts.append(self._checker.check(T @ poses[first : first + size], *world))
        reach = Reach.joined([part.reach for part in parts])
        flipped = np.concatenate([part.flipped for part in parts])
        poses = np.where(flipped[:, None, None], flip_gripper(poses), poses)
        best_arm = next((arm for arm in reach.arms if arm), "")
        info = replace(
            info,
            stage=STAGE_REACHABLE,
            joint_names=self._checker.joint_names,
            tcp_frame=self._checker.tcp_frame(best_arm) if best_arm else info.tcp_frame,
        )
        turned = replace(grasps.grasps, poses=poses)
        return replace(grasps, info=info, grasps=turned, reach=reach)

    def suggest_base(
        self, grasps: GraspList, arms: tuple[str, ...]
    ) -> FloatArray | None:
        """Return where the base would have to stand, seen from where it stands now.

        Args:
            grasps: Grasps that cannot be reached, the best first.
            arms: As of ``check``.

        Returns:
            Pose in ``base_frame``, shape (4, 4); None if there is no such place near.

        Raises:
            ConfigError: If an arm is unknown.
            DetectionError: As ``check``.
        """
        self.require_arms(arms)
        info = grasps.info
        T = self._transforms(self._checker.base_frame, info.frame_id, info.stamp)
        return self._checker.suggest_base(
            T @ grasps.grasps.poses,
            arms or self._config.current.arms,
            self._joints(),
            self._obstacles(),
            self.boxes.in_base(),
        )

    def _obstacles(self) -> FloatArray | None:
        """Return the seen surface in the robot's base frame, None without a scene."""
        view = self._view
        if view is None:
            return None
        T = self._transforms(self._checker.base_frame, view.frame_id, view.stamp)
        points, _ = seen_surface(view.volume)
        return apply(T @ view.T_frame_task, points)

    @staticmethod
    def reached(grasps: GraspList) -> NDArray[np.bool_]:
        """Tell which checked grasps are reached, shape (G,)."""
        reach = grasps.reach or Reach.unknown(len(grasps))
        return np.asarray(reach.codes == Grasp.REACH_OK)
