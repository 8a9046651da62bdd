# SPDX-License-Identifier: Apache-2.0
"""Trajectories out and joint states in, against controllers of the test."""

import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("control_msgs")

from action_msgs.srv import CancelGoal  # noqa: E402
from control_msgs.action import FollowJointTrajectory  # noqa: E402
from rclpy.action import ActionServer, CancelResponse, GoalResponse  # noqa: E402
from rclpy.callback_groups import ReentrantCallbackGroup  # noqa: E402
from rclpy.node import Node  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402

from neugrasp_ros.errors import CanceledError, MotionError  # noqa: E402
from neugrasp_ros.geometry.finger_joint import joint_at  # noqa: E402
from neugrasp_ros.geometry.gripper import load_gripper  # noqa: E402
from neugrasp_ros.motion.limits import Trajectory  # noqa: E402
from neugrasp_ros.nodes import arm_hardware  # noqa: E402
from neugrasp_ros.nodes.arm_hardware import Controllers  # noqa: E402
from neugrasp_ros.nodes.executor import PatientExecutor  # noqa: E402
from neugrasp_ros.nodes.runtime import SpinThread  # noqa: E402
from neugrasp_ros.robot.urdf import finger_joints  # noqa: E402

pytestmark = pytest.mark.ros

HAND = load_gripper("robotiq_2f85")
JOINTS = ("torso_lift_joint", "arm_left_1_joint", "arm_left_2_joint")
Result = FollowJointTrajectory.Result


class Robot:
    """Three joints and a gripper; the measured values come first."""

    grippers = {"left": HAND}
    joint_names = (*JOINTS, *finger_joints("left"))
    home = np.zeros(5)

    def configuration(self, joints, default):
        values = dict(zip(self.joint_names, default, strict=True)) | dict(joints)
        return np.array([values[name] for name in self.joint_names])

    def set_opening(self, q, key, opening):
        q[3:] = opening / 2


class Controller:
    """Takes trajectories; ends when told, or when it is cancelled and not deaf."""

    def __init__(self, node, name) -> None:
        self.goals, self.cancels, self.deaf = [], 0, False
        self.go, self.answer = threading.Event(), Result()
        self.takes = threading.Event()
        self.takes.set()
        self.server = ActionServer(
            node, FollowJointTrajectory, f"{name}/follow_joint_trajectory",
            self.run, callback_group=ReentrantCallbackGroup(),
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            goal_callback=self.accept,
        )  # fmt: skip

    def accept(self, _):
        self.takes.wait(20.0)
        return GoalResponse.ACCEPT

    def run(self, goal):
        self.goals.append(goal.request.trajectory)
        while not self.go.is_set():
            if goal.is_cancel_requested and not self.deaf:
                self.cancels += 1
                goal.canceled()
                return Result()
            time.sleep(0.01)
        if self.answer.error_code:
            goal.abort()
        else:
            goal.succeed()
        return self.answer


class Rig:
    def __init__(self, wait_until) -> None:
        self.executor = PatientExecutor(8)
        robot, user = self.nodes = (Node("robot"), Node("user"))
        for node in self.nodes:
            self.executor.add_node(node)
        self.spinning = SpinThread(self.executor)
        names = ("torso_controller", "arm_left_controller")
        self.ends = {
            name: Controller(robot, name)
            for name in (*names, "gripper_left_controller")
        }
        self.states = robot.create_publisher(JointState, "joint_states", 10)
        self.hand = Controllers(user, Robot(), names)
        wait_until(lambda: not self.hand.missing(), what="the controllers")
        self.told = {"torso_lift_joint": 0.2}
        robot.create_timer(0.02, self.tell)

    def tell(self) -> None:
        self.states.publish(
            JointState(name=list(self.told), position=list(self.told.values()))
        )

    def let_go(self) -> None:
        for end in self.ends.values():
            end.go.set()

    def close(self) -> None:
        self.let_go()
        self.spinning.stop()
        self.hand.destroy()
        for end in self.ends.values():
            end.server.destroy()
        for node in self.nodes:
            node.destroy_node()


@pytest.fixture
def rig(ros, wait_until):
    rig = Rig(wait_until)
    yield rig
    rig.close()


def motion(names=JOINTS, seconds=1.5):
    positions = np.array([[0.0, 0.0, 0.0], [0.1, 0.2, 0.3]])
    times = np.array([0.0, seconds])
    return Trajectory(names, times, positions, positions * 2, positions)


class Running:
    """A call in a thread, and what came of it."""

    def __init__(self, call) -> None:
        self.error = None
        self._thread = threading.Thread(target=self._run, args=(call,))
        self._thread.start()

    def _run(self, call) -> None:
        try:
            call()
        except Exception as error:
            self.error = error

    def end(self):
        self._thread.join(30.0)
        assert not self._thread.is_alive()
        return self.error


def test_each_controller_gets_its_own_joints_at_the_same_times(rig):
    rig.let_go()
    rig.hand.follow("arm_left_torso", motion())
    (torso,) = rig.ends["torso_controller"].goals
    (arm,) = rig.ends["arm_left_controller"].goals
    assert torso.joint_names == ["torso_lift_joint"]
    assert arm.joint_names == ["arm_left_1_joint", "arm_left_2_joint"]
    last = arm.points[-1]
    assert list(last.positions) == [0.2, 0.3] and list(last.velocities) == [0.4, 0.6]
    assert (last.time_from_start.sec, last.time_from_start.nanosec) == (1, 5 * 10**8)
    assert list(torso.points[-1].positions) == [0.1]


