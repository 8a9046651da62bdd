# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from neugrasp_ros.errors import ConfigError, EmptySceneError, ShapeError
from neugrasp_ros.fusion.tsdf import (
    TsdfVolume,
    empty_volume,
    integrate,
    seen_surface,
)
from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.geometry.mesh import box_mesh
from neugrasp_ros.geometry.raycast import MeshScene
from neugrasp_ros.geometry.transform import look_at, translation

EDGE = 0.3
SIZE = 32
VOXEL = EDGE / SIZE
WIDTH, HEIGHT = 320, 240
CAMERA = Intrinsics.from_hfov(WIDTH, HEIGHT, np.deg2rad(90))
ABOVE = look_at(np.array([0.15, 0.15, 0.6]), np.array([0.15, 0.15, 0.0]))
CENTER, RADIUS = np.array([0.15, 0.15, 0.12]), 0.06


def plane_depth(height: float) -> np.ndarray:
    return np.full((HEIGHT, WIDTH), ABOVE[2, 3] - height, dtype=np.float32)


def sphere_depth(T: np.ndarray) -> np.ndarray:
    """Exact depth image of the sphere, NaN beside it."""
    rays = CAMERA.ray_directions() @ T[:3, :3].T  # z-depth 1 each
    offset = T[:3, 3] - CENTER
    a, b = (rays**2).sum(axis=-1), rays @ offset
    inside = b**2 - a * (offset @ offset - RADIUS**2)
    near = (-b - np.sqrt(np.maximum(inside, 0))) / a
    return np.where(inside > 0, near, np.nan).astype(np.float32)


def voxel_centers() -> np.ndarray:
    axis = (np.arange(SIZE) + 0.5) * VOXEL
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)


def ring_of_cameras(elevation: float = 0.6) -> list[np.ndarray]:
    turns = 2 * np.pi * np.arange(6) / 6
    directions = np.stack(
        [
            np.cos(turns) * np.cos(elevation),
            np.sin(turns) * np.cos(elevation),
            np.full(6, np.sin(elevation)),
        ],
        axis=1,
    )
    return [look_at(CENTER + 0.5 * d, CENTER) for d in directions]


def test_distances_to_a_plane_are_those_along_the_rays():
    volume = integrate(empty_volume(SIZE), plane_depth(0.1), CAMERA, ABOVE)
    p = voxel_centers() - ABOVE[:3, 3]
    stretch = np.linalg.norm(p, axis=-1) / -p[..., 2]
    expected = (voxel_centers()[..., 2] - 0.1) * stretch / volume.truncation
    seen = expected > -1
    np.testing.assert_allclose(
        volume.distances[seen], np.minimum(expected, 1)[seen], atol=1e-4
    )
    assert np.isnan(volume.distances[~seen]).all()
    assert np.array_equal(volume.weights, seen.astype(np.uint8))
    assert volume.view_count == 1


def test_the_surface_of_a_plane_is_read_back():
    volume = integrate(empty_volume(SIZE), plane_depth(0.1), CAMERA, ABOVE)
    points, normals = seen_surface(volume)
    assert np.abs(points[:, 2] - 0.1).max() < 1e-4
    assert normals[:, 2].min() > 0.97
    assert len(np.unique(np.floor(points[:, :2] / VOXEL), axis=0)) > 0.9 * SIZE**2


def test_a_volume_that_is_seen_to_be_free_has_no_surface():
    free = np.ones((SIZE,) * 3, dtype=np.float32)
    volume = replace(empty_volume(SIZE), distances=free, view_count=1)
    points, normals = seen_surface(volume)
    assert points.shape == normals.shape == (0, 3)


def test_the_surface_of_a_sphere_seen_all_round_is_read_back():
    volume = empty_volume(SIZE)
    for T in ring_of_cameras():
        volume = integrate(volume, sphere_depth(T), CAMERA, T)
    points, normals = seen_surface(volume)
    outward = points - CENTER
    radii = np.linalg.norm(outward, axis=1)
    errors = np.abs(radii - RADIUS)
    assert np.median(errors) < 0.5 * VOXEL
    assert np.percentile(errors, 95) < 1.5 * VOXEL  # silhouettes blur its far side
    cosines = np.einsum("ij,ij->i", outward / radii[:, None], normals)
    assert np.median(cosines) > 0.95
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)


def test_the_surface_of_a_box_lies_on_the_faces_that_are_seen():
    scene = MeshScene(
        [box_mesh(np.array([0.05, 0.04, 0.05]))], translation(*CENTER)[None]
    )
    T = look_at(CENTER + [0.3, 0.0, 0.4], CENTER)
    volume = integrate(empty_volume(SIZE), scene.depth(CAMERA, T), CAMERA, T)
    points, _ = seen_surface(volume)
    gap = np.abs(points - CENTER) - [0.05, 0.04, 0.05]
    assert np.percentile(np.abs(gap.max(axis=1)), 90) < 0.5 * VOXEL
    assert (points[:, 0] > CENTER[0] - 0.05 - VOXEL).all()
    on_top = np.abs(points[:, 2] - CENTER[2] - 0.05) < 0.5 * VOXEL
    on_front = np.abs(points[:, 0] - CENTER[0] - 0.05) < 0.5 * VOXEL
    assert on_top.sum() > 60
    assert on_front.sum() > 60


