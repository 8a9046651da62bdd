# SPDX-License-Identifier: Apache-2.0
"""``neugrasp doctor``: look for what usually keeps a set-up from working."""

import argparse
import importlib.util
import os
import platform
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

SHARED_MEMORY = Path("/dev/shm")
LEAST_SHARED_MEMORY = 32 << 20  # bytes: eight processes of one 4 MB segment
PACKAGES = ("rclpy", "neugrasp_msgs", "torch", "open3d", "pinocchio", "pybullet")


class Finding(NamedTuple):
    """One look: whether it is fine, what was seen, what to do if not."""

    good: bool
    seen: str
    remedy: str = ""


def add_parser(
    subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]",
) -> None:
    """Add the command and its options."""
    parser = subparsers.add_parser(
        "doctor",
        help="look for what keeps a set-up from working; exit 0 if all is fine",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print every look; 1 if one of them found something wrong."""
    all_good = True
    for look in LOOKS:
        finding = _finding(look)
        all_good &= finding.good
        print(f"{'ok   ' if finding.good else 'WRONG'} {finding.seen}", flush=True)
        if not finding.good:
            print(f"      {finding.remedy}")
    return 0 if all_good else 1


def _finding(look: Callable[[], Finding]) -> Finding:
    """Look; what needs a package that is not there cannot."""
    try:
        return look()
    except ImportError as error:
        return Finding(False, str(error), "make setup")


def look_at_python() -> Finding:
    """Check the interpreter's version."""
    version = platform.python_version()
    return Finding(
        sys.version_info[:2] in ((3, 11), (3, 12)),
        f"Python {version}",
        "use Python 3.11 or 3.12",
    )


def look_at_packages() -> Finding:
    """Check that all packages can be found."""
    missing = [name for name in PACKAGES if importlib.util.find_spec(name) is None]
    if not missing:
        return Finding(True, f"packages: {', '.join(PACKAGES)}")
    return Finding(False, f"missing packages: {', '.join(missing)}", "make setup")


def look_at_ros() -> Finding:
    """Check that there is not one ROS from apt and another from pip."""
    spec = importlib.util.find_spec("rclpy")
    origin = "" if spec is None or spec.origin is None else spec.origin
    apt = [
        p for p in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if "/opt/ros" in p
    ]
    clash = bool(apt) and "/opt/ros" not in origin
    return Finding(
        not clash,
        f"rclpy from {'apt' if '/opt/ros' in origin else 'pip'}",
        "a sourced /opt/ros hides behind pip's ROS: open a shell without sourcing it",
    )


def look_at_shared_memory() -> Finding:
    """Check that depth images fit into shared memory."""
    if not SHARED_MEMORY.is_dir():
        return Finding(True, "no /dev/shm: images go over UDP")
    status = os.statvfs(SHARED_MEMORY)
    free = status.f_bavail * status.f_frsize
    return Finding(
        free >= LEAST_SHARED_MEMORY,
        f"{free >> 20} MB of shared memory free",
        "`fastdds shm clean` removes what killed processes left; in a container give "
        "more by --shm-size",
    )


def look_at_weights() -> Finding:
    """Check that the shipped weights are whole."""
    from neugrasp_ros.errors import CheckpointError
    from neugrasp_ros.model import default_weights, file_sha256, load_network

    path = default_weights()
    try:
        load_network(path)
    except CheckpointError as error:
        return Finding(False, str(error), "see `neugrasp train --help`")
    return Finding(True, f"weights {path.name}, sha256 {file_sha256(path)[:12]}")


def look_at_robot() -> Finding:
    """Check that the robot's description is there and has its frames."""
    from neugrasp_ros.errors import NeuGraspError
    from neugrasp_ros.robot.model import load_robot

    try:
        robot = load_robot("tiago_dual")
    except NeuGraspError as error:
        return Finding(False, str(error), "make setup")
    return Finding(
        True, f"robot {robot.description.name}: {len(robot.joint_names)} joints"
    )


LOOKS: tuple[Callable[[], Finding], ...] = (
    look_at_python,
    look_at_packages,
    look_at_ros,
    look_at_shared_memory,
    look_at_weights,
    look_at_robot,
)
