# SPDX-License-Identifier: Apache-2.0
"""Both packages as pip and colcon see them; a real colcon build is not run here."""

import ast
import importlib.metadata
import os
import subprocess
import sys
from configparser import ConfigParser
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

import neugrasp_ros

ROOT = Path(__file__).resolve().parents[2]
MANIFEST = ElementTree.parse(ROOT / "package.xml").getroot()
MESSAGES = ElementTree.parse(ROOT / "msg_defs" / "package.xml").getroot()
SCRIPTS = {
    "neugrasp",
    "tsdf_fusion",
    "scene_renderer",
    "grasp_evaluator",
    "reachability_filter",
    "grasp_server",
    "grasp_executor",
    "grasp_suite",
    "sim_bridge",
}
ROS_SUFFIXES = ("_msgs", "_srvs", "_interfaces")
ROS_PACKAGES = ("rclpy", "tf2_ros", "launch", "launch_ros", "ament_index_python")


def scripts() -> dict[str, importlib.metadata.EntryPoint]:
    points = importlib.metadata.distribution("neugrasp_ros").entry_points
    return {p.name: p for p in points if p.group == "console_scripts"}


def imported_ros_packages() -> set[str]:
    """Return the ROS packages that our files import, at any depth."""
    names = set()
    for folder in ("neugrasp_ros", "sim_bridge"):
        for path in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.ImportFrom) and node.module:
                    names.add(node.module.split(".")[0])
                elif isinstance(node, ast.Import):
                    names.update(alias.name.split(".")[0] for alias in node.names)
    return {n for n in names if n.endswith(ROS_SUFFIXES) or n in ROS_PACKAGES}


def test_all_places_tell_one_version():
    version = MANIFEST.findtext("version")
    assert neugrasp_ros.__version__ == version
    assert importlib.metadata.version("neugrasp_ros") == version
    assert importlib.metadata.version("neugrasp_msgs") == MESSAGES.findtext("version")


@pytest.mark.parametrize(
    ("manifest", "name", "build_type"),
    [
        (MANIFEST, "neugrasp_ros", "ament_python"),
        (MESSAGES, "neugrasp_msgs", "ament_cmake"),
    ],
)
def test_manifest_is_what_colcon_needs(manifest, name, build_type):
    assert manifest.get("format") == "3"
    assert manifest.findtext("name") == name
    assert manifest.findtext("export/build_type") == build_type
    assert manifest.findtext("license") == "Apache-2.0"


def test_messages_are_a_group_of_interfaces():
    assert MESSAGES.findtext("member_of_group") == "rosidl_interface_packages"


def test_manifest_names_every_ros_package_that_is_imported():
    declared = {e.text for e in MANIFEST if e.tag in ("depend", "exec_depend")}
    assert imported_ros_packages() <= declared


def test_colcon_is_told_where_both_packages_are():
    defaults = yaml.safe_load((ROOT / "colcon_defaults.yaml").read_text())
    assert defaults["build"]["base-paths"] == [".", "msg_defs"]


def test_ros2_run_finds_the_executables():
    settings = ConfigParser()
    settings.read(ROOT / "setup.cfg")
    assert settings["develop"]["script_dir"] == "$base/lib/neugrasp_ros"
    assert settings["install"]["install_scripts"] == "$base/lib/neugrasp_ros"


def test_every_folder_of_code_is_a_package():
    """setuptools and import-linter pass over a folder without `__init__.py`."""
    folders = {
        path.parent
        for name in ("neugrasp_ros", "sim_bridge")
        for path in (ROOT / name).rglob("*.py")
        if path.parent.name != "launch"
    }
    assert [f for f in sorted(folders) if not (f / "__init__.py").is_file()] == []


def test_the_console_scripts_are_those_promised():
    assert SCRIPTS <= set(scripts())


@pytest.mark.ros
@pytest.mark.parametrize("name", sorted(scripts()))
def test_console_script_imports(name):
    assert callable(scripts()[name].load())


def test_a_build_shares_what_ros_looks_for(tmp_path):
    """What `colcon build` does for ament_python, with setuptools alone."""
    base, prefix = tmp_path / "build", tmp_path / "install"
    command = [sys.executable, "setup.py", "-q", "egg_info", "--egg-base", tmp_path]
    command += ["build", "--build-base", base, "install", "--prefix", prefix]
    command += ["--record", tmp_path / "log", "--single-version-externally-managed"]
    done = subprocess.run(
        [str(part) for part in command],
        cwd=ROOT,
        env={**os.environ, "PYTHONWARNINGS": "ignore"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    index = prefix / "share/ament_index/resource_index/packages/neugrasp_ros"
    share = prefix / "share/neugrasp_ros"
    assert index.is_file()
    assert (share / "package.xml").is_file()
    for path in (ROOT / "config").rglob("*.*"):
        assert (share / path.relative_to(ROOT)).is_file()
    made = {p.name for p in (prefix / "lib/neugrasp_ros").iterdir()}
    assert SCRIPTS <= made


@pytest.mark.parametrize("path", sorted((ROOT / "config").rglob("*.*")), ids=str)
def test_config_file_loads(path):
    if path.suffix == ".xml":
        ElementTree.parse(path)
    else:
        assert isinstance(yaml.safe_load(path.read_text()), dict)
