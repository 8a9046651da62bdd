# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from neugrasp_ros.config import RenderConfig
from neugrasp_ros.geometry.grid import ScalarGrid
from neugrasp_ros.scene import rendering
from neugrasp_ros.scene.rendering import render_surface, scene_cameras, thin

EDGE, SIZE = 0.3, 48
CENTER, RADIUS = np.array([0.15, 0.15, 0.12]), 0.06
CONFIG = RenderConfig()


@pytest.fixture(scope="module")
def sphere() -> ScalarGrid:
    axis = (np.arange(SIZE) + 0.5) * EDGE / SIZE
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    distance = RADIUS - np.linalg.norm(points - CENTER, axis=-1)
    return ScalarGrid(np.clip(100 * distance, -8, 8), EDGE / SIZE)


def test_cameras_stand_round_the_cube_and_look_at_its_axis():
    poses = scene_cameras(CONFIG, np.full(3, EDGE))
    eyes, views = poses[:, :3, 3], poses[:, :3, 2]
    target = np.array([0.15, 0.15, 0.075])
    np.testing.assert_allclose(eyes + CONFIG.radius * views, [target] * 6)
    np.testing.assert_allclose(np.arcsin(-views[:, 2]), np.deg2rad(60.0))
    np.testing.assert_allclose((eyes - target).mean(axis=0)[:2], 0.0, atol=1e-12)
    gaps = np.linalg.norm(np.diff(eyes, axis=0), axis=1)
    np.testing.assert_allclose(gaps, gaps[0])


def test_the_rendered_sphere_is_a_sphere_with_its_normals(sphere):
    points, normals = render_surface(sphere, CONFIG)
    outward = points - CENTER
    radii = np.linalg.norm(outward, axis=1)
    assert np.abs(radii - RADIUS).max() < 5e-4
    cosines = np.einsum("ij,ij->i", outward / radii[:, None], normals)
    assert cosines.min() > 0.99
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)


def test_the_sphere_is_covered_but_for_its_foot(sphere):
    points, _ = render_surface(sphere, CONFIG)
    rng = np.random.default_rng(0)
    wanted = rng.normal(size=(300, 3))
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    wanted = wanted[wanted[:, 2] > 0.2] * RADIUS + CENTER
    gaps = np.linalg.norm(wanted[:, None] - points[None], axis=-1).min(axis=1)
    assert gaps.max() < 0.015
    lowest = CENTER[2] - RADIUS * np.sin(np.deg2rad(30))  # behind it at 60 degrees
    assert points[:, 2].min() > lowest - 0.002


def test_boxes_of_one_size_share_their_rays(sphere):
    lows = [np.full(3, low) for low in (0.0, 0.1, 0.15)]
    boxes = [(low, low + 0.12) for low in lows]
    assert len({tuple(high - low) for low, high in boxes}) > 1  # by rounding
    rendering._scene_rays.cache_clear()
    render_surface(sphere, CONFIG, boxes=boxes)
    assert rendering._scene_rays.cache_info().misses == 1


def test_points_keep_their_spacing(sphere):
    coarse, _ = render_surface(sphere, replace(CONFIG, point_spacing=0.02))
    fine, _ = render_surface(sphere, CONFIG)
    cells = np.floor(coarse / 0.02)
    assert len(np.unique(cells, axis=0)) == len(cells)
    assert len(fine) > 2 * len(coarse)


def test_threads_render_the_same(sphere):
    alone, shared = (render_surface(sphere, CONFIG, threads=n)[0] for n in (1, 3))
    assert np.array_equal(alone, shared)


@pytest.mark.parametrize("value", [-8.0, 8.0])
def test_nothing_and_everything_have_no_surface(value):
    points, normals = render_surface(ScalarGrid(np.full((8,) * 3, value), 0.04), CONFIG)
    assert points.shape == (0, 3)
    assert normals.shape == (0, 3)


def test_thinning_keeps_the_first_of_each_cell_in_order():
    points = np.array(
        [[0.019, 0, 0], [0.001, 0, 0], [0.011, 0, 0], [0.0, 0.0, 0.05], [0.009, 0, 0]]
    )
    kept = thin(points, 0.01)
    assert np.array_equal(kept, points[[0, 1, 3]])


def test_thinning_twice_changes_nothing_more():
    points = np.random.default_rng(0).uniform(0, 0.3, (500, 3))
    once = thin(points, 0.03)
    assert len(once) < 500
    assert np.array_equal(thin(once, 0.03), once)
