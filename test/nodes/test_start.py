# SPDX-License-Identifier: Apache-2.0
"""What a node says when it cannot start, and time that jumps back."""

import os
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from nodes.standin import make_side_checker, make_standin  # noqa: E402
from nodes.synthetic import Scene, camera_info, depth_image  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402

from neugrasp_ros.config import PlannerConfig  # noqa: E402
from neugrasp_ros.errors import (  # noqa: E402
    CheckpointError,
    ConfigError,
    RobotModelError,
    UnknownNameError,
)
from neugrasp_ros.nodes.conversions import to_stamp  # noqa: E402
from neugrasp_ros.nodes.grasp_server import GraspServerNode  # noqa: E402
from neugrasp_ros.nodes.outcomes import DetectionError  # noqa: E402
from neugrasp_ros.nodes.planners import OnePlanner, box_volume, load_planner  # noqa: E402
from neugrasp_ros.nodes.reach_stage import load_checker  # noqa: E402
from neugrasp_ros.nodes.reachability_filter import ReachabilityFilterNode  # noqa: E402
from neugrasp_ros.nodes.settings import ReachConfig, WorkspaceConfig  # noqa: E402
from neugrasp_ros.nodes.tsdf_fusion import TsdfFusionNode  # noqa: E402

pytestmark = pytest.mark.ros

SECOND = 10**9


def run_main(module: str, *parameters: str) -> subprocess.CompletedProcess[str]:
    arguments = [word for p in parameters for word in ("-p", p)]
    code = f"import sys; from {module} import main; sys.exit(main())"
    return subprocess.run(
        [sys.executable, "-c", code, "--ros-args", *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )


def test_missing_weights_end_the_suite_with_a_sentence(ros):
    ended = run_main(
        "neugrasp_ros.nodes.composed",
        "scene_renderer:weights:=/nowhere/w.safetensors",
        "grasp_evaluator:weights:=/nowhere/w.safetensors",
    )
    said = ended.stdout + ended.stderr
    assert ended.returncode == 1, said
    assert "cannot start: /nowhere/w.safetensors: no such weights file" in said
    assert "neugrasp train" in said and "Traceback" not in said


def test_an_absurd_parameter_ends_the_node_with_a_sentence(ros):
    ended = run_main("neugrasp_ros.nodes.tsdf_fusion", "max_depth:=0.1")
    said = ended.stdout + ended.stderr
    assert ended.returncode == 1, said
    assert "cannot start: max_depth must be above min_depth" in said


def test_a_damaged_weights_file_is_refused(tmp_path):
    path = tmp_path / "w.safetensors"
    path.write_bytes(b"\x10" + bytes(100))
    with pytest.raises(CheckpointError, match="not a whole safetensors file"):
        load_planner(PlannerConfig(weights=str(path)))


def test_the_suite_imports_torch_before_any_callback_runs():
    code = (
        "import sys; from neugrasp_ros.nodes import composed; "
        "composed.run = lambda *_, **__: 'torch' in sys.modules; "
        "sys.exit(0 if composed.main([]) else 3)"
    )
    assert subprocess.run([sys.executable, "-c", code], timeout=120).returncode == 0


def test_the_planner_of_an_unknown_gripper_names_the_known_ones():
    with pytest.raises(UnknownNameError, match="'tweezers'; known: panda, robotiq"):
        load_planner(PlannerConfig(gripper="tweezers"))


def test_an_unknown_gripper_names_the_known_ones(ros):
    values = [Parameter("gripper", value="tweezers")]
    with pytest.raises(UnknownNameError, match="'tweezers'; known: panda, robotiq"):
        ReachabilityFilterNode(make_side_checker, parameter_overrides=values)


def test_unknown_robots_and_arms_are_refused():
    with pytest.raises(UnknownNameError, match="unknown robot 'r2d2'"):
        load_checker(ReachConfig(robot="r2d2"))
    with pytest.raises(RobotModelError, match="arm_middle"):
        load_checker(ReachConfig(arms=("arm_middle",)))


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("workspace.size", [9.0, 0.3, 0.3], "workspace.size must be in"),
        ("workspace.origin", [400.0, 0.0, 0.0], "workspace.origin must be within"),
        ("workspace.rpy", [0.0, 0.0, 90.0], r"workspace.rpy is in \[rad\]"),
        ("workspace.frame", "", "workspace.frame must not be empty"),
        ("view_mode", "oldest", "view_mode must be one of latest, fuse"),
        ("max_rate", -1.0, "max_rate must be in"),
    ],
)
def test_absurd_parameters_of_the_fusion_are_refused(ros, name, value, sentence):
    with pytest.raises(ConfigError, match=sentence):
        TsdfFusionNode(parameter_overrides=[Parameter(name, value=value)])


def test_absurd_parameters_of_the_server_are_refused(ros):
    for name, value in (("max_grasps", 0), ("goal_policy", "shrug"), ("timeout", 1e9)):
        with pytest.raises(ConfigError, match=name):
            GraspServerNode(parameter_overrides=[Parameter(name, value=value)])


def test_nodes_of_one_process_must_agree_on_the_planner():
    shared = OnePlanner(make_standin)
    first = shared(PlannerConfig())
    assert shared(PlannerConfig()) is first
    with pytest.raises(ConfigError, match="same parameters"):
        shared(PlannerConfig(gripper="panda"))


def test_the_volume_that_the_planner_is_tried_on_is_a_box_on_a_table():
    volume = box_volume(64)
    assert volume.distances.shape == (64, 64, 64) and volume.view_count == 1
    column = volume.distances[32, 32]  # through the middle of the box
    surface = np.flatnonzero(np.diff(np.sign(np.nan_to_num(column, nan=-1.0))))
    assert surface[-1] * volume.voxel_size == pytest.approx(0.13, abs=0.005)


def test_time_that_jumps_back_clears_scene_and_transforms(spinner, wait_until):
    values = [Parameter("use_sim_time", value=True)]
    node = spinner.add(TsdfFusionNode(parameter_overrides=values))
    talker = spinner.add(Node("clock_talker"))
    clock = talker.create_publisher(Clock, "/clock", 1)
    scene = Scene(WorkspaceConfig())

    def is_at(seconds: float) -> bool:
        clock.publish(Clock(clock=to_stamp(int(seconds * SECOND))))
        return abs(node.get_clock().now().nanoseconds - seconds * SECOND) < 1e6

    wait_until(lambda: is_at(100.0))
    from neugrasp_ros.nodes.compat.tf_buffer import to_transform

    camera = to_transform(scene.T_base_camera, "base_footprint", "camera_optical", 0)
    node.buffer.set_transform_static(camera, "")
    moving = to_transform(scene.T_base_camera, "base_footprint", "arm", 100 * SECOND)
    node.buffer.set_transform(moving, "")
    node.fusion.on_camera_info(camera_info())
    node.fusion.on_depth(depth_image(scene.depth(), 100 * SECOND))
    before = node.fusion.view().revision
    wait_until(lambda: is_at(3.0))
    wait_until(lambda: node.fusion.revision > before)
    with pytest.raises(DetectionError, match="no depth/image since"):
        node.fusion.view()
    assert "arm" not in node.buffer.all_frames()
    node.fusion.on_depth(depth_image(scene.depth(), 3 * SECOND))
    assert node.fusion.view().revision > before
