# SPDX-License-Identifier: Apache-2.0
"""The demonstration with a whole robot: execute, drop into a box, film it."""

from collections.abc import Callable
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from neugrasp_msgs.action import ExecuteGrasp
from neugrasp_msgs.msg import Grasp, GraspArray
from neugrasp_msgs.srv import DetectGrasps
from numpy.typing import NDArray
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from neugrasp_ros.manipulation.executor import GraspOutcome
from neugrasp_ros.nodes.compat.actions import ActionClient
from neugrasp_ros.nodes.compat.images import read_color
from neugrasp_ros.nodes.conversions import from_stamp, only
from neugrasp_ros.nodes.demo_client import DemoClient, DemoError, attempt_of
from neugrasp_ros.nodes.qos import latched, newest
from neugrasp_ros.nodes.settings import DEFAULT_SUPPORT_HEIGHT
from neugrasp_ros.pictures.decision import Attempt
from neugrasp_ros.pictures.film import STAGES, Shot

FloatArray = NDArray[np.float64]

TRIED = 3  # grasps of one answer, where the robot refuses the first
MOTION_TIMEOUT = 600.0  # [s] of the wall clock; a busy machine simulates slowly
WORKSPACE = "workspace.origin"
LOOK, REACH, GRASP, LIFT, DROP = STAGES
HOME = "home"  # on the way back, which no caption names
SHOWN = {"close": GRASP, "lift": LIFT}
"""Stages of the action by what a bystander would call them, where that changes."""
REFUSED = (GraspOutcome.UNREACHABLE, GraspOutcome.ABORTED)


