# SPDX-License-Identifier: Apache-2.0
"""``neugrasp``: one command line, one module per command."""

import argparse
import importlib
import importlib.util
import sys
from collections.abc import Sequence
from typing import NoReturn

from neugrasp_ros.errors import NeuGraspError

COMMANDS = (
    "demo", "summarize", "up", "detect", "doctor", "transport", "warm",
    "datagen", "agreement", "train", "evaluate", "bench", "profile", "robot",
)  # fmt: skip
USAGE = 64  # exit code for a wrong command line, as in sysexits.h
FAILURE = 1


class Parser(argparse.ArgumentParser):
    """A parser that ends with ``USAGE`` where argparse would end with 2."""

    def error(self, message: str) -> NoReturn:
        """Print usage and message, and exit."""
        self.print_usage(sys.stderr)
        self.exit(USAGE, f"{self.prog}: {message}\n")


def build_parser() -> Parser:
    """Return the parser with all commands that are installed."""
    parser = Parser(
        prog="neugrasp", description="Grasp detection from one depth view, for ROS 2."
    )
    commands = parser.add_subparsers(
        title="commands", required=True, metavar="COMMAND", parser_class=Parser
    )
    for name in COMMANDS:
        module = f"neugrasp_ros.cli.{name}"
        if importlib.util.find_spec(module) is not None:
            importlib.import_module(module).add_parser(commands)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return the exit code of the process."""
    args = build_parser().parse_args(arguments)
    try:
        return int(args.run(args))
    except NeuGraspError as error:
        print(f"neugrasp: {error}", file=sys.stderr)
        return FAILURE
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
