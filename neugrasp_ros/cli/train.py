# SPDX-License-Identifier: Apache-2.0
"""``neugrasp train``: from labelled shards to weights."""

import argparse
import json
import logging
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from neugrasp_ros.config import NetworkConfig, TrainConfig

CONTEXT = 32  # features of the surroundings that the affordance head reads
HAND_VIEW = 64  # features of the view along the hand


def add_parser(
    subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]",
) -> None:
    """Add the command and its options."""
    parser = subparsers.add_parser(
        "train", help="train on labelled shards; also under torchrun"
    )
    parser.add_argument("--data", help="folders of training shards, comma separated")
    parser.add_argument(
        "--seen", default="",
        help="more such folders, of which the stages hands and context alone learn, "
        "without the local surfaces of their grasps, which take most of the time",
    )  # fmt: skip
    parser.add_argument("--tune", type=Path, help="folder of shards to calibrate on")
    parser.add_argument(
        "--out", type=Path, help="default runs/train, or runs/smoke with --smoke"
    )
    parser.add_argument(
        "--weights", type=Path, help="default: OUT/neugrasp.safetensors"
    )
    parser.add_argument(
        "--start", type=Path,
        help="weights to begin with; heads they lack are new, a context stays",
    )  # fmt: skip
    parser.add_argument(
        "--network", choices=("cpu", "paper"),
        help="size; default that of --start, or cpu. Weights of another scene encoder "
        "start the rest alone",
    )  # fmt: skip
    parser.add_argument(
        "--steps",
        help="steps of the stages occupancy, quality, joint, hands and context, such "
        "as occupancy=3600,joint=600; 0 skips one",
    )
    parser.add_argument(
        "--local-view", default="rendered", choices=("rendered", "grid", "centre"),
        help="ablations: detectors that do not see the local surface",
    )  # fmt: skip
    parser.add_argument(
        "--w-aff", type=float, help="weight of the affordance loss; default 0.15"
    )
    parser.add_argument(
        "--keep", type=Path, metavar="DIR",
        help="folder of small files to commit, from which a run goes on without OUT",
    )  # fmt: skip
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument(
        "--smoke", action="store_true", help="overfit four scenes in about a minute"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Train, write the weights, print the card."""
    from neugrasp_ros.errors import ConfigError
    from neugrasp_ros.training.run import TrainingRun, train
    from neugrasp_ros.training.smoke import smoke_test

    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
    out = args.out or Path("runs/smoke" if args.smoke else "runs/train")
    if args.smoke:
        figures = smoke_test(out, args.seed)
        print(json.dumps(figures, indent=1))
        return 0 if figures["learned"] else 1
    if not args.data or not args.tune:
        raise ConfigError(
            "train needs --data and --tune (`neugrasp datagen`), or --smoke"
        )
    stages = _stages(args)
    card = train(
        TrainingRun(
            train=tuple(Path(folder) for folder in args.data.split(",")),
            tune=args.tune,
            folder=out,
            weights=args.weights or out / "neugrasp.safetensors",
            network=_shape(args, stages),
            stages=stages,
            workers=args.workers,
            start=args.start,
            seen=tuple(Path(folder) for folder in args.seen.split(",") if folder),
            keep=args.keep,
        )
    )
    if card:
        print(json.dumps(card, indent=1))
    return 0


def _shape(
    args: argparse.Namespace, stages: "tuple[TrainConfig, ...]"
) -> "NetworkConfig":
    """Return the named network, or that of the weights to begin with.

    It has a context if one is trained, or the weights to begin with have one, and so
    with the thing head and the view along the hand. Ablations of the local view have
    none of them.
    """
    from neugrasp_ros.config import CPU_NETWORK, PAPER_NETWORK
    from neugrasp_ros.model import load_network
    from sim_bridge.objects.affordances import AFFORDANCE_NAMES

    started = load_network(args.start)[0].config if args.start else None
    named = PAPER_NETWORK if args.network == "paper" else CPU_NETWORK
    shape = named if args.network or started is None else started
    before = started.context if started else 0
    taught = CONTEXT if any(s.stage == "context" for s in stages) else 0
    context = (before or taught) if args.local_view == "rendered" else 0
    things = taught or (started and started.thing_head)
    heard = any(s.stage == "hands" for s in stages)
    view = started.hand_view if started else 0
    hands = view or (HAND_VIEW if taught or heard else 0)
    return replace(
        shape,
        affordances=AFFORDANCE_NAMES,
        part_head=not context,
        thing_head=bool(context and things),
        context=context,
        hand_view=hands if context else 0,
        local_view=args.local_view,
    )


def _stages(args: argparse.Namespace) -> "tuple[TrainConfig, ...]":
    """Return the stages to run, with the steps and weights that were asked for."""
    from neugrasp_ros.errors import ConfigError
    from neugrasp_ros.training.run import DEFAULT_STAGES

    known = {stage.stage: stage for stage in DEFAULT_STAGES}
    try:
        pairs = (item.split("=") for item in (args.steps or "").split(",") if item)
        steps = {name: int(count) for name, count in pairs}
    except ValueError as error:
        raise ConfigError(
            f"--steps: expected STAGE=COUNT,.., got {args.steps!r}"
        ) from error
    unknown = set(steps) - set(known)
    if unknown:
        raise ConfigError(
            f"--steps: unknown stages {sorted(unknown)}, expected some of {list(known)}"
        )
    changes = {} if args.w_aff is None else {"w_affordance": args.w_aff}
    stages = []
    for name, stage in known.items():
        count = steps.get(name, stage.steps)
        if name == "hands" and name not in steps and steps.get("context") == 0:
            continue  # nobody would listen to it
        if count:
            stages.append(replace(stage, seed=args.seed, steps=count, **changes))
    if not stages:
        raise ConfigError("--steps skips every stage")
    return tuple(stages)
