# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import ConfigError, ShapeError
from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.geometry.mesh import box_mesh
from neugrasp_ros.geometry.raycast import MeshScene
from neugrasp_ros.geometry.transform import flip_gripper, invert, translation
from neugrasp_ros.grasp.collision import approach_is_free, support_clearance
from neugrasp_ros.grasp.sampling import SamplerConfig, sample_candidates

TABLE = 0.05
PANDA = load_gripper("panda")


def boxes(*placed):
    meshes = [box_mesh(np.array(half)) for half, _ in placed]
    poses = np.stack([translation(x, y, TABLE + h[2]) for h, (x, y) in placed])
    scene = MeshScene(meshes, poses)
    return scene.sample_surface(12000, np.random.default_rng(1))


def sample(cloud, gripper=PANDA, seed=0, height=TABLE, **kwargs):
    rng = np.random.default_rng(seed)
    config = SamplerConfig(**kwargs)
    return sample_candidates(*cloud, gripper, config, rng, support_height=height)


@pytest.fixture(scope="module")
def clutter():
    points, normals, bodies = boxes(
        ((0.02, 0.03, 0.06), (0.08, 0.08)),
        ((0.03, 0.02, 0.04), (0.22, 0.1)),
        ((0.025, 0.025, 0.01), (0.1, 0.22)),
        ((0.03, 0.03, 0.03), (0.22, 0.22)),
    )
    return points, normals, bodies


@pytest.mark.parametrize("name", ["panda", "robotiq_2f85"])
def test_clutter_gets_many_free_grasps_above_the_table(clutter, name):
    points, normals, bodies = clutter
    gripper = load_gripper(name)
    grasps = sample((points, normals), gripper)
    openings = np.full(len(grasps), gripper.max_opening)
    assert len(grasps) >= 128
    assert approach_is_free(grasps.poses, openings, points, gripper, 0.0).mean() > 0.97
    assert support_clearance(grasps.poses, openings, gripper, TABLE).min() > -1e-9
    assert (grasps.widths <= gripper.max_opening).all()
    gaps = np.linalg.norm(points[:, None] - grasps.poses[None, :, :3, 3], axis=-1)
    for body in range(4):
        assert gaps[bodies == body].min() < 0.03


def test_threads_find_the_same_grasps(clutter):
    alone, shared = (sample(clutter[:2], threads=threads) for threads in (1, 3))
    np.testing.assert_array_equal(alone.poses, shared.poses)
    np.testing.assert_array_equal(alone.widths, shared.widths)


def test_grasps_come_from_above_and_from_the_side(clutter):
    approach = sample(clutter[:2]).poses[:, 2, 2]
    assert (approach > -0.5).mean() > 0.15
    assert (approach < -0.9).mean() > 0.15
    assert approach.max() <= SamplerConfig().max_approach_z
    level = sample(clutter[:2], max_approach_z=-0.8).poses[:, 2, 2]
    assert level.max() <= -0.8


def test_no_two_grasps_are_the_same_or_twins(clutter):
    poses = sample(clutter[:2]).poses
    for others in (poses, flip_gripper(poses)):
        near = np.linalg.norm(poses[:, None, :3, 3] - others[None, :, :3, 3], axis=-1)
        relative = np.einsum("aji,bjk->abik", poses[:, :3, :3], others[:, :3, :3])
        cosine = (np.trace(relative, axis1=2, axis2=3) - 1) / 2
        same = (near < 0.0199) & (cosine > np.cos(0.349))
        assert not (same & ~np.eye(len(poses), dtype=bool)).any()


def test_jaws_are_centred_and_open_a_little_wider_than_the_box():
    points, normals, _ = boxes(((0.02, 0.06, 0.03), (0.15, 0.15)))
    grasps = sample((points, normals))
    straight = grasps.take(np.abs(grasps.poses[:, 0, 1]) > 0.999)
    assert len(straight) > 3
    assert (
        np.abs(straight.widths - 0.04 - 2 * SamplerConfig().width_margin).max() < 3e-3
    )
    centers = (invert(straight.poses) @ np.array([0.15, 0.15, 0.08, 1.0]))[:, 1]
    assert np.abs(centers).max() < 3e-3


def test_a_card_on_the_table_is_grasped_touching_the_table():
    points, normals, _ = boxes(((0.02, 0.03, 0.0025), (0.15, 0.15)))
    grasps = sample((points, normals))
    openings = np.full(len(grasps), PANDA.max_opening)
    clearance = support_clearance(grasps.poses, openings, PANDA, TABLE)
    assert len(grasps)
    assert clearance.min() > -1e-9
    assert clearance.max() < SamplerConfig().clearance


def test_what_does_not_fit_between_the_jaws_gives_nothing():
    points, normals, _ = boxes(((0.06, 0.06, 0.06), (0.15, 0.15)))
    assert len(sample((points, normals), min_alignment=0.8)) == 0  # edges are less
    assert len(sample((points[:0], normals[:0]))) == 0


def test_obstacles_are_avoided_and_not_grasped(clutter):
    points, normals, _ = boxes(((0.02, 0.02, 0.04), (0.15, 0.15)))
    wall, _, _ = boxes(((0.005, 0.1, 0.1), (0.21, 0.15)))
    rng = np.random.default_rng(0)
    grasps = sample_candidates(
        points, normals, PANDA, SamplerConfig(), rng,
        support_height=TABLE, obstacles=wall,
    )  # fmt: skip
    openings = np.full(len(grasps), PANDA.max_opening)
    assert len(grasps) > 10
    assert approach_is_free(grasps.poses, openings, wall, PANDA).all()
    assert np.linalg.norm(grasps.poses[:, :2, 3] - 0.15, axis=1).max() < 0.04


def test_half_closed_jaws_reach_into_a_gap():
    points, normals, _ = boxes(
        ((0.02, 0.02, 0.05), (0.1, 0.1)),
        ((0.02, 0.02, 0.05), (0.152, 0.1)),
        ((0.02, 0.02, 0.05), (0.1, 0.152)),
        ((0.02, 0.02, 0.05), (0.152, 0.152)),
    )
    openings = sample((points, normals), half_closed=True, width_margin=0.003)
    fully = np.full(len(openings), PANDA.max_opening)
    narrow = ~approach_is_free(openings.poses, fully, points, PANDA, 0.0015)
    assert narrow.sum() >= 3
    assert (openings.widths[narrow] < 0.075).all()


def test_one_visible_side_is_enough_when_asked_for():
    points, normals, _ = boxes(((0.02, 0.03, 0.05), (0.15, 0.15)))
    seen = normals @ np.array([0.6, 0.0, 0.8]) > 0.1
    cloud = points[seen], normals[seen]
    assert len(sample(cloud, one_sided=True)) > 2 * len(sample(cloud))


def test_the_same_seed_gives_the_same_grasps(clutter):
    one, two, other = (sample(clutter[:2], seed=seed) for seed in (4, 4, 5))
    np.testing.assert_array_equal(one.poses, two.poses)
    assert len(one) != len(other) or not np.array_equal(one.poses, other.poses)


def test_at_most_the_wanted_number_comes_back(clutter):
    assert len(sample(clutter[:2], max_candidates=20)) == 20


def test_wrong_shapes_and_settings_are_named(clutter):
    with pytest.raises(ShapeError, match="points, normals"):
        sample((clutter[0], clutter[1][:5]))
    with pytest.raises(ConfigError, match="n_seeds"):
        SamplerConfig(n_seeds=0)
    with pytest.raises(ConfigError, match="depth_fractions"):
        SamplerConfig(depth_fractions=(1.5,))
