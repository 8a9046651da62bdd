# SPDX-License-Identifier: Apache-2.0
"""A picture of every failed attempt: what was seen, completed, chosen, and why not."""

from pathlib import Path

import numpy as np

from neugrasp_ros.benchmark.protocol import Attempt
from neugrasp_ros.benchmark.records import AttemptRecord
from neugrasp_ros.pictures.decision import Attempt as Outcome
from neugrasp_ros.pictures.decision import Decision, draw_decision
from sim_bridge.trial_result import (
    DISTURBED,
    EMPTY,
    PREGRASP_COLLISION,
    SLIPPED,
    SNAGGED,
    TABLE_CONTACT,
)
from sim_bridge.world import WORKSPACE_EDGE

SENTENCES = {
    PREGRASP_COLLISION: "collision before the approach",
    TABLE_CONTACT: "pressed on the table on approach",
    DISTURBED: "moved an object on approach",
    EMPTY: "closed on nothing",
    SLIPPED: "slipped in the lift",
    SNAGGED: "lifted, but caught on something",
}


class Album:
    """Watches a benchmark and draws the attempts that fail.

    Args:
        folder: Where the pictures go, one per failed attempt.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __call__(self, record: AttemptRecord, attempt: Attempt) -> None:
        """Draw an attempt unless it succeeded."""
        if record.success:
            return
        plan, look = attempt.plan, attempt.look
        sentence = SENTENCES[record.reason]
        name = f"round_{record.round_index:03d}_{record.number}_{record.reason}.png"
        draw_decision(
            Decision(
                depth=look.view.depth,
                surface=plan.surface,
                candidates=plan.candidates.poses,
                candidate_widths=plan.candidates.widths,
                grasps=plan.grasps.poses,
                widths=plan.grasps.widths,
                quality=plan.grasps.quality,
                lower=np.zeros(3),
                edge=WORKSPACE_EDGE,
            ),
            [Outcome(record.quality, record.opening, False, sentence)],
            look.gripper,
            self._folder / name,
            f"round {record.round_index}, attempt {record.number + 1}: {sentence}",
        )
