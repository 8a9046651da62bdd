# SPDX-License-Identifier: Apache-2.0
"""``neugrasp demo``: clear a seeded table in the simulator, over real ROS."""

import argparse
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from threading import Event, Thread
from typing import Any

from neugrasp_ros.cli.detect import count
from neugrasp_ros.cli.processes import (
    PATIENCE,
    SIGNALS,
    keep_to_this_machine,
    stop_on_signals,
)

SUITE = (sys.executable, "-m", "neugrasp_ros.cli.main", "up", "--sim")
STOP_TIMEOUT = PATIENCE * len(SIGNALS) + 5.0  # [s]; the suite has processes of its own
STOPPED = 130  # exit code, as of a command that Ctrl-C ended


def add_parser(
    subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]",
) -> None:
    """Add the command and its options."""
    parser = subparsers.add_parser(
        "demo", help="clear a seeded table in the simulator; exit 0 if a grasp held"
    )
    parser.add_argument("--seed", type=count, default=0)
    parser.add_argument(
        "--scene",
        help="pile, the default, or packed; with --robot tiago also table, shelf, "
        "cupboard, or such as shelf:packed",
    )  # fmt: skip
    parser.add_argument("--objects", type=count, default=5)
    parser.add_argument(
        "--robot", choices=("gripper", "tiago"), default="gripper",
        help="a gripper alone, which is quick, or the whole TIAGo++",
    )  # fmt: skip
    parser.add_argument("--separate", action="store_true", help="one process per node")
    parser.add_argument(
        "--affordance", default="",
        help="such as pour: affordance objects, each class asked for, this one tried",
    )  # fmt: skip
    parser.add_argument("--picture", type=Path, default=Path("out/demo.png"))
    parser.add_argument(
        "-p", "--param", metavar="NODE:NAME:=VALUE", action="append", default=[],
        help="set a parameter of the suite",
    )  # fmt: skip
    parser.add_argument("--json", type=Path, help="write the attempts here, too")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Start the suite, clear the table, print the attempts; 0 if one lifted.

    Raises:
        ConfigError: If options do not go together.
    """
    from neugrasp_ros.benchmark.report import command_line, source_commit
    from neugrasp_ros.errors import ConfigError
    from neugrasp_ros.model import default_weights, file_sha256

    if args.affordance and args.robot == "gripper" and args.scene:
        raise ConfigError(
            "--affordance has a scene of its own with --robot gripper: leave out "
            f"--scene {args.scene}"
        )
    if not default_weights().is_file():
        print(f"there are no trained weights at {default_weights()} yet: no demo")
        return 1
    domain = keep_to_this_machine()
    print(f"starting the suite (ROS_DOMAIN_ID {domain}) ...", flush=True)
    args.picture.parent.mkdir(parents=True, exist_ok=True)
    log_path = args.picture.with_suffix(".log")
    with stop_on_signals() as stopping, log_path.open("w") as log:
        suite = subprocess.Popen(
            [*SUITE, *_options(args)],
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        done, died = Event(), Event()
        watch = (suite, stopping, done, died)
        Thread(target=_watch, args=watch, daemon=True).start()
        try:
            result = _clear(args, stopping)
        finally:
            done.set()
            _stop(suite)
    if died.is_set():
        if "error" in result:  # else the demonstration had ended before it
            code = suite.returncode
            print(f"failed: the suite ended with exit code {code}, see {log_path}")
            return 1
    elif stopping.is_set():
        print("stopped")
        return STOPPED
    if args.json:
        result["weights_sha256"] = file_sha256(default_weights())
        result["commit"] = source_commit()
        result["command"] = command_line()
        args.json.parent.mkdir(parents=True, exist_ok=True)
        args.json.write_text(json.dumps(result, indent=1) + "\n")
    print(f"log of the suite: {log_path}")
    if "error" in result:
        print(f"failed: {result['error']}")
    print(
        f"lifted {result['lifted']} of {result['objects']} objects "
        f"in {len(result['attempts'])} attempts"
    )
    return 0 if result["lifted"] else 1


def _options(args: argparse.Namespace) -> list[str]:
    """Return the options of ``neugrasp up`` for a demonstration."""
    options = ["--separate"] if args.separate else []
    if args.robot == "tiago":
        options.append("--execute")
    for parameter in args.param:
        options += ["-p", parameter]
    return options


def _clear(args: argparse.Namespace, stopping: Event) -> dict[str, Any]:
    if args.affordance and args.robot == "gripper":
        return _ask(args, stopping)
    from neugrasp_ros.nodes.demo_client import DemoScene
    from neugrasp_ros.nodes.demo_run import run_demo

    return run_demo(
        DemoScene(
            kind=args.scene or "pile",
            seed=args.seed,
            n_objects=args.objects,
            affordance=args.affordance,
        ),
        picture=args.picture,
        robot=args.robot == "tiago",
        say=lambda line: print(line, flush=True),
        stopping=stopping,
    )


def _ask(args: argparse.Namespace, stopping: Event) -> dict[str, Any]:
    from neugrasp_ros.nodes.affordance_demo import run_affordance_demo

    return run_affordance_demo(
        seed=args.seed,
        n_objects=args.objects,
        query=args.affordance,
        picture=args.picture,
        say=lambda line: print(line, flush=True),
        stopping=stopping,
    )


def _watch(
    suite: "subprocess.Popen[bytes]", stopping: Event, done: Event, died: Event
) -> None:
    """Stop the demonstration where its suite ends before it is done."""
    suite.wait()
    if not (done.is_set() or stopping.is_set()):
        died.set()
        stopping.set()


def _stop(suite: "subprocess.Popen[bytes]") -> None:
    """Ask the suite to end; insist when it does not."""
    for sign in (signal.SIGINT, signal.SIGKILL):
        if suite.poll() is None:
            os.killpg(suite.pid, sign)
            try:
                suite.wait(STOP_TIMEOUT)
            except subprocess.TimeoutExpired:
                continue
