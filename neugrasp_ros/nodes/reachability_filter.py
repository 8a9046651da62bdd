# SPDX-License-Identifier: Apache-2.0
"""Node ``reachability_filter``: which grasps the robot reaches, and with which arm.

``CheckReachability`` serves twice: ``~/check`` answers with the grasps that were asked
about, ``~/suggest_base`` with at most one "grasp", whose pose is where the base would
have to stand, in the base frame.
"""

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseArray, PoseStamped
from neugrasp_msgs.msg import Grasp, GraspArray, TsdfVolume
from neugrasp_msgs.srv import CheckReachability
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import Executor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.nodes.compat.tf import Buffer, TransformListener
from neugrasp_ros.nodes.conversions import (
    from_grasp_array,
    from_tsdf,
    to_best_pose,
    to_grasp_array,
    to_pose,
    to_pose_array,
)
from neugrasp_ros.nodes.courtesy import Courtesy, Wait
from neugrasp_ros.nodes.grasp_list import GraspList
from neugrasp_ros.nodes.markers import to_markers
from neugrasp_ros.nodes.params import declare_config
from neugrasp_ros.nodes.qos import latched, newest, overrides, sensor_input
from neugrasp_ros.nodes.reach_stage import MakeChecker, ReachStage, load_checker
from neugrasp_ros.nodes.runtime import run
from neugrasp_ros.nodes.settings import ReachConfig
from neugrasp_ros.nodes.solid_boxes import TOPIC
from neugrasp_ros.nodes.transforms import Transforms
from neugrasp_ros.nodes.work import LatestWorker, answer, shielded

NAME = "reachability_filter"


class ReachabilityFilterNode(Node):
    """Check grasps against the robot, and publish every final list of grasps."""

    def __init__(
        self,
        make_checker: MakeChecker = load_checker,
        transforms: Transforms | None = None,
        let_requests_go_first: Wait = lambda _: False,
        **node_options: Any,
    ) -> None:
        """Load the robot, then wire topics and services.

        Args:
            make_checker: Loads the robot.
            transforms: Looks up transforms; default a listener of its own.
            let_requests_go_first: The stream of grasps calls it between batches. By
                default there is nothing to wait for.
            node_options: Of the ROS node.
        """
        super().__init__(NAME, **node_options)
        self._courtesy = Courtesy(let_requests_go_first)
        self._answer: GraspArray | None = None  # the last one
        self._publishing = threading.Lock()
        self._config = declare_config(self, ReachConfig, read_only=True)
        config = self._config.current
        self._gripper = load_gripper(config.gripper)
        self._joints: dict[str, float] = {}
        if transforms is None:
            buffer = Buffer()
            self._listener = TransformListener(buffer, self)
            transforms = Transforms(buffer)
        self.stage = ReachStage(
            make_checker(config), self._config, transforms, lambda: self._joints
        )
        self._worker = LatestWorker(self, self._stream)
        self._create_outputs()
        inputs = MutuallyExclusiveCallbackGroup()
        for kind, topic, callback, qos in (
            (GraspArray, "grasps/scored", self._on_scored, newest()),
            (GraspArray, "grasps/answered", self._on_answered, newest()),
            (JointState, "joint_states", self._on_joints, sensor_input(1)),
            (TsdfVolume, "tsdf", self._on_tsdf, latched()),
            (MarkerArray, TOPIC, self.stage.boxes.remember, latched()),
        ):
            self.create_subscription(
                kind,
                topic,
                shielded(self, callback),
                qos,
                callback_group=inputs,
                qos_overriding_options=overrides(),
            )
        for name, work, group in (
            ("~/check", self._on_check, ReentrantCallbackGroup()),
            # a long search; several at once would keep ``~/check`` from its threads
            (
                "~/suggest_base",
                self._on_suggest_base,
                MutuallyExclusiveCallbackGroup(),
            ),
        ):
            self.create_service(CheckReachability, name, work, callback_group=group)

    def _create_outputs(self) -> None:
        def output(kind: type, topic: str) -> Any:
            return self.create_publisher(
                kind, topic, latched(), qos_overriding_options=overrides()
            )

        self._grasps = output(GraspArray, "grasps")
        self._poses = output(PoseArray, "grasps/poses")
        self._best = output(PoseStamped, "grasps/best")
        self._markers = output(MarkerArray, "grasps/markers")

    def _on_joints(self, state: JointState) -> None:
        known = dict(zip(state.name, state.position, strict=False))
        self._joints = {**self._joints, **known}

    def _on_tsdf(self, message: TsdfVolume) -> None:
        self.stage.remember(from_tsdf(message))

    def _on_scored(self, message: GraspArray) -> None:
        if self._config.current.streaming:
            self._worker.put(message)

    def _stream(self, message: GraspArray) -> None:
        """Publish what can be reached, unless a request was answered meanwhile."""
        config, grasps = self._config.current, from_grasp_array(message)
        grasps = grasps.take(np.arange(min(len(grasps), config.max_grasps)))
        before = self._answer

        def is_answered() -> bool:
            last = self._answer
            return (
                last is not None
                and last is not before
                and last.scene_revision >= message.scene_revision
            )

        def make_way() -> bool:
            return self._courtesy.make_way(
                lambda _: self._worker.has_next() or is_answered()
            )

        checked = self.stage.check(grasps, (), None, make_way)
        reached = checked.take(self.stage.reached(checked))
        if config.keep_unreachable:
            order = np.argsort(~self.stage.reached(checked), kind="stable")
            reached = checked.take(order)
        with self._publishing:
            if not is_answered():
                self._publish(to_grasp_array(reached))
        self._courtesy.published()

    def _on_answered(self, message: GraspArray) -> None:
        with self._publishing:
            self._answer = message
            self._publish(message)

    def _publish(self, message: GraspArray) -> None:
        """Publish final grasps on all four topics."""
        grasps: GraspList = from_grasp_array(message)
        self._grasps.publish(message)
        self._poses.publish(to_pose_array(message))
        if len(grasps):
            self._best.publish(to_best_pose(message))
        self._markers.publish(to_markers(grasps, self._gripper))

    def _on_check(
        self, request: CheckReachability.Request, response: CheckReachability.Response
    ) -> object:
        def work() -> None:
            grasps = from_grasp_array(request.grasps)
            start = dict(
                zip(request.start_state.name, request.start_state.position, strict=True)
            )
            checked = self.stage.check(grasps, tuple(request.arms), start)
            response.grasps = to_grasp_array(checked)

        return answer(self, response, work)

    def _on_suggest_base(
        self, request: CheckReachability.Request, response: CheckReachability.Response
    ) -> object:
        """Answer with one pose of the base (``tcp_frame``), or none if it knows none.

        ``start_state`` is not looked at: the base moves, the arm stays as it is.
        """

        def work() -> None:
            grasps, base = from_grasp_array(request.grasps), self.stage.base_frame
            T = self.stage.suggest_base(grasps, tuple(request.arms))
            response.grasps.header.frame_id = response.grasps.tcp_frame = base
            response.grasps.header.stamp = request.grasps.header.stamp
            if T is not None:
                response.grasps.grasps = [Grasp(pose=to_pose(T))]

        return answer(self, response, work)

    def destroy_node(self) -> None:
        """End the worker, then the node."""
        self._worker.close()
        super().destroy_node()


def start(executor: Executor) -> Callable[[], None]:
    """Add the node to an executor; return what ends it."""
    node = ReachabilityFilterNode()
    executor.add_node(node)
    return node.destroy_node


def main(args: list[str] | None = None) -> int:
    """Run the node until shutdown."""
    return run(NAME, start, args)
