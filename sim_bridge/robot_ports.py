# SPDX-License-Identifier: Apache-2.0
"""The controllers of the simulated robot, as ROS sees them.

Each takes trajectories as a ``FollowJointTrajectory`` action and, for whoever needs no
answer, on a topic; a new one takes the place of the old one, as on the robot.
"""

import time
from typing import Any, NamedTuple

import numpy as np
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectory

from neugrasp_ros.errors import NeuGraspError, SimulationError
from neugrasp_ros.nodes.qos import overrides
from neugrasp_ros.nodes.trajectories import from_joint_trajectory
from neugrasp_ros.nodes.work import shielded
from sim_bridge.joint_drive import DriveState, JointDrive
from sim_bridge.robot_world import RobotWorld

POLL = 0.02  # [s]
GOAL_TOLERANCE = 0.02  # [rad] or [m] at the end of a trajectory
PATH_TOLERANCE = 0.15  # [rad] or [m] on the way; more means that the arm is blocked
SETTLE_TIME = 0.5  # [s] of simulated time after the end

_Result = FollowJointTrajectory.Result


class _Run(NamedTuple):
    """A trajectory that a drive was told to follow.

    Attributes:
        drive: The drive; a new scene has another one.
        turn: Number of the trajectory.
        end: When it is over, in [s] of simulated time.
    """

    drive: JointDrive
    turn: int
    end: float


class ControllerPort:
    """One controller's action and topic.

    Args:
        node: Node that owns them.
        world: The physics.
        name: Name of the controller.
        yields: It may be stopped by what it holds, as jaws are; then neither tolerance
            is asked for.
    """

    def __init__(
        self, node: Node, world: RobotWorld, name: str, *, yields: bool
    ) -> None:
        self._node, self._world, self._name, self._yields = node, world, name, yields
        self._joints = world.controllers[name]
        self._turn = 0
        group = ReentrantCallbackGroup()
        node.create_subscription(
            JointTrajectory,
            f"{name}/joint_trajectory",
            shielded(node, self._on_message),
            10,
            callback_group=group,
            qos_overriding_options=overrides(),
        )
        self._action = ActionServer(
            node,
            FollowJointTrajectory,
            f"{name}/follow_joint_trajectory",
            self._on_execute,
            goal_callback=self._on_goal,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            callback_group=group,
        )

    def destroy(self) -> None:
        """End the action."""
        self._action.destroy()

    def _start(self, message: JointTrajectory) -> _Run:
        """Have the drive follow a trajectory."""
        points = from_joint_trajectory(message, self._joints)

        def begin() -> _Run:
            drive, now = self._world.drives[self._name], self._world.now
            track = drive.read(*points)
            drive.start(track, now)
            self._turn += 1  # in the physics thread, as the start itself
            return _Run(drive, self._turn, now + track.duration)

        run: _Run = self._world.do(begin).result()
        return run

    def _on_message(self, message: JointTrajectory) -> None:
        self._start(message)

    def _on_goal(self, request: Any) -> GoalResponse:
        try:
            from_joint_trajectory(request.trajectory, self._joints)
        except NeuGraspError as error:
            self._node.get_logger().warning(f"{self._name}: goal refused: {error}")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _on_execute(self, goal: Any) -> FollowJointTrajectory.Result:
        try:
            return self._wait(goal, self._start(goal.request.trajectory))
        except NeuGraspError as error:
            goal.abort()
            return _Result(error_code=_Result.INVALID_GOAL, error_string=str(error))

    def _wait(self, goal: Any, run: _Run) -> FollowJointTrajectory.Result:
        """Return what came of the trajectory that runs.

        Raises:
            SimulationError: If its drive moves no more.
        """
        while True:
            error = self._error()
            self._check(run.drive)  # afterwards, so that the error was this drive's
            if run.turn != self._turn:
                goal.abort()
                return _Result(
                    error_code=_Result.INVALID_GOAL, error_string="another one came"
                )
            if goal.is_cancel_requested:
                self._stop(run.drive)
                goal.canceled()
                return _Result(error_string="stopped on the way")
            if not self._yields and error > PATH_TOLERANCE:
                self._stop(run.drive)
                goal.abort()
                return _Result(
                    error_code=_Result.PATH_TOLERANCE_VIOLATED,
                    error_string=f"{self._name}: a joint is {error:.3f} behind",
                )
            over = run.drive.state is DriveState.HOLDING
            if over and (self._yields or error < GOAL_TOLERANCE):
                goal.succeed()
                return _Result(error_code=_Result.SUCCESSFUL)
            if over and self._world.now > run.end + SETTLE_TIME:
                goal.abort()
                return _Result(
                    error_code=_Result.GOAL_TOLERANCE_VIOLATED,
                    error_string=f"{self._name}: a joint is {error:.3f} off its goal",
                )
            time.sleep(POLL)

    def _check(self, drive: JointDrive) -> None:
        """Refuse to wait for a drive that nobody asks for set points any more.

        Its state would stay as it is for ever.

        Raises:
            SimulationError: If the world has ended, or has another drive by now.
        """
        if ended := self._world.ended:
            raise SimulationError(ended)
        if self._world.drives[self._name] is not drive:
            raise SimulationError(f"{self._name}: a new scene came")

    def _stop(self, drive: JointDrive) -> None:
        """Bring a drive to rest on its way; return when it stands.

        Raises:
            SimulationError: If it moves no more before that.
        """
        self._world.do(lambda: drive.stop(self._world.now)).result()
        while drive.state is DriveState.STOPPING:
            self._check(drive)
            time.sleep(POLL)

    def _error(self) -> float:
        """Return how far the worst joint is from where it shall be."""
        measured, wanted = self._world.following(self._name)
        return float(np.abs(measured - wanted).max())
