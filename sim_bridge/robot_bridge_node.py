# SPDX-License-Identifier: Apache-2.0
"""Node ``sim_bridge`` with the whole robot: its controllers, its head, its furniture.

Topics, actions and frames are those of the real robot; scenes are named by furniture
and kind, such as ``shelf:packed``.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from neugrasp_msgs.srv import SpawnScene
from numpy.typing import NDArray
from rclpy.executors import Executor
from sensor_msgs.msg import Image, JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from neugrasp_ros.config import option
from neugrasp_ros.errors import ConfigError
from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.nodes.compat.images import write_color
from neugrasp_ros.nodes.compat.tf import (
    StaticTransformBroadcaster,
    TransformBroadcaster,
    to_transform,
)
from neugrasp_ros.nodes.conversions import to_stamp
from neugrasp_ros.nodes.diagnostics import Status
from neugrasp_ros.nodes.markers import LabelledBox, box_markers
from neugrasp_ros.nodes.qos import latched, newest
from neugrasp_ros.nodes.robot_posture import aim_head
from neugrasp_ros.nodes.runtime import run
from neugrasp_ros.robot.link_meshes import LinkMeshes, VisualMeshes
from neugrasp_ros.robot.model import RobotModel, load_robot
from neugrasp_ros.robot.urdf import advance_joint, finger_joints
from sim_bridge.bridge_node import NAME, BridgeConfig, SimBridgeNode
from sim_bridge.bridge_world import BridgeScenes, BridgeWorld, Snapshot
from sim_bridge.furniture import BINS, Block, Furniture
from sim_bridge.joint_drive import DriveLimits
from sim_bridge.robot_body import RobotSetup
from sim_bridge.robot_camera import Bystander, Parts, RobotCamera
from sim_bridge.robot_ports import ControllerPort
from sim_bridge.robot_world import RobotWorld, Stance, finger_joint
from sim_bridge.world import TABLE_HEIGHT

FloatArray = NDArray[np.float64]

HEAD_JOINTS = ("head_1_joint", "head_2_joint")
FINGER_TRAVEL = 0.8  # [rad] from open to closed
FINGER_BOUNDS = (3.0, 60.0, 2000.0)  # velocity, acceleration, jerk of a finger joint
PLACE_SPREAD = 0.02  # [m]; of where the base stands
TORSO_SPREAD = (0.10, 0.30)  # [m]
AIM_SPREAD = 0.04  # [m]; of the point that the head looks at
THREADS = 12


@dataclass(frozen=True, kw_only=True)
class RobotBridgeConfig(BridgeConfig):
    """Parameters of ``sim_bridge`` with a whole robot."""

    random_view: bool = option(
        False, "Draw torso height, head aim and the base's place with every scene"
    )
    view_rate: float = option(1.0, "Pictures on ~/view per second [Hz]", 0.05, 30.0)


class RobotBridgeNode(SimBridgeNode):
    """The fake driver of the real robot."""

    config_type = RobotBridgeConfig

    def _stand(self, config: BridgeConfig) -> FloatArray:
        """Load the robot; its frames move, so there is no one camera pose."""
        self._robot = load_robot(config.robot)
        base = self._robot.description.base_frame
        if base != self._base:
            raise ConfigError(f"workspace.frame must be {base!r}, got {self._base!r}")
        self._frames = _told_frames(self._robot, config.camera.frame)
        self._moving = TransformBroadcaster(self)
        self._standing = StaticTransformBroadcaster(self)
        self._standing.sendTransform(to_transform(np.eye(4), "world", base, 0))
        return np.eye(4)

    def _stance(self, furniture: Furniture, seed: int) -> Stance:
        """Return where furniture and joints are when a scene begins."""
        config: Any = self._config.current
        x, y, _ = config.workspace.origin
        T = translation(x, y, furniture.support_height - TABLE_HEIGHT)
        middle = (T @ [0.15, 0.15, TABLE_HEIGHT, 1.0])[:3]
        torso = config.torso
        if config.random_view:
            rng = np.random.default_rng([seed, 7])
            T[:2, 3] += rng.uniform(-PLACE_SPREAD, PLACE_SPREAD, 2)
            torso = rng.uniform(*TORSO_SPREAD)
            middle[:2] += rng.uniform(-AIM_SPREAD, AIM_SPREAD, 2)
        robot = self._robot
        q = robot.configuration({"torso_lift_joint": torso}, default=robot.home)
        q = aim_head(
            robot, q, middle, camera_frame=config.camera.frame, head_joints=HEAD_JOINTS
        )
        return Stance(T, q)

    def _make_world(self, config: BridgeConfig) -> BridgeWorld:
        robot = self._robot
        controllers, limits = _controllers(robot)
        setup = RobotSetup(
            urdf=robot.urdf,
            joint_names=robot.joint_names,
            T_base_root=robot.T_base_root,
            jaws={key: finger_joints(key) for key in robot.grippers},
            carriages={key: advance_joint(key) for key in robot.grippers},
            grippers=robot.grippers,
        )
        scenes = BridgeScenes(config.objects, config.object_part)
        world = RobotWorld(
            setup, controllers, limits, self._stance, scenes, config.realtime_factor
        )
        self._ports = [
            ControllerPort(self, world, name, yields=name.startswith("gripper"))
            for name in controllers
        ]
        return world

    def _make_camera(
        self, intrinsics: Intrinsics, T_base_camera: FloatArray
    ) -> RobotCamera:
        frame, links = (
            self._config.current.camera.frame,
            LinkMeshes(self._robot, without=HEAD_JOINTS),
        )
        return RobotCamera(
            intrinsics,
            lambda q: self._robot.frame_pose(q, frame),
            Parts(links.meshes, links.poses),
        )

    def _T_base_world(self, snapshot: Snapshot) -> FloatArray:
        return np.asarray(snapshot.robot.stance.T_base_world)

    def _create_topics(self) -> None:
        super()._create_topics()
        description = self.create_publisher(String, "robot_description", latched())
        description.publish(String(data=self._robot.urdf))
        self._solids = self.create_publisher(MarkerArray, "collision_boxes", latched())
        self._bins = self.create_publisher(MarkerArray, "~/bins", latched())
        self._view = self.create_publisher(Image, "~/view", newest())
        self._bystander: Bystander | None = None
        self._next_view = 0
        self._publish_solids()

    def _publish_solids(self) -> None:
        """Tell what stands around, as boxes that a hand must stay out of."""
        snapshot = self.world.snapshot
        stamp = to_stamp(snapshot.time)
        blocks = [b for b in snapshot.robot.blocks if b.name != "bin"]
        solids = [bin_.solid() for bin_ in BINS.values()]
        self._solids.publish(
            box_markers([_box(b) for b in (*blocks, *solids)], self._base, stamp)
        )
        bins = [_box(b)._replace(name=n) for n, b in zip(BINS, solids, strict=True)]
        self._bins.publish(box_markers(bins, self._base, stamp))

    def _on_spawn(
        self, request: SpawnScene.Request, response: SpawnScene.Response
    ) -> object:
        answered = super()._on_spawn(request, response)
        self._publish_solids()
        return answered

    def _publish_joints(self) -> None:
        snapshot = self.world.snapshot
        robot = snapshot.robot
        state = JointState(
            name=[*self._robot.joint_names, *robot.fingers],
            position=[*robot.q.tolist(), *robot.fingers.values()],
            velocity=[*robot.velocities.tolist(), *[0.0] * len(robot.fingers)],
            effort=[*robot.efforts.tolist(), *[0.0] * len(robot.fingers)],
        )
        state.header.stamp = to_stamp(snapshot.time)
        self._states.publish(state)
        self._publish_moving(snapshot)

    def _publish_moving(self, snapshot: Snapshot) -> None:
        q = snapshot.robot.q
        transforms: list[TransformStamped] = [
            to_transform(self._robot.frame_pose(q, f), self._base, f, snapshot.time)
            for f in self._frames
        ]
        task = self._T_base_world(snapshot)
        transforms.append(to_transform(task, self._base, "sim_task", snapshot.time))
        self._moving.sendTransform(transforms)

    def _publish_images(self, snapshot: Snapshot) -> None:
        self._publish_moving(snapshot)
        super()._publish_images(snapshot)
        config: Any = self._config.current
        if snapshot.time < self._next_view or not self._view.get_subscription_count():
            return
        self._next_view = snapshot.time + int(1e9 / config.view_rate)
        if self._bystander is None:
            look = VisualMeshes(self._robot)
            self._bystander = Bystander(Parts(look.meshes, look.poses), look.colors)
        picture = self._bystander.photo(snapshot)
        self._view.publish(write_color(picture, self._base, to_stamp(snapshot.time)))

    def _physics_status(self) -> Status:
        status = super()._physics_status()
        world = self.world
        assert isinstance(world, RobotWorld)
        touch = world.largest_touch
        felt = {
            "largest_contact_n": f"{touch.force:.1f}",
            "largest_contact_link": touch.link,
        }
        return status._replace(values={**status.values, **felt})

    def destroy_node(self) -> None:
        """End the controllers, then the rest."""
        for port in self._ports:
            port.destroy()
        super().destroy_node()


def _told_frames(robot: RobotModel, camera_frame: str) -> tuple[str, ...]:
    """Return the frames on /tf, all seen from the base."""
    description = robot.description
    tips = [description.groups[arm].tcp_frame for arm in description.arms]
    return tuple(dict.fromkeys([camera_frame, *tips, *description.frames]))


def _controllers(
    robot: RobotModel,
) -> tuple[dict[str, tuple[str, ...]], dict[str, DriveLimits]]:
    """Return joints and limits of the robot's controllers, named as on the robot."""
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


def _box(block: Block) -> LabelledBox:
    return LabelledBox(block.name, translation(*block.center), block.size)


def start(executor: Executor) -> Callable[[], None]:
    """Add the node to an executor; return what ends it."""
    node = RobotBridgeNode()
    executor.add_node(node)
    return node.destroy_node


def main(args: list[str] | None = None) -> int:
    """Run the node until shutdown."""
    return run(NAME, start, args, threads=THREADS)
