# SPDX-License-Identifier: Apache-2.0
from types import SimpleNamespace

import numpy as np

from neugrasp_ros.benchmark.endurance import endure
from neugrasp_ros.benchmark.speed import resident_mb


class HoardingPlanner:
    """Keeps 40 MB of every decision."""

    resolution = 8

    def __init__(self) -> None:
        self.hoard: list[np.ndarray] = []
        self.revisions: list[int] = []

    def decide(self, volume, revision) -> None:
        self.hoard.append(np.ones(40 * 2**17))
        self.revisions.append(revision)


def test_a_growing_process_is_seen_to_grow():
    planner = HoardingPlanner()
    shots = [SimpleNamespace(fused=lambda resolution: resolution)] * 2
    before = resident_mb()
    found = endure(planner, shots, 2, 5)
    assert planner.revisions == list(range(1, 6))
    assert found["rss_early_mb"] > before
    assert 110 < found["rss_late_mb"] - found["rss_early_mb"] < 140
    assert found["rss_growth"] > 1
    assert found["endurance_peak_memory_mb"] >= found["rss_late_mb"] - 1
