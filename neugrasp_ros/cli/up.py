# SPDX-License-Identifier: Apache-2.0
"""``neugrasp up``: start the nodes and look after them."""

import argparse

from neugrasp_ros.cli.processes import (
    Command,
    Supervisor,
    python_main,
    stop_on_signals,
)
from neugrasp_ros.nodes.table import PARAMETERS, ros_arguments, suite
from neugrasp_ros.resources import parameter_file


def add_parser(
    subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]",
) -> None:
    """Add the command and its options."""
    parser = subparsers.add_parser(
        "up",
        help="start the nodes",
        description="Start the nodes: all in one process, the simulator in its own. "
        "Like `ros2 launch neugrasp_ros grasp.launch.py`.",
    )
    parser.add_argument("--sim", action="store_true", help="with the simulated cell")
    parser.add_argument(
        "--execute", action="store_true",
        help="with the node that moves the arms; --sim is a whole robot then",
    )  # fmt: skip
    parser.add_argument("--separate", action="store_true", help="one process per node")
    parser.add_argument(
        "--params", metavar="FILE", action="append", default=[],
        help="YAML of parameters, a path or a name in config/; may come several times",
    )  # fmt: skip
    parser.add_argument("--ns", default="", metavar="/NAME", help="namespace of all")
    parser.add_argument(
        "-r", "--remap", metavar="A:=B", action="append", default=[],
        help="remap a topic or service",
    )  # fmt: skip
    parser.add_argument(
        "-p", "--param", metavar="[NODE:]NAME:=VALUE", action="append", default=[],
        help="set a parameter",
    )  # fmt: skip
    parser.set_defaults(run=run)


def commands(args: argparse.Namespace) -> list[Command]:
    """Return the processes that the options ask for.

    Raises:
        ConfigError: If a parameter file does not exist.
    """
    files = [parameter_file(name) for name in (PARAMETERS, *args.params)]
    return [
        Command(
            spec.name,
            python_main(
                spec.module,
                ros_arguments(
                    spec,
                    sim=args.sim,
                    namespace=args.ns,
                    parameter_files=files,
                    remaps=args.remap,
                    parameters=args.param,
                ),
            ),
        )
        for spec in suite(
            sim=args.sim, separate=args.separate, whole_robot=args.execute
        )
    ]


def run(args: argparse.Namespace) -> int:
    """Run the nodes until Ctrl-C (0) or until one of them ends by itself (1)."""
    with stop_on_signals() as stopping:
        return Supervisor(commands(args), stopping=stopping).wait()
