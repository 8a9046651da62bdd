# SPDX-License-Identifier: Apache-2.0
"""Node ``grasp_server``: a request for grasps, as a service and as an action."""

import time
from collections.abc import Callable
from typing import Any

from neugrasp_msgs.action import DetectGrasps as DetectAction
from neugrasp_msgs.msg import GraspArray
from neugrasp_msgs.srv import DetectGrasps, ListAffordances
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import Executor
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo

from neugrasp_ros.errors import ConfigError, NeuGraspError
from neugrasp_ros.nodes.compat.images import read_intrinsics
from neugrasp_ros.nodes.compat.tf import Buffer, TransformListener
from neugrasp_ros.nodes.conversions import to_grasp_array
from neugrasp_ros.nodes.detection import Detection, Outcome, Progress, Stages
from neugrasp_ros.nodes.grasp_list import GraspList
from neugrasp_ros.nodes.outcomes import Code, as_detection_error
from neugrasp_ros.nodes.params import declare_config
from neugrasp_ros.nodes.qos import newest, overrides, sensor_input
from neugrasp_ros.nodes.remote_stages import RemoteStages
from neugrasp_ros.nodes.requests import SCENES, read_request
from neugrasp_ros.nodes.runtime import run
from neugrasp_ros.nodes.selection import describe
from neugrasp_ros.nodes.settings import ServerConfig
from neugrasp_ros.nodes.target_mask import Camera
from neugrasp_ros.nodes.transforms import Transforms
from neugrasp_ros.nodes.waiting import Turns, is_ending
from neugrasp_ros.nodes.work import LatestWorker, log_bug, shielded

NAME = "grasp_server"
THREADS = 6  # one request runs, three wait; replies of stages need one more
LIST_TIME = 5.0  # [s]
REPLY_FIRST = 0.02  # [s] that listeners wait, by when the answer has been sent


