# SPDX-License-Identifier: Apache-2.0
"""A controller over real ROS, with drives that do what a test tells them."""

import threading
import time
from concurrent.futures import Future
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("control_msgs")

import rclpy  # noqa: E402
from action_msgs.msg import GoalStatus  # noqa: E402
from control_msgs.action import FollowJointTrajectory  # noqa: E402
from rclpy.context import Context  # noqa: E402
from rclpy.node import Node  # noqa: E402
from trajectory_msgs.msg import JointTrajectory  # noqa: E402

from neugrasp_ros.errors import ConfigError  # noqa: E402
from neugrasp_ros.nodes.compat.actions import ActionClient  # noqa: E402
from neugrasp_ros.nodes.executor import PatientExecutor  # noqa: E402
from neugrasp_ros.nodes.runtime import SpinThread, prepare  # noqa: E402
from neugrasp_ros.nodes.trajectories import Points, to_joint_trajectory  # noqa: E402
from sim_bridge.joint_drive import DriveState  # noqa: E402
from sim_bridge.robot_ports import (  # noqa: E402
    GOAL_TOLERANCE,
    PATH_TOLERANCE,
    SETTLE_TIME,
    ControllerPort,
)

pytestmark = pytest.mark.ros

Result = FollowJointTrajectory.Result
JOINTS = ("a_joint", "b_joint")
SECONDS = 2.0


class Track:
    duration = SECONDS


class Drive:
    def __init__(self) -> None:
        self.state, self.read_points, self.stops = DriveState.HOLDING, [], 0
        self.stopped = DriveState.HOLDING

    def read(self, times, positions, velocities=None, accelerations=None):
        if np.abs(positions).max() > 3.0:
            raise ConfigError("beyond its limits")
        self.read_points.append(positions)
        return Track()

    def start(self, track, now):
        self.state = DriveState.FOLLOWING

    def stop(self, now):
        self.stops += 1
        self.state = self.stopped


class World:
    """A world whose time and errors are those of the test."""

    def __init__(self) -> None:
        self.now, self.error, self.ended = 100.0, 0.0, ""
        self.controllers = {"arm": JOINTS, "jaws": ("finger",)}
        self.drives = {name: Drive() for name in self.controllers}

    def do(self, job):
        future = Future()
        try:
            future.set_result(job())
        except Exception as error:
            future.set_exception(error)
        return future

    def following(self, name):
        zero = np.zeros(len(self.controllers[name]))
        return zero, zero + self.error


class Rig:
    def __init__(self, context: Context) -> None:
        self.world = World()
        self.executor = PatientExecutor(6, context=context)
        self.robot = Node("ports_robot", context=context)
        self.user = Node("ports_user", context=context)
        self.ports = [
            ControllerPort(self.robot, self.world, name, yields=name == "jaws")
            for name in self.world.controllers
        ]
        self.clients = {
            name: ActionClient(
                self.user, FollowJointTrajectory, f"{name}/follow_joint_trajectory"
            )
            for name in self.world.controllers
        }
        self.topic = self.user.create_publisher(
            JointTrajectory, "arm/joint_trajectory", 10
        )
        for node in (self.robot, self.user):
            self.executor.add_node(node)
        self.spinning = SpinThread(self.executor)

    def send(self, name="arm", joints=JOINTS, value=1.0):
        client = self.clients[name]
        assert client.wait_for_server(timeout_sec=30.0)
        goal = FollowJointTrajectory.Goal(trajectory=message(joints, value))
        return done(client.send_goal_async(goal))

    def close(self) -> None:
        self.spinning.stop()
        for end in (*self.ports, *self.clients.values()):
            end.destroy()
        for node in (self.robot, self.user):
            node.destroy_node()


def message(joints, value):
    positions = np.full((1, len(joints)), value)
    return to_joint_trajectory(
        joints, Points(np.array([SECONDS]), positions, None, None)
    )


def done(future, seconds=30.0):
    over = threading.Event()
    future.add_done_callback(lambda _: over.set())
    assert over.wait(seconds), "no answer in time"
    return future.result()


def outcome(handle):
    return done(handle.get_result_async()).result


@pytest.fixture
def rig(domain):
    prepare()
    context = Context()  # other tests have the default one
    rclpy.init(args=[], context=context)
    rig = Rig(context)
    yield rig
    rig.close()
    context.try_shutdown()


