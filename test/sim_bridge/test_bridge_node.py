# SPDX-License-Identifier: Apache-2.0
"""The simulated cell over real DDS."""

import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

import rclpy  # noqa: E402
from neugrasp_msgs.msg import Grasp, GraspArray  # noqa: E402
from neugrasp_msgs.srv import SpawnScene, TryGrasp  # noqa: E402
from rclpy.context import Context  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.qos import qos_profile_sensor_data  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from sensor_msgs.msg import CameraInfo, Image, JointState  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402
from visualization_msgs.msg import Marker, MarkerArray  # noqa: E402

from neugrasp_ros.geometry.camera import deproject  # noqa: E402
from neugrasp_ros.geometry.transform import apply, invert  # noqa: E402
from neugrasp_ros.nodes.compat.images import read_depth, read_intrinsics  # noqa: E402
from neugrasp_ros.nodes.compat.tf import Buffer, TransformListener  # noqa: E402
from neugrasp_ros.nodes.conversions import from_pose, from_stamp  # noqa: E402
from neugrasp_ros.nodes.diagnostics import ERROR, OK, WARN  # noqa: E402
from neugrasp_ros.nodes.executor import PatientExecutor  # noqa: E402
from neugrasp_ros.nodes.qos import latched  # noqa: E402
from neugrasp_ros.nodes.runtime import SpinThread, prepare  # noqa: E402
from neugrasp_ros.nodes.settings import WorkspaceConfig  # noqa: E402
from neugrasp_ros.nodes.transforms import Transforms  # noqa: E402
from sim_bridge.bridge_node import SimBridgeNode  # noqa: E402

pytestmark = [
    pytest.mark.ros,
    pytest.mark.filterwarnings("ignore:Gimbal lock"),
]

HEAD = "head_front_camera/depth_registered"
OPTICAL = "head_front_camera_rgb_optical_frame"
ORIGIN = np.array(WorkspaceConfig().origin)
TABLE_Z = ORIGIN[2] + 0.05


class Listener(Node):
    def __init__(self, context: Context) -> None:
        super().__init__("listener", context=context)
        self.heard: dict[str, list] = {}
        for kind, topic, qos in (
            (Image, f"{HEAD}/image_raw", qos_profile_sensor_data),
            (CameraInfo, f"{HEAD}/camera_info", qos_profile_sensor_data),
            (Clock, "/clock", qos_profile_sensor_data),
            (JointState, "joint_states", 10),
            (MarkerArray, "sim_bridge/objects", latched()),
            (GraspArray, "grasps/executed", 10),
        ):
            self.heard[topic] = []
            self.create_subscription(kind, topic, self.heard[topic].append, qos)
        buffer = Buffer()
        self._tf = TransformListener(buffer, self)
        self.transforms = Transforms(buffer)

    def call(self, kind, name, /, **fields):
        client = self.create_client(kind, name)
        assert client.wait_for_service(timeout_sec=20.0)
        done = threading.Event()
        future = client.call_async(kind.Request(**fields))
        future.add_done_callback(lambda _: done.set())
        assert done.wait(60.0), f"no answer from {name}"
        return future.result()


@pytest.fixture(scope="module")
def cell(domain):
    prepare()
    context = Context()  # other tests have the default one
    rclpy.init(args=[], context=context)
    options = {
        "realtime_factor": 0.0, "camera.rate": 2.0, "seed": 3, "count": 2,
        "kind": "packed", "camera.width": 320, "camera.height": 240,
    }  # fmt: skip
    overrides = [Parameter(k, value=v) for k, v in options.items()]
    bridge, listener = (
        SimBridgeNode(parameter_overrides=overrides, context=context),
        Listener(context),
    )
    executor = PatientExecutor(6, context=context)
    for node in (bridge, listener):
        executor.add_node(node)
    spinning = SpinThread(executor)
    yield listener
    spinning.stop()
    bridge.destroy_node()
    listener.destroy_node()
    context.try_shutdown()


def wait_for(condition, seconds: float = 20.0):
    deadline = time.monotonic() + seconds
    while (value := condition()) is None or not np.any(value):
        assert time.monotonic() < deadline, "the condition did not come true in time"
        time.sleep(0.01)
    return value


def next_image(cell) -> Image:
    """Wait for an image of what there is now; two on their way may be older."""
    heard = cell.heard[f"{HEAD}/image_raw"]
    count = len(heard)
    wait_for(lambda: len(heard) > count + 2)
    return heard[-1]


