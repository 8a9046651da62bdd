# SPDX-License-Identifier: Apache-2.0
"""Node ``grasp_executor``: a grasp as motion of the robot, and what came of it."""

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from neugrasp_msgs.action import ExecuteGrasp
from neugrasp_msgs.msg import GraspArray, TsdfVolume
from numpy.typing import NDArray
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import Executor
from rclpy.node import Node
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from neugrasp_ros.errors import CanceledError, ConfigError, NeuGraspError
from neugrasp_ros.manipulation.executor import GraspExecutor, GraspOutcome, Outcome
from neugrasp_ros.manipulation.mover import ArmMover
from neugrasp_ros.manipulation.scene_watch import SceneWatch, SeenScene
from neugrasp_ros.manipulation.warm_up import try_once
from neugrasp_ros.nodes.arm_hardware import Controllers
from neugrasp_ros.nodes.compat.tf import Buffer, TransformListener
from neugrasp_ros.nodes.conversions import from_grasp_array, from_tsdf
from neugrasp_ros.nodes.grasp_list import GraspList
from neugrasp_ros.nodes.params import declare_config
from neugrasp_ros.nodes.qos import latched, newest, overrides
from neugrasp_ros.nodes.runtime import run
from neugrasp_ros.nodes.sensing_robot import FreshViews, SensingRobot
from neugrasp_ros.nodes.settings import ExecuteConfig
from neugrasp_ros.nodes.solid_boxes import TOPIC, KnownBoxes
from neugrasp_ros.nodes.transforms import Transforms
from neugrasp_ros.nodes.work import answer, log_bug, shielded
from neugrasp_ros.robot.model import load_robot
from neugrasp_ros.robot.reachability import ReachabilityChecker

FloatArray = NDArray[np.float64]

NAME = "grasp_executor"
THREADS = 6