class GraspServerNode(Node):
    """Offer ``detect_grasps``; one request runs at a time, few wait."""

    def __init__(self, stages: Stages | None = None, **node_options: Any) -> None:
        """Wire service and action; without stages, ask the stage nodes' services."""
        super().__init__(NAME, **node_options)
        self._config = declare_config(self, ServerConfig)
        if stages is None:
            buffer = Buffer()
            self._listener = TransformListener(buffer, self)
            stages = RemoteStages(self, Transforms(buffer))
        self._stages = stages
        self._turn = Turns(lambda: is_ending(self))
        self._camera: Camera | None = None  # that the masks of requests belong to
        self._no_camera = ""  # why the camera info that came is of no use
        self._executed = 0  # when a grasp was last executed [ns]
        self._answered = self.create_publisher(GraspArray, "grasps/answered", newest())
        self._listeners = LatestWorker(self, self._tell)
        group = ReentrantCallbackGroup()
        self.create_subscription(
            GraspArray,
            "grasps/executed",
            self._on_executed,
            newest(),
            callback_group=group,
        )
        self.create_subscription(
            CameraInfo,
            "depth/camera_info",
            shielded(self, self._on_camera_info),
            sensor_input(1),
            callback_group=group,
            qos_overriding_options=overrides(),
        )
        self.create_service(
            ListAffordances, "list_affordances", self._on_list, callback_group=group
        )
        self._action = ActionServer(
            self,
            DetectAction,
            "detect_grasps",
            self._on_goal_execute,
            goal_callback=self._on_goal,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            callback_group=group,
        )
        self.create_service(
            DetectGrasps, "detect_grasps", self._on_detect, callback_group=group
        )

    def _now(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _on_camera_info(self, info: CameraInfo) -> None:
        try:
            intrinsics = read_intrinsics(info)
        except ConfigError as error:
            self._camera, self._no_camera = None, str(error)
            raise
        self._camera = Camera(intrinsics, info.header.frame_id)

    def _on_executed(self, _: GraspArray) -> None:
        self._executed = self._now()

    def _last_execution(self) -> int:
        """Return when a grasp was last executed in [ns]; 0 = not since it was seen.

        One in the future was executed before time jumped back: no image of the new run
        would be newer.
        """
        if self._executed > self._now():
            self._executed = 0
        return self._executed

    def _on_detect(
        self, request: DetectGrasps.Request, response: DetectGrasps.Response
    ) -> DetectGrasps.Response:
        outcome = self.detect(request, Progress())
        response.success = outcome.report.code == Code.NONE
        self._fill(response, outcome)
        return response

    def _fill(self, answer: Any, outcome: Outcome) -> None:
        """Put an outcome into an answer, which goes out before listeners hear of it."""
        answer.report = outcome.report
        if outcome.grasps is not None:
            answer.grasps = to_grasp_array(outcome.grasps)
            if outcome.report.code == Code.NONE:
                self._listeners.put(answer.grasps)

    def _tell(self, grasps: GraspArray) -> None:
        time.sleep(REPLY_FIRST)
        self._answered.publish(grasps)

    def _on_goal(self, _: Any) -> GoalResponse:
        policy = self._config.current.goal_policy
        if self._turn.locked() and policy == "reject":
            self.get_logger().warning("goal rejected: another request is running")
            return GoalResponse.REJECT
        if policy == "queue" and self._turn.full():
            self.get_logger().warning("goal rejected: too many requests wait")
            return GoalResponse.REJECT
        if policy == "preempt":
            self._turn.preempt()
        return GoalResponse.ACCEPT

    def _on_goal_execute(self, goal: Any) -> DetectAction.Result:
        def report(stage: str, share: float, best: GraspList | None) -> None:
            feedback = DetectAction.Feedback(stage=stage, progress=share)
            if best is not None:
                feedback.grasps_so_far = len(best)
                feedback.best_so_far = to_grasp_array(best)
            goal.publish_feedback(feedback)

        progress = Progress(lambda: goal.is_cancel_requested, report)
        outcome = self.detect(goal.request, progress)
        result = DetectAction.Result()
        self._fill(result, outcome)
        if goal.is_cancel_requested:
            goal.canceled()
        elif outcome.report.code == Code.NONE:
            goal.succeed()
        else:
            goal.abort()
        return result

    def detect(self, request: Any, progress: Progress) -> Outcome:
        """Run one request when it is its turn; whatever happens, there is a report."""
        asked, start = self._now(), time.monotonic()
        outcome = Outcome()
        try:
            config = self._config.current
            wanted = read_request(request, config, self._camera, self._no_camera)
            ticket = self._turn.acquire(wanted.timeout, progress.canceled)
            try:
                fresh = wanted.scene != SCENES["current"]
                newer_than = asked if fresh else self._last_execution()
                stop = progress.canceled
                progress.canceled = lambda: stop() or ticket.is_void()
                detection = Detection(
                    self._stages, config, wanted, progress, newer_than
                )
                outcome = detection.run()
                if outcome.report.views and self._executed == newer_than:
                    self._executed = 0  # seen since; no later request need wait
            finally:
                self._turn.release(ticket)
        except NeuGraspError as error:
            reason = as_detection_error(error)
            outcome.report.code = int(reason.code)
            outcome.report.message = reason.sentence
        except Exception as error:  # noqa: BLE001 (a bug must not end the node)
            log_bug(self)
            outcome.report.code = int(Code.INTERNAL)
            outcome.report.message = f"{NAME}: {error!r}; see its log"
        outcome.report.seconds_total = time.monotonic() - start
        self._log(outcome)
        return outcome

    def _log(self, outcome: Outcome) -> None:
        report = outcome.report
        line = (
            f"{Code(report.code).name}: {report.message} "
            f"({report.sampled} sampled, {report.seconds_total:.2f} s)"
        )
        if report.code == Code.NONE:
            self.get_logger().info(line)
        else:
            self.get_logger().warning(line)

    def _on_list(
        self, _: ListAffordances.Request, response: ListAffordances.Response
    ) -> ListAffordances.Response:
        missing = self._stages.missing()
        if missing:  # the answer has no field to say so
            self.get_logger().warning(f"list_affordances: {'; '.join(missing)}")
            return response
        try:
            response.labels = list(self._stages.labels(time.monotonic() + LIST_TIME))
        except NeuGraspError as error:
            self.get_logger().warning(f"list_affordances: {error}")
        response.descriptions = [describe(label) for label in response.labels]
        return response

    def destroy_node(self) -> None:
        """End the action server and the worker, then the node."""
        self._action.destroy()
        self._listeners.close()
        super().destroy_node()


def start(executor: Executor) -> Callable[[], None]:
    """Add the node to an executor; return what ends it."""
    node = GraspServerNode()
    executor.add_node(node)
    return node.destroy_node


def main(args: list[str] | None = None) -> int:
    """Run the node until shutdown."""
    return run(NAME, start, args, threads=THREADS)
