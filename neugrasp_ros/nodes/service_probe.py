# SPDX-License-Identifier: Apache-2.0
"""Shows depth images to a running suite and measures how soon it answers."""

import threading
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from builtin_interfaces.msg import Duration
from neugrasp_msgs.msg import DetectionReport
from neugrasp_msgs.srv import DetectGrasps
from sensor_msgs.msg import CameraInfo, Image

from neugrasp_ros.benchmark.shots import Shot
from neugrasp_ros.nodes.client import NoAnswerError, SuiteClient
from neugrasp_ros.nodes.compat.images import write_depth, write_intrinsics
from neugrasp_ros.nodes.compat.tf import StaticTransformBroadcaster
from neugrasp_ros.nodes.compat.tf_message import to_transform
from neugrasp_ros.nodes.conversions import to_stamp
from neugrasp_ros.nodes.depth_fusion import workspace_pose
from neugrasp_ros.nodes.qos import sensor_output
from neugrasp_ros.nodes.settings import WorkspaceConfig
from neugrasp_ros.nodes.table import DEPTH_TOPICS

HEAD_START = 0.1  # [s]; by then the server knows that it waits for an image
PAUSE = 0.1  # [s] between an answer and the next question
RETRY = 1.0  # [s] between questions to a suite that is not ready
TIMEOUT = 10.0  # [s] of a request
LIBRARY = (
    "fusion", "encoding", "rendering", "sampling", "local_rendering", "quality"
)  # fmt: skip


class Answer(NamedTuple):
    """One answered request.

    Attributes:
        latency: From the depth image's stamp to the reply, in [s].
        library: What of it the stages of the library took, in [s].
        code: Of the report.
    """

    latency: float
    library: float
    code: int


class Probe:
    """A camera that sees one scene after another, and a user.

    Args:
        client: Whose node publishes and asks.
        shots: Scenes of one cube, as in the suite's default workspace.
    """

    def __init__(self, client: SuiteClient, shots: Sequence[Shot]) -> None:
        self._client, self._shots = client, shots
        node = client.node
        self._depth = node.create_publisher(
            Image, DEPTH_TOPICS["depth/image"], sensor_output()
        )
        self._info = node.create_publisher(
            CameraInfo, DEPTH_TOPICS["depth/camera_info"], sensor_output()
        )
        self._service = node.create_client(DetectGrasps, "detect_grasps")
        workspace = WorkspaceConfig()
        self._broadcaster = StaticTransformBroadcaster(node)
        self._broadcaster.sendTransform(
            [
                to_transform(
                    workspace_pose(workspace) @ shot.T_task_camera,
                    workspace.frame,
                    _frame(number),
                    0,
                )
                for number, shot in enumerate(shots)
            ]
        )

    def wait_for_service(self, seconds: float) -> None:
        """Wait for the suite.

        Raises:
            NoAnswerError: If nobody offers the service in time.
        """
        if not self._service.wait_for_service(timeout_sec=seconds):
            raise NoAnswerError(f"nobody offers detect_grasps after {seconds} s")

    def ask(self, number: int) -> Answer:
        """Ask for grasps in an image that is taken a moment after the question.

        Raises:
            NoAnswerError: If no answer comes.
        """
        request = DetectGrasps.Request(
            scene=DetectGrasps.Request.SCENE_FRESH,
            reachability=DetectGrasps.Request.REACH_OFF,
            timeout=Duration(sec=int(TIMEOUT)),
            seed=number + 1,
        )
        done, replied = threading.Event(), [0]

        def note(_: Any) -> None:
            replied[0] = self._now()
            done.set()

        future = self._service.call_async(request)
        future.add_done_callback(note)
        time.sleep(HEAD_START)
        taken = self._show(number % len(self._shots))
        if not done.wait(2 * TIMEOUT):
            raise NoAnswerError(f"no answer from detect_grasps in {2 * TIMEOUT} s")
        report = future.result().report
        library = sum(getattr(report, f"seconds_{name}") for name in LIBRARY)
        return Answer((replied[0] - taken) / 1e9, library, report.code)

    def _show(self, number: int) -> int:
        """Publish a scene's image, taken now; return its stamp in [ns]."""
        shot, frame = self._shots[number], _frame(number)
        image = write_depth(shot.depth, "32FC1", frame, to_stamp(0))
        taken = self._now()
        image.header.stamp = to_stamp(taken)
        info = write_intrinsics(shot.intrinsics, frame, image.header.stamp)
        self._info.publish(info)
        self._depth.publish(image)
        return taken

    def _now(self) -> int:
        return int(self._client.node.get_clock().now().nanoseconds)


def _frame(number: int) -> str:
    return f"probe_camera_{number}_optical"


def measure(
    shots: Sequence[Shot], requests: int, start_timeout: float
) -> dict[str, Any]:
    """Ask a running suite again and again, each time about another image.

    Args:
        shots: Scenes of one cube.
        requests: How many answers count; those before the first grasps do not.
        start_timeout: How long the suite may take to start and compile [s].

    Returns:
        As ``figures``.

    Raises:
        NoAnswerError: If the suite does not come up or stops answering.
    """
    with SuiteClient() as client:
        probe = Probe(client, shots)
        probe.wait_for_service(start_timeout)
        deadline = time.monotonic() + start_timeout
        number = 0
        while probe.ask(number).code != DetectionReport.NONE:
            if time.monotonic() > deadline:
                raise NoAnswerError(f"no grasps after {start_timeout} s")
            number += 1
            time.sleep(RETRY)
        answers = []
        for _ in range(requests):
            number += 1
            time.sleep(PAUSE)
            answers.append(probe.ask(number))
    return figures(answers)


def figures(answers: Sequence[Answer]) -> dict[str, Any]:
    """Return median and 90th percentile of answers with grasps, in [ms].

    ``extra`` is the latency without the stages of the library.
    """
    good = [a for a in answers if a.code == DetectionReport.NONE]
    columns = {
        "latency": [a.latency for a in good],
        "library": [a.library for a in good],
        "extra": [a.latency - a.library for a in good],
    }
    result: dict[str, Any] = {"n": len(good), "failed": len(answers) - len(good)}
    for name, seconds in columns.items() if good else ():
        result[f"{name}_ms_median"] = round(1e3 * float(np.median(seconds)), 2)
        result[f"{name}_ms_p90"] = round(1e3 * float(np.percentile(seconds, 90)), 2)
    return result
