# SPDX-License-Identifier: Apache-2.0
"""A client of a running suite, for the command line."""

import math
import threading
from collections.abc import Sequence
from types import TracebackType
from typing import Any

import rclpy
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Vector3
from neugrasp_msgs.msg import Grasp
from neugrasp_msgs.srv import DetectGrasps
from rclpy.client import Client
from rclpy.context import Context
from rclpy.exceptions import InvalidNamespaceException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.validate_namespace import validate_namespace

from neugrasp_ros.errors import ConfigError, NeuGraspError
from neugrasp_ros.nodes.outcomes import Code
from neugrasp_ros.nodes.runtime import SpinThread, prepare

SLACK = 5.0  # [s] beyond the request's own timeout


class NoAnswerError(NeuGraspError):
    """The suite is not there or does not answer."""


class SuiteClient:
    """A node that calls the suite's services.

    Args:
        namespace: Namespace of the suite.

    Raises:
        ConfigError: If ROS cannot take the namespace.
    """

    def __init__(self, namespace: str = "") -> None:
        prepare()
        try:
            validate_namespace("/" + namespace.lstrip("/"))
        except InvalidNamespaceException as error:
            reason = str(error).splitlines()[0].rstrip(":")
            raise ConfigError(f"namespace {namespace!r}: {reason}") from error
        self._context = Context()
        rclpy.init(args=[], context=self._context)
        self.node = Node(
            "neugrasp_cli", context=self._context, namespace=namespace or None
        )
        executor = SingleThreadedExecutor(context=self._context)
        executor.add_node(self.node)
        self._spinning = SpinThread(executor)

    def __enter__(self) -> "SuiteClient":
        """Return the client itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave ROS."""
        self._spinning.stop()
        self.node.destroy_node()
        self._context.try_shutdown()

    def call(self, client: Client, request: Any, timeout: float) -> Any:
        """Call a service.

        Raises:
            NoAnswerError: If the service is not there, or not answered in time [s].
        """
        if not client.wait_for_service(timeout_sec=timeout):
            raise NoAnswerError(
                f"nobody offers {client.srv_name}: is the suite running (neugrasp up), "
                "with the same ROS_DOMAIN_ID and namespace?"
            )
        done = threading.Event()
        future = client.call_async(request)
        future.add_done_callback(lambda _: done.set())
        if not done.wait(timeout + SLACK):
            raise NoAnswerError(f"no answer from {client.srv_name} in {timeout} s")
        return future.result()

    def detect(
        self,
        *,
        timeout: float,
        roi: Sequence[float] | None = None,
        roi_frame: str = "",
        **fields: Any,
    ) -> dict[str, Any]:
        """Ask for grasps and return the answer as plain values.

        Args:
            timeout: Of the request in [s].
            roi: Centre and edges of an upright box to look in [m]; None = everywhere.
            roi_frame: Frame of the box; empty = the server's target frame.
            fields: Fields of ``DetectGrasps.Request``.

        Raises:
            NoAnswerError: If the suite is not there or does not answer.
        """
        client = self.node.create_client(DetectGrasps, "detect_grasps")
        whole = math.floor(timeout)
        request = DetectGrasps.Request(**fields)
        if roi is not None:
            x, y, z, *edges = map(float, roi)
            request.roi_pose.header.frame_id = roi_frame
            request.roi_pose.pose.position = Point(x=x, y=y, z=z)
            request.roi_pose.pose.orientation.w = 1.0
            request.roi_size = Vector3(x=edges[0], y=edges[1], z=edges[2])
        request.timeout = Duration(sec=whole, nanosec=int((timeout - whole) * 1e9))
        return as_values(self.call(client, request, timeout))


def as_values(response: DetectGrasps.Response) -> dict[str, Any]:
    """Return an answer as values for JSON; what was not computed is None."""
    report, array = response.report, response.grasps
    fields = report.get_fields_and_field_types()
    counts = ("views", "sampled", *(f for f in fields if f.startswith("after_")))
    prefix = "seconds_"
    return {
        "code": Code(report.code).name,
        "message": report.message,
        "counts": {name: getattr(report, name) for name in counts},
        "seconds": {
            name.removeprefix(prefix): getattr(report, name)
            for name in fields
            if name.startswith(prefix)
        },
        "frame_id": array.header.frame_id,
        "tcp_frame": array.tcp_frame,
        "gripper": array.gripper,
        "axes": array.axes,
        "affordance_labels": list(array.affordance_labels),
        "grasps": [_grasp_values(grasp) for grasp in array.grasps],
    }


def _grasp_values(grasp: Grasp) -> dict[str, Any]:
    p, q = grasp.pose.position, grasp.pose.orientation
    return {
        "id": grasp.id,
        "position": [p.x, p.y, p.z],
        "quaternion_xyzw": [q.x, q.y, q.z, q.w],
        "width": grasp.width,
        "quality": _number(grasp.quality),
        "affordance": _number(grasp.affordance),
        "affordance_scores": list(grasp.affordance_scores),
        "arm": grasp.arm,
        "manipulability": _number(grasp.manipulability),
        "joint_positions": list(grasp.joint_positions),
        "contacts": [[p.x, p.y, p.z] for p in grasp.contacts],
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
