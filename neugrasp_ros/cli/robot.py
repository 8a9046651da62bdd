# SPDX-License-Identifier: Apache-2.0
"""``neugrasp robot``: figures of the whole robot, without ROS."""

import argparse
import math
from pathlib import Path
from typing import Any

from neugrasp_ros.cli.counts import require_positive


def add_parser(
    subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]",
) -> None:
    """Add the command and its parts."""
    parser = subparsers.add_parser("robot", help="figures of the whole robot")
    parts = parser.add_subparsers(title="parts", required=True, metavar="PART")
    clear = parts.add_parser("clear", help="rounds of clearing furniture")
    add = clear.add_argument
    add("--rounds", type=int, default=30)
    add("--seed", type=int, default=0)
    add("--share", default="1/1", metavar="K/N", help="do every N-th round, from K on")
    add("--keep", type=Path, default=Path("runs/robot"), metavar="FOLDER",
        help="a file per round; those that are there are not run again")  # fmt: skip
    add("--json", type=Path, help="where the figures of the rounds kept go")
    clear.set_defaults(run=run_clear)
    reach = parts.add_parser("reach", help="time, recall and truth of reachability")
    add = reach.add_argument
    add("--sets", type=int, default=20, help="of 200 grasps, each with its scene")
    add("--slow-sets", type=int, default=5, help="compared with the slow reference")
    add("--seed", type=int, default=0)
    add("--json", type=Path, help="where the figures go")
    reach.set_defaults(run=run_reach)
    order = parts.add_parser("order", help="reach asked first against reach asked last")
    add = order.add_argument
    add("--scenes", type=int, default=12)
    add("--candidates", type=int, default=1000, help="proposed per scene at most")
    add("--budgets", type=float, nargs="+", default=[0.05, 0.1, 0.2, 0.0],
        metavar="SECONDS",
        help="for scores where reach is asked last; 0 = no budget")  # fmt: skip
    add("--seed", type=int, default=100)
    add("--json", type=Path, help="where the figures go")
    order.set_defaults(run=run_order)


def parse_share(text: str) -> tuple[int, int]:
    """Return K and N of ``K/N``.

    Raises:
        ConfigError: If it is not that, or K is not one of 1..N.
    """
    from neugrasp_ros.errors import ConfigError

    first, _, count = text.partition("/")
    if not (first.isdigit() and count.isdigit() and 1 <= int(first) <= int(count)):
        raise ConfigError(f"--share must be K/N with 1 <= K <= N, got {text!r}")
    return int(first), int(count)


def run_clear(args: argparse.Namespace) -> int:
    """Run the rounds that are missing, then pool all that are kept."""
    from neugrasp_ros.benchmark.robot_figures import (
        by_kind,
        keep_round,
        load_rounds,
        round_path,
        summarize_rounds,
    )
    from neugrasp_ros.benchmark.robot_round import open_rounds
    from neugrasp_ros.errors import ConfigError
    from neugrasp_ros.model import default_weights, file_sha256

    require_positive(args, "rounds")
    weights = file_sha256(default_weights())
    load_rounds(args.keep, args.rounds, args.seed, weights)
    first, count = parse_share(args.share)
    mine = range(first - 1, args.rounds, count)
    missing = [i for i in mine if not round_path(args.keep, i).exists()]
    if missing:
        with open_rounds(lambda line: print(line, flush=True)) as rounds:
            for index in missing:
                record = rounds.run(index, args.seed)
                made = {**record.as_record(), "weights_sha256": weights}
                keep_round(args.keep, made)
                print(
                    f"round {index}: {len(record.cleared)} of {len(record.objects)} "
                    f"cleared in {len(record.attempts)} attempts, {record.ended}, "
                    f"largest contact {record.largest_contact:.1f} N",
                    flush=True,
                )
    kept = load_rounds(args.keep, args.rounds, args.seed, weights)
    if not kept:
        raise ConfigError(f"{args.keep}: holds no round")
    figures = {
        **summarize_rounds(kept),
        "by_kind": by_kind(kept),
        "seed": args.seed,
        "rounds_asked": args.rounds,
    }
    _tell(figures, args.json)
    return 0


def run_reach(args: argparse.Namespace) -> int:
    """Measure the reachability check."""
    from neugrasp_ros.benchmark.robot_reach import measure
    from neugrasp_ros.errors import ConfigError
    from neugrasp_ros.robot.model import load_robot

    require_positive(args, "sets")
    if args.slow_sets < 0:
        raise ConfigError(f"--slow-sets must be 0 or more, got {args.slow_sets}")
    figures = measure(load_robot("tiago_dual"), args.sets, args.slow_sets, args.seed)
    _tell({**figures, "seed": args.seed}, args.json)
    return 0


def run_order(args: argparse.Namespace) -> int:
    """Compare both orders."""
    from neugrasp_ros.benchmark.robot_order import compare_orders
    from neugrasp_ros.benchmark.robot_round import open_rounds
    from neugrasp_ros.errors import ConfigError

    require_positive(args, "scenes", "candidates")
    for budget in args.budgets:
        if not 0 <= budget < math.inf:
            raise ConfigError(f"--budgets must be 0 or more seconds, got {budget}")
    with open_rounds(print, args.candidates) as rounds:
        figures = compare_orders(
            rounds.robot,
            rounds.detector,
            scenes=args.scenes,
            budgets=args.budgets,
            seed=args.seed,
            say=lambda line: print(line, flush=True),
        )
    _tell(figures, args.json)
    return 0


def _tell(figures: dict[str, Any], path: Path | None) -> None:
    """Print figures, and write them with what made them."""
    from neugrasp_ros.benchmark.report import command_line, source_commit, write_report
    from neugrasp_ros.model import default_weights, file_sha256

    for name, value in figures.items():
        if name != "rows":
            print(f"{name}: {value}")
    if path:
        origin = {
            "command": command_line(),
            "commit": source_commit(),
            "weights_sha256": file_sha256(default_weights()),
        }
        write_report(path, {**figures, **origin})
