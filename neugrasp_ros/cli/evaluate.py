# SPDX-License-Identifier: Apache-2.0
"""``neugrasp evaluate``: predicted quality and affordances against labels."""

import argparse
from pathlib import Path

REPORT_EVERY = 20


def add_parser(
    subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]",
) -> None:
    """Add the command and its options."""
    parser = subparsers.add_parser(
        "evaluate", help="predicted quality and affordances against labelled shards"
    )
    add = parser.add_argument
    add(
        "--data", type=Path, required=True, help="folder of shards, such as a val split"
    )
    add("--weights", type=Path, help="weights file; default the shipped one")
    add("--views", type=int, default=1, help="views a scene")
    add("--scenes", type=int, default=0, help="at most so many scenes; 0 = all")
    add("--seed", type=int, default=0, help="of views, noise and intervals")
    add("--threads", type=int, default=1)
    add("--json", type=Path, help="where the figures go")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Look at every scene, say how it goes, write the figures."""
    import numpy as np

    from neugrasp_ros.benchmark.report import command_line, source_commit, write_report
    from neugrasp_ros.datagen.shards import load_shards
    from neugrasp_ros.errors import ConfigError
    from neugrasp_ros.model import (
        default_weights,
        file_sha256,
        load_network,
        quality_sha256,
    )
    from neugrasp_ros.pipeline import use_threads
    from neugrasp_ros.training.evaluation import report, score_scene

    weights = args.weights or default_weights()
    network, _ = load_network(weights)
    use_threads(args.threads)
    scenes = list(load_shards(args.data))[: args.scenes or None]
    views = []
    for number, labels in enumerate(scenes, start=1):
        if not labels.scene.objects or not len(labels.grasps):
            continue
        for view in range(args.views):
            scored = score_scene(network, labels, args.seed, view, args.threads)
            views += [scored] if scored else []
        if number % REPORT_EVERY == 0:
            print(f"{number}/{len(scenes)} scenes", flush=True)
    if not views:
        raise ConfigError(f"{args.data}: no grasp of any scene meets a surface")
    figures = report(
        views, network.config.affordances, np.random.default_rng(args.seed)
    )
    figures |= {
        "command": command_line(),
        "commit": source_commit(),
        "data": args.data.name,
        "seed": args.seed,
        "views_per_scene": args.views,
        "weights_sha256": file_sha256(weights),
        "quality_sha256": quality_sha256(network),
    }
    if args.json:
        write_report(args.json, figures)
    print(_table(figures))
    return 0


def _table(figures: dict) -> str:
    """Return the figures for people."""
    rows = [("all", figures["quality"]), ("tried", figures["tried"])]
    for groups in figures["by"].values():
        rows += groups.items()
    lines = ["grasps       number  positive  AUC    AP     ECE"]
    for name, values in rows:
        lines.append(
            f"{name:<12} {values['grasps']:6d}  {_number(values['positive'])}     "
            f"{_number(values['auc'])}  {_number(values['ap'])}  "
            f"{_number(values['ece'])}"
        )
    if "affordances" in figures:
        lines.append("class        number  prevalence  AP     ECE")
        for name, values in figures["affordances"].items():
            lines.append(
                f"{name:<12} {values['positives']:6d}  "
                f"{_number(values['prevalence'])}       {_number(values['ap'])}  "
                f"{_number(values['ece'])}"
            )
        lines.append(f"mean AP {_number(figures['ap_macro'])}")
    return "\n".join(lines)


def _number(value: float | None) -> str:
    return "  -  " if value is None else f"{value:.3f}"
