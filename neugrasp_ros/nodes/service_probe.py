# SPDX-License-Identifier: Apache-2.0
"""Shows depth images to a running suite and measures how soon it answers."""

import threading
import time
from collections.abc import Callable, Sequence
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
PAUSE = 1.0  # [s] between an answer and the next question; by then the streams, which
# look at each image as well, have let go of the planner
RETRY = 1.0  # [s] between questions to a suite that is not ready
TIMEOUT = 10.0  # [s] of a request
POLL = 0.2  # [s] between two looks whether the suite still runs
LIBRARY = (
    "fusion", "encoding", "rendering", "sampling", "local_rendering", "quality"
)  # fmt: skip


class Answer(NamedTuple):
    """One answered request.

    Attributes:
        latency: From the depth image's stamp to the reply, in [s].
        library: What of it the stages of the library took, in [s].
        code: Of the report.
        message: Of the report.
    """

    latency: float
    library: float
    code: int
    message: str = ""


class Probe:
    """A camera that sees one scene after another, and a user.

    Args:
        client: Whose node publishes and asks.
        shots: Scenes of one cube, as in the suite's default workspace.
        is_running: Tells whether the suite's processes run.
    """

    def __init__(
        self,
        client: SuiteClient,
        shots: Sequence[Shot],
        is_running: Callable[[], bool] = lambda: True,
    ) -> None:
        self._client, self._shots = client, shots
        self._is_running = is_running
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
            NoAnswerError: If nobody offers the service in time, or the suite has ended.
        """
        service = self._service
        if not self._wait(lambda t: service.wait_for_service(timeout_sec=t), seconds):
            raise NoAnswerError(f"nobody offers detect_grasps after {seconds} s")

    def ask(self, number: int) -> Answer | None:
        """Ask for grasps in an image that is taken a moment after the question.

        Returns:
            The answer; None if none comes in twice the request's time.

        Raises:
            NoAnswerError: If the suite has ended.
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
        if not self._wait(done.wait, 2 * TIMEOUT):
            self._service.remove_pending_request(future)
            return None
        report = future.result().report
        library = sum(getattr(report, f"seconds_{name}") for name in LIBRARY)
        latency = (replied[0] - taken) / 1e9
        return Answer(latency, library, report.code, report.message)

    def _wait(self, wait: Callable[[float], bool], seconds: float) -> bool:
        """Wait a little again and again; return whether that was successful in time.

        Raises:
            NoAnswerError: If the suite has ended.
        """
        deadline = time.monotonic() + seconds
        while not wait(POLL):
            if not self._is_running():
                raise NoAnswerError("the suite has ended: its output says why")
            if time.monotonic() > deadline:
                return False
        return True

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
    shots: Sequence[Shot],
    requests: int,
    start_timeout: float,
    is_running: Callable[[], bool] = lambda: True,
    after: Callable[[int], None] = lambda _: None,
    pause: float = PAUSE,
) -> dict[str, Any]:
    """Ask a running suite again and again, each time about another image.

    Args:
        shots: Scenes of one cube.
        requests: How many answers count; those before the first grasps do not.
        start_timeout: How long the suite may take to start and compile [s].
        is_running: Tells whether the suite's processes run.
        after: Told how many answers that count have come.
        pause: Between an answer and the next question in [s].

    Returns:
        As ``figures``.

    Raises:
        NoAnswerError: If the suite does not come up, ends or stops answering.
    """
    deadline = time.monotonic() + start_timeout
    with SuiteClient() as client:
        probe = Probe(client, shots, is_running)
        probe.wait_for_service(start_timeout)
        first = _first_grasps(probe, deadline)
        answers = []
        for number in range(first + 1, first + 1 + requests):
            time.sleep(pause)
            answer = probe.ask(number)
            if answer is None:
                raise NoAnswerError(f"no answer from detect_grasps in {2 * TIMEOUT} s")
            answers.append(answer)
            after(len(answers))
    return figures(answers)


def _first_grasps(probe: Probe, deadline: float) -> int:
    """Ask until there are grasps; return the number of that question.

    Raises:
        NoAnswerError: If there are none at a deadline of ``time.monotonic()``.
    """
    number, answer = 0, probe.ask(0)
    while answer is None or answer.code != DetectionReport.NONE:
        if time.monotonic() > deadline:
            what = "no answer"
            if answer is not None:
                what = f"code {answer.code} {answer.message}"
            raise NoAnswerError(f"no grasps in the time to start; last: {what}")
        time.sleep(RETRY)
        number += 1
        answer = probe.ask(number)
    return number


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