class RobotDemoClient(DemoClient):
    """Ask for grasps, have the robot carry them out, until the table is clear.

    Attributes:
        shots: Pictures of the run, each with what the robot does in it.
        largest_contact: Force of robot and furniture in [N], the largest of the run.
    """

    failures_to_stop = 4

    def __init__(self, spin: Callable[[float], None]) -> None:
        super().__init__(spin)
        self.shots: list[Shot] = []
        self._stage, self._before, self._begin = LOOK, 0, 0
        self.largest_contact = 0.0
        self._execute = ActionClient(self, ExecuteGrasp, "execute_grasp")
        self._drop = self.create_client(Trigger, "grasp_executor/drop")
        self._home = self.create_client(Trigger, "grasp_executor/home")
        self._reset = self.create_client(Trigger, "tsdf_fusion/reset")
        self._get = self.create_client(GetParameters, "tsdf_fusion/get_parameters")
        self._set = self.create_client(SetParameters, "tsdf_fusion/set_parameters")
        for name, kind, topic, qos in (
            ("objects", MarkerArray, "sim_bridge/objects", latched()),
            ("bins", MarkerArray, "sim_bridge/bins", latched()),
            ("support", MarkerArray, "collision_boxes", latched()),
        ):
            self.create_subscription(kind, topic, self._keep(name), qos)
        self.create_subscription(Image, "sim_bridge/view", self._on_view, newest())
        self.create_subscription(
            DiagnosticArray, "/diagnostics", self._on_diagnostics, 10
        )

    def clients_needed(self) -> tuple[Any, ...]:
        """Return the clients without whose service nothing can be shown."""
        return (self._detect, self._spawn, self._drop, self._set)

    def prepare_scene(self, kind: str) -> None:
        """Bring the workspace to the height of the furniture, and look anew.

        Raises:
            DemoError: If the workspace cannot be moved.
        """
        self._pause(0.5)
        top = self._support_height()
        answer = self._call(self._get, GetParameters.Request(names=[WORKSPACE]))
        x, y, z = answer.values[0].double_array_value
        if abs(top - DEFAULT_SUPPORT_HEIGHT - z) > 1e-6:
            value = ParameterValue(
                type=ParameterType.PARAMETER_DOUBLE_ARRAY,
                double_array_value=[x, y, top - DEFAULT_SUPPORT_HEIGHT],
            )
            request = SetParameters.Request(
                parameters=[Parameter(name=WORKSPACE, value=value)]
            )
            done = self._call(self._set, request).results[0]
            if not done.successful:
                raise DemoError(f"{WORKSPACE}: {done.reason}")
        self._call(self._reset, Trigger.Request())
        # pictures of what stood there before may still be on their way
        self._begin = from_stamp(_cubes(self._latest["support"])[0].header.stamp)
        self.shots.clear()

    def _support_height(self) -> float:
        """Return the top of the box that the bridge names first, the support."""
        marker = _cubes(self._latest["support"])[0]
        return float(marker.pose.position.z + marker.scale.z / 2)

    def _on_view(self, image: Image) -> None:
        if from_stamp(image.header.stamp) < self._begin:
            return
        frame = read_color(image)
        if self.shots and np.array_equal(self.shots[-1].frame, frame):
            return
        known = len(_cubes(self._latest.get("objects", MarkerArray())))
        cleared = len(self._cleared())
        if self._stage == DROP and cleared > self._before:
            self._stage = HOME  # the hand is empty
        tally = f"{cleared} of {known} in the boxes"
        self.shots.append(Shot(frame.copy(), self._stage, tally))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            for pair in status.values:
                if pair.key == "largest_contact_n":
                    self.largest_contact = max(self.largest_contact, float(pair.value))

    def _attempt(self, grasps: GraspArray) -> Attempt:
        """Have the robot carry out the best grasp that it does not refuse."""
        for best in grasps.grasps[:TRIED]:
            before = self._cleared()
            self._stage, self._before = REACH, len(before)
            outcome, words = self._carry_out(grasps, best)
            if outcome not in REFUSED:
                break
        if outcome is not GraspOutcome.GRASPED:
            if outcome not in REFUSED:
                words = f"{outcome.name}: {words}"
            return attempt_of(best, False, words)
        lost = self._bring_to_box()
        self._pause(0.7)  # of the bridge's objects, which it tells twice a second
        new = sorted(self._cleared() - before)
        if new:
            return attempt_of(best, True, f"cleared {new[0]}")
        return attempt_of(best, False, f"LOST: {lost or 'not in the box'}")

    def _bring_to_box(self) -> str:
        """Drop what is held into its box; return why not, empty if it was let go.

        Where there is no way from here, there may be one from the resting posture.
        """
        self._stage = DROP
        first = self._call(self._drop, Trigger.Request(), MOTION_TIMEOUT)
        if first.success:
            return ""
        self._call(self._home, Trigger.Request(), MOTION_TIMEOUT)
        again = self._call(self._drop, Trigger.Request(), MOTION_TIMEOUT)
        return "" if again.success else str(first.message)

    def _carry_out(self, grasps: GraspArray, best: Grasp) -> tuple[GraspOutcome, str]:
        sent = self._execute.send_goal_async(
            ExecuteGrasp.Goal(grasp=only(grasps, best)), self._on_progress
        )
        handle = self._await(sent, "execute_grasp", MOTION_TIMEOUT)
        if not handle.accepted:
            return GraspOutcome.ABORTED, "execute_grasp took no goal"
        future = handle.get_result_async()
        result = self._await(future, "execute_grasp", MOTION_TIMEOUT).result
        return GraspOutcome(result.outcome), result.message

    def _on_progress(self, message: Any) -> None:
        self._stage = SHOWN.get(message.feedback.stage, self._stage)

    def _ask(self, seed: int, affordance: str) -> DetectGrasps.Response:
        self._stage = LOOK
        return super()._ask(seed, affordance)

    def _cleared(self) -> set[str]:
        """Return the names of the objects in the bins."""
        bins = _cubes(self._latest.get("bins", MarkerArray()))
        return {
            marker.text
            for marker in _cubes(self._latest.get("objects", MarkerArray()))
            if any(_is_in(marker, bin_) for bin_ in bins)
        }


def _cubes(message: MarkerArray) -> list[Marker]:
    return [m for m in message.markers if m.action == Marker.ADD]


def _is_in(marker: Marker, bin_: Marker) -> bool:
    """Tell whether an object's middle lies over a bin's floor and under its rim."""
    p, c, size = marker.pose.position, bin_.pose.position, bin_.scale
    inside = abs(p.x - c.x) < size.x / 2 and abs(p.y - c.y) < size.y / 2
    return inside and p.z < c.z + size.z / 2