class GraspExecutorNode(Node):
    """Offer ``execute_grasp``, and services to put down and to return."""

    def __init__(
        self, transforms: Transforms | None = None, **node_options: Any
    ) -> None:
        """Load the robot, then wire topics, action and services."""
        super().__init__(NAME, **node_options)
        config = declare_config(self, ExecuteConfig, read_only=True).current
        self._config = config
        self._robot = robot = load_robot(config.robot)
        self._base = robot.description.base_frame
        mover = ArmMover(ReachabilityChecker(robot, config.reach), config.mover)
        try_once(mover)
        self._arms = tuple(mover.checker.arms)
        self._watch = SceneWatch(config.support_height)
        self._controllers = Controllers(self, robot, config.controllers)
        views = FreshViews(self, self._watch, self._on_tsdf, config.fresh_view)
        if transforms is None:
            buffer = Buffer()
            self._listener = TransformListener(buffer, self)
            transforms = Transforms(buffer)
        self._transforms = transforms
        self._boxes = KnownBoxes(self._base, transforms)
        self._hardware = SensingRobot(
            self._controllers,
            mover,
            self._watch,
            views.wait,
            self._now,
            self._boxes.in_base,
        )
        self._grasping = GraspExecutor(mover, self._hardware, config)
        self._turn = threading.Lock()
        self._executed = self.create_publisher(GraspArray, "grasps/executed", newest())
        self._create_inputs()
        self._create_servers()

    def _create_inputs(self) -> None:
        group = ReentrantCallbackGroup()
        for kind, topic, callback in (
            (TsdfVolume, "tsdf", self._on_tsdf),
            (MarkerArray, TOPIC, self._boxes.remember),
        ):
            self.create_subscription(
                kind,
                topic,
                shielded(self, callback),
                latched(),
                callback_group=group,
                qos_overriding_options=overrides(),
            )

    def _create_servers(self) -> None:
        group = ReentrantCallbackGroup()
        self._action = ActionServer(
            self,
            ExecuteGrasp,
            "execute_grasp",
            self._on_execute,
            goal_callback=self._on_goal,
            cancel_callback=self._on_cancel,
            callback_group=group,
        )
        for name, callback in (("~/drop", self._on_drop), ("~/home", self._on_home)):
            self.create_service(Trigger, name, callback, callback_group=group)

    def _now(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _on_tsdf(self, message: TsdfVolume) -> None:
        view = from_tsdf(message)
        T = self._transforms(self._base, view.frame_id, view.stamp)
        scene = SeenScene(view.volume, T @ view.T_frame_task, view.revision, view.stamp)
        self._watch.remember(scene)

    def _on_goal(self, _: Any) -> GoalResponse:
        """Accept a goal with the turn, so that none comes in before it starts."""
        if not self._turn.acquire(blocking=False):
            self.get_logger().warning("goal rejected: another motion is carried out")
            return GoalResponse.REJECT
        self._controllers.clear_stop()
        return GoalResponse.ACCEPT

    def _on_cancel(self, _: Any) -> CancelResponse:
        self._controllers.request_stop()
        return CancelResponse.ACCEPT

    def _on_execute(self, goal: Any) -> ExecuteGrasp.Result:
        def report(stage: str, share: float) -> None:
            goal.publish_feedback(ExecuteGrasp.Feedback(stage=stage, progress=share))

        try:
            outcome = self._execute(goal.request, report)
        finally:
            self._turn.release()
        line = f"{outcome.kind.name}: {outcome.message}"
        self.get_logger().info(line)
        if outcome.kind is GraspOutcome.CANCELED and goal.is_cancel_requested:
            goal.canceled()
        elif outcome.kind is GraspOutcome.GRASPED:
            goal.succeed()
        else:
            goal.abort()
        return ExecuteGrasp.Result(
            outcome=int(outcome.kind),
            message=outcome.message,
            final_width=outcome.opening,
        )

    def _execute(
        self, request: ExecuteGrasp.Goal, report: Callable[[str, float], None]
    ) -> Outcome:
        """Carry out a request; whatever happens, there is an outcome."""
        try:
            grasps = from_grasp_array(request.grasp)
            if not len(grasps):
                raise ConfigError("execute_grasp: the array holds no grasp")
            T = self._transforms(self._base, grasps.info.frame_id, 0)
            self._hardware.seen_in = self._scene_of(grasps)
            self._hardware.look_anew()
            self._executed.publish(request.grasp)
            arm = grasps.reach.arms[0] if grasps.reach else ""
            return self._grasping.execute(
                T @ grasps.grasps.poses[0],
                width=self._opening(float(grasps.grasps.widths[0])),
                arms=(arm,) if arm else self._arms,
                lift=request.lift,
                report=report,
            )
        except NeuGraspError as error:
            return Outcome(GraspOutcome.ABORTED, str(error))
        except Exception as error:  # noqa: BLE001 (a bug must not end the node)
            log_bug(self)
            return Outcome(GraspOutcome.ABORTED, f"INTERNAL: {NAME}: {error!r}")

    def _opening(self, width: float) -> float:
        grippers = self._robot.grippers.values()
        widest = min(gripper.max_opening for gripper in grippers)
        return widest if self._config.open_fully else min(width, widest)

    def _scene_of(self, grasps: GraspList) -> SeenScene | None:
        """Return the scene that grasps came from, by its number or their stamp."""
        info = grasps.info
        if info.revision:
            found = self._watch.get(info.revision)
            if found is not None:
                return found
        return self._watch.before(info.stamp)

    def _on_drop(self, _: Trigger.Request, response: Trigger.Response) -> object:
        return self._move(response, self._grasping.drop)

    def _on_home(self, _: Trigger.Request, response: Trigger.Response) -> object:
        def work() -> None:
            for arm in self._arms:
                self._grasping.go_home(arm)

        return self._move(response, work)

    def _move(self, response: Trigger.Response, work: Callable[[], None]) -> object:
        def guarded() -> None:
            if not self._turn.acquire(blocking=False):
                raise CanceledError("another motion is carried out")
            try:
                self._controllers.clear_stop()
                work()
            finally:
                self._turn.release()

        return answer(self, response, guarded)

    def destroy_node(self) -> None:
        """End the action server and the clients, then the node."""
        self._controllers.request_stop()
        self._action.destroy()
        self._controllers.destroy()
        super().destroy_node()


def start(executor: Executor) -> Callable[[], None]:
    """Add the node to an executor; return what ends it."""
    node = GraspExecutorNode()
    executor.add_node(node)
    return node.destroy_node


def main(args: list[str] | None = None) -> int:
    """Run the node until shutdown."""
    return run(NAME, start, args, threads=THREADS)
