# SPDX-License-Identifier: Apache-2.0
"""The robot behind its controllers: trajectories out, joint states in."""

import threading
import time
from collections.abc import Mapping
from typing import Any, NoReturn

import numpy as np
from action_msgs.msg import GoalStatus
from control_msgs.action import FollowJointTrajectory
from numpy.typing import NDArray
from rclpy.action.client import ClientGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from sensor_msgs.msg import JointState

from neugrasp_ros.errors import CanceledError, MotionError, NeuGraspError
from neugrasp_ros.geometry.finger_joint import joint_at, opening_at
from neugrasp_ros.motion.limits import Trajectory
from neugrasp_ros.nodes.compat.actions import ActionClient
from neugrasp_ros.nodes.motion_deadline import MotionDeadline
from neugrasp_ros.nodes.qos import overrides, sensor_input
from neugrasp_ros.nodes.trajectories import Points, to_joint_trajectory, to_seconds
from neugrasp_ros.robot.model import RobotModel
from neugrasp_ros.robot.urdf import finger_joints

FloatArray = NDArray[np.float64]

POLL = 0.02  # [s]
ANSWER_TIME = 10.0  # [s] that a controller may take to accept or to stop
SLOWER = 2.0  # times as long as it was told to, a controller may move
STATE_TIME = 5.0  # [s] that joint states may fail to come
JAW_TIME = 0.7  # [s] of a jaw motion
ENDS = {
    GoalStatus.STATUS_CANCELED: "somebody else stopped it",
    GoalStatus.STATUS_ABORTED: "the controller gave it up",
}


class Controllers:
    """Sends motions to a robot's trajectory controllers.

    A controller ``arm_left_controller`` moves the joints ``arm_left_*``; a motion of
    several controllers is sent to all of them at once.

    Args:
        node: Node that owns the clients.
        robot: The robot.
        names: Names of the controllers of arms and torso.
    """

    def __init__(self, node: Node, robot: RobotModel, names: tuple[str, ...]) -> None:
        self._robot = robot
        self._clock = node.get_clock()
        self._joints: Mapping[str, float] = {}
        self._arrived = 0.0
        self._stop = threading.Event()
        group = ReentrantCallbackGroup()
        self._prefixes = {name: name.removesuffix("controller") for name in names}
        jaws = [f"gripper_{key}_controller" for key in robot.grippers]
        self._clients = {
            name: ActionClient(
                node,
                FollowJointTrajectory,
                f"{name}/follow_joint_trajectory",
                callback_group=group,
            )
            for name in (*names, *jaws)
        }
        node.create_subscription(
            JointState,
            "joint_states",
            self._on_joints,
            sensor_input(1),
            callback_group=group,
            qos_overriding_options=overrides(),
        )

    def destroy(self) -> None:
        """End the clients."""
        for client in self._clients.values():
            client.destroy()

    def request_stop(self) -> None:
        """Have the motion that runs, or the next one, stop."""
        self._stop.set()

    def clear_stop(self) -> None:
        """Allow motion again."""
        self._stop.clear()

    def check_stop(self) -> None:
        """Let a search for a motion go on.

        Raises:
            CanceledError: If a stop was requested.
        """
        if self._stop.is_set():
            raise CanceledError("stopped before the next motion")

    def missing(self) -> list[str]:
        """Return the controllers that nobody offers."""
        return [n for n, c in self._clients.items() if not c.server_is_ready()]

    def _on_joints(self, state: JointState) -> None:
        known = dict(zip(state.name, state.position, strict=False))
        self._joints = {**self._joints, **known}
        self._arrived = time.monotonic()

    def configuration(self) -> FloatArray:
        """Return the robot's configuration, measured from now on, shape (J,).

        Raises:
            MotionError: If no joint states come.
        """
        asked = time.monotonic()
        while self._arrived <= asked:
            if time.monotonic() > asked + STATE_TIME:
                raise MotionError(f"no joint_states for {STATE_TIME:.0f} s")
            time.sleep(POLL)
        robot = self._robot
        q = robot.configuration(self._joints, default=robot.home)
        for key in robot.grippers:
            if not set(finger_joints(key)) & set(self._joints):
                robot.set_opening(q, key, self.opening(key))
        return q

    def opening(self, gripper: str) -> float:
        """Return the measured opening of jaws in [m]; open where nothing is known."""
        measures, joints = self._robot.grippers[gripper], self._joints
        if (driver := f"gripper_{gripper}_finger_joint") in joints:
            return opening_at(measures, joints[driver])
        slides = finger_joints(gripper)
        if set(slides) <= set(joints):
            return sum(joints[name] for name in slides)
        return measures.max_opening

    def move_jaws(self, gripper: str, opening: float) -> None:
        """Bring jaws to an opening in [m], or until they hold something.

        Raises:
            MotionError: If their controller refuses it or does not end it in time.
            CanceledError: If it was stopped.
        """
        joint = f"gripper_{gripper}_finger_joint"
        value = joint_at(self._robot.grippers[gripper], opening)
        points = Points(np.array([JAW_TIME]), np.array([[value]]), None, None)
        goal = FollowJointTrajectory.Goal(
            trajectory=to_joint_trajectory((joint,), points)
        )
        self._run({f"gripper_{gripper}_controller": goal}, strict=False)
        self.configuration()

    def follow(self, group: str, motion: Trajectory) -> None:
        """Carry out a motion.

        Raises:
            MotionError: If a controller refuses it, cannot follow, is stopped by
                somebody else, or does not end it in time.
            CanceledError: If it was stopped; it stands still by then.
        """
        goals = {}
        for name, prefix in self._prefixes.items():
            columns = [
                k for k, j in enumerate(motion.joint_names) if j.startswith(prefix)
            ]
            if not columns:
                continue
            points = Points(
                motion.times,
                motion.positions[:, columns],
                motion.velocities[:, columns],
                motion.accelerations[:, columns],
            )
            joints = tuple(motion.joint_names[k] for k in columns)
            goals[name] = FollowJointTrajectory.Goal(
                trajectory=to_joint_trajectory(joints, points)
            )
        told = sum(len(goal.trajectory.joint_names) for goal in goals.values())
        if told != len(motion.joint_names):
            raise MotionError(f"no controller for some of {motion.joint_names}")
        self._run(goals, strict=True)

    def _run(
        self, goals: Mapping[str, FollowJointTrajectory.Goal], *, strict: bool
    ) -> None:
        """Send goals at once and wait for all; one that fails stops the others."""
        self.check_stop()
        for name in goals:
            if not self._clients[name].server_is_ready():
                raise MotionError(f"nobody offers {name}/follow_joint_trajectory")
        sent = {n: self._clients[n].send_goal_async(g) for n, g in goals.items()}
        handles = _handles(sent)
        for name, handle in handles.items():
            if not handle.accepted:
                _give_up(handles, MotionError(f"{name} refused the motion"))
        results = {name: h.get_result_async() for name, h in handles.items()}
        told = max(_duration(goal) for goal in goals.values())
        deadline = MotionDeadline(SLOWER * told + ANSWER_TIME, self._now)
        while not all(result.done() for result in results.values()):
            if self._stop.is_set():
                stopped = CanceledError("stopped on the way")
                _give_up(handles, stopped)
            if strict and (failed := _failure(results)):
                _give_up(handles, MotionError(failed))
            if deadline.is_over():
                late = ", ".join(n for n, r in results.items() if not r.done())
                words = f"{late} did not end a motion of {told:.1f} s in time"
                _give_up(handles, MotionError(words))
            time.sleep(POLL)
        if strict and (failed := _failure(results)):
            raise MotionError(failed)

    def _now(self) -> int:
        return int(self._clock.now().nanoseconds)


