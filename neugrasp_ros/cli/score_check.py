# SPDX-License-Identifier: Apache-2.0
"""The scores' comparison of ``neugrasp profile``: long, so it can be stopped."""

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from neugrasp_ros.benchmark.equivalence import ScoreCheck, check_scores
from neugrasp_ros.benchmark.report import source_commit
from neugrasp_ros.benchmark.scene_notes import SceneNotes

SETTINGS = ("seed", "grasps", "candidates", "gripper")


def score_notes_path(report: Path) -> Path:
    """Return where scenes are written down on the way to a report."""
    return report.with_suffix(".scores.jsonl")


def noted_scores(
    args: argparse.Namespace, planner: Any, shots: Sequence[Any]
) -> dict[str, float]:
    """Compare scores; write down each scene beside ``--json``, and say how long yet.

    A run that was stopped goes on with the scenes that its file lacks.

    Args:
        args: Of the command.
        planner: The fast planner.
        shots: Scenes of one cube.

    Returns:
        As of ``check_scores``.
    """
    about = {name: getattr(args, name) for name in SETTINGS}
    about |= {"data": str(args.data), "weights": planner.weights_sha256}
    about["commit"] = source_commit()
    notes = SceneNotes(score_notes_path(args.json) if args.json else None, about)
    known = {number: ScoreCheck(*kept) for number, kept in notes.known.items()}
    before, start = len(known), time.monotonic()

    def keep(number: int, check: ScoreCheck) -> None:
        notes.keep(number, check)
        seconds = (time.monotonic() - start) / (len(notes.known) - before)
        left = sum(other not in notes.known for other in range(len(shots)))
        print(
            f"scores: {len(shots) - left} of {len(shots)} scenes, "
            f"{seconds:.1f} s each, {left * seconds / 60:.1f} min left",
            file=sys.stderr,
            flush=True,
        )

    return check_scores(
        planner, shots, n_grasps=args.grasps, seed=args.seed, known=known, keep=keep
    )