def wait_until(condition, seconds=30.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "the condition did not come true in time"
        time.sleep(0.01)


def test_a_motion_that_ends_at_its_goal_succeeds(rig):
    handle = rig.send()
    drive = rig.world.drives["arm"]
    wait_until(lambda: drive.state is DriveState.FOLLOWING)
    rig.world.error = GOAL_TOLERANCE / 2
    drive.state = DriveState.HOLDING
    assert outcome(handle).error_code == Result.SUCCESSFUL
    assert drive.read_points[0].tolist() == [[1.0, 1.0]] and not drive.stops


def test_joints_that_are_not_its_own_are_refused(rig):
    assert not rig.send(joints=("a_joint", "finger")).accepted
    assert rig.world.drives["arm"].state is DriveState.HOLDING


def test_what_the_drive_refuses_is_an_invalid_goal(rig):
    result = outcome(rig.send(value=9.0))
    assert result.error_code == Result.INVALID_GOAL
    assert result.error_string == "beyond its limits"


def test_a_joint_far_behind_stops_the_arm(rig):
    handle = rig.send()
    rig.world.error = PATH_TOLERANCE + 0.01
    result = outcome(handle)
    assert result.error_code == Result.PATH_TOLERANCE_VIOLATED
    assert result.error_string == "arm: a joint is 0.160 behind"
    assert rig.world.drives["arm"].stops == 1


def test_an_end_off_the_goal_is_told_when_it_had_time_to_settle(rig):
    handle = rig.send()
    drive = rig.world.drives["arm"]
    wait_until(lambda: drive.state is DriveState.FOLLOWING)
    rig.world.error = 2 * GOAL_TOLERANCE
    drive.state = DriveState.HOLDING
    future = handle.get_result_async()
    rig.world.now += SECONDS + SETTLE_TIME - 0.01
    with pytest.raises(AssertionError, match="no answer"):
        done(future, 0.3)
    rig.world.now += 0.02
    assert done(future).result.error_code == Result.GOAL_TOLERANCE_VIOLATED


def test_a_cancel_brings_it_to_rest(rig):
    handle = rig.send()
    wait_until(lambda: rig.world.drives["arm"].state is DriveState.FOLLOWING)
    done(handle.cancel_goal_async())
    assert outcome(handle).error_string == "stopped on the way"
    assert rig.world.drives["arm"].stops == 1


def test_a_later_trajectory_takes_the_place_of_the_former(rig):
    first = rig.send()
    wait_until(lambda: rig.world.drives["arm"].state is DriveState.FOLLOWING)
    rig.topic.publish(message(JOINTS, 0.5))
    assert outcome(first).error_string == "another one came"
    drive = rig.world.drives["arm"]
    assert drive.read_points[-1].tolist() == [[0.5, 0.5]]
    assert drive.state is DriveState.FOLLOWING and not drive.stops


def test_jaws_may_be_stopped_by_what_they_hold(rig):
    handle = rig.send("jaws", ("finger",))
    drive = rig.world.drives["jaws"]
    wait_until(lambda: drive.state is DriveState.FOLLOWING)
    rig.world.error = 0.5
    drive.state = DriveState.HOLDING
    assert outcome(handle).error_code == Result.SUCCESSFUL


def test_a_motion_thrown_away_by_a_new_scene_has_failed(rig):
    handle = rig.send()
    wait_until(lambda: rig.world.drives["arm"].state is DriveState.FOLLOWING)
    rig.world.drives = {name: Drive() for name in rig.world.controllers}
    future = handle.get_result_async()
    assert done(future).status == GoalStatus.STATUS_ABORTED
    assert done(future).result.error_code == Result.INVALID_GOAL
    assert done(future).result.error_string == "arm: a new scene came"


def test_a_cancelled_motion_does_not_wait_for_a_drive_that_is_gone(rig):
    handle = rig.send()
    drive = rig.world.drives["arm"]
    drive.stopped = DriveState.STOPPING
    wait_until(lambda: drive.state is DriveState.FOLLOWING)
    done(handle.cancel_goal_async())
    wait_until(lambda: drive.state is DriveState.STOPPING)
    rig.world.drives = {name: Drive() for name in rig.world.controllers}
    future = handle.get_result_async()
    assert done(future).status == GoalStatus.STATUS_ABORTED
    assert done(future).result.error_string == "arm: a new scene came"


@pytest.mark.parametrize("state", [DriveState.FOLLOWING, DriveState.STOPPING])
def test_no_motion_outlives_the_physics(rig, state):
    handle = rig.send()
    drive = rig.world.drives["arm"]
    drive.stopped = DriveState.STOPPING
    wait_until(lambda: drive.state is DriveState.FOLLOWING)
    if state is DriveState.STOPPING:
        done(handle.cancel_goal_async())
        wait_until(lambda: drive.state is DriveState.STOPPING)
    rig.world.ended = "the simulated world was closed"
    result = outcome(handle)
    assert result.error_code == Result.INVALID_GOAL
    assert result.error_string == "the simulated world was closed"


def test_a_motion_whose_port_is_gone_ends_with_the_world(rig):
    """As after Ctrl-C: the handle of a destroyed port knows of nothing any more."""
    request = SimpleNamespace(trajectory=message(JOINTS, 1.0))
    goal = SimpleNamespace(
        request=request, is_cancel_requested=False, abort=lambda: None
    )
    running = threading.Thread(
        target=rig.ports[0]._on_execute, args=(goal,), daemon=True
    )
    running.start()
    wait_until(lambda: rig.world.drives["arm"].state is DriveState.FOLLOWING)
    rig.world.ended = "the simulated world was closed"
    running.join(10.0)
    assert not running.is_alive()
