# SPDX-License-Identifier: Apache-2.0
"""The figures of a benchmark, as a line for people and as JSON for the record."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp_ros.benchmark.metrics import summarize
from neugrasp_ros.benchmark.protocol import Suite
from neugrasp_ros.benchmark.records import RoundRecord
from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.model import (
    default_weights,
    file_sha256,
    load_network,
    quality_sha256,
)


def say(rounds: Sequence[RoundRecord], n_rounds: int) -> str:
    """Return one line about the rounds so far."""
    attempts = sum(len(r.attempts) for r in rounds)
    successes = sum(r.n_successes for r in rounds)
    objects = sum(r.n_counted for r in rounds)
    return (
        f"round {len(rounds)}/{n_rounds}: {successes}/{attempts} attempts, "
        f"{successes}/{objects} objects, last ended: {rounds[-1].ended}"
    )


def source_commit() -> str:
    """Return the commit of the source tree; empty outside a checkout or without git."""
    try:
        answer = subprocess.run(
            ["git", "rev-parse", "--short", "HEAD"],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            check=False,
        )
    except OSError:
        return ""
    return answer.stdout.strip()


def figures(
    suite: Suite,
    policy: str,
    rounds: Sequence[RoundRecord],
    weights: str,
    command: str,
) -> dict[str, Any]:
    """Return everything that a reader needs to believe, or repeat, the figures.

    Args:
        suite: What was benchmarked.
        policy: Who chose the grasps.
        rounds: What came of it.
        weights: Weights file; empty for the shipped one.
        command: The command line that was run.
    """
    path = Path(weights) if weights else default_weights()
    settings = asdict(suite) | {
        "objects": os.path.basename(suite.objects),
        "gripper": load_gripper(suite.gripper).name,
    }
    return {
        **summarize(rounds, np.random.default_rng(0)),
        **{f"suite_{k}" if k == "objects" else k: v for k, v in settings.items()},
        "policy": policy,
        "weights_sha256": file_sha256(path),
        "quality_sha256": quality_sha256(load_network(path)[0]),
        "command": without_folders(command),
        "commit": source_commit(),
    }


def command_line() -> str:
    """Return the command that this process runs, as reports have it."""
    return without_folders("neugrasp " + " ".join(sys.argv[1:]))


def without_folders(command: str) -> str:
    """Return a command line that names this machine's folders no more."""
    return re.sub(r"(?<![\w.$-])/[^\s,:]*/", "$DIR/", command)


def write_report(path: Path, result: dict[str, Any]) -> None:
    """Write figures as JSON, one key a line; the file appears only when it is whole."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    part.write_text(json.dumps(result, indent=1, sort_keys=True) + "\n")
    os.replace(part, path)
