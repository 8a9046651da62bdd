# SPDX-License-Identifier: Apache-2.0
"""A camera that publishes a synthetic scene, and a client that asks for grasps."""

import threading

from geometry_msgs.msg import PoseArray, PoseStamped
from neugrasp_msgs.msg import GraspArray
from neugrasp_msgs.srv import DetectGrasps
from nodes.synthetic import CAMERA_FRAME, Scene, camera_info, depth_image
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image
from visualization_msgs.msg import MarkerArray

from neugrasp_ros.nodes.compat.tf import StaticTransformBroadcaster
from neugrasp_ros.nodes.compat.tf_buffer import to_transform
from neugrasp_ros.nodes.qos import latched, sensor_output
from neugrasp_ros.nodes.settings import WorkspaceConfig

PERIOD = 0.1  # [s]


class CameraNode(Node):
    """Publishes depth, camera info and a static transform; what, can be changed."""

    def __init__(self, **options) -> None:
        super().__init__("camera", **options)
        self.scene = Scene(WorkspaceConfig())
        self.encoding = "32FC1"
        self.sends = {"depth", "info"}
        self.age = 0.0  # of the stamps [s]
        self.edit = lambda image: image
        self._image = self.create_publisher(Image, "depth/image", sensor_output())
        self._info = self.create_publisher(
            CameraInfo, "depth/camera_info", sensor_output()
        )
        self._broadcaster = StaticTransformBroadcaster(self)
        self.create_timer(PERIOD, self._shoot)

    def send_tf(self) -> None:
        self._broadcaster.sendTransform(
            to_transform(self.scene.T_base_camera, "base_footprint", CAMERA_FRAME, 0)
        )

    def _shoot(self) -> None:
        stamp = self.get_clock().now().nanoseconds - int(self.age * 1e9)
        if "info" in self.sends:
            self._info.publish(camera_info(stamp))
        if "depth" in self.sends:
            image = depth_image(self.scene.depth(), stamp, self.encoding)
            self._image.publish(self.edit(image))


class ClientNode(Node):
    """Listens like a user who never calls, and calls like one who does."""

    def __init__(self, **options) -> None:
        super().__init__("user", **options)
        self.heard: dict[str, list] = {
            "grasps": [], "grasps/poses": [], "grasps/best": [], "grasps/markers": []
        }  # fmt: skip
        kinds = (GraspArray, PoseArray, PoseStamped, MarkerArray)
        for kind, topic in zip(kinds, self.heard, strict=True):
            self.create_subscription(kind, topic, self.heard[topic].append, latched())
        self._clients_by_name: dict = {}
        self.client = self.create_client(DetectGrasps, "detect_grasps")

    def ask(self, seconds: float = 60.0, **fields) -> DetectGrasps.Response:
        """Call the service and wait for its answer; the node spins elsewhere."""
        return wait_for_answer(self.client, DetectGrasps.Request(**fields), seconds)

    def call(self, kind, name, /, seconds: float = 30.0, **fields):
        """Call a service by name, over a client that is made once."""
        if name not in self._clients_by_name:
            self._clients_by_name[name] = self.create_client(kind, name)
        client = self._clients_by_name[name]
        return wait_for_answer(client, kind.Request(**fields), seconds)


def wait_for_answer(client, request, seconds: float):
    assert client.wait_for_service(timeout_sec=seconds), client.srv_name
    done = threading.Event()
    future = client.call_async(request)
    future.add_done_callback(lambda _: done.set())
    assert done.wait(seconds), f"no answer from {client.srv_name} in time"
    return future.result()
