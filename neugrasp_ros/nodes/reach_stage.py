# SPDX-License-Identifier: Apache-2.0
"""What ``reachability_filter`` does, without its topics."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Protocol

import numpy as np
from neugrasp_msgs.msg import Grasp
from numpy.typing import NDArray

from neugrasp_ros.errors import ConfigError
from neugrasp_ros.geometry.transform import flip_gripper
from neugrasp_ros.nodes.grasp_list import STAGE_REACHABLE, GraspList, Reach
from neugrasp_ros.nodes.params import LiveConfig
from neugrasp_ros.nodes.settings import ReachConfig
from neugrasp_ros.nodes.transforms import Transforms

FloatArray = NDArray[np.float64]


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
    ) -> Reach:
        """Check poses (G, 4, 4) for any of the arms, from joint values by name."""

    def tcp_frame(self, arm: str) -> str:
        """Return the TF frame of an arm's TCP."""


MakeChecker = Callable[[ReachConfig], Checker]


class ArmChecker:
    """Inverse kinematics within joint limits, for several arms and both twins.

    Args:
        config: Robot and arms.
    """

    def __init__(self, config: ReachConfig) -> None:
        from neugrasp_ros.robot.kinematics import ArmKinematics
        from neugrasp_ros.robot.model import load_robot

        robot = load_robot(config.robot)
        self._robot = robot
        self._arms = {arm: ArmKinematics(robot, arm) for arm in config.arms}
        self.base_frame = robot.description.base_frame
        self.joint_names = robot.joint_names
        self.arms = tuple(self._arms)

    def tcp_frame(self, arm: str) -> str:
        """Return the TF frame of an arm's TCP."""
        return self._robot.description.groups[arm].tcp_frame

    def check(
        self,
        T_base_grippers: FloatArray,
        arms: tuple[str, ...],
        start: Mapping[str, float],
    ) -> Reach:
        """Check poses (G, 4, 4) for the arms in their order; the best wins.

        Among the solutions of a grasp the one with the largest manipulability is
        returned.
        """
        count = len(T_base_grippers)
        q_start = self._robot.configuration(start, default=self._robot.home)
        codes = np.full(count, Grasp.REACH_NO_IK, dtype=np.uint8)
        best, names = np.full(count, np.nan), [""] * count
        joints = [np.zeros(0)] * count
        for arm in arms:
            kinematics = self._arms[arm]
            for poses in (T_base_grippers, flip_gripper(T_base_grippers)):
                near = q_start[kinematics.indices]
                found = kinematics.solve(poses, near=near)
                value = kinematics.manipulability(found.q)
                for row in np.flatnonzero(found.reached):
                    if names[row] and value[row] <= best[row]:
                        continue
                    q = q_start.copy()
                    q[kinematics.indices] = found.q[row]
                    best[row], names[row], joints[row] = value[row], arm, q
                    codes[row] = Grasp.REACH_OK
                missed = codes != Grasp.REACH_OK
                if missed.any():
                    beyond = kinematics.reaches_beyond_limits(poses[missed])
                    codes[np.flatnonzero(missed)[beyond]] = Grasp.REACH_LIMITS
        return Reach(
            codes=codes, arms=tuple(names), manipulability=best, joints=tuple(joints)
        )


def load_checker(config: ReachConfig) -> Checker:
    """Load the robot that the configuration names.

    Raises:
        NeuGraspError: If its description, a group or a frame is missing.
    """
    return ArmChecker(config)


class ReachStage:
    """Checks grasps against the robot.

    Args:
        checker: The robot.
        config: Live configuration.
        transforms: From other frames to the robot's base.
        joints: Returns the newest joint values by name.
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

    def check(
        self,
        grasps: GraspList,
        arms: tuple[str, ...],
        start: Mapping[str, float] | None = None,
    ) -> GraspList:
        """Return the grasps, in their order, with what the robot makes of each.

        Args:
            grasps: Grasps in any frame.
            arms: Planning groups to try; empty = the configured ones.
            start: Joint values by name; empty = the newest that came.

        Raises:
            ConfigError: If an arm is unknown.
            DetectionError: If the frame is not connected to the robot's base.
        """
        unknown = sorted(set(arms) - set(self._checker.arms))
        if unknown:
            raise ConfigError(
                f"unknown arm {unknown[0]!r}; known: {', '.join(self._checker.arms)}"
            )
        info = grasps.info
        T = self._transforms(self._checker.base_frame, info.frame_id, info.stamp)
        reach = self._checker.check(
            T @ grasps.grasps.poses,
            arms or self._config.current.arms,
            start or self._joints(),
        )
        best_arm = next((arm for arm in reach.arms if arm), "")
        info = replace(
            info,
            stage=STAGE_REACHABLE,
            joint_names=self._checker.joint_names,
            tcp_frame=self._checker.tcp_frame(best_arm) if best_arm else info.tcp_frame,
        )
        return replace(grasps, info=info, reach=reach)

    @staticmethod
    def reached(grasps: GraspList) -> NDArray[np.bool_]:
        """Tell which checked grasps are reached, shape (G,)."""
        reach = grasps.reach or Reach.unknown(len(grasps))
        return np.asarray(reach.codes == Grasp.REACH_OK)