def test_a_joint_without_controller_is_refused_before_anything_moves(rig):
    with pytest.raises(MotionError, match="no controller for some of"):
        rig.hand.follow("g", motion(("torso_lift_joint", "leg_joint", "tail_joint")))
    assert not any(end.goals for end in rig.ends.values())


def test_one_controller_that_fails_stops_the_others(rig, wait_until):
    arm, torso = rig.ends["arm_left_controller"], rig.ends["torso_controller"]
    arm.answer = Result(error_code=-4, error_string="a joint is 0.2 behind")
    run = Running(lambda: rig.hand.follow("g", motion()))
    wait_until(lambda: arm.goals and torso.goals, what="both goals")
    arm.go.set()
    error = run.end()
    assert isinstance(error, MotionError)
    assert str(error) == "arm_left_controller: a joint is 0.2 behind"
    assert torso.cancels == 1


def test_a_motion_that_somebody_else_stops_has_failed(rig, wait_until):
    arm, torso = rig.ends["arm_left_controller"], rig.ends["torso_controller"]
    name = "arm_left_controller/follow_joint_trajectory/_action/cancel_goal"
    somebody = rig.nodes[0].create_client(CancelGoal, name)
    wait_until(somebody.service_is_ready, what="the service")
    run = Running(lambda: rig.hand.follow("g", motion()))
    wait_until(lambda: arm.goals and torso.goals, what="both goals")
    somebody.call_async(CancelGoal.Request())
    error = run.end()
    assert isinstance(error, MotionError)
    assert str(error) == (
        "arm_left_controller: the motion did not succeed, somebody else stopped it"
    )
    assert torso.cancels == 1


@pytest.mark.parametrize("deaf", [False, True])
def test_a_controller_that_does_not_end_is_not_waited_for_for_ever(
    rig, monkeypatch, deaf
):
    monkeypatch.setattr(arm_hardware, "ANSWER_TIME", 1.0)
    arm, torso = rig.ends["arm_left_controller"], rig.ends["torso_controller"]
    arm.deaf = deaf
    error = Running(lambda: rig.hand.follow("g", motion(seconds=0.1))).end()
    assert isinstance(error, MotionError)
    words = "did not end a motion of 0.1 s in time"
    told = f"torso_controller, arm_left_controller {words}"
    if deaf:
        told += "; told to stop, arm_left_controller did not answer in 1 s"
    assert str(error) == told
    assert (arm.cancels, torso.cancels) == (0 if deaf else 1, 1)


def test_a_controller_that_does_not_say_whether_it_moves_stops_all(
    rig, monkeypatch, wait_until
):
    monkeypatch.setattr(arm_hardware, "ANSWER_TIME", 1.0)
    arm, torso = rig.ends["arm_left_controller"], rig.ends["torso_controller"]
    arm.takes.clear()
    error = Running(lambda: rig.hand.follow("g", motion())).end()
    assert isinstance(error, MotionError)
    assert str(error) == "arm_left_controller did not answer in 1 s"
    assert torso.cancels == 1
    arm.takes.set()
    wait_until(lambda: arm.cancels == 1, what="the cancel of the late goal")


def test_a_stop_ends_the_motion_and_forbids_the_next(rig, wait_until):
    run = Running(lambda: rig.hand.follow("g", motion()))
    wait_until(lambda: rig.ends["torso_controller"].goals, what="the goal")
    rig.hand.request_stop()
    assert isinstance(run.end(), CanceledError)
    assert rig.ends["torso_controller"].cancels == 1
    assert rig.ends["arm_left_controller"].cancels == 1
    with pytest.raises(CanceledError, match="before the next motion"):
        rig.hand.follow("g", motion())
    rig.hand.clear_stop()
    rig.let_go()
    rig.hand.follow("g", motion())


def test_jaws_close_by_their_finger_joint_whatever_stops_them(rig):
    rig.let_go()
    jaws = rig.ends["gripper_left_controller"]
    jaws.answer = Result(error_code=-5, error_string="off its goal")
    rig.hand.move_jaws("left", 0.03)
    (told,) = jaws.goals
    assert told.joint_names == ["gripper_left_finger_joint"]
    assert told.points[0].positions[0] == pytest.approx(joint_at(HAND, 0.03))


def test_the_configuration_is_measured_from_now_on(rig, monkeypatch):
    assert rig.hand.configuration()[:3].tolist() == [0.2, 0.0, 0.0]
    rig.told = {"arm_left_1_joint": 0.7}
    time.sleep(0.1)
    assert rig.hand.configuration()[:3].tolist() == [0.2, 0.7, 0.0]
    rig.tell = lambda: None
    rig.states = SimpleNamespace(publish=lambda _: None)
    monkeypatch.setattr(arm_hardware, "STATE_TIME", 0.2)
    time.sleep(0.1)
    with pytest.raises(MotionError, match="no joint_states"):
        rig.hand.configuration()


@pytest.mark.parametrize(
    ("told", "opening"),
    [
        ({"torso_lift_joint": 0.0}, HAND.max_opening),
        ({"gripper_left_finger_joint": joint_at(HAND, 0.04)}, 0.04),
        (dict.fromkeys(finger_joints("left"), 0.01), 0.02),
    ],
)
def test_the_opening_is_told_by_what_is_known_of_the_jaws(rig, told, opening):
    rig.told = told
    time.sleep(0.1)
    q = rig.hand.configuration()
    assert rig.hand.opening("left") == pytest.approx(opening, abs=1e-6)
    assert q[3:].sum() == pytest.approx(opening, abs=1e-6)
