# SPDX-License-Identifier: Apache-2.0
"""``neugrasp profile``: what a decision costs, and what being fast loses."""

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from neugrasp_ros.cli.counts import require_positive

TABLES = ((0.3, 0.3, 0.3), (0.6, 0.4, 0.3), (0.9, 0.6, 0.3), (1.2, 0.8, 0.4))
ON_TABLE = (5, 8, 12, 18)  # objects
CURVE_SCENES = 5
PARTS = (
    "timing", "speedup", "rays", "scores", "curves", "tables", "endurance", "service",
    "memory",
)  # fmt: skip
ON_REQUEST = ("endurance", "service", "memory")  # long, or they start the suite
USUAL = ",".join(name for name in PARTS if name not in ON_REQUEST)
COUNTS = (
    "scenes", "reference", "rays", "scores", "grasps", "detections", "candidates",
    "repeat", "requests",
)  # fmt: skip


def add_parser(
    subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]",
) -> None:
    """Add the command and its options."""
    parser = subparsers.add_parser(
        "profile", help="time every stage, beside the paper's renderer"
    )
    add = parser.add_argument
    add("--only", default=USUAL, help=f"parts to measure, of {','.join(PARTS)}")
    add("--scenes", type=int, default=30, help="scenes that are timed")
    add("--data", type=Path, help="folder of shards; default: seeded piles")
    add("--reference", type=int, default=2, help="scenes the reference is timed on")
    add("--rays", type=int, default=50, help="scenes whose rays are compared")
    add("--scores", type=int, default=50, help="scenes whose scores are compared")
    add("--grasps", type=int, default=32, help="grasps compared in a scene")
    add("--detections", type=int, default=1000, help="of endurance and memory")
    add("--requests", type=int, default=50, help="to the service, of either kind")
    add("--repeat", type=int, default=3, help="runs of the timing; the best one counts")
    add("--threads", type=int, default=2)
    add("--candidates", type=int, default=256)
    add("--gripper", default="robotiq_2f85", metavar="NAME|FILE")
    add("--weights", default="", help="weights file; default the shipped one")
    add("--seed", type=int, default=0)
    add("--json", type=Path, help="where the figures go; the picture goes beside it")
    add("--merge", action="store_true", help="keep its figures that are not made now")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Measure, print the table, write figures and picture."""
    from neugrasp_ros.benchmark.report import command_line, source_commit, write_report
    from neugrasp_ros.benchmark.speed import best_of, matmul_ms
    from neugrasp_ros.benchmark.speed_figures import draw_profile, profile_table
    from neugrasp_ros.cli.score_check import score_notes_path
    from neugrasp_ros.config import PlannerConfig
    from neugrasp_ros.errors import ConfigError
    from neugrasp_ros.pipeline import GraspPlanner, use_threads

    wanted = _wanted(args)
    use_threads(args.threads)
    config = PlannerConfig(
        weights=args.weights,
        gripper=args.gripper,
        threads=args.threads,
        max_candidates=args.candidates,
    )
    planner = GraspPlanner(config)
    scenes, shots = _shots(args, wanted)
    best_of(planner, shots[:1], repeats=1)  # compiles and allocates
    result: dict[str, Any] = {}
    if args.merge and args.json and args.json.exists():
        result = json.loads(args.json.read_text())
        before = result.get("weights_sha256")
        if before != planner.weights_sha256:
            raise ConfigError(
                f"--merge: {args.json} is of the weights {before}, "
                f"these are {planner.weights_sha256}"
            )
    result["matmul_512_ms"] = matmul_ms()
    result |= {
        "commands": dict(result.get("commands", {})),
        "weights_sha256": planner.weights_sha256,
        "render": asdict(config.render),
    }
    for name in wanted:
        result |= _part(name, args, planner, scenes, shots)()
        result["commands"][name] = {
            "command": command_line(),
            "commit": source_commit(),
            "seed": args.seed,
            "threads": args.threads,
            "matmul_512_ms": result["matmul_512_ms"],
        }
        if args.json:
            write_report(args.json, result)
            if name == "scores":
                score_notes_path(args.json).unlink(missing_ok=True)
    print(profile_table(result))
    if args.json and "stages_ms" in result:
        draw_profile(result, args.json.with_suffix(".png"))
    return 0


def _wanted(args: argparse.Namespace) -> list[str]:
    """Return the parts to measure; refuse numbers and words that cannot be meant."""
    from neugrasp_ros.errors import ConfigError

    wanted = [name.strip() for name in args.only.split(",")]
    unknown = sorted(set(wanted) - set(PARTS))
    if unknown:
        raise ConfigError(f"--only: expected of {', '.join(PARTS)}, got {unknown}")
    require_positive(args, *COUNTS)
    if args.merge and not args.json:
        raise ConfigError("--merge needs --json, the figures to keep")
    return wanted


def _shots(args: argparse.Namespace, wanted: list[str]) -> tuple[Any, Any]:
    """Return as many scenes as the parts need, and a view of each."""
    import numpy as np

    from neugrasp_ros.benchmark.shots import piles, recorded, shoot

    needs = {"rays": args.rays, "scores": args.scores, "speedup": args.reference}
    count = max(CURVE_SCENES, *(needs.get(name, args.scenes) for name in wanted), 1)
    scenes = list(recorded(args.data, count) if args.data else piles(count, args.seed))
    shots = [
        shoot(scene, np.random.default_rng([args.seed, n]))
        for n, scene in enumerate(scenes)
    ]
    return scenes, shots


def _part(
    name: str, args: argparse.Namespace, planner: Any, scenes: Any, shots: Any
) -> Callable[[], dict[str, Any]]:
    """Return what measures one of ``PARTS``."""
    import numpy as np

    from neugrasp_ros.benchmark import speed, speed_curves
    from neugrasp_ros.benchmark.endurance import endure
    from neugrasp_ros.benchmark.equivalence import check_rays
    from neugrasp_ros.benchmark.shots import shoot, table
    from neugrasp_ros.cli.score_check import noted_scores
    from neugrasp_ros.cli.service_latency import by_service
    from neugrasp_ros.cli.suite_memory import by_memory

    few = shots[:CURVE_SCENES]

    def tables() -> dict[str, Any]:
        seen = [
            shoot(
                table(scenes, size[:2], count),
                np.random.default_rng([args.seed, count]),
                size,
            )
            for size, count in zip(TABLES, ON_TABLE, strict=True)
        ]
        return {"tables": speed_curves.by_table(planner, seen)}

    return {
        "timing": lambda: {
            **speed.best_run(planner, shots[: args.scenes], args.repeat),
            "peak_memory_mb": speed.peak_memory_mb(),
        },
        "speedup": lambda: speed.against_reference(
            planner, shots[: args.reference], args.grasps
        ),
        "rays": lambda: check_rays(planner, shots[: args.rays], seed=args.seed),
        "scores": lambda: noted_scores(args, planner, shots[: args.scores]),
        "curves": lambda: {
            "curve_candidates": speed_curves.by_candidates(planner, few),
            "curve_threads": speed_curves.by_threads(planner, few),
            "curve_resolution": speed_curves.by_resolution(shots[0]),
        },
        "tables": tables,
        "endurance": lambda: endure(
            planner, few, max(args.detections // 10, 1), args.detections
        ),
        "service": lambda: by_service(few, args.requests, planner.config),
        "memory": lambda: by_memory(few, args.detections, planner.config),
    }[name]
