# SPDX-License-Identifier: Apache-2.0
"""The whole robot over real ROS: simulator, suite and executor in one process."""

import threading
import time

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

import rclpy  # noqa: E402
from builtin_interfaces.msg import Duration  # noqa: E402
from neugrasp_msgs.action import ExecuteGrasp  # noqa: E402
from neugrasp_msgs.msg import DetectionReport, Grasp, GraspArray  # noqa: E402
from neugrasp_msgs.srv import DetectGrasps, SpawnScene  # noqa: E402
from rclpy.context import Context  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from neugrasp_ros.geometry.transform import make_transform  # noqa: E402
from neugrasp_ros.manipulation.executor import GraspOutcome  # noqa: E402
from neugrasp_ros.model import default_weights  # noqa: E402
from neugrasp_ros.nodes.compat.actions import ActionClient  # noqa: E402
from neugrasp_ros.nodes.composed import Suite  # noqa: E402
from neugrasp_ros.nodes.conversions import to_pose  # noqa: E402
from neugrasp_ros.nodes.executor import PatientExecutor  # noqa: E402
from neugrasp_ros.nodes.grasp_executor import GraspExecutorNode  # noqa: E402
from neugrasp_ros.nodes.runtime import SpinThread, prepare  # noqa: E402
from neugrasp_ros.robot.model import load_robot  # noqa: E402
from sim_bridge.robot_bridge_node import RobotBridgeNode  # noqa: E402

pytestmark = [
    pytest.mark.ros,
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore:Gimbal lock"),
    pytest.mark.skipif(not default_weights().is_file(), reason="needs the weights"),
]

BASE = "base_footprint"
DOWN = np.diag([1.0, -1.0, -1.0])
HEAD = "/head_front_camera/depth_registered"
REMAPS = [
    "-r", f"depth/image:={HEAD}/image_raw",
    "-r", f"depth/camera_info:={HEAD}/camera_info",
]  # fmt: skip
LONG = 300.0  # [s]; a busy machine simulates slowly
SIMULATED = {
    "realtime_factor": 4.0, "clock_rate": 10.0, "camera.rate": 2.0,
    "camera.width": 320, "camera.height": 240,
    "kind": "table:packed", "seed": 5, "count": 2,
}  # fmt: skip
QUIET = {"streaming": False, "max_depth_age": 0.0, "use_sim_time": True}
PATIENT = {"fresh_view": 60.0, "mover.timeout": 30.0, "use_sim_time": True}
CANDIDATES = 64  # enough for two objects


class User(Node):
    def __init__(self, context: Context) -> None:
        super().__init__("user", context=context)
        self.execute = ActionClient(self, ExecuteGrasp, "execute_grasp")
        self.stages: list[str] = []

    def call(self, kind, name, /, **fields):
        client = self.create_client(kind, name)
        assert client.wait_for_service(timeout_sec=30.0)
        return done(client.call_async(kind.Request(**fields)))

    def send(self, grasps: GraspArray):
        self.stages = stages = []  # a goal before may still tell of its own
        goal = ExecuteGrasp.Goal(grasp=grasps)
        assert self.execute.wait_for_server(timeout_sec=30.0)
        return done(
            self.execute.send_goal_async(
                goal, feedback_callback=lambda m: stages.append(m.feedback.stage)
            )
        )


def done(future, seconds: float = LONG):
    over = threading.Event()
    future.add_done_callback(lambda _: over.set())
    assert over.wait(seconds), "no answer in time"
    return future.result()


def wait_for(condition, seconds: float = LONG):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "the condition did not come true in time"
        time.sleep(0.02)


class Cell:
    """Everything that spins, and the user."""

    def __init__(self, context: Context) -> None:
        robot = PatientExecutor(12, context=context)  # its own, as on a robot
        others = PatientExecutor(12, context=context)
        self.bridge = RobotBridgeNode(**options(SIMULATED), context=context)
        robot.add_node(self.bridge)
        self.suite = Suite(
            others,
            **options(QUIET),
            cli_args=["--ros-args", *REMAPS],
            context=context,
        )
        self.arms = GraspExecutorNode(**options(PATIENT), context=context)
        self.user = User(context)
        for node in (self.arms, self.user):
            others.add_node(node)
        self.spinning = [SpinThread(robot), SpinThread(others)]
        self.suite.load()
        self.home = load_robot("tiago_dual").home

    @property
    def world(self):
        return self.bridge.world

    def close(self) -> None:
        for spinning in self.spinning:
            spinning.stop()
        self.suite.close()
        for node in (self.arms, self.bridge, self.user):
            node.destroy_node()

    def spawn(self, seed: int = 5, count: int = 2) -> None:
        answer = self.user.call(
            SpawnScene, "sim_bridge/spawn_scene",
            kind="table:packed", seed=seed, objects=count,
        )  # fmt: skip
        assert answer.success, answer.message
        self.let_clocks_pass()

    def let_clocks_pass(self) -> None:
        """Wait until no node takes an image from before for a later one."""
        now = self.world.snapshot.time
        for node in (self.suite.nodes[1], self.arms):
            wait_for(lambda n=node: n.get_clock().now().nanoseconds > now)

    def detect(self) -> DetectGrasps.Response:
        return self.user.call(
            DetectGrasps, "detect_grasps",
            seed=1, scene=DetectGrasps.Request.SCENE_FRESH,
            max_candidates=CANDIDATES, timeout=Duration(sec=int(LONG)),
        )  # fmt: skip

    def arm_offset(self) -> float:
        names = self.world.setup.joint_names
        rows = [k for k, name in enumerate(names) if name.startswith("arm_")]
        q = self.world.snapshot.robot.q
        return float(np.abs(q - self.home)[rows].max())