def test_two_views_are_averaged():
    near, far = plane_depth(0.10), plane_depth(0.11)
    volume = empty_volume(SIZE)
    for depth in (near, far, far):
        volume = integrate(volume, depth, CAMERA, ABOVE)
    points, _ = seen_surface(volume)
    assert np.median(points[:, 2]) == pytest.approx((0.10 + 2 * 0.11) / 3, abs=2e-4)
    assert volume.weights.max() == 3
    assert volume.view_count == 3


@pytest.mark.parametrize("bad", [0.0, -0.5, np.nan, np.inf, -np.inf])
def test_what_was_not_measured_changes_nothing(bad):
    depth = plane_depth(0.1)
    depth[:, WIDTH // 2 :] = bad
    volume = integrate(empty_volume(SIZE), depth, CAMERA, ABOVE)
    depth[:, WIDTH // 2 :] = np.nan
    same = integrate(empty_volume(SIZE), depth, CAMERA, ABOVE)
    np.testing.assert_array_equal(volume.distances, same.distances)
    assert not volume.observed[SIZE // 2 + 1 :].any()  # +x is right in this image
    assert volume.observed[: SIZE // 2 - 1, :, -1].all()


def test_a_view_from_behind_or_beside_sees_nothing():
    up = look_at(np.array([0.15, 0.15, 0.6]), np.array([0.15, 0.15, 2.0]))
    volume = integrate(empty_volume(SIZE), plane_depth(0.1), CAMERA, up)
    assert not volume.observed.any()
    assert volume.view_count == 1


def test_inputs_are_left_alone():
    volume = integrate(empty_volume(SIZE), plane_depth(0.1), CAMERA, ABOVE)
    distances, weights = volume.distances.copy(), volume.weights.copy()
    depth, pose = plane_depth(0.2), ABOVE.copy()
    integrate(volume, depth, CAMERA, pose)
    np.testing.assert_array_equal(volume.distances, distances)
    np.testing.assert_array_equal(volume.weights, weights)
    np.testing.assert_array_equal(depth, plane_depth(0.2))
    np.testing.assert_array_equal(pose, ABOVE)


@pytest.mark.parametrize("decay", [False, True])
def test_only_decay_removes_the_ghost_of_an_object_taken_away(decay):
    volume = empty_volume(SIZE)
    for height in [0.15] * 20 + [0.06]:
        volume = integrate(volume, plane_depth(height), CAMERA, ABOVE, decay=decay)
    points, _ = seen_surface(volume)
    ghost = np.abs(points[:, 2] - 0.15) < 0.01
    assert ghost.any() != decay
    if decay:
        assert np.median(points[:, 2]) == pytest.approx(0.06, abs=0.002)


def test_decay_keeps_averaging_where_nothing_was_taken_away():
    volume = empty_volume(SIZE)
    for height in (0.10, 0.104):
        volume = integrate(volume, plane_depth(height), CAMERA, ABOVE, decay=True)
    assert np.median(seen_surface(volume)[0][:, 2]) == pytest.approx(0.102, abs=2e-4)


def test_weights_stop_at_their_greatest_value():
    full = empty_volume(8)
    distances = np.zeros_like(full.distances)
    weights = np.full_like(full.weights, 255)
    volume = TsdfVolume(distances, weights, full.voxel_size, full.truncation, 255)
    after = integrate(volume, plane_depth(0.1), CAMERA, ABOVE)
    assert after.weights.max() == 255
    assert np.isfinite(after.distances).all()


def test_a_volume_need_not_be_a_cube():
    volume = integrate(empty_volume((32, 16, 24)), plane_depth(0.1), CAMERA, ABOVE)
    np.testing.assert_allclose(volume.size, [0.3, 0.15, 0.225])
    assert volume.observed.any()


def test_no_image_means_no_surface():
    with pytest.raises(EmptySceneError, match="no depth image"):
        seen_surface(empty_volume(8))


@pytest.mark.parametrize("shape", [(320, 240), (240, 320, 1), (240,)])
def test_an_image_of_another_size_is_rejected(shape):
    with pytest.raises(ShapeError, match=r"expected shape \(240, 320\)"):
        integrate(empty_volume(8), np.ones(shape, np.float32), CAMERA, ABOVE)


@pytest.mark.parametrize("sizes", [(0, 0.3, 4.0), (8, 0.0, 4.0), (8, 0.3, -1.0)])
def test_a_volume_needs_positive_sizes(sizes):
    with pytest.raises(ConfigError, match="positive sizes"):
        empty_volume(*sizes)


@pytest.mark.parametrize(
    ("distances", "weights", "told"),
    [
        (np.zeros((4, 4)), np.zeros((4, 4)), "distances"),
        (np.zeros((4, 4, 4)), np.zeros((4, 4, 5)), "weights"),
    ],
)
def test_grids_of_a_volume_must_agree(distances, weights, told):
    with pytest.raises(ShapeError, match=told):
        TsdfVolume(distances, weights, 0.1, 0.4)
