# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.robot.obstacles import (
    CELL,
    SolidBox,
    make_obstacles,
    surface_points,
)


def test_points_stand_cell_by_cell(rng):
    points = rng.uniform([0, 0, 0], [0.5, 0.4, 0.3], (2000, 3))
    obstacles = make_obstacles(points, resolution=1e-4)
    assert len(obstacles.points) == 2000
    assert obstacles.starts[-1] == 2000
    index = np.floor((obstacles.points - obstacles.origin) / CELL).astype(int)
    flat = (index[:, 0] * obstacles.cells[1] + index[:, 1]) * obstacles.cells[2]
    flat += index[:, 2]
    for cell in rng.integers(0, len(obstacles.starts) - 1, 50):
        inside = np.arange(obstacles.starts[cell], obstacles.starts[cell + 1])
        assert np.array_equal(np.flatnonzero(flat == cell), inside)


def test_dense_points_are_thinned_to_the_resolution():
    x = np.arange(0, 0.1, 0.001)
    points = np.stack(np.meshgrid(x, x, [0.0]), axis=-1).reshape(-1, 3)
    obstacles = make_obstacles(points, resolution=0.01)
    assert 90 <= len(obstacles.points) <= 121
    assert obstacles.reach == 0.005


def test_points_that_are_not_finite_are_left_out():
    points = np.array([[0, 0, 0], [np.nan, 0, 0], [0, np.inf, 0]])
    assert len(make_obstacles(points).points) == 1


def test_a_stray_point_does_not_take_the_memory(rng):
    points = rng.uniform(0, 0.3, (500, 3))
    obstacles = make_obstacles(np.vstack([points, [[1e6, 0, 0]]]), resolution=1e-4)
    assert np.prod(obstacles.cells) < 1000
    assert len(obstacles.points) == 500


def test_nothing_is_an_empty_scene():
    obstacles = make_obstacles()
    assert len(obstacles.points) == 0
    assert len(obstacles.boxes.radii) == 0


def test_a_box_has_its_eight_corners():
    T = np.eye(4)
    T[:3, 3] = 1.0, 2.0, 3.0
    boxes = make_obstacles(boxes=[SolidBox(T, np.array([0.2, 0.4, 0.6]))]).boxes
    assert boxes.centers[0] == pytest.approx([1, 2, 3])
    assert boxes.halves[0] == pytest.approx([0.1, 0.2, 0.3])
    assert len(boxes.vertices) == 8
    assert boxes.vertices.max(axis=0) == pytest.approx([1.1, 2.2, 3.3])


def test_points_of_another_shape_are_refused():
    with pytest.raises(ShapeError, match="scene points"):
        make_obstacles(np.zeros((3, 2)))


def sphere_distances(size=24, voxel=0.01, truncation=0.04):
    grid = (
        np.stack(np.meshgrid(*[np.arange(size)] * 3, indexing="ij"), -1) + 0.5
    ) * voxel
    distance = np.linalg.norm(grid - 0.12, axis=-1) - 0.08
    values = np.clip(distance / truncation, -1, 1)
    values[distance < -truncation] = np.nan
    return values.astype(np.float32), voxel


def test_the_surface_of_a_sphere_is_found():
    distances, voxel = sphere_distances()
    T = np.eye(4)
    T[:3, 3] = 1.0, -2.0, 0.5
    points = surface_points(distances, voxel, T)
    radii = np.linalg.norm(points - T[:3, 3] - 0.12, axis=1)
    assert len(points) > 500
    assert np.abs(radii - 0.08).max() < 1e-3
    above = points[:, 2] - 0.5 > 0.12
    assert 0.4 < above.mean() < 0.6


def test_unknown_space_is_free_or_solid_as_asked():
    distances = np.full((10, 10, 10), 1.0, dtype=np.float32)
    distances[:, :, :4] = np.nan  # never seen
    free = surface_points(distances, 0.01, np.eye(4))
    solid = surface_points(distances, 0.01, np.eye(4), unknown_is_solid=True)
    assert len(free) == 0
    assert len(solid) == 100
    assert solid[:, 2] == pytest.approx(0.035)  # at the centre of the last unknown


def test_an_unseen_volume_has_no_surface():
    nothing = np.full((8, 8, 8), np.nan, dtype=np.float32)
    assert len(surface_points(nothing, 0.01, np.eye(4), unknown_is_solid=True)) == 0
