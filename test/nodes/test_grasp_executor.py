# SPDX-License-Identifier: Apache-2.0
"""The executor's node over real ROS, without arms: what it refuses, and how."""

import threading

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_msgs.action import ExecuteGrasp  # noqa: E402
from neugrasp_msgs.msg import Grasp, GraspArray  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from neugrasp_ros.fusion.tsdf import empty_volume  # noqa: E402
from neugrasp_ros.geometry.transform import make_transform, translation  # noqa: E402
from neugrasp_ros.manipulation.executor import GraspOutcome, Outcome  # noqa: E402
from neugrasp_ros.nodes.compat.actions import ActionClient  # noqa: E402
from neugrasp_ros.nodes.conversions import (  # noqa: E402
    from_grasp_array,
    to_pose,
    to_stamp,
    to_tsdf,
)
from neugrasp_ros.nodes.executor import PatientExecutor  # noqa: E402
from neugrasp_ros.nodes.grasp_executor import GraspExecutorNode  # noqa: E402
from neugrasp_ros.nodes.markers import LabelledBox, box_markers  # noqa: E402
from neugrasp_ros.nodes.runtime import SpinThread  # noqa: E402
from neugrasp_ros.nodes.scene_view import SceneView  # noqa: E402

pytestmark = [pytest.mark.ros, pytest.mark.filterwarnings("ignore:Gimbal lock")]

DOWN = np.diag([1.0, -1.0, -1.0])
SECOND = 10**9


class Grasping:
    """Stands for the library's executor: notes what it is asked for."""

    def __init__(self) -> None:
        self.asked, self.go = [], threading.Event()
        self.outcome = Outcome(GraspOutcome.GRASPED, "lifted", 0.03)
        self.go.set()

    def execute(self, T, *, width, arms, lift, report):
        self.asked.append((T, width, arms, lift))
        report("plan", 0.25)
        assert self.go.wait(30.0)
        if isinstance(self.outcome, Exception):
            raise self.outcome
        return self.outcome


class Rig:
    def __init__(self) -> None:
        self.executor = PatientExecutor(6)
        self.node = GraspExecutorNode(
            lambda target, source, stamp: translation(0.0, 0.0, 1.0),
            parameter_overrides=[Parameter("fresh_view", value=0.0)],
        )
        self.user = Node("executor_user")
        self.client = ActionClient(self.user, ExecuteGrasp, "execute_grasp")
        for node in (self.node, self.user):
            self.executor.add_node(node)
        self.spinning = SpinThread(self.executor)

    def send(self, array, feedback=None, **fields):
        assert self.client.wait_for_server(timeout_sec=30.0)
        goal = ExecuteGrasp.Goal(grasp=array, **fields)
        return done(self.client.send_goal_async(goal, feedback_callback=feedback))

    def call(self, name):
        client = self.user.create_client(Trigger, f"grasp_executor/{name}")
        assert client.wait_for_service(timeout_sec=30.0)
        return done(client.call_async(Trigger.Request()))

    def close(self) -> None:
        self.spinning.stop()
        self.client.destroy()
        self.node.destroy_node()
        self.user.destroy_node()


@pytest.fixture(scope="module")
def rig(ros):
    rig = Rig()
    yield rig
    rig.close()


@pytest.fixture
def grasping(rig, monkeypatch):
    stand_in = Grasping()
    monkeypatch.setattr(rig.node, "_grasping", stand_in)
    return stand_in


def done(future, seconds=30.0):
    over = threading.Event()
    future.add_done_callback(lambda _: over.set())
    assert over.wait(seconds), "no answer in time"
    return future.result()


def result(handle):
    return done(handle.get_result_async()).result


def one_grasp(**fields) -> GraspArray:
    pose = to_pose(make_transform(DOWN, np.array([0.5, 0.1, -0.2])))
    array = GraspArray(axes=GraspArray.AXES_Z_APPROACH_Y_CLOSING)
    array.header.frame_id = "camera"
    array.grasps = [Grasp(id="g", pose=pose, **({"width": 0.04} | fields))]
    return array


