# SPDX-License-Identifier: Apache-2.0
"""The fast path against the literal one, on a network whose scene is known."""

from dataclasses import replace

import numpy as np
import pytest
from diamond import AFFORDING_NETWORK, diamond_network

from neugrasp_ros.benchmark import equivalence
from neugrasp_ros.benchmark.equivalence import (
    ScoreCheck,
    check_rays,
    check_scores,
    score_figures,
)
from neugrasp_ros.benchmark.shots import Shot
from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.geometry.transform import look_at
from neugrasp_ros.model import save_network
from neugrasp_ros.pipeline import GraspPlanner

CENTER, RADIUS = np.array([0.15, 0.15, 0.09]), 0.05  # [m]
NETWORK = replace(AFFORDING_NETWORK, affordances=(), resolution=64)  # as shipped


@pytest.fixture(scope="module")
def shot() -> Shot:
    """A camera above that sees the table around the diamond, and nothing in front."""
    pixels = Intrinsics.from_hfov(80, 80, 0.6)
    camera = look_at(np.array([0.15, 0.15, 0.8]), np.array([0.15, 0.15, 0.0]))
    depth = np.full((80, 80), 0.65, dtype=np.float32)
    return Shot(depth, pixels, camera, (0.3, 0.3, 0.3), CENTER[None])


@pytest.mark.slow
def test_rays_and_scores_agree_with_the_reference(shot, tmp_path):
    path = tmp_path / "diamond.safetensors"
    save_network(diamond_network(NETWORK, CENTER, RADIUS), path)
    planner = GraspPlanner(PlannerConfig(weights=str(path), gripper="panda", threads=1))
    found = check_rays(planner, [shot], n_rays=24576)
    found |= check_scores(planner, [shot], n_grasps=3)
    assert found["rays_same_hit"] >= 0.99
    assert found["rays_within_1_5_mm"] >= 0.99
    assert found["rays_median_mm"] < 0.01
    assert found["rays_met"] > 0.002
    assert found["scores_grasps"] == 3
    assert found["scores_mean_gap"] <= 0.02
    assert found["scores_p95_gap"] <= 0.08
    assert found["scores_best_as_good"] == 1.0


def test_scenes_are_pooled_by_grasp_and_those_without_any_do_not_count():
    checks = [ScoreCheck([0.0, 0.1, 0.2], 0.01), ScoreCheck([], 0.0)]
    found = score_figures([*checks, ScoreCheck([0.5], 0.04)])
    assert found["scores_scenes"] == 2
    assert found["scores_grasps"] == 4
    assert found["scores_mean_gap"] == pytest.approx(0.2)
    assert found["scores_best_as_good"] == 0.5
    assert found["scores_best_worst_gap"] == 0.04
    assert score_figures(checks[1:]) == {}


def test_only_scenes_that_are_not_known_are_compared(monkeypatch):
    draws, kept = {}, {}

    def compare_scores(fast, slow, shot, n_grasps, rng):
        draws[shot] = rng.random()
        return ScoreCheck([draws[shot]], 0.0)

    def check(**more):
        draws.clear()
        return check_scores(planner, ["a", "b", "c"], seed=5, **more)

    monkeypatch.setattr(equivalence, "compare_scores", compare_scores)
    monkeypatch.setattr(equivalence, "GraspPlanner", lambda *_: None)
    planner = type("Planner", (), {"config": PlannerConfig(), "gripper": None})
    whole = check(keep=kept.__setitem__)
    assert sorted(kept) == [0, 1, 2]
    assert check(known={0: kept[0], 2: kept[2]}) == whole
    assert list(draws) == ["b"]
