# SPDX-License-Identifier: Apache-2.0
"""Does the memory of a process grow with its detections?"""

from collections.abc import Sequence

from neugrasp_ros.benchmark.shots import Shot
from neugrasp_ros.benchmark.speed import peak_memory_mb, resident_mb
from neugrasp_ros.pipeline import GraspPlanner


def endure(
    planner: GraspPlanner, shots: Sequence[Shot], early: int, late: int
) -> dict[str, float]:
    """Decide again and again, each time on another view.

    Args:
        planner: The planner.
        shots: Views that take turns.
        early: Decisions before the memory is read first.
        late: Decisions before it is read again.

    Returns:
        Resident memory after either number in [MB], their ratio, and the peak.
    """
    resident = {}
    volumes = [shot.fused(planner.resolution) for shot in shots]
    for done in range(1, late + 1):
        planner.decide(volumes[done % len(volumes)], done)
        if done in (early, late):
            resident[done] = resident_mb()
    return {
        "detections_early": early,
        "detections_late": late,
        "rss_early_mb": resident[early],
        "rss_late_mb": resident[late],
        "rss_growth": resident[late] / resident[early],
        "endurance_peak_memory_mb": peak_memory_mb(),
    }