def test_a_grasp_goes_to_the_arms_in_the_base_frame_with_open_jaws(rig, grasping):
    stages = []
    handle = rig.send(one_grasp(), lambda m: stages.append(m.feedback.stage), lift=True)
    answer = result(handle)
    assert (answer.outcome, answer.message) == (GraspOutcome.GRASPED, "lifted")
    assert answer.final_width == pytest.approx(0.03)
    ((T, width, arms, lift),) = grasping.asked
    assert T == pytest.approx(make_transform(DOWN, np.array([0.5, 0.1, 0.8])))
    assert width == pytest.approx(0.085, abs=1e-3) and lift
    assert arms == ("arm_left_torso", "arm_right_torso")


def test_the_arm_that_a_grasp_was_checked_for_is_the_one_that_goes(rig, grasping):
    reached = one_grasp(
        reachability=Grasp.REACH_OK, arm="arm_right_torso", manipulability=0.5
    )
    result(rig.send(reached))
    assert grasping.asked[0][2] == ("arm_right_torso",)


def test_an_array_without_grasps_is_refused(rig, grasping):
    empty = one_grasp()
    empty.grasps = []
    answer = result(rig.send(empty))
    assert answer.outcome == GraspOutcome.ABORTED
    assert "holds no grasp" in answer.message and not grasping.asked


def test_a_second_goal_is_rejected_while_one_is_carried_out(rig, grasping):
    grasping.go.clear()
    first = rig.send(one_grasp())
    assert not rig.send(one_grasp()).accepted
    refused = rig.call("home")
    assert not refused.success and "another motion" in refused.message
    grasping.go.set()
    assert result(first).outcome == GraspOutcome.GRASPED
    assert result(rig.send(one_grasp())).outcome == GraspOutcome.GRASPED


def test_a_bug_is_an_outcome_and_the_node_lives_on(rig, grasping):
    grasping.outcome = ZeroDivisionError("a bug")
    answer = result(rig.send(one_grasp()))
    assert answer.outcome == GraspOutcome.ABORTED
    assert answer.message.startswith("INTERNAL: grasp_executor: ZeroDivisionError")
    grasping.outcome = Outcome(GraspOutcome.MISSED, "nothing")
    assert result(rig.send(one_grasp())).outcome == GraspOutcome.MISSED


def test_with_empty_hands_there_is_nothing_to_drop(rig):
    answer = rig.call("drop")
    assert not answer.success and "no hand holds anything" in answer.message


def test_nothing_moves_where_nobody_tells_the_joints(rig, monkeypatch):
    monkeypatch.setattr("neugrasp_ros.nodes.arm_hardware.STATE_TIME", 0.2)
    answer = result(rig.send(one_grasp()))
    assert answer.outcome == GraspOutcome.ABORTED
    assert "no joint_states" in answer.message


def scene(revision, stamp):
    return SceneView(
        volume=empty_volume((4, 4, 4), 0.3, 4.0),
        T_frame_task=np.eye(4),
        frame_id="camera",
        stamp=stamp,
        revision=revision,
        seconds=0.0,
    )


def test_the_scene_of_a_grasp_is_found_by_number_or_by_time(rig):
    for revision, stamp in ((5, 10 * SECOND), (6, 20 * SECOND)):
        rig.node._on_tsdf(to_tsdf(scene(revision, stamp)))
    array = one_grasp()
    array.scene_revision = 5
    assert rig.node._scene_of(from_grasp_array(array)).revision == 5
    array.scene_revision = 0
    for stamp, revision in ((15, 5), (25, 6)):
        array.header.stamp = to_stamp(stamp * SECOND)
        assert rig.node._scene_of(from_grasp_array(array)).revision == revision
    array.header.stamp = to_stamp(5 * SECOND)
    assert rig.node._scene_of(from_grasp_array(array)) is None


def test_boxes_that_are_told_are_around_the_robot(rig):
    table = LabelledBox("table", translation(0.6, 0, 0), np.array([0.6, 0.8, 0.03]))
    rig.node._boxes.remember(box_markers([table], "camera", to_stamp(0)))
    (box,) = rig.node._hardware.surroundings().boxes
    assert box.T_base_box == pytest.approx(translation(0.6, 0.0, 1.0))
