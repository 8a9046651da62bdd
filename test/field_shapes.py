# SPDX-License-Identifier: Apache-2.0
"""Occupancy fields of known shape, and hands in them."""

import numpy as np

from neugrasp_ros.geometry.grid import ScalarGrid
from neugrasp_ros.geometry.transform import make_transform, random_rotation

EDGE, SIZE = 0.3, 64
SLOPE = 150.0  # [logit/m]
LIMIT = 8.0  # [logit]


def grid_points(size: int = SIZE) -> np.ndarray:
    axis = (np.arange(size) + 0.5) * EDGE / size
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)


def field_of(depth: np.ndarray) -> ScalarGrid:
    """Field from the depth inside a shape in [m] at ``grid_points()``."""
    return ScalarGrid(np.clip(SLOPE * depth, -LIMIT, LIMIT), EDGE / len(depth))


def sphere_field(center: np.ndarray, radius: float) -> ScalarGrid:
    return field_of(radius - np.linalg.norm(grid_points() - center, axis=-1))


def box_field(center: np.ndarray, half_extents: np.ndarray) -> ScalarGrid:
    return field_of((half_extents - np.abs(grid_points() - center)).min(axis=-1))


def hand_at(position: np.ndarray, approach: np.ndarray, closing: np.ndarray):
    """Pose of a hand from where it comes and how it closes (made orthogonal to it)."""
    z = np.asarray(approach, dtype=float) / np.linalg.norm(approach)
    y = np.asarray(closing, dtype=float)
    y = y - (y @ z) * z
    y = y / np.linalg.norm(y)
    return make_transform(np.stack([np.cross(y, z), y, z], axis=-1), position)


def random_hands(center: np.ndarray, count: int, rng: np.random.Generator):
    """Poses whose TCPs lie within 1 cm of a point along each axis."""
    rotations = np.stack([random_rotation(rng) for _ in range(count)])
    return make_transform(rotations, center + rng.uniform(-0.01, 0.01, (count, 3)))
