# SPDX-License-Identifier: Apache-2.0
"""``neugrasp summarize``: many demonstrations as one figure with its interval."""

import argparse
from pathlib import Path


def add_parser(
    subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]",
) -> None:
    """Add the command and its options."""
    parser = subparsers.add_parser(
        "summarize", help="pool the JSON files of many `neugrasp demo` runs"
    )
    parser.add_argument("folder", type=Path, help="folder of the files")
    parser.add_argument("--json", type=Path, help="where the figures go")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the pooled figures, and write them."""
    from neugrasp_ros.benchmark.demo_summary import load_demos, summarize_demos
    from neugrasp_ros.benchmark.report import command_line, write_report

    figures = summarize_demos(load_demos(args.folder))
    figures["command"] = command_line()
    if args.json:
        write_report(args.json, figures)
    low, high = figures["success_ci"]
    print(
        f"{len(figures['seeds'])} demonstrations: {figures['successes']} of "
        f"{figures['attempts']} attempts held ({figures['success_percent']:.0f} %, "
        f"interval {low:.0f}-{high:.0f}), {figures['lifted']} of {figures['objects']} "
        f"objects lifted, at least one in {figures['demos_with_a_lift']}"
    )
    return 0
