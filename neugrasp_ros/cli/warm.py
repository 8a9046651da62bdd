# SPDX-License-Identifier: Apache-2.0
"""``neugrasp warm``: compile what the first decision would have to wait for."""

import argparse
import time


def add_parser(
    subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]",
) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "warm", help="compile the kernels once, so that no first decision waits for it"
    )
    parser.set_defaults(run=run)


def run(_: argparse.Namespace) -> int:
    """Try fusion, planner and robot once each; 0 without weights, too."""
    import numpy as np

    from neugrasp_ros.config import PlannerConfig
    from neugrasp_ros.errors import CheckpointError
    from neugrasp_ros.fusion.tsdf import empty_volume, integrate, seen_surface
    from neugrasp_ros.geometry.camera import Intrinsics
    from neugrasp_ros.manipulation.mover import ArmMover
    from neugrasp_ros.manipulation.warm_up import try_once
    from neugrasp_ros.nodes.planners import load_planner
    from neugrasp_ros.nodes.reach_stage import RobotChecker
    from neugrasp_ros.nodes.settings import ReachConfig
    from neugrasp_ros.robot.model import load_robot
    from neugrasp_ros.robot.reachability import ReachabilityChecker

    def fuse() -> None:
        camera = Intrinsics(4, 4, 4.0, 4.0, 2.0, 2.0)
        depth = np.full((4, 4), 0.1, dtype=np.float32)
        seen_surface(integrate(empty_volume(), depth, camera, np.eye(4)))

    def move() -> None:
        robot = load_robot(ReachConfig().robot)
        try_once(ArmMover(ReachabilityChecker(robot)))

    for name, load in (
        ("fusion", fuse),
        ("planner", lambda: load_planner(PlannerConfig())),
        ("robot", lambda: RobotChecker(ReachConfig())),
        ("motion", move),
    ):
        start = time.perf_counter()
        try:
            load()
        except CheckpointError as error:
            print(f"{name}: {error}", flush=True)
            continue
        print(f"{name} compiled in {time.perf_counter() - start:.0f} s", flush=True)
    return 0
