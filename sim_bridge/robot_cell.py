# SPDX-License-Identifier: Apache-2.0
"""A described robot as the simulator wants it: body, controllers, and its stance."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.robot.model import RobotModel
from neugrasp_ros.robot.posture import aim_head
from neugrasp_ros.robot.urdf import advance_joint, finger_joints
from sim_bridge.furniture import Furniture
from sim_bridge.joint_drive import DriveLimits
from sim_bridge.robot_body import RobotSetup
from sim_bridge.robot_world import Stance, finger_joint
from sim_bridge.world import TABLE_HEIGHT

FloatArray = NDArray[np.float64]

HEAD_JOINTS = ("head_1_joint", "head_2_joint")
FINGER_TRAVEL = 0.8  # [rad] from open to closed
FINGER_BOUNDS = (3.0, 60.0, 2000.0)  # velocity, acceleration, jerk of a finger joint
PLACE_SPREAD = 0.02  # [m]; of where the base stands
TORSO_SPREAD = (0.10, 0.30)  # [m]
AIM_SPREAD = 0.04  # [m]; of the point that the head looks at


@dataclass(frozen=True, slots=True, kw_only=True)
class StanceRule:
    """How a robot stands at furniture.

    Attributes:
        camera_frame: Optical frame of its head camera.
        place: Lower corner of the workspace in the base frame, x and y in [m].
        torso: Height of its torso lift in [m].
        random_view: Draw torso height, head aim and the base's place with every scene.
    """

    camera_frame: str = "head_front_camera_rgb_optical_frame"
    place: tuple[float, float] = (0.4, -0.15)
    torso: float = 0.25
    random_view: bool = False


def draw_stance(
    robot: RobotModel, furniture: Furniture, seed: int, rule: StanceRule
) -> Stance:
    """Return where furniture and joints are when a scene begins."""
    T = translation(*rule.place, furniture.support_height - TABLE_HEIGHT)
    middle = (T @ [0.15, 0.15, TABLE_HEIGHT, 1.0])[:3]
    torso = rule.torso
    if rule.random_view:
        rng = np.random.default_rng([seed, 7])
        T[:2, 3] += rng.uniform(-PLACE_SPREAD, PLACE_SPREAD, 2)
        torso = rng.uniform(*TORSO_SPREAD)
        middle[:2] += rng.uniform(-AIM_SPREAD, AIM_SPREAD, 2)
    q = robot.configuration({"torso_lift_joint": torso}, default=robot.home)
    frame = rule.camera_frame
    q = aim_head(robot, q, middle, camera_frame=frame, head_joints=HEAD_JOINTS)
    return Stance(T, q)


def robot_setup(robot: RobotModel) -> RobotSetup:
    """Return what the simulator needs to know of a robot."""
    return RobotSetup(
        urdf=robot.urdf,
        joint_names=robot.joint_names,
        T_base_root=robot.T_base_root,
        jaws={key: finger_joints(key) for key in robot.grippers},
        carriages={key: advance_joint(key) for key in robot.grippers},
        grippers=robot.grippers,
    )


def robot_controllers(
    robot: RobotModel,
) -> tuple[dict[str, tuple[str, ...]], dict[str, DriveLimits]]:
    """Return joints and limits of a robot's controllers, named as on the robot."""
    controllers = {
        "torso_controller": ("torso_lift_joint",),
        "head_controller": HEAD_JOINTS,
    }
    for group in robot.description.arms:
        name = group.removesuffix("_torso")
        joints = robot.description.groups[group].joints
        controllers[f"{name}_controller"] = tuple(
            joint for joint in joints if joint != "torso_lift_joint"
        )
    limits = {}
    for name, joints in controllers.items():
        own = robot.limits.take(np.array([robot.joint_names.index(j) for j in joints]))
        limits[name] = DriveLimits(
            own.lower, own.upper, own.velocity, own.acceleration, own.jerk
        )
    for key in robot.grippers:
        name = f"gripper_{key}_controller"
        controllers[name] = (finger_joint(key),)
        bounds = (0.0, FINGER_TRAVEL, *FINGER_BOUNDS)
        limits[name] = DriveLimits(*(np.array([value]) for value in bounds))
    return controllers, limits
