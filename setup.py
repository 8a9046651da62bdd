# SPDX-License-Identifier: Apache-2.0
"""What the package is, for pip and for colcon (ament_python) alike."""

from collections import defaultdict
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

NAME = "neugrasp_ros"
SHARE = Path("share") / NAME
NODES = (
    "tsdf_fusion",
    "scene_renderer",
    "grasp_evaluator",
    "reachability_filter",
    "grasp_server",
    "grasp_executor",
)


def shared_files() -> list[tuple[str, list[str]]]:
    """Return what goes to share/: index marker, package.xml, config/, launch files."""
    files = {
        "share/ament_index/resource_index/packages": [f"resource/{NAME}"],
        str(SHARE): ["package.xml"],
    }
    folders = defaultdict(list, files)
    for path in sorted(Path("config").rglob("*")):
        if path.is_file():
            folders[str(SHARE / path.parent)].append(str(path))
    for path in sorted(Path(NAME, "launch").glob("*.launch.py")):
        folders[str(SHARE / "launch")].append(str(path))
    return list(folders.items())


setup(
    name=NAME,
    version=ElementTree.parse("package.xml").findtext("version"),
    description="Grasp detection from one depth view by neural surface rendering",
    license="Apache-2.0",
    python_requires=">=3.11,<3.13",
    packages=find_packages(include=[f"{NAME}*", "sim_bridge*"]),
    package_data={
        NAME: ["**/*.safetensors", "**/*.json", "**/*.xml", "**/*.md"],
        "sim_bridge": ["assets/**/*"],
    },
    data_files=shared_files(),
    install_requires=["setuptools"],
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "neugrasp = neugrasp_ros.cli.main:main",
            *(f"{node} = neugrasp_ros.nodes.{node}:main" for node in NODES),
            "grasp_suite = neugrasp_ros.nodes.composed:main",
            "sim_bridge = sim_bridge.bridge_node:main",
        ]
    },
)
