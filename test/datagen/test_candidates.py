# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.datagen.candidates import (
    DRAWN,
    CandidateConfig,
    draw_candidates,
    is_side,
)
from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.geometry.mesh import box_mesh
from neugrasp_ros.geometry.raycast import MeshScene
from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.grasp.collision import approach_is_free, support_clearance

TABLE = 0.05


def scene():
    halves = np.array([[0.02, 0.02, 0.06], [0.02, 0.03, 0.04]])
    poses = [translation(0.1, 0.1, 0.11), translation(0.2, 0.2, 0.09)]
    return MeshScene([box_mesh(h) for h in halves], np.stack(poses))


def draw(name="panda", seed=0, **changes):
    rng = np.random.default_rng(seed)
    config = CandidateConfig(**changes)
    return draw_candidates(scene(), load_gripper(name), TABLE, config, rng)


@pytest.mark.parametrize("name", ["panda", "robotiq_2f85"])
def test_the_mix_has_the_wanted_numbers_and_sources(name):
    gripper = load_gripper(name)
    found = draw(name, n_trials=60, n_collisions=20)
    assert 50 <= (~found.blocked).sum() <= 64
    counts = np.bincount(found.sources[~found.blocked], minlength=len(DRAWN))
    np.testing.assert_allclose(counts / 60, CandidateConfig().shares, atol=0.06)
    assert is_side(found.poses).mean() >= 0.25
    openings = np.full(len(found.poses), gripper.max_opening)
    clearance = support_clearance(found.poses, openings, gripper, TABLE)
    assert clearance.min() > -CandidateConfig().table_overlap
    assert found.poses[:, 2, 2].max() <= CandidateConfig().max_approach_z


def test_blocked_grasps_are_those_whose_pregrasp_is_inside_something():
    found = draw(n_trials=40, n_collisions=20)
    points, _, _ = scene().sample_surface(30000, np.random.default_rng(9))
    gripper = load_gripper("panda")
    pregrasps = found.poses @ translation(0.0, 0.0, -0.05)
    openings = np.full(len(pregrasps), gripper.max_opening)
    free = approach_is_free(pregrasps, openings, points, gripper, 0.001, 0.0)
    assert (free == ~found.blocked).mean() > 0.9


def test_the_same_seed_draws_the_same_grasps():
    np.testing.assert_array_equal(draw(seed=3).poses, draw(seed=3).poses)
    assert not np.array_equal(draw(seed=3).poses[:5], draw(seed=4).poses[:5])


def test_side_is_beyond_sixty_degrees_from_straight_down():
    poses = np.stack([np.eye(4)] * 3)
    poses[:, 2, 2] = -np.cos(np.radians([0.0, 59.0, 61.0]))
    assert is_side(poses).tolist() == [False, False, True]
