# SPDX-License-Identifier: Apache-2.0
"""The literal ray search against a sphere."""

import numpy as np
import pytest

from neugrasp_ros.geometry.ray_search import (
    first_crossings,
    outward_normals,
    refine_crossings,
)

CENTER = np.array([0.15, 0.14, 0.16])
RADIUS = 0.05


def depth(points: np.ndarray) -> np.ndarray:
    return RADIUS - np.linalg.norm(points - CENTER, axis=1)


def occupancy(points: np.ndarray) -> np.ndarray:
    return 1 / (1 + np.exp(-200 * depth(points)))


@pytest.fixture
def rays():
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return CENTER - 0.3 * directions, directions


def test_a_ray_to_the_centre_meets_the_sphere_in_front_of_it(rays):
    found = first_crossings(occupancy, *rays, np.linspace(0.01, 0.5, 60))
    np.testing.assert_allclose(found, 0.3 - RADIUS, atol=1e-4)


def test_rays_that_miss_or_start_inside_give_nan(rays):
    origins, directions = rays
    away = first_crossings(occupancy, origins, -directions, np.linspace(0, 0.5, 60))
    inside = first_crossings(
        occupancy, np.tile(CENTER, (50, 1)), directions, np.linspace(0, 0.5, 60)
    )
    assert np.isnan(away).all()
    assert np.isnan(inside).all()


def test_every_sample_of_every_ray_is_asked_and_each_hit_is_refined(rays):
    asked = []

    def counting(points):
        asked.append(len(points))
        return occupancy(points)

    first_crossings(counting, *rays, np.linspace(0.01, 0.5, 60), secant_steps=3)
    assert asked == [50 * 60, 50, 50, 50]


def test_no_rays_meet_nothing():
    none = np.zeros((0, 3))
    assert first_crossings(occupancy, none, none, np.linspace(0, 1, 5)).shape == (0,)


def test_normals_of_a_sphere_point_outwards(rays):
    _, directions = rays
    found = outward_normals(depth, CENTER + RADIUS * directions, 0.002)
    np.testing.assert_allclose(found, directions, atol=1e-3)


def test_refining_moves_points_onto_the_surface(rays):
    _, directions = rays
    rng = np.random.default_rng(1)
    off = RADIUS + rng.uniform(-0.003, 0.003, (50, 1))
    near = CENTER + off * directions
    found = refine_crossings(depth, near, -directions, 0.004)
    assert np.abs(depth(found)).max() < 1e-5
    steep = refine_crossings(
        lambda p: np.tanh(2000 * depth(p)), near, -directions, 0.004
    )
    assert np.abs(depth(steep)).max() < 1e-3


def test_what_does_not_bracket_the_surface_stays(rays):
    _, directions = rays
    far = CENTER + 0.2 * directions
    np.testing.assert_array_equal(refine_crossings(depth, far, -directions, 0.004), far)