@pytest.fixture(scope="module")
def cell(domain):
    prepare()
    context = Context()  # other tests have the default one
    rclpy.init(args=[], context=context)
    cell = Cell(context)
    yield cell
    cell.close()
    context.try_shutdown()


def options(values: dict) -> dict:
    return {"parameter_overrides": [Parameter(k, value=v) for k, v in values.items()]}


def one_grasp(x, y, z) -> GraspArray:
    pose = to_pose(make_transform(DOWN, np.array([x, y, z])))
    array = GraspArray(axes=GraspArray.AXES_Z_APPROACH_Y_CLOSING)
    array.header.frame_id = BASE
    array.grasps = [Grasp(id="g", pose=pose, width=0.08)]
    return array


def test_spawn_detect_and_execute_one_grasp_and_drop_it(cell):
    cell.spawn()
    answer = cell.detect()
    assert answer.success, answer.report.message
    handle = cell.user.send(answer.grasps)
    stages = cell.user.stages
    second = cell.user.send(answer.grasps)
    assert handle.accepted and not second.accepted
    result = done(handle.get_result_async()).result
    assert result.outcome == GraspOutcome.GRASPED, result.message
    assert stages[0] == "plan" and "lift" in stages
    assert result.final_width > 0.002
    heights = cell.world.snapshot.poses[:, 2, 3]
    assert heights.max() > heights.min() + 0.05
    dropped = cell.user.call(Trigger, "grasp_executor/drop")
    assert dropped.success, dropped.message
    assert cell.arm_offset() < 0.05
    use = cell.world.limit_use
    assert use.position < 1e-6 and max(use[1:4]) <= 1.0


def test_an_object_that_moved_since_the_detection_is_stale_or_missed(cell):
    cell.spawn(count=1)  # nothing else can take its place
    answer = cell.detect()
    assert answer.success, answer.report.message

    def push() -> None:
        world = cell.world._world
        for body in world.object_ids:
            T = world.pose(body)
            T[:2, 3] += 0.06
            world.set_pose(body, T)

    cell.world.do(push).result()
    cell.let_clocks_pass()
    handle = cell.user.send(answer.grasps)
    result = done(handle.get_result_async()).result
    assert result.outcome in (GraspOutcome.STALE, GraspOutcome.MISSED), result.message
    assert cell.arm_offset() < 0.05


def test_an_unreachable_target_is_refused_with_its_reason_and_nothing_moves(cell):
    cell.spawn()
    handle = cell.user.send(one_grasp(1.6, 0.0, 0.9))
    result = done(handle.get_result_async()).result
    assert result.outcome == GraspOutcome.UNREACHABLE
    assert "no arm posture" in result.message
    assert cell.world.limit_use.samples == 0


def test_a_cancel_in_mid_motion_stops_the_arm_within_its_limits(cell):
    cell.spawn(count=0)
    handle = cell.user.send(one_grasp(0.55, 0.1, 0.80))
    wait_for(lambda: np.abs(cell.world.snapshot.robot.velocities).max() > 0.3)
    done(handle.cancel_goal_async())
    result = done(handle.get_result_async()).result
    assert result.outcome == GraspOutcome.CANCELED, result.message
    stopped = cell.world.snapshot.time
    wait_for(lambda: cell.world.snapshot.time > stopped + 3e8)
    assert np.abs(cell.world.snapshot.robot.velocities).max() < 0.05
    assert cell.arm_offset() > 0.05  # on the way, not at its end
    use = cell.world.limit_use
    assert use.position < 1e-6 and max(use[1:4]) <= 1.0
    answer = cell.user.call(Trigger, "grasp_executor/home")
    assert answer.success, answer.message
    assert cell.arm_offset() < 0.05


def test_nothing_to_grasp_is_said(cell):
    cell.spawn(count=0)
    assert cell.detect().report.code == DetectionReport.EMPTY_WORKSPACE
