# SPDX-License-Identifier: Apache-2.0
"""Does the memory of the composed suite grow with its answers?"""

import sys
from collections.abc import Mapping, Sequence
from subprocess import Popen
from typing import Any

from neugrasp_ros.benchmark.speed import peak_memory_mb, resident_mb
from neugrasp_ros.cli.processes import keep_to_this_machine
from neugrasp_ros.cli.service_latency import asked, suite_commands
from neugrasp_ros.config import PlannerConfig

EARLY = 10  # the memory counts first up to this part of the detections
SAID = 10  # lines of progress
WINDOW = 50  # answers over which the memory's greatest counts: it goes up and down
PAUSE = 0.05  # [s] between two questions


def by_memory(
    shots: Sequence[Any], detections: int, config: PlannerConfig
) -> dict[str, Any]:
    """Run the suite in one process, ask it again and again, and read its memory.

    Args:
        shots: Scenes of one cube, of ``benchmark.shots``; they take turns.
        detections: Answers; the memory counts up to a tenth of them, and at the end.
        config: Of the suite's planner.

    Returns:
        ``memory_composed``: the suite's figures as of ``by_service``; its greatest
        resident memory over the ``WINDOW`` answers up to either number in [MB], their
        ratio, and the peak.

    Raises:
        NoAnswerError: If the suite does not come up, ends or stops answering.
    """
    keep_to_this_machine()
    early = max(detections // EARLY, 1)
    seen = dict.fromkeys((early, detections), 0.0)
    peak = 0.0

    def after(processes: Mapping[str, "Popen[str]"], answers: int) -> None:
        nonlocal peak
        (process,) = processes.values()
        for mark in seen:
            if mark - WINDOW < answers <= mark:
                seen[mark] = max(seen[mark], resident_mb(process.pid))
        if answers == detections:
            peak = peak_memory_mb(process.pid)
        if answers % max(detections // SAID, 1) == 0:
            now = resident_mb(process.pid)
            line = f"memory: {answers} of {detections} answers, {now:.0f} MB"
            print(line, file=sys.stderr, flush=True)

    commands = suite_commands(config, separate=False)
    figures = asked(commands, shots, detections, after, PAUSE)
    return {
        "memory_composed": {
            **figures,
            "detections_early": early,
            "detections_late": detections,
            "rss_early_mb": seen[early],
            "rss_late_mb": seen[detections],
            "rss_growth": seen[detections] / seen[early],
            "peak_mb": peak,
        }
    }