def seen_points(cell) -> np.ndarray:
    """Return what the camera measures, in base_footprint."""
    image = next_image(cell)
    info = wait_for(lambda: cell.heard[f"{HEAD}/camera_info"])[-1]
    points = deproject(read_depth(image), read_intrinsics(info)).reshape(-1, 3)
    T = wait_for(lambda: _look(cell, "base_footprint", image.header.frame_id))
    return apply(T, points[np.isfinite(points).all(axis=1)])


def _look(cell, target, source):
    from neugrasp_ros.nodes.outcomes import DetectionError

    try:
        return cell.transforms(target, source, 0)
    except DetectionError:
        return None


def objects(cell, count: int) -> list[Marker]:
    heard = cell.heard["sim_bridge/objects"]

    def boxes():
        return [m for m in heard[-1].markers if m.action == Marker.ADD]

    wait_for(lambda: heard and len(boxes()) == count)
    return boxes()


def test_the_depth_of_the_table_is_where_tf_says(cell):
    assert cell.call(SpawnScene, "sim_bridge/spawn_scene", kind="empty").success
    points = seen_points(cell)
    inside = (np.abs(points[:, :2] - (ORIGIN[:2] + 0.15)) < 0.15).all(axis=1)
    assert inside.sum() > 1000
    np.testing.assert_allclose(points[inside, 2], TABLE_Z, atol=1e-3)


def test_names_and_frames_are_the_robots(cell):
    image = next_image(cell)
    assert image.header.frame_id == OPTICAL and image.encoding == "32FC1"
    state = wait_for(lambda: cell.heard["joint_states"])[-1]
    assert {"torso_lift_joint", "head_2_joint", "arm_left_7_joint"} <= set(state.name)
    T = _look(cell, "base_footprint", OPTICAL)
    middle = np.append(ORIGIN + [0.15, 0.15, 0.05], 1.0)
    x, y, z, _ = invert(T) @ middle
    assert abs(x / z) < 0.01 and abs(y / z) < 0.01 and 0.4 < z < 0.9
    assert _look(cell, "base_footprint", "gripper_left_tcp") is not None


def test_stamps_and_clock_are_simulated_time_and_rise(cell):
    wait_for(lambda: len(cell.heard["/clock"]) > 5)
    clock = [from_stamp(m.clock) for m in cell.heard["/clock"]]
    assert clock == sorted(clock) and clock[-1] > clock[0]
    stamps = [from_stamp(m.header.stamp) for m in cell.heard[f"{HEAD}/image_raw"]]
    assert stamps == sorted(stamps)
    assert min(np.diff(stamps)) > 0 and np.median(np.diff(stamps)) >= 0.4e9


def test_a_spawned_scene_is_seeded_and_seen(cell):
    first = cell.call(
        SpawnScene, "sim_bridge/spawn_scene", kind="packed", seed=5, objects=3
    )
    assert first.success and len(first.names) > 0
    boxes = objects(cell, len(first.names))
    assert sorted(m.text for m in boxes) == sorted(first.names)
    again = cell.call(Trigger, "sim_bridge/reset_scene")
    assert again.success
    points = seen_points(cell)
    above = points[points[:, 2] > TABLE_Z + 0.015]
    for marker in boxes:
        center = from_pose(marker.pose)[:3, 3]
        assert np.linalg.norm(above[:, :2] - center[:2], axis=1).min() < 0.03


def test_an_unknown_scene_is_refused_with_the_known_ones(cell):
    answer = cell.call(SpawnScene, "sim_bridge/spawn_scene", kind="circus")
    assert not answer.success
    assert "unknown scene kind 'circus'; known: affordance" in answer.message


def straight_down(marker: Marker) -> GraspArray:
    """Return a grasp from above over the narrow side of a box, REP 120 axes."""
    T, size = from_pose(marker.pose), marker.scale
    narrow = int(np.argmin([size.x, size.y]))
    closing = T[:3, narrow] * [1, 1, 0]
    closing /= np.linalg.norm(closing)
    approach = np.array([0.0, 0.0, -1.0])
    rotation = np.stack([approach, closing, np.cross(approach, closing)], axis=1)
    position = T[:3, 3].copy()
    top = position[2] + size.z / 2
    position[2] = max(top - 0.03, TABLE_Z + 0.01)
    from neugrasp_ros.geometry.transform import make_transform
    from neugrasp_ros.nodes.conversions import to_pose

    array = GraspArray(grasps=[Grasp(width=0.085)])
    array.header.frame_id = "base_footprint"
    array.grasps[0].pose = to_pose(make_transform(rotation, position))
    return array


