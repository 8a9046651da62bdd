# SPDX-License-Identifier: Apache-2.0
"""``neugrasp datagen``: make scenes and label grasps in them."""

import argparse
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from neugrasp_ros.cli.counts import require_positive

if TYPE_CHECKING:
    from neugrasp_ros.datagen.jobs import RunPlan

REPORT_SECONDS = 10.0


def add_parser(
    subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]",
) -> None:
    """Add the command and its options."""
    parser = subparsers.add_parser("datagen", help="make scenes and label grasps")
    parser.add_argument("--out", required=True, help="folder of the shards")
    parser.add_argument(
        "--objects", default="procedural,random_urdfs", metavar="SET[,SET..]",
        help="names or folders; pile:FOLDER serves scenes of that kind only, "
        "FOLDER@0.8 has only its objects of at least 0.8 kg",
    )  # fmt: skip
    parser.add_argument(
        "--kind", default="mixed", choices=("pile", "packed", "egad", "mixed")
    )
    parser.add_argument(
        "--gripper", default="mixed", help="name, YAML file, varied, or mixed"
    )
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument(
        "--count", type=int, default=0,
        help="objects put on the table of each scene; default 0 draws their number",
    )  # fmt: skip
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--split",
        default="train",
        choices=("train", "tune", "val", "held_out"),
        help="held_out: affordance objects never learned from",
    )
    parser.add_argument(
        "--no-physics", action="store_true",
        help="label only what geometry tells, above all the parts between the jaws: "
        "many scenes of affordance objects at a low price",
    )  # fmt: skip
    parser.add_argument(
        "--trials", type=int, default=30, help="grasps a scene that may be tried"
    )
    parser.add_argument(
        "--collisions", type=int,
        help="grasps a scene that collide before they begin, at most: labelled, not "
        "tried; default 12. Of more, training sees a quarter as many as of the others "
        "in each view",
    )  # fmt: skip
    parser.add_argument(
        "--chosen", action="store_true",
        help="label the grasps that the network itself would choose in a random view",
    )  # fmt: skip
    parser.add_argument(
        "--weights", default="", help="of that network; default the shipped ones"
    )
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument(
        "--engine", nargs="+", default=["local"], metavar=("local|dask", "ADDRESS")
    )
    parser.add_argument(
        "--json", type=Path, help="where counts and rates go, while it runs, too"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the factory; return 1 if scenes were skipped."""
    from neugrasp_ros.benchmark.report import write_report
    from neugrasp_ros.datagen.factory import Progress, run_factory

    plan, address = _plan(args)
    about = _about(args)
    said = 0.0

    def say(progress: Progress) -> None:
        print(progress.line(), flush=True)
        if args.json:
            write_report(args.json, about | progress.figures())

    def report(progress: Progress) -> None:
        nonlocal said
        if time.monotonic() - said > REPORT_SECONDS:
            said = time.monotonic()
            say(progress)

    progress = run_factory(
        plan, args.out, n_workers=args.workers, dask_address=address, report=report
    )
    say(progress)
    print("reasons:", progress.reasons)
    for line in progress.skipped:
        print("skipped", line)
    return 1 if progress.skipped else 0


def _plan(args: argparse.Namespace) -> "tuple[RunPlan, str | None]":
    """Return what shall be made, and the address of a Dask scheduler if there is one.

    Raises:
        ConfigError: If options are impossible, alone or together.
    """
    from neugrasp_ros.datagen.candidates import CandidateConfig
    from neugrasp_ros.datagen.jobs import RunPlan
    from neugrasp_ros.errors import ConfigError
    from neugrasp_ros.model import default_weights

    engine, *address = args.engine
    if engine not in ("local", "dask") or len(address) != (engine == "dask"):
        raise ConfigError(
            f"--engine: expected local or dask ADDRESS, got {args.engine}"
        )
    if args.weights and not args.chosen:
        raise ConfigError("--weights says whose choice is labelled: give --chosen too")
    require_positive(args, "trials", "scenes", "workers")
    if args.collisions is not None and (args.collisions < 0 or args.chosen):
        raise ConfigError(
            "--collisions: expected 0 or more, and no --chosen, got "
            f"{args.collisions}{' and --chosen' if args.chosen else ''}"
        )
    drawn = {} if args.collisions is None else {"n_collisions": args.collisions}
    plan = RunPlan(
        objects=tuple(args.objects.split(",")),
        kind=args.kind,
        gripper=args.gripper,
        n_scenes=args.scenes,
        seed=args.seed,
        split=args.split,
        physics=not args.no_physics,
        candidates=CandidateConfig(n_trials=args.trials, **drawn),
        weights=(args.weights or str(default_weights())) if args.chosen else "",
        count=args.count,
    )
    if engine == "local":  # other machines have folders of their own
        _require_parts(plan)
    return plan, address[0] if address else None


def _require_parts(plan: "RunPlan") -> None:
    """Look for objects and grippers before a folder is bound to the plan.

    Raises:
        ConfigError: If a set or its part of the split is empty.
        UnknownNameError: If there is no such set or gripper.
    """
    from neugrasp_ros.datagen.labels import VARIED
    from neugrasp_ros.geometry.gripper import load_gripper
    from sim_bridge.objects.registry import object_set, part_names

    for name in {name for kind in plan.kinds() for name in plan.sets_for(kind)}:
        part_names(object_set(name), plan.split)
    for name in set(plan.grippers()) - {VARIED}:
        load_gripper(name)


def _about(args: argparse.Namespace) -> dict[str, Any]:
    """Return what a reader of the figures needs to repeat them, without folders."""
    from neugrasp_ros.benchmark.report import command_line, source_commit

    return {
        "command": command_line(),
        "commit": source_commit(),
        "cores": os.cpu_count(),
        "workers": args.workers,
        "seed": args.seed,
    }
