# SPDX-License-Identifier: Apache-2.0
import ast
import importlib.metadata
import importlib.util
from pathlib import Path

import yaml

import neugrasp_ros
from neugrasp_ros.nodes.table import (
    COMPOSED,
    DEPTH_TOPICS,
    EXECUTOR,
    PARAMETERS,
    PROCESSING,
    SIMULATOR,
    clock_users,
    remappings,
    ros_arguments,
    suite,
)
from neugrasp_ros.resources import parameter_file

FUSION = PROCESSING[0]


def test_one_process_for_all_or_one_for_each_and_the_simulator_always_alone():
    assert suite(sim=False, separate=False) == (COMPOSED,)
    assert suite(sim=True, separate=False) == (SIMULATOR, COMPOSED)
    assert suite(sim=True, separate=True) == (SIMULATOR, *PROCESSING)


def test_every_process_has_its_module_and_its_executable():
    points = importlib.metadata.distribution("neugrasp_ros").entry_points
    scripts = {p.name: p.value for p in points if p.group == "console_scripts"}
    for spec in (SIMULATOR, COMPOSED, EXECUTOR, *PROCESSING):
        assert importlib.util.find_spec(spec.module), spec
        assert scripts[spec.name] == f"{spec.module}:main"


def test_only_those_who_compare_stamps_follow_the_clock():
    assert clock_users(COMPOSED) == ("tsdf_fusion", "grasp_server")
    assert clock_users(EXECUTOR) == ("grasp_executor",)
    assert clock_users(SIMULATOR) == ()
    line = ros_arguments(COMPOSED, sim=True)
    assert "tsdf_fusion:use_sim_time:=true" in line
    assert not any("scene_renderer" in word for word in line)


def test_depth_comes_from_the_robots_camera_and_tf_follows_the_namespace():
    assert remappings(FUSION)["depth/image"].startswith("head_front_camera/")
    assert "/tf" not in remappings(FUSION)
    assert remappings(FUSION, "/tiago_1")["/tf"] == "tf"
    line = ros_arguments(FUSION, namespace="tiago_1", remaps=["depth/image:=/other"])
    assert "__ns:=/tiago_1" in line
    first = [word for word in line if word.startswith("depth/image:=")][0]
    assert first == "depth/image:=/other"  # rcl takes the first rule that matches


def test_whoever_listens_to_the_camera_gets_its_topics():
    for spec in PROCESSING:
        source = Path(importlib.util.find_spec(spec.module).origin).read_text()
        words = ros_arguments(spec)
        for topic, robots in DEPTH_TOPICS.items():
            if f'"{topic}"' in source:
                assert f"{topic}:={robots}" in words, spec.name
        assert spec.reads_depth == ('"depth/' in source), spec.name


def test_the_shipped_parameters_name_nodes_and_parameters_that_exist():
    from neugrasp_ros.nodes import settings

    content = yaml.safe_load(Path(parameter_file(PARAMETERS)).read_text())
    names = {spec.name for spec in (SIMULATOR, *PROCESSING)}
    assert {key.removeprefix("/**/") for key in content} <= names
    origin = settings.WorkspaceConfig().origin
    for key in ("tsdf_fusion", "sim_bridge"):
        values = content[f"/**/{key}"]["ros__parameters"]["workspace"]
        settings.WorkspaceConfig(**{k: _tuple(v) for k, v in values.items()})
        assert tuple(values["origin"]) == origin


def _tuple(value):
    return tuple(value) if isinstance(value, list) else value


def test_the_launch_file_is_python_and_uses_the_same_table():
    path = Path(neugrasp_ros.__file__).parent / "launch" / "grasp.launch.py"
    tree = ast.parse(path.read_text())
    functions = {n.name for n in tree.body if isinstance(n, ast.FunctionDef)}
    assert "generate_launch_description" in functions
    modules = {n.module for n in tree.body if isinstance(n, ast.ImportFrom)}
    assert "neugrasp_ros.nodes.table" in modules
