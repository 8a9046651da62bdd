# SPDX-License-Identifier: Apache-2.0
"""``neugrasp profile``: what a decision costs, and what being fast loses."""

import argparse
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

TABLES = ((0.3, 0.3, 0.3), (0.6, 0.4, 0.3), (0.9, 0.6, 0.3), (1.2, 0.8, 0.4))
ON_TABLE = (5, 8, 12, 18)  # objects


def add_parser(
    subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]",
) -> None:
    """Add the command and its options."""
    parser = subparsers.add_parser(
        "profile", help="time every stage, beside the paper's renderer"
    )
    add = parser.add_argument
    add("--scenes", type=int, default=30, help="scenes that are timed")
    add("--data", type=Path, help="folder of shards; default: seeded piles")
    add("--reference", type=int, default=2, help="scenes the reference is timed on")
    add("--rays", type=int, default=10, help="scenes whose rays are compared")
    add("--scores", type=int, default=4, help="scenes whose scores are compared")
    add("--grasps", type=int, default=32, help="grasps compared in a scene")
    add("--curves", action="store_true", help="also over candidates, threads, cubes")
    add("--threads", type=int, default=2)
    add("--candidates", type=int, default=256)
    add("--gripper", default="robotiq_2f85", metavar="NAME|FILE")
    add("--weights", default="", help="weights file; default the shipped one")
    add("--seed", type=int, default=0)
    add("--json", type=Path, help="where the figures go; the picture goes beside it")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Measure, print the table, write figures and picture."""
    import numpy as np

    from neugrasp_ros.benchmark.equivalence import check_equivalence
    from neugrasp_ros.benchmark.report import source_commit, write_report
    from neugrasp_ros.benchmark.shots import piles, recorded, shoot, table
    from neugrasp_ros.benchmark.speed import (
        against_reference,
        best_of,
        curves,
        matmul_ms,
        peak_memory_mb,
        summary,
    )
    from neugrasp_ros.benchmark.speed_figures import draw_profile, profile_table
    from neugrasp_ros.config import PlannerConfig
    from neugrasp_ros.errors import ConfigError
    from neugrasp_ros.pipeline import GraspPlanner, use_threads

    if args.scenes < 1:
        raise ConfigError(f"--scenes must be positive, got {args.scenes}")
    use_threads(args.threads)
    config = PlannerConfig(
        weights=args.weights,
        gripper=args.gripper,
        threads=args.threads,
        max_candidates=args.candidates,
    )
    planner = GraspPlanner(config)
    source = recorded(args.data, args.scenes) if args.data else None
    scenes = list(source or piles(args.scenes, args.seed))
    shots = [
        shoot(scene, np.random.default_rng([args.seed, n]))
        for n, scene in enumerate(scenes)
    ]
    best_of(planner, shots[:1], repeats=1)  # compiles and allocates
    result: dict[str, Any] = {"matmul_512_ms": matmul_ms()}
    result |= summary(best_of(planner, shots))
    result["peak_memory_mb"] = peak_memory_mb()
    result |= against_reference(planner, shots[: args.reference], args.grasps)
    result |= check_equivalence(
        planner,
        shots[: args.rays],
        shots[: args.scores],
        n_grasps=args.grasps,
        seed=args.seed,
    )
    if args.curves:
        tables = [
            shoot(
                table(scenes, size[:2], count),
                np.random.default_rng([args.seed, count]),
                size,
            )
            for size, count in zip(TABLES, ON_TABLE, strict=True)
        ]
        result["curves"] = curves(planner, shots[:5], tables)
    result |= {
        "seed": args.seed,
        "threads": args.threads,
        "command": "neugrasp " + " ".join(sys.argv[1:]),
        "commit": source_commit(),
        "weights_sha256": planner.weights_sha256,
        "render": asdict(config.render),
    }
    print(profile_table(result))
    if args.json:
        write_report(args.json, result)
        draw_profile(result, args.json.with_suffix(".png"))
    return 0
