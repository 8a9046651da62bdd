# SPDX-License-Identifier: Apache-2.0
"""``neugrasp agreement``: labels against the benchmark's full execution."""

import argparse
from pathlib import Path

from neugrasp_ros.cli.counts import require_positive

REPORT_EVERY = 10


def add_parser(
    subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]",
) -> None:
    """Add the command and its options."""
    parser = subparsers.add_parser(
        "agreement", help="repeat labelled trials in the benchmark's full execution"
    )
    add = parser.add_argument
    add("--data", type=Path, required=True, help="folder of labelled shards")
    add("--count", type=int, default=500, help="grasps per scene kind and gripper")
    add("--seed", type=int, default=0)
    add("--workers", type=int, default=1)
    add("--json", type=Path, help="where the figures go")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Repeat the trials, print the shares, write the figures."""
    import numpy as np

    from neugrasp_ros.benchmark.metrics import wilson_interval
    from neugrasp_ros.benchmark.report import command_line, source_commit, write_report
    from neugrasp_ros.datagen.agreement import count_agreement, draw_rechecks, recheck
    from neugrasp_ros.datagen.pool import run_local
    from neugrasp_ros.datagen.shards import load_shards
    from neugrasp_ros.errors import ConfigError

    require_positive(args, "count")
    rng = np.random.default_rng(args.seed)
    jobs = draw_rechecks(load_shards(args.data), args.count, rng)
    outcomes = []
    for number, outcome in enumerate(run_local(recheck, jobs, args.workers), start=1):
        if outcome.error:
            print(f"skipped {outcome.job.describe()}: {outcome.error}")
            continue
        outcomes.append(outcome.result)
        if number % REPORT_EVERY == 0:
            print(f"{number}/{len(jobs)} scenes", flush=True)
    if not outcomes:
        raise ConfigError(f"{args.data}: no tried grasp could be repeated")
    groups = {}
    for name, counts in count_agreement(outcomes).items():
        lower, upper = wilson_interval(counts["agree"], counts["n"])
        share = 100 * counts["agree"] / counts["n"]
        bounds = [100 * lower, 100 * upper]
        groups[name] = {**counts, "percent": share, "percent_ci": bounds}
        print(
            f"{name:<22} {counts['agree']}/{counts['n']} agree, {share:.1f} % "
            f"({bounds[0]:.1f}-{bounds[1]:.1f}), {counts['false_positive']} false "
            f"positive, {counts['false_negative']} false negative"
        )
    if args.json:
        write_report(
            args.json,
            {
                "agreement": groups,
                "command": command_line(),
                "commit": source_commit(),
                "data": args.data.name,
                "seed": args.seed,
            },
        )
    return 0