def test_a_lifted_object_is_gone_and_the_execution_is_announced(cell):
    for seed in range(8):
        names = cell.call(
            SpawnScene, "sim_bridge/spawn_scene", kind="packed", seed=seed, objects=1
        ).names
        (marker,) = objects(cell, 1)
        if marker.text != names[0] or min(marker.scale.x, marker.scale.y) > 0.07:
            continue
        executed = len(cell.heard["grasps/executed"])
        answer = cell.call(
            TryGrasp, "sim_bridge/try_grasp", grasp=straight_down(marker)
        )
        wait_for(lambda n=executed: len(cell.heard["grasps/executed"]) > n)
        if answer.success:
            assert answer.lifted and answer.closed_on_object
            assert answer.final_width > 0.005
            objects(cell, 0)
            points = seen_points(cell)
            near = np.linalg.norm(points[:, :2] - from_pose(marker.pose)[:2, 3], axis=1)
            assert points[near < 0.03, 2].max() < TABLE_Z + 0.01
            return
    raise AssertionError("no seed of eight gave an object that could be lifted")


def test_a_grasp_of_air_and_an_empty_one_fail_with_their_reason(cell):
    cell.call(SpawnScene, "sim_bridge/spawn_scene", kind="empty")
    marker = Marker()
    marker.pose.position.x, marker.pose.position.y = (ORIGIN[:2] + 0.15).tolist()
    marker.pose.position.z = float(TABLE_Z + 0.1)
    marker.pose.orientation.w = 1.0
    air = cell.call(TryGrasp, "sim_bridge/try_grasp", grasp=straight_down(marker))
    assert not air.success and not air.closed_on_object and air.message == "empty"
    nothing = cell.call(TryGrasp, "sim_bridge/try_grasp", grasp=GraspArray())
    assert not nothing.success and "holds no grasp" in nothing.message
    lost = straight_down(marker)
    lost.header.frame_id = "mars"
    there = cell.call(TryGrasp, "sim_bridge/try_grasp", grasp=lost)
    assert not there.success and "TF_ERROR: base_footprint <- mars" in there.message


@pytest.mark.parametrize(
    ("factor", "ended", "level", "message"),
    [
        (1.0, "", OK, "in time"),
        (0.5, "", WARN, "slow"),
        (1.0, "the simulated world has ended: x", ERROR, "world has ended: x"),
    ],
)
def test_the_physics_say_whether_they_live(factor, ended, level, message):
    snapshot = SimpleNamespace(time=0, names=())
    world = SimpleNamespace(measured_factor=factor, ended=ended, snapshot=snapshot)
    config = SimpleNamespace(current=SimpleNamespace(realtime_factor=1.0))
    node = SimpleNamespace(world=world, _config=config)
    status = SimBridgeNode._physics_status(node)
    assert status.level == level and message in status.message


class Untouched:
    """A world that must not be asked for anything."""

    def spawn(self, *_):
        raise AssertionError("a scene was built")

    def try_grasp(self, *_):
        raise AssertionError("a grasp was tried")


def untouched_node():
    log = SimpleNamespace(warning=lambda _: None, error=lambda _: None)
    return SimpleNamespace(world=Untouched(), get_logger=lambda: log)


@pytest.mark.parametrize("count", [51, 100_000])
def test_more_objects_than_a_scene_may_have_are_refused(count):
    request = SpawnScene.Request(kind="pile", objects=count)
    response = SimBridgeNode._on_spawn(untouched_node(), request, SpawnScene.Response())
    assert not response.success
    assert f"at most 50 objects, got {count}" in response.message


@pytest.mark.parametrize("height", [np.nan, np.inf, -0.1, 150.0])
def test_a_lift_that_would_take_for_ever_is_refused(height):
    request = TryGrasp.Request(lift_height=height, grasp=GraspArray(grasps=[Grasp()]))
    response = SimBridgeNode._on_try(untouched_node(), request, TryGrasp.Response())
    assert not response.success
    assert "lift_height must be within [0, 1.0] m" in response.message
