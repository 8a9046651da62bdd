# SPDX-License-Identifier: Apache-2.0
"""The composed suite, a camera and a user, and how the user asks."""

import threading

import numpy as np
from builtin_interfaces.msg import Duration, Time
from neugrasp_msgs.action import DetectGrasps as DetectAction
from neugrasp_msgs.srv import DetectGrasps
from nodes.camera_node import CameraNode, ClientNode
from nodes.standin import make_side_checker, make_standin
from nodes.synthetic import CAMERA_FRAME, Scene
from rclpy.parameter import Parameter
from sensor_msgs.msg import Image

from neugrasp_ros.nodes.compat.actions import ActionClient
from neugrasp_ros.nodes.compat.images import write_labels
from neugrasp_ros.nodes.composed import Suite
from neugrasp_ros.nodes.executor import PatientExecutor
from neugrasp_ros.nodes.runtime import SpinThread
from neugrasp_ros.nodes.settings import WorkspaceConfig

ORIGIN = np.array(WorkspaceConfig().origin)
PATIENT = 30.0  # [s]; on a busy machine images come late
LEFT, RIGHT = (0.15, 0.22, 0.07), (0.15, 0.08, 0.07)  # boxes in the task frame


class Bench:
    """Suite, camera and two users of one module; nodes live as long as the spin."""

    def __init__(self) -> None:
        self.executor = PatientExecutor(12)
        self.suite = Suite(self.executor, make_standin, make_side_checker)
        self.allow_age(PATIENT)
        self.camera = CameraNode()
        self.camera.sends = set()
        self.user, self.other = ClientNode(), ClientNode()
        self.action = ActionClient(self.user, DetectAction, "detect_grasps")
        for node in (self.camera, self.user, self.other):
            self.executor.add_node(node)
        self._spinning = SpinThread(self.executor)

    def allow_age(self, seconds: float) -> None:
        """Let depth images be so old."""
        fusion = self.suite.nodes[0]
        (done,) = fusion.set_parameters([Parameter("max_depth_age", value=seconds)])
        assert done.successful

    def stop(self) -> None:
        self._spinning.stop()
        self.suite.close()
        self.camera.destroy_node()
        self.action.destroy()
        self.user.destroy_node()
        self.other.destroy_node()

    def start(self) -> None:
        """Load everything and let the camera see both boxes."""
        self.suite.load()
        self.camera.sends = {"depth", "info"}
        self.camera.send_tf()
        self.show(LEFT, RIGHT)

    def show(self, *boxes) -> None:
        self.camera.scene.clear()
        for box in boxes:
            self.camera.scene.add_box(box)


def newest(bench, topic):
    """Return what the user heard last on a topic, or None."""
    heard = bench.user.heard[topic]
    return heard[-1] if heard else None


def ask(bench, **fields):
    return bench.user.ask(**({"seed": 1} | fields))


def begin(bench, wait_until) -> None:
    """Let both boxes be seen, whatever happened before."""
    bench.camera.sends = {"depth", "info"}
    bench.camera.encoding, bench.camera.age = "32FC1", 0.0
    bench.camera.edit = lambda image: image
    bench.allow_age(PATIENT)
    bench.show(LEFT, RIGHT)
    fresh = DetectGrasps.Request.SCENE_FRESH
    wait_until(lambda: ask(bench, scene=fresh).success, seconds=30.0)
    wait_until(lambda: newest(bench, "grasps"), seconds=30.0)


def positions(response) -> np.ndarray:
    poses = [g.pose.position for g in response.grasps.grasps]
    return np.array([[p.x, p.y, p.z] for p in poses]).reshape(-1, 3)


def mask_of(box) -> Image:
    """Return the pixels in which a box changes the picture of an empty table."""
    alone, empty = Scene(WorkspaceConfig()), Scene(WorkspaceConfig())
    alone.add_box(box)
    pixels = np.where(alone.depth() < empty.depth() - 1e-3, np.uint8(255), np.uint8(0))
    return write_labels(pixels, "mono8", CAMERA_FRAME, Time())


def duration(seconds: float) -> Duration:
    return Duration(sec=int(seconds), nanosec=int(seconds % 1 * 1e9))


def result(future, seconds: float = 30.0):
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    assert done.wait(seconds), "no answer in time"
    return future.result()
