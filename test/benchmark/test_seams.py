# SPDX-License-Identifier: Apache-2.0
"""A scene in the middle of four cubes, and answers that come back from there."""

import numpy as np
import pytest

from neugrasp_ros.benchmark.policies import make_policy
from neugrasp_ros.benchmark.protocol import Plan, Round, Suite
from neugrasp_ros.benchmark.seams import (
    EXTRA_VOXELS,
    SHIFT,
    VOXELS,
    moved_back,
    moved_look,
)
from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.grasp.types import GraspSet
from neugrasp_ros.pipeline import GraspPlanner
from neugrasp_ros.scene.cubes import centrality, cover
from sim_bridge.world import World


def test_four_cubes_are_equally_far_from_the_middle_of_the_scene():
    wide = VOXELS + EXTRA_VOXELS
    corners = cover((wide, wide, VOXELS), VOXELS, round(0.1 / 0.3 * VOXELS))
    assert len(corners) == 4
    middle = np.array([[wide / 2, wide / 2, VOXELS / 2]])
    assert np.ptp(centrality(middle, corners, VOXELS)) == 0
    assert wide / 2 / VOXELS * 0.3 == pytest.approx(0.15 + SHIFT)


@pytest.fixture(scope="module")
def look():
    with World() as world:
        round_ = Round(Suite(seed=3), 0, world)
        round_.build()
        yield round_.look()


def test_what_failed_and_what_is_answered_move_with_the_camera(look):
    bad = translation(0.1, 0.2, 0.08)
    moved = moved_look(look._replace(failed=(bad,)))
    step = moved.view.T_task_camera[:3, 3] - look.view.T_task_camera[:3, 3]
    np.testing.assert_allclose(step, [SHIFT, SHIFT, 0])
    grasps = GraspSet(np.stack(moved.failed), np.array([0.08]))
    back = moved_back(Plan(grasps, surface=moved.failed[0][:3, 3][None]))
    np.testing.assert_allclose(back.grasps.poses[0], bad)
    np.testing.assert_allclose(back.surface[0], bad[:3, 3])


def test_grasps_at_the_seams_lie_on_the_objects(look):
    plans = [
        make_policy(name, PlannerConfig(threads=1))(look, np.random.default_rng(0))
        for name in ("neugrasp", "seams")
    ]
    assert all(len(plan.grasps) for plan in plans)
    alone, seams = (plan.grasps.poses[:, :3, 3] for plan in plans)
    gaps = np.linalg.norm(seams[:, None] - alone, axis=2).min(axis=1)
    assert np.median(gaps) < 0.02


def test_without_scene_render_nothing_is_completed_to_sample_on(look, monkeypatch):
    choose = make_policy("no_scene_render", PlannerConfig(threads=1))
    monkeypatch.delattr(GraspPlanner, "render")
    plan = choose(look, np.random.default_rng(0))
    assert len(plan.grasps)
    assert len(plan.surface)