def _duration(goal: FollowJointTrajectory.Goal) -> float:
    return to_seconds(goal.trajectory.points[-1].time_from_start)


def _handles(sent: Mapping[str, Any]) -> dict[str, ClientGoalHandle]:
    """Wait until all controllers have answered whether they take their goals.

    Raises:
        MotionError: If one does not answer; the others are stopped, and so is that one
            if it takes its goal later.
    """
    handles: dict[str, ClientGoalHandle] = {}
    silent: MotionError | None = None
    for name, future in sent.items():
        try:
            handles[name] = _wait(future, ANSWER_TIME, name)
        except MotionError as error:
            silent = error
            future.add_done_callback(_stop_late)
    if silent:
        _give_up(handles, silent)
    return handles


def _stop_late(accepting: Any) -> None:
    handle = accepting.result()
    if handle is not None and handle.accepted:
        handle.cancel_goal_async()


def _give_up(handles: Mapping[str, ClientGoalHandle], why: NeuGraspError) -> NoReturn:
    """Stop all motions, wait until the robot stands, and raise why.

    Raises:
        MotionError: Instead, if a controller does not answer: it may still move.
    """
    accepted = {name: handle for name, handle in handles.items() if handle.accepted}
    for handle in accepted.values():
        handle.cancel_goal_async()
    silent = []
    for name, handle in accepted.items():
        try:
            _wait(handle.get_result_async(), ANSWER_TIME, name)
        except MotionError as error:
            silent.append(str(error))
    if silent:
        raise MotionError(f"{why}; told to stop, {', '.join(silent)}") from why
    raise why


def _failure(results: Mapping[str, Any]) -> str:
    """Return what went wrong with the motions that are over, empty if nothing.

    A motion that is cancelled has no error code, and arms that stopped on their way.
    """
    for name, future in results.items():
        if not future.done():
            continue
        answer = future.result()
        if answer.result.error_code:
            return f"{name}: {answer.result.error_string}"
        if answer.status != GoalStatus.STATUS_SUCCEEDED:
            how = ENDS.get(answer.status, f"it ended with status {answer.status}")
            return f"{name}: the motion did not succeed, {how}"
    return ""


def _wait(future: Any, seconds: float, what: str) -> Any:
    deadline = time.monotonic() + seconds
    while not future.done():
        if time.monotonic() > deadline:
            raise MotionError(f"{what} did not answer in {seconds:.0f} s")
        time.sleep(POLL)
    return future.result()
