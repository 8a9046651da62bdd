# SPDX-License-Identifier: Apache-2.0
"""``neugrasp transport``: measure how many depth images arrive between processes."""

import argparse
import json
import os
import threading
from pathlib import Path
from typing import Any

from neugrasp_ros.cli.processes import Command, Supervisor, python_main
from neugrasp_ros.nodes.table import PROCESSING, SIMULATOR, ros_arguments

FUSION = PROCESSING[0]
START_TIMEOUT = 60.0  # [s]


def add_parser(
    subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]",
) -> None:
    """Add the command and its options."""
    parser = subparsers.add_parser(
        "transport",
        help="measure depth images from the bridge to the fusion node",
        description="Run the simulated cell and tsdf_fusion in processes of their own "
        "and count images. Exit code 0 if at least 9.5 Hz are published at 0.9 of "
        "real time or more, and 99 % of them arrive.",
    )
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, help="write the figures here, too")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Measure, print, and return whether it is enough."""
    from neugrasp_ros.nodes.transport_probe import measure

    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    parameters = [f"sim_bridge:seed:={args.seed}"]
    commands = [
        Command(
            spec.name,
            python_main(
                spec.module, ros_arguments(spec, sim=True, parameters=parameters)
            ),
        )
        for spec in (SIMULATOR, FUSION)
    ]
    supervisor = Supervisor(commands)
    watcher = threading.Thread(target=supervisor.wait, daemon=True)
    watcher.start()
    try:
        figures = measure(args.seconds, START_TIMEOUT)
    finally:
        supervisor.request_stop()
        watcher.join()
    print(json.dumps(figures, indent=1))
    if args.json:
        from neugrasp_ros.benchmark.report import write_report

        write_report(args.json, figures | origin(args))
    return 0 if is_enough(figures) else 1


def origin(args: argparse.Namespace) -> dict[str, Any]:
    """Return what it takes to repeat a measurement."""
    from neugrasp_ros.benchmark.report import source_commit
    from neugrasp_ros.model import default_weights, file_sha256

    return {
        "seed": args.seed,
        "command": f"neugrasp transport --seconds {args.seconds:g} --seed {args.seed}",
        "commit": source_commit(),
        "weights_sha256": file_sha256(default_weights()),
    }


def is_enough(figures: dict[str, Any]) -> bool:
    """Tell whether rate, real-time factor and share of arrivals are as promised."""
    return bool(
        figures["published_hz"] >= 9.5
        and figures["real_time_factor"] >= 0.9
        and figures["received_share"] >= 0.99
    )
