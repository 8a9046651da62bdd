# SPDX-License-Identifier: Apache-2.0
"""Node ``sim_bridge``: table, objects, head camera and gripper in PyBullet.

It publishes what the real robot would, under the robot's names, and takes grasps to
try. The robot stands still: its head camera looks at the table, its arms are parked.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from neugrasp_msgs.msg import GraspArray
from neugrasp_msgs.srv import SpawnScene, TryGrasp
from numpy.typing import NDArray
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from neugrasp_ros.config import Checked, option
from neugrasp_ros.errors import ConfigError
from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.geometry.transform import invert, translation
from neugrasp_ros.nodes.compat.images import write_depth, write_intrinsics, write_labels
from neugrasp_ros.nodes.compat.tf import (
    Buffer,
    StaticTransformBroadcaster,
    to_transform,
)
from neugrasp_ros.nodes.conversions import from_grasp_array, to_stamp
from neugrasp_ros.nodes.depth_fusion import workspace_pose
from neugrasp_ros.nodes.diagnostics import ERROR, OK, WARN, Diagnostics, Status
from neugrasp_ros.nodes.markers import LabelledBox, box_markers
from neugrasp_ros.nodes.params import declare_config, fixed
from neugrasp_ros.nodes.qos import latched, newest, overrides, sensor_output
from neugrasp_ros.nodes.runtime import run
from neugrasp_ros.nodes.settings import WorkspaceConfig, part
from neugrasp_ros.nodes.transforms import Transforms
from neugrasp_ros.nodes.work import answer
from neugrasp_ros.robot.model import load_robot
from neugrasp_ros.robot.posture import aim_head
from sim_bridge.bridge_camera import BridgeCamera
from sim_bridge.bridge_world import BridgeScenes, BridgeWorld, Snapshot
from sim_bridge.world import TABLE_HEIGHT

FloatArray = NDArray[np.float64]

NAME = "sim_bridge"
JOINT_RATE = 20.0  # [Hz]
OBJECT_RATE = 2.0  # [Hz]
POLL = 0.002  # [s] between two looks at simulated time
SLOW = 0.9  # a real-time factor below this share of the wanted one is worth a warning
MOST_OBJECTS = 50  # of a scene; each takes up to a simulated second to fall
HIGHEST_LIFT = 1.0  # [m] that a tried grasp may be lifted
HEAD_JOINTS = ("head_1_joint", "head_2_joint")


@dataclass(frozen=True, kw_only=True)
class CameraConfig(Checked):
    """The head camera."""

    rate: float = option(10.0, "Images per simulated second [Hz]", 0.1, 60.0)
    width: int = fixed(option(640, "Columns [pixel]", 16, 4096))
    height: int = fixed(option(480, "Rows [pixel]", 16, 4096))
    hfov_deg: float = fixed(option(63.0, "Horizontal field of view [deg]", 10.0, 150.0))
    frame: str = fixed(option("head_front_camera_rgb_optical_frame", "Optical frame"))
    encoding: str = fixed(
        option("32FC1", "Metres or millimetres", choices=("32FC1", "16UC1"))
    )
    noise_std: float = option(0.0, "Noise of the depth [m]", 0.0, 0.05)


@dataclass(frozen=True, kw_only=True)
class BridgeConfig(Checked):
    """Parameters of ``sim_bridge``."""

    robot: str = fixed(option("tiago_dual", "Robot that stands at the table"))
    torso: float = fixed(option(0.25, "Height of its torso lift [m]", 0.0, 0.35))
    gripper: str = fixed(option("robotiq_2f85", "Gripper's name or its YAML file"))
    clock_rate: float = fixed(option(50.0, "Messages on /clock [Hz]", 1.0, 500.0))
    realtime_factor: float = option(
        1.0, "Simulated over real time; 0 = as fast as possible", 0.0, 100.0
    )
    objects: str = fixed(option("procedural", "Object set, or a folder of objects"))
    object_part: str = fixed(
        option(
            "val", "Objects to draw from; the network never saw those of val",
            choices=("val", "tune", "train", "all"),
        )
    )  # fmt: skip
    kind: str = fixed(option("pile", "Scene at the start"))
    seed: int = fixed(option(0, "Its seed", 0, 2**31 - 1))
    count: int = fixed(option(5, "Its number of objects", 0, MOST_OBJECTS))
    open_fully: bool = option(
        True, "Approach with open jaws, as the network learned; else with Grasp.width"
    )
    workspace: WorkspaceConfig = part(WorkspaceConfig, "Workspace over the table")
    camera: CameraConfig = part(CameraConfig, "Head camera")


class SimBridgeNode(Node):
    """The fake driver of the real cell."""

    config_type: type[BridgeConfig] = BridgeConfig

    def __init__(self, **node_options: Any) -> None:
        """Build the world, then wire topics and services."""
        super().__init__(NAME, **node_options)
        self._config = declare_config(self, self.config_type)
        config = self._config.current
        self._T_base_task = workspace_pose(config.workspace)
        self._base = config.workspace.frame
        self._gripper = load_gripper(config.gripper)
        T_base_camera = self._stand(config)
        camera = config.camera
        intrinsics = Intrinsics.from_hfov(
            camera.width, camera.height, float(np.deg2rad(camera.hfov_deg))
        )
        self._camera = self._make_camera(intrinsics, T_base_camera)
        self.world = self._make_world(config)
        self.world.spawn(config.kind, config.seed, config.count)
        self._rng = np.random.default_rng(config.seed)
        self._counts: dict[str, float] = {"published": 0}
        self._closed = threading.Event()
        self._create_topics()
        self._create_services()
        self._thread = threading.Thread(target=self._shoot, name="camera", daemon=True)
        self._thread.start()

    def _make_camera(
        self, intrinsics: Intrinsics, T_base_camera: FloatArray
    ) -> BridgeCamera:
        return BridgeCamera(intrinsics, invert(self._T_base_task) @ T_base_camera)

    def _make_world(self, config: BridgeConfig) -> BridgeWorld:
        scenes = BridgeScenes(config.objects, config.object_part)
        return BridgeWorld(self._gripper, scenes, config.realtime_factor)

    def _T_base_world(self, snapshot: Snapshot) -> FloatArray:
        """Return the world's frame as seen from the robot's base, shape (4, 4)."""
        return self._T_base_task

    def _stand(self, config: BridgeConfig) -> FloatArray:
        """Put the robot into its posture; publish its frames; return T_base_camera."""
        robot = load_robot(config.robot)
        if robot.description.base_frame != self._base:
            raise ConfigError(
                f"workspace.frame must be {robot.description.base_frame!r}, "
                f"got {self._base!r}"
            )
        q = robot.configuration({"torso_lift_joint": config.torso}, default=robot.home)
        middle = (self._T_base_task @ [0.15, 0.15, TABLE_HEIGHT, 1.0])[:3]
        frame = config.camera.frame
        q = aim_head(robot, q, middle, camera_frame=frame, head_joints=HEAD_JOINTS)
        self._joints = dict(zip(robot.joint_names, q.tolist(), strict=True))
        tips = [
            robot.description.groups[arm].tcp_frame for arm in robot.description.arms
        ]
        poses = {name: robot.frame_pose(q, name) for name in (frame, *tips)}
        poses["sim_task"] = self._T_base_task
        frames = [to_transform(T, self._base, name, 0) for name, T in poses.items()]
        frames.append(to_transform(np.eye(4), "world", self._base, 0))
        self._publish_frames(frames)
        return poses[frame]

    def _publish_frames(self, frames: list[TransformStamped]) -> None:
        buffer = Buffer()
        for frame in frames:
            buffer.set_transform_static(frame, NAME)
        self._transforms = Transforms(buffer)
        self._broadcaster = StaticTransformBroadcaster(self)
        self._broadcaster.sendTransform(frames)

    def _create_topics(self) -> None:
        config = self._config.current

        def output(kind: type, topic: str, qos: QoSProfile) -> Any:
            return self.create_publisher(
                kind, topic, qos, qos_overriding_options=overrides()
            )

        head = "head_front_camera/depth_registered"
        self._image = output(Image, f"{head}/image_raw", sensor_output())
        self._info = output(CameraInfo, f"{head}/camera_info", sensor_output())
        self._labels = self.create_publisher(Image, "~/segmentation", sensor_output())
        self._objects = self.create_publisher(MarkerArray, "~/objects", latched())
        self._clock_output = self.create_publisher(ClockMessage, "/clock", newest())
        self._states = self.create_publisher(JointState, "joint_states", 10)
        self._executed = self.create_publisher(GraspArray, "grasps/executed", newest())
        group = MutuallyExclusiveCallbackGroup()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        for rate, callback in (
            (config.clock_rate, self._publish_clock),
            (JOINT_RATE, self._publish_joints),
            (OBJECT_RATE, self._publish_objects),
        ):
            self.create_timer(1.0 / rate, callback, callback_group=group, clock=steady)
        self._diagnostics = Diagnostics(
            self, {"physics": self._physics_status, "camera": self._camera_status}
        )

    def _create_services(self) -> None:
        group = MutuallyExclusiveCallbackGroup()
        for kind, name, callback in (
            (SpawnScene, "~/spawn_scene", self._on_spawn),
            (Trigger, "~/reset_scene", self._on_reset),
            (TryGrasp, "~/try_grasp", self._on_try),
        ):
            self.create_service(kind, name, callback, callback_group=group)

    def _publish_clock(self) -> None:
        self.world.realtime_factor = self._config.current.realtime_factor
        stamp = to_stamp(self.world.snapshot.time)
        self._clock_output.publish(ClockMessage(clock=stamp))

    def _publish_joints(self) -> None:
        state = JointState(
            name=list(self._joints), position=list(self._joints.values())
        )
        state.header.stamp = to_stamp(self.world.snapshot.time)
        self._states.publish(state)

    def _publish_objects(self) -> None:
        snapshot = self.world.snapshot
        boxes = [
            _labelled_box(name, model.bounds(), self._T_base_world(snapshot) @ pose)
            for name, model, pose in zip(
                snapshot.names, snapshot.models, snapshot.poses, strict=True
            )
        ]
        stamp = to_stamp(snapshot.time)
        self._objects.publish(box_markers(boxes, self._base, stamp))

    def _shoot(self) -> None:
        """Publish images at the camera's rate in simulated time."""
        due = self.world.snapshot.time
        while not self._closed.is_set() and self.context.ok():
            snapshot = self.world.snapshot
            if snapshot.time < due:
                self._closed.wait(POLL)
                continue
            period = int(1e9 / self._config.current.camera.rate)
            due += period
            if due <= snapshot.time:  # missed: do not catch up
                due = snapshot.time + period
            self._publish_images(snapshot)

    def _publish_images(self, snapshot: Snapshot) -> None:
        camera, stamp = self._config.current.camera, to_stamp(snapshot.time)
        depth = self._camera.depth(snapshot)
        if camera.noise_std > 0:
            noise = self._rng.normal(0.0, camera.noise_std, depth.shape)
            depth = depth + noise.astype(np.float32)
        self._info.publish(
            write_intrinsics(self._camera.intrinsics, camera.frame, stamp)
        )
        self._image.publish(write_depth(depth, camera.encoding, camera.frame, stamp))
        self._counts = {
            "published": self._counts["published"] + 1,
            "newest_stamp": snapshot.time / 1e9,
        }
        if self._labels.get_subscription_count():
            labels = self._camera.labels(snapshot)
            self._labels.publish(write_labels(labels, "mono16", camera.frame, stamp))

    def _on_spawn(
        self, request: SpawnScene.Request, response: SpawnScene.Response
    ) -> object:
        def work() -> None:
            if request.objects > MOST_OBJECTS:
                raise ConfigError(
                    f"spawn_scene: at most {MOST_OBJECTS} objects, "
                    f"got {request.objects}"
                )
            names = self.world.spawn(request.kind, request.seed, request.objects)
            response.names = list(names)

        return answer(self, response, work)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> object:
        return answer(self, response, self.world.reset)

    def _on_try(self, request: TryGrasp.Request, response: TryGrasp.Response) -> object:
        def work() -> None:
            if not request.grasp.grasps:
                raise ConfigError("try_grasp: the array holds no grasp")
            if not 0.0 <= request.lift_height <= HIGHEST_LIFT:  # NaN is neither
                raise ConfigError(
                    f"try_grasp: lift_height must be within [0, {HIGHEST_LIFT}] m, "
                    f"got {request.lift_height}"
                )
            grasp = from_grasp_array(request.grasp).take(np.array([0]))
            T = self._transforms(self._base, grasp.info.frame_id, 0)
            T_task_gripper = invert(self._T_base_task) @ T @ grasp.grasps.poses[0]
            opening = self._gripper.max_opening
            if not self._config.current.open_fully:
                opening = min(float(grasp.grasps.widths[0]), opening)
            result = self.world.try_grasp(T_task_gripper, opening, request.lift_height)
            response.lifted = result.success
            response.closed_on_object = result.reason in ("", "slipped")
            response.final_width = result.width
            response.message = result.reason or "lifted"
            self._executed.publish(request.grasp)

        answer(self, response, work)
        response.success = response.success and response.lifted
        return response

    def _physics_status(self) -> Status:
        factor, wanted = (
            self.world.measured_factor,
            self._config.current.realtime_factor,
        )
        values = {
            "real_time_factor": f"{factor:.3f}",
            "simulated_seconds": f"{self.world.snapshot.time / 1e9:.3f}",
            "objects": len(self.world.snapshot.names),
        }
        if ended := self.world.ended:
            return Status(ERROR, ended, values)
        slow = wanted > 0 and factor < SLOW * wanted
        return Status(WARN if slow else OK, "slow" if slow else "in time", values)

    def _camera_status(self) -> Status:
        values = {**self._counts, "renderings": self._camera.renderings}
        return Status(OK, "publishing", values)

    def destroy_node(self) -> None:
        """End camera and physics, then the node."""
        self._closed.set()
        self._thread.join()
        self.world.close()
        super().destroy_node()


def _labelled_box(
    name: str, bounds: FloatArray, T_base_object: FloatArray
) -> LabelledBox:
    lower, upper = bounds
    return LabelledBox(
        name, T_base_object @ translation(*(lower + upper) / 2), upper - lower
    )


def start(executor: Executor) -> Callable[[], None]:
    """Add the node to an executor; return what ends it."""
    node = SimBridgeNode()
    executor.add_node(node)
    return node.destroy_node


def main(args: list[str] | None = None) -> int:
    """Run the node until shutdown."""
    return run(NAME, start, args)
