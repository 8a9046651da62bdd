# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.geometry.grid import ScalarGrid, march

SPACING = 0.3 / 64
CENTER = np.array([0.15, 0.14, 0.16])
RADIUS = 0.07


def centers(size: int = 64) -> np.ndarray:
    axis = (np.arange(size) + 0.5) * 0.3 / size
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)


@pytest.fixture(scope="module")
def sphere() -> ScalarGrid:
    distance = RADIUS - np.linalg.norm(centers() - CENTER, axis=-1)
    return ScalarGrid(np.clip(100 * distance, -8, 8), SPACING)


def rays_onto(points: np.ndarray, rng: np.random.Generator):
    """Rays from a larger sphere to points."""
    origins = rng.normal(size=points.shape)
    origins = CENTER + 0.5 * origins / np.linalg.norm(origins, axis=1, keepdims=True)
    ways = points - origins
    return origins, ways / np.linalg.norm(ways, axis=1, keepdims=True)


def sphere_distances(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Solve ``|origin + t direction - center| = radius`` for the nearer t."""
    offset = origins - CENTER
    b = np.einsum("ij,ij->i", offset, directions)
    inside = b**2 - (offset**2).sum(axis=1) + RADIUS**2
    return np.where(inside > 0, -b - np.sqrt(np.maximum(inside, 0)), np.nan)


def test_a_linear_field_is_interpolated_exactly():
    slope, base = np.array([3.0, -2.0, 0.5]), 0.7
    grid = ScalarGrid(centers(8) @ slope + base, 0.3 / 8)
    points = np.random.default_rng(0).uniform(0.02, 0.28, (5, 20, 3))
    np.testing.assert_allclose(grid.sample(points), points @ slope + base, atol=1e-5)


def test_a_field_goes_on_as_at_its_border():
    grid = ScalarGrid(np.random.default_rng(0).normal(size=(4, 5, 6)), 0.1)
    assert grid.sample(np.array([-1.0, -1.0, -1.0])) == grid.values[0, 0, 0]
    far = grid.sample(np.array([9.0, 9.0, 9.0]))
    assert far == pytest.approx(grid.values[-1, -1, -1], abs=1e-4)
    np.testing.assert_allclose(grid.size, [0.4, 0.5, 0.6])


def test_normals_of_a_sphere_point_outwards(sphere):
    directions = np.random.default_rng(0).normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    normals = sphere.normals(CENTER + RADIUS * directions)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-6)
    assert np.einsum("ij,ij->i", normals, directions).min() > 0.999


def test_normals_agree_with_finite_differences(sphere):
    points = CENTER + np.random.default_rng(1).uniform(-0.05, 0.05, (50, 3))
    steps = SPACING * np.eye(3)
    slopes = np.stack(
        [sphere.sample(points - s) - sphere.sample(points + s) for s in steps], axis=1
    )
    slopes = slopes / np.linalg.norm(slopes, axis=1, keepdims=True)
    np.testing.assert_allclose(sphere.normals(points), slopes, atol=1e-4)


def test_marching_meets_a_sphere_within_a_fifth_of_a_millimetre(sphere):
    rng = np.random.default_rng(0)
    origins, directions = rays_onto(CENTER + rng.normal(0, 0.03, (500, 3)), rng)
    truth = sphere_distances(origins, directions)
    offset = np.linalg.norm(np.cross(origins - CENTER, directions), axis=1)
    clear = offset < 0.9 * RADIUS  # a grazing ray's distance has no bound
    found = march(sphere, origins, directions)
    assert clear.sum() > 400
    assert np.abs(found[clear] - truth[clear]).max() < 2e-4
    met = origins[clear] + found[clear, None] * directions[clear]
    assert np.abs(np.linalg.norm(met - CENTER, axis=1) - RADIUS).max() < 2e-4


def test_rays_that_miss_give_nan(sphere):
    rng = np.random.default_rng(2)
    origins, directions = rays_onto(CENTER + rng.normal(0, 0.2, (300, 3)), rng)
    offset = np.linalg.norm(np.cross(origins - CENTER, directions), axis=1)
    ahead = np.einsum("ij,ij->i", CENTER - origins, directions) > 0
    misses = (offset > 1.02 * RADIUS) | ~ahead
    assert misses.sum() > 50
    assert np.isnan(march(sphere, origins, directions)[misses]).all()


def test_rays_past_the_cube_or_away_from_it_give_nan(sphere):
    origins = np.array([[-0.1, 5.0, 0.1], [-0.1, 0.14, 0.16], [0.15, 0.14, 1.0]])
    directions = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.isnan(march(sphere, origins, directions)).all()


def test_a_ray_that_starts_inside_gives_nothing(sphere):
    directions = np.random.default_rng(0).normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    assert np.isnan(march(sphere, np.tile(CENTER, (20, 1)), directions)).all()


def test_a_thin_wall_is_met_from_both_sides():
    values = np.full((32, 32, 32), -8.0)
    values[16] = 8.0
    grid = ScalarGrid(values, 0.01)
    origins = np.array([[-1.0, 0.155, 0.155], [1.0, 0.155, 0.155]])
    directions = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    np.testing.assert_allclose(
        march(grid, origins, directions), [1.16, 0.83], atol=1e-6
    )


def test_threads_give_the_same(sphere):
    rng = np.random.default_rng(3)
    origins, directions = rays_onto(CENTER + rng.normal(0, 0.05, (333, 3)), rng)
    alone = march(sphere, origins, directions)
    assert np.array_equal(
        alone, march(sphere, origins, directions, threads=3), equal_nan=True
    )


def test_marching_leaves_its_inputs_alone(sphere):
    origins, directions = rays_onto(np.tile(CENTER, (3, 1)), np.random.default_rng(0))
    before = sphere.values.copy(), origins.copy(), directions.copy()
    march(sphere, origins, directions)
    for kept, now in zip(before, (sphere.values, origins, directions), strict=True):
        assert np.array_equal(kept, now)


def test_leaping_misses_nothing_that_small_steps_meet():
    rng = np.random.default_rng(4)
    values = np.full((24, 20, 16), -8.0)
    values[tuple(rng.integers(3, 13, (3, 12)))] = 6.0
    grid = ScalarGrid(values, 0.01)
    targets = (np.argwhere(values > 0) + 0.5)[rng.integers(12, size=300)] * 0.01
    origins = rng.uniform(-0.1, 0.3, (300, 3))
    directions = targets + rng.normal(0, 0.004, (300, 3)) - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found = march(grid, origins, directions, step=0.0005)
    along = np.arange(0, 0.6, 0.0005)
    points = origins[:, None] + along[:, None] * directions[:, None]
    inside = (grid.sample(points) > 0) & ((points > 0) & (points < grid.size)).all(-1)
    first = np.where(inside.any(1), along[inside.argmax(1)], np.nan)
    both = np.isfinite(found) & np.isfinite(first)
    assert both.sum() > 100
    assert np.abs(found - first)[both].max() < 0.001
    assert (np.isfinite(found) != np.isfinite(first)).mean() < 0.02


def test_rays_of_unlike_number_are_rejected(sphere):
    with pytest.raises(ShapeError, match=r"two \(R, 3\)"):
        march(sphere, np.zeros((2, 3)), np.zeros((3, 3)))


@pytest.mark.parametrize("shape", [(4, 4), (4, 4, 1), (0, 4, 4)])
def test_a_grid_needs_two_samples_along_three_axes(shape):
    with pytest.raises(ShapeError, match="values"):
        ScalarGrid(np.zeros(shape), 0.1)


def test_normals_compare_values_as_far_apart_as_told():
    values = np.zeros((16, 4, 4))
    values[8:] = 1.0  # a step at x = 0.08
    near, wide = ScalarGrid(values, 0.01), ScalarGrid(values, 0.01, normal_reach=0.03)
    point = np.array([[0.06, 0.02, 0.02]])
    np.testing.assert_allclose(near.normals(point), 0.0)
    np.testing.assert_allclose(wide.normals(point), [[-1.0, 0.0, 0.0]])
