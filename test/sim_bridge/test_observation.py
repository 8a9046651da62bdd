# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from sim_shapes import box_model, looking_down, standing

from neugrasp_ros.errors import UnknownNameError
from neugrasp_ros.geometry.camera import Intrinsics
from sim_bridge.observation import (
    TABLE_BODY,
    VIEWS,
    draw_view,
    mesh_scene,
    observe,
    world_meshes,
)

SMALL = Intrinsics(64, 48, 54.0, 54.0, 32.0, 24.0)


def polar_angle(pose):
    offset = pose[:3, 3] - [0.15, 0.15, 0.0]
    return np.rad2deg(np.arccos(offset[2] / np.linalg.norm(offset)))


def test_the_fixed_view_is_the_benchmarks():
    pose = draw_view("fixed", np.random.default_rng(0))
    expected = [0.15 + 0.6 * np.sin(np.pi / 6), 0.15, 0.6 * np.cos(np.pi / 6)]
    np.testing.assert_allclose(pose[:3, 3], expected)
    to_center = np.array([0.15, 0.15, 0.0]) - pose[:3, 3]
    np.testing.assert_allclose(pose[:3, 2], to_center / 0.6)
    assert pose[2, 1] < 0  # image down is world down


@pytest.mark.parametrize(
    ("view", "lower", "upper"), [("random", 15, 75), ("hard", 75, 75), ("train", 0, 75)]
)
def test_views_fill_their_range(view, lower, upper):
    rng = np.random.default_rng(1)
    poses = [draw_view(view, rng) for _ in range(300)]
    angles = np.array([polar_angle(pose) for pose in poses])
    radii = [np.linalg.norm(pose[:3, 3] - [0.15, 0.15, 0.0]) for pose in poses]
    assert angles.min() >= lower - 1e-6 and angles.max() <= upper + 1e-6
    assert np.ptp(angles) >= 0.95 * (upper - lower)
    assert min(radii) >= 0.48 - 1e-9 and max(radii) <= 0.72 + 1e-9


def test_only_training_and_strict_views_walk_around_the_table():
    rng = np.random.default_rng(2)
    tests = [draw_view("random", rng)[1, 3] for _ in range(20)]
    np.testing.assert_allclose(tests, 0.15)
    assert np.ptp([draw_view("random", rng, any_azimuth=True)[1, 3] for _ in range(20)])
    assert np.ptp([draw_view("train", rng)[1, 3] for _ in range(20)])


def test_a_box_is_seen_where_the_physics_has_it_with_and_without_the_table(make_world):
    world = make_world()
    world.load_object(box_model(0.04, 0.04, 0.02), standing(0.02))
    above = looking_down(0.15, 0.15, 0.59)
    rng = np.random.default_rng(0)
    for table in (True, False):
        scene = mesh_scene(world_meshes(world), table=table)
        view = observe(scene, above, rng, intrinsics=SMALL)
        assert abs(view.depth[24, 32] - 0.5) < 1e-4
        bodies = scene.segmentation(SMALL, above)
        assert bodies[24, 32] == 0
        assert bodies[2, 2] == (TABLE_BODY if table else -1)
        if table:
            assert abs(view.depth[2, 2] - 0.54) < 1e-4
        else:
            assert np.isnan(view.depth[2, 2])


def test_strict_noise_is_small_and_drops_pixels_only_at_edges(make_world):
    world = make_world()
    world.load_object(box_model(0.04, 0.04, 0.04), standing(0.04))
    scene = mesh_scene(world_meshes(world), table=True)
    above = looking_down(0.15, 0.15, 0.59)
    clean = observe(scene, above, np.random.default_rng(0), intrinsics=SMALL).depth
    noisy = observe(
        scene, above, np.random.default_rng(0), noise="strict", intrinsics=SMALL
    ).depth
    error = np.abs(noisy - clean)[np.isfinite(noisy)]
    assert 0.0005 < error.mean() < 0.02
    dropped = np.isnan(noisy)
    assert 0 < dropped.sum() < 0.2 * dropped.size
    assert not dropped[22:27, 30:35].any()


def test_noise_is_reproducible_and_unknown_names_are_errors(make_world):
    scene = mesh_scene(world_meshes(make_world()), table=True)
    pose = draw_view("fixed", np.random.default_rng(0))
    images = [
        observe(
            scene, pose, np.random.default_rng(5), noise="mod_dex", intrinsics=SMALL
        )
        for _ in range(2)
    ]
    np.testing.assert_array_equal(images[0].depth, images[1].depth)
    with pytest.raises(UnknownNameError, match="fog"):
        observe(scene, pose, np.random.default_rng(0), noise="fog")
    with pytest.raises(UnknownNameError, match="top"):
        draw_view("top", np.random.default_rng(0))
    assert set(VIEWS) == {"fixed", "random", "hard", "train"}
