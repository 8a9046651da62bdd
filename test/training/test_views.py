# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.geometry.mesh import box_mesh
from neugrasp_ros.geometry.raycast import MeshScene
from neugrasp_ros.geometry.transform import look_at, translation
from neugrasp_ros.training.views import (
    EDGE,
    TABLE_TOP,
    ViewRange,
    dequantise,
    quantise,
    random_camera,
    render_volume,
    sample_occupancy,
)

HALF = np.array([0.03, 0.02, 0.025])
CENTER = np.array([0.15, 0.15, TABLE_TOP + 0.025])
CLEAN = ViewRange(noise=(1.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def box() -> MeshScene:
    return MeshScene([box_mesh(HALF)], translation(*CENTER)[None])


def test_quantised_distances_come_back_to_a_step():
    rng = np.random.default_rng(0)
    distances = rng.uniform(-1, 1, (6, 6, 6)).astype(np.float32)
    distances[0], distances[1, 0, 0], distances[1, 0, 1] = np.nan, -1.0, 1.0
    stored = quantise(distances)
    back = dequantise(stored)
    assert stored.dtype == np.int8
    assert back.dtype == np.float32
    np.testing.assert_array_equal(np.isnan(back), np.isnan(distances))
    known = ~np.isnan(distances)
    assert np.abs(back - distances)[known].max() <= 0.5 / 127 + 1e-6
    assert (back[1, 0, 0], back[1, 0, 1]) == (-1.0, 1.0)
    np.testing.assert_array_equal(quantise(back), stored)


def test_cameras_cover_the_range_and_look_at_the_foot_of_the_axis():
    views, rng = ViewRange(), np.random.default_rng(0)
    poses = np.stack([random_camera(views, rng) for _ in range(300)])
    offsets = poses[:, :3, 3] - [EDGE / 2, EDGE / 2, 0.0]
    radii = np.linalg.norm(offsets, axis=1)
    polar = np.arccos(offsets[:, 2] / radii)
    azimuth = np.arctan2(offsets[:, 1], offsets[:, 0])
    for values, (low, high) in (
        (radii, views.radius), (polar, views.polar), (azimuth, (-np.pi, np.pi)),
    ):  # fmt: skip
        assert low - 1e-9 <= values.min() < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < values.max() <= high + 1e-9
    np.testing.assert_allclose(poses[:, :3, 2], -offsets / radii[:, None], atol=1e-9)


def test_a_clean_view_of_a_box_has_its_faces_at_zero(box):
    T = look_at(np.array([0.15, 0.15, 0.7]), np.array([0.15, 0.15, 0.0]))
    distances = render_volume(box, T, CLEAN, np.random.default_rng(0), resolution=32)
    column = distances[16, 16]
    heights = (np.arange(32) + 0.5) * EDGE / 32 - (CENTER[2] + HALF[2])
    expected = np.clip(heights / (4 * EDGE / 32), None, 1.0)
    seen = expected > -1
    np.testing.assert_allclose(column[seen], expected[seen], atol=0.02)
    assert np.isnan(column[~seen]).all()


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_views_follow_the_seed_and_noise_changes_them(box, kind):
    views = ViewRange(noise=tuple(float(i == kind) for i in range(3)))
    T = look_at(np.array([0.3, 0.1, 0.6]), CENTER)
    first, second, clean = (
        render_volume(box, T, v, np.random.default_rng(4), resolution=16)
        for v in (views, views, CLEAN)
    )
    np.testing.assert_array_equal(first, second)
    assert np.array_equal(first, clean, equal_nan=True) == (kind == 0)


def test_occupancy_is_that_of_the_box(box):
    samples = sample_occupancy(box, 2000, np.random.default_rng(0))
    points = samples.points * EDGE
    inside = (np.abs(points - CENTER) < HALF).all(axis=1)
    edge = np.abs((np.abs(points - CENTER) - HALF).max(axis=1)) < 1e-5
    assert samples.points.shape == (2000, 3)
    assert ((samples.points >= 0) & (samples.points <= 1)).all()
    assert np.array_equal(samples.occupied[~edge], inside[~edge])
    assert 0.15 < samples.occupied.mean() < 0.6


def test_half_of_the_points_are_near_the_surface_and_a_quarter_anywhere(box):
    points = sample_occupancy(box, 4000, np.random.default_rng(0)).points * EDGE
    beyond = np.maximum(np.abs(points - CENTER) - HALF, 0)
    far = np.linalg.norm(beyond, axis=1) > 0.035
    assert far.mean() == pytest.approx(0.25, abs=0.05)


def test_a_scene_of_nothing_is_empty_everywhere():
    nothing = MeshScene([], np.zeros((0, 4, 4)))
    samples = sample_occupancy(nothing, 100, np.random.default_rng(0))
    assert samples.points.shape == (100, 3)
    assert not samples.occupied.any()
