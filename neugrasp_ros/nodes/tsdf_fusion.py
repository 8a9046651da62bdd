# SPDX-License-Identifier: Apache-2.0
"""Node ``tsdf_fusion``: depth images with their transforms into a TSDF."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from neugrasp_msgs.msg import TsdfVolume
from neugrasp_msgs.srv import GetTsdf
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType, JumpThreshold
from rclpy.duration import Duration
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.time import Time
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import Marker

from neugrasp_ros.errors import ConfigError
from neugrasp_ros.fusion.tsdf import seen_surface
from neugrasp_ros.geometry.transform import apply
from neugrasp_ros.nodes.compat.clouds import write_cloud
from neugrasp_ros.nodes.compat.tf import Buffer, TransformListener, from_transform
from neugrasp_ros.nodes.conversions import from_stamp, to_stamp, to_tsdf
from neugrasp_ros.nodes.courtesy import PATIENCE
from neugrasp_ros.nodes.depth_fusion import DepthFusion
from neugrasp_ros.nodes.diagnostics import OK, WARN, Diagnostics, Status
from neugrasp_ros.nodes.markers import workspace_marker
from neugrasp_ros.nodes.outcomes import DetectionError
from neugrasp_ros.nodes.params import declare_config
from neugrasp_ros.nodes.qos import latched, overrides, sensor_input
from neugrasp_ros.nodes.runtime import run
from neugrasp_ros.nodes.scene_file import read_scene, write_scene
from neugrasp_ros.nodes.scene_view import SceneView
from neugrasp_ros.nodes.settings import FusionConfig
from neugrasp_ros.nodes.waiting import is_ending
from neugrasp_ros.nodes.work import answer, shielded, to_timings

NAME = "tsdf_fusion"
LOOK_PERIOD = 0.05  # [s] between two looks for late transforms and due volumes
SHOW_DELAY = 0.3  # [s] by which a request about a new scene is answered


class TsdfFusionNode(Node):
    """Fuse depth images; parameters are those of ``FusionConfig``."""

    def __init__(
        self, serves_request: Callable[[], bool] = lambda: False, **node_options: Any
    ) -> None:
        """Wire topics and services.

        Args:
            serves_request: Tells whether somebody waits for grasps in this process;
                what only people look at can wait.
            node_options: Of the ROS node.
        """
        super().__init__(NAME, **node_options)
        self._serves_request = serves_request
        self._config = declare_config(self, FusionConfig)
        self.buffer = Buffer()
        self._listener = TransformListener(self.buffer, self)
        self.fusion = DepthFusion(self._config, self._lookup, self._now)
        self._to_show: SceneView | None = None
        self._show_due = 0.0  # time.monotonic() [s]
        self._published = (0, 0.0)  # revision, time.monotonic() of the last volume
        self._jumps = self.get_clock().create_jump_callback(
            JumpThreshold(
                min_forward=None,
                min_backward=Duration(nanoseconds=-1),
                on_clock_change=False,
            ),
            post_callback=self._on_jump,
        )
        self._create_topics()
        self._diagnostics = Diagnostics(self, {"depth": self._depth_status})
        services = ReentrantCallbackGroup()
        for kind, name, callback in (
            (Trigger, "~/reset", self._on_reset),
            (SetBool, "~/set_integrating", self._on_set_integrating),
            (GetTsdf, "~/get_tsdf", self._on_get_tsdf),
            (Trigger, "~/save", self._on_save),
            (Trigger, "~/load", self._on_load),
        ):
            self.create_service(kind, name, callback, callback_group=services)

    def _create_topics(self) -> None:
        self._tsdf = self.create_publisher(
            TsdfVolume, "tsdf", latched(), qos_overriding_options=overrides()
        )
        self._cloud = self.create_publisher(
            PointCloud2, "scene_cloud", latched(), qos_overriding_options=overrides()
        )
        self._workspace = self.create_publisher(Marker, "workspace", latched())
        images = MutuallyExclusiveCallbackGroup()
        for kind, topic, callback, depth in (
            (Image, "depth/image", self._on_depth, 5),
            (CameraInfo, "depth/camera_info", self._on_camera_info, 1),
        ):
            self.create_subscription(
                kind,
                topic,
                shielded(self, callback),
                sensor_input(depth),
                callback_group=images,
                qos_overriding_options=overrides(),
            )
        self.create_timer(
            LOOK_PERIOD,
            lambda: shielded(self, self._on_look)(None),
            callback_group=images,
            clock=Clock(clock_type=ClockType.STEADY_TIME),
        )

    def _now(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _lookup(self, target: str, source: str, stamp: int) -> np.ndarray:
        time_there = Time(nanoseconds=stamp)
        return from_transform(self.buffer.lookup_transform(target, source, time_there))

    def _on_camera_info(self, info: CameraInfo) -> None:
        self.fusion.on_camera_info(info)

    def _on_depth(self, image: Image) -> None:
        self.fusion.on_depth(image)
        self._publish_if_due()

    def _on_look(self, _: None) -> None:
        self.fusion.retry()
        self._publish_if_due()
        self._show()

    def _on_jump(self, jump: object) -> None:
        self.get_logger().warning("time has jumped back: scene and transforms cleared")
        self.buffer.clear()
        self.fusion.forget()

    def _publish_if_due(self) -> None:
        revision, last = self._published
        rate = self._config.current.publish_rate
        due = rate > 0 and time.monotonic() - last >= 1.0 / rate
        if not due or self.fusion.revision == revision:
            return
        try:
            self.publish(self.fusion.view())
        except DetectionError:
            return  # nothing to show yet; whoever asks is told why

    def publish(self, view: SceneView) -> None:
        """Publish a scene, unless its revision was the last one published.

        What only people look at follows a moment later.
        """
        if view.revision == self._published[0]:
            return
        self._published = (view.revision, time.monotonic())
        self._tsdf.publish(to_tsdf(view))
        if self._to_show is None:
            self._show_due = time.monotonic() + SHOW_DELAY
        self._to_show = view

    def _show(self) -> None:
        """Publish the cloud and the outline of the newest scene, when there is time."""
        view, now = self._to_show, time.monotonic()
        if view is None or now < self._show_due:
            return
        if self._serves_request() and now < self._show_due + PATIENCE:
            return
        self._to_show = None
        stamp = to_stamp(view.stamp)
        points, normals = seen_surface(view.volume)
        points = apply(view.T_frame_task, points)
        normals = normals @ view.T_frame_task[:3, :3].T
        self._cloud.publish(
            write_cloud(np.hstack([points, normals]), view.frame_id, stamp)
        )
        self._workspace.publish(
            workspace_marker(view.T_frame_task, view.volume.size, view.frame_id, stamp)
        )

    def _depth_status(self) -> Status:
        values: dict[str, object] = {
            **self.fusion.counts,
            "newest_stamp": self.fusion.newest / 1e9,
            "revision": self.fusion.revision,
        }
        try:
            view = self.fusion.view()
        except DetectionError as error:
            return Status(WARN, f"{error.code.name}: {error.sentence}", values)
        values["seconds_fusion"] = f"{view.seconds:.4f}"
        return Status(OK, "fusing", values)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> object:
        return answer(self, response, self.fusion.reset)

    def _on_set_integrating(
        self, request: SetBool.Request, response: SetBool.Response
    ) -> object:
        (result,) = self.set_parameters([Parameter("integrating", value=request.data)])
        response.success, response.message = result.successful, result.reason
        return response

    def _on_get_tsdf(
        self, request: GetTsdf.Request, response: GetTsdf.Response
    ) -> object:
        def work() -> None:
            deadline = time.monotonic() + from_stamp(request.timeout) / 1e9
            view = self.fusion.wait(
                lambda v: v.revision >= request.min_revision,
                deadline,
                lambda: is_ending(self),
            )
            self.publish(view)
            response.volume = to_tsdf(view)
            response.message = to_timings({"fusion": view.seconds})

        return answer(self, response, work)

    def _on_save(self, _: Trigger.Request, response: Trigger.Response) -> object:
        def work() -> None:
            path = self._scene_path()
            write_scene(path, self.fusion.saved())
            response.message = f"scene written to {path}"

        return answer(self, response, work)

    def _on_load(self, _: Trigger.Request, response: Trigger.Response) -> object:
        def work() -> None:
            path = self._scene_path()
            scene = read_scene(path)
            self.set_parameters([Parameter("integrating", value=False)])
            self.fusion.load(scene)
            self.publish(self.fusion.view())
            response.message = (
                f"{path} is the scene now and counts as fresh; integrating is off, "
                "~/set_integrating turns it on"
            )

        return answer(self, response, work)

    def _scene_path(self) -> Path:
        path = self._config.current.scene_path
        if not path:
            raise ConfigError("no file to save to or load from: set scene_path")
        return Path(path).expanduser()


def start(executor: Executor) -> Callable[[], None]:
    """Add the node to an executor; return what ends it."""
    node = TsdfFusionNode()
    executor.add_node(node)
    return node.destroy_node


def main(args: list[str] | None = None) -> int:
    """Run the node until shutdown."""
    return run(NAME, start, args)
