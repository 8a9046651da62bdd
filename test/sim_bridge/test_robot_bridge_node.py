# SPDX-License-Identifier: Apache-2.0
"""What the whole robot's bridge tells of itself, and refuses."""

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

import rclpy  # noqa: E402
from neugrasp_msgs.msg import Grasp, GraspArray  # noqa: E402
from neugrasp_msgs.srv import SpawnScene, TryGrasp  # noqa: E402
from rclpy.context import Context  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402

from neugrasp_ros.errors import ConfigError  # noqa: E402
from neugrasp_ros.nodes.runtime import prepare  # noqa: E402
from sim_bridge.furniture import BINS, FURNITURE  # noqa: E402
from sim_bridge.robot_bridge_node import RobotBridgeNode, _told_frames  # noqa: E402

pytestmark = [pytest.mark.ros, pytest.mark.filterwarnings("ignore:Gimbal lock")]

CAMERA = "head_front_camera_rgb_optical_frame"


class Heard:
    """Stands for a publisher: keeps what is published."""

    def __init__(self) -> None:
        self.messages = []

    def publish(self, message) -> None:
        self.messages.append(message)

    sendTransform = publish  # noqa: N815 (tf2's name)


@pytest.fixture(scope="module")
def context(domain):
    prepare()
    context = Context()  # other tests have the default one
    rclpy.init(args=[], context=context)
    yield context
    context.try_shutdown()


@pytest.fixture(scope="module")
def bridge(context):
    options = {"kind": "shelf:packed", "count": 1, "camera.width": 64,
               "camera.height": 48, "camera.rate": 0.5}  # fmt: skip
    overrides = [Parameter(k, value=v) for k, v in options.items()]
    bridge = RobotBridgeNode(parameter_overrides=overrides, context=context)
    yield bridge
    bridge.destroy_node()


@pytest.fixture
def heard(bridge, monkeypatch):
    outputs = {name: Heard() for name in ("_states", "_moving", "_solids", "_bins")}
    for name, output in outputs.items():
        monkeypatch.setattr(bridge, name, output)
    return outputs


def newest(heard):
    """Return the last message; the camera's thread may add some of its own."""
    return heard.messages[-1]


def test_frames_are_told_once_each_the_camera_first(tiago):
    frames = _told_frames(tiago, CAMERA)
    assert frames[0] == CAMERA and len(set(frames)) == len(frames)
    assert {"gripper_left_tcp", "gripper_right_tcp"} <= set(frames)
    assert set(tiago.description.frames) <= set(frames)


def test_joints_and_fingers_are_told_under_the_robots_names(bridge, heard, tiago):
    bridge._publish_joints()
    state = newest(heard["_states"])
    told = dict(zip(state.name, state.position, strict=True))
    robot = bridge.world.snapshot.robot
    assert told["torso_lift_joint"] == pytest.approx(0.25, abs=5e-3)
    assert told["gripper_left_finger_joint"] == pytest.approx(0.0, abs=0.02)
    assert set(tiago.joint_names) <= set(told)
    assert len(state.velocity) == len(state.effort) == len(told)
    assert robot.q.shape == (len(tiago.joint_names),)


def test_moving_frames_are_those_of_the_joints(bridge, heard, tiago):
    bridge._publish_joints()
    poses = {t.child_frame_id: t for t in newest(heard["_moving"])}
    tip = poses["gripper_left_tcp"]
    assert tip.header.frame_id == "base_footprint"
    expected = tiago.frame_pose(bridge.world.snapshot.robot.q, "gripper_left_tcp")
    place = tip.transform.translation
    assert [place.x, place.y, place.z] == pytest.approx(expected[:3, 3], abs=2e-3)
    assert "sim_task" in poses and CAMERA in poses


def test_solid_things_are_the_furniture_and_closed_bins(bridge, heard):
    response = bridge._on_spawn(
        SpawnScene.Request(kind="cupboard:pile", seed=1, objects=0),
        SpawnScene.Response(),
    )
    assert response.success, response.message
    solids = [m for m in newest(heard["_solids"]).markers if m.scale.x]
    top = solids[0]
    assert top.pose.position.z + top.scale.z / 2 == pytest.approx(
        FURNITURE["cupboard"].support_height
    )
    bins = [m for m in newest(heard["_bins"]).markers if m.scale.x]
    assert [m.text for m in bins] == list(BINS)
    for marker, bin_ in zip(bins, BINS.values(), strict=True):
        rim = marker.pose.position.z + marker.scale.z / 2
        assert rim == pytest.approx(bin_.center[2])
    assert len(solids) == 2 + len(BINS), "top, body, and the bins as one box each"


def test_an_unknown_furniture_is_refused_and_the_scene_stays(bridge, heard):
    names = bridge.world.snapshot.names
    response = bridge._on_spawn(
        SpawnScene.Request(kind="sofa:pile", seed=1, objects=2), SpawnScene.Response()
    )
    assert not response.success and "sofa" in response.message
    assert bridge.world.snapshot.names == names


@pytest.mark.parametrize("grasps", [[], [Grasp()]])
def test_a_grasp_to_try_is_sent_to_the_executor(bridge, grasps):
    request = TryGrasp.Request(grasp=GraspArray(grasps=grasps))
    request.grasp.header.frame_id = "base_footprint"
    response = bridge._on_try(request, TryGrasp.Response())
    assert not response.success and not response.lifted
    assert "send the grasp to the action execute_grasp" in response.message


def test_the_hardest_contact_is_in_the_diagnostics(bridge):
    values = bridge._physics_status().values
    assert float(values["largest_contact_n"]) == 0.0
    assert values["largest_contact_link"] == ""


def test_a_workspace_of_another_frame_is_refused(context):
    other = [Parameter("workspace.frame", value="map")]
    with pytest.raises(ConfigError, match="must be 'base_footprint', got 'map'"):
        RobotBridgeNode(parameter_overrides=other, context=context)


def test_pictures_of_the_head_are_as_large_as_asked(bridge):
    depth = bridge._camera.depth(bridge.world.snapshot)
    assert depth.shape == (48, 64) and np.isfinite(depth).any()
