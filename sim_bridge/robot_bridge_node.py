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
from neugrasp_msgs.srv import SpawnScene, TryGrasp
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
from neugrasp_ros.nodes.runtime import run
from neugrasp_ros.nodes.work import answer
from neugrasp_ros.robot.link_meshes import LinkMeshes, VisualMeshes
from neugrasp_ros.robot.model import RobotModel, load_robot
from sim_bridge.bridge_node import NAME, BridgeConfig, SimBridgeNode
from sim_bridge.bridge_world import BridgeScenes, BridgeWorld, Snapshot
from sim_bridge.furniture import BINS, Block, Furniture
from sim_bridge.robot_camera import Bystander, Parts, RobotCamera
from sim_bridge.robot_cell import (
    HEAD_JOINTS,
    StanceRule,
    draw_stance,
    robot_controllers,
    robot_setup,
)
from sim_bridge.robot_ports import ControllerPort
from sim_bridge.robot_world import RobotWorld, Stance

FloatArray = NDArray[np.float64]

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
        rule = StanceRule(
            camera_frame=config.camera.frame,
            place=config.workspace.origin[:2],
            torso=config.torso,
            random_view=config.random_view,
        )
        return draw_stance(self._robot, furniture, seed, rule)

    def _make_world(self, config: BridgeConfig) -> BridgeWorld:
        robot = self._robot
        controllers, limits = robot_controllers(robot)
        setup = robot_setup(robot)
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

    def _on_try(self, request: TryGrasp.Request, response: TryGrasp.Response) -> object:
        """Answer with what to do instead: the world says so, whatever the grasp."""
        return answer(self, response, lambda: self.world.try_grasp(np.eye(4), 0.0, 0.0))

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
