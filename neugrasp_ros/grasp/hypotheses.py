# SPDX-License-Identifier: Apache-2.0
"""Where hands start from: seed points, facing contacts, oriented hands around them."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from neugrasp_ros.geometry.transform import make_transform

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Contacts(NamedTuple):
    """Pairs of facing surface points.

    Attributes:
        seeds: Index of the first contact's seed, shape (K,).
        middles: Midpoints in [m], shape (K, 3).
        axes: Unit vectors from the first to the second contact, shape (K, 3).
        distances: Between the contacts in [m], shape (K,).
    """

    seeds: IntArray
    middles: FloatArray
    axes: FloatArray
    distances: FloatArray


def thin(points: FloatArray, voxel: float, rng: np.random.Generator) -> IntArray:
    """Return the indices of one random point per voxel, shape (M,)."""
    order = rng.permutation(len(points))
    cells = np.floor(points[order] / voxel).astype(np.int64)
    cells -= cells.min(axis=0)
    keys = (cells[:, 0] * (cells[:, 1].max() + 1) + cells[:, 1]) * (
        cells[:, 2].max() + 1
    ) + cells[:, 2]
    return np.asarray(order[np.unique(keys, return_index=True)[1]])


@njit(cache=True, nogil=True)
def _farthest(points: FloatArray, first: int, n_wanted: int) -> IntArray:
    chosen = np.empty(n_wanted, dtype=np.int64)
    gaps = np.full(len(points), np.inf)
    current = first
    for k in range(n_wanted):
        chosen[k] = current
        furthest = -1.0
        following = 0
        for i in range(len(points)):
            dx = points[i, 0] - points[current, 0]
            dy = points[i, 1] - points[current, 1]
            dz = points[i, 2] - points[current, 2]
            gaps[i] = min(gaps[i], dx * dx + dy * dy + dz * dz)
            if gaps[i] > furthest:
                furthest = gaps[i]
                following = i
        current = following
    return chosen


def choose_seeds(
    points: FloatArray, n_seeds: int, rng: np.random.Generator
) -> IntArray:
    """Choose seed points: half as far from each other as possible, half at random.

    The first half gives every object its seeds, however small; left alone it prefers
    edges and corners, which the second half makes up for.

    Args:
        points: Surface points in [m], shape (N, 3).
        n_seeds: How many to choose.
        rng: Source of randomness.

    Returns:
        Indices, shape (min(n_seeds, N),).
    """
    n_far = min((n_seeds + 1) // 2, len(points))
    far = _farthest(points, int(rng.integers(len(points))), n_far)
    rest = rng.permutation(np.setdiff1d(np.arange(len(points)), far))
    return np.concatenate([far, rest[: max(0, n_seeds - n_far)]])


@njit(cache=True, nogil=True)
def _opposite(
    cloud: FloatArray, seeds: IntArray, reach: float, radius: float, min_cosine: float
) -> IntArray:
    partners = np.full(len(seeds), -1, dtype=np.int64)
    for s in range(len(seeds)):
        p = cloud[seeds[s]]
        best = min_cosine
        for i in range(len(cloud)):
            dx = p[0] - cloud[i, 0]
            dy = p[1] - cloud[i, 1]
            dz = p[2] - cloud[i, 2]
            along = dx * p[3] + dy * p[4] + dz * p[5]
            if not 0.002 < along < reach:
                continue
            if dx * dx + dy * dy + dz * dz - along * along > radius * radius:
                continue
            facing = -(p[3] * cloud[i, 3] + p[4] * cloud[i, 4] + p[5] * cloud[i, 5])
            if facing > best:
                best = facing
                partners[s] = i
    return partners


def facing_contacts(
    cloud: FloatArray, seeds: IntArray, reach: float, radius: float, max_angle: float
) -> Contacts:
    """Find for every seed the surface point that faces it through the object.

    Args:
        cloud: Points in [m] and outward unit normals, shape (N, 6).
        seeds: Indices of the first contacts, shape (S,).
        reach: Greatest distance of the contacts in [m].
        radius: How far from the seed's inward normal the second contact may lie, [m].
        max_angle: Between the two contacts' normals, one reversed, in [rad].
    """
    partners = _opposite(cloud, seeds, reach, radius, float(np.cos(max_angle)))
    found = np.flatnonzero(partners >= 0)
    first, second = cloud[seeds[found], :3], cloud[partners[found], :3]
    distances = np.linalg.norm(second - first, axis=1)
    axes = (second - first) / distances[:, None]
    return Contacts(found, (first + second) / 2, axes, distances)


def perpendicular(axes: FloatArray) -> FloatArray:
    """Return a unit vector at a right angle to each axis, shape (K, 3)."""
    helper = np.where(np.abs(axes[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    side = np.cross(axes, helper)
    return np.asarray(side / np.linalg.norm(side, axis=1, keepdims=True))


def hands_around(
    middles: FloatArray, axes: FloatArray, n_rolls: int, rng: np.random.Generator
) -> FloatArray:
    """Place hands that close along given axes, coming from all around them.

    Args:
        middles: TCPs in [m], shape (K, 3).
        axes: Closing directions, unit, shape (K, 3).
        n_rolls: Even steps over the whole turn; where they start is random.
        rng: Source of randomness.

    Returns:
        Poses ``T_task_hand``, shape (K, n_rolls, 4, 4).
    """
    steps = 2 * np.pi / n_rolls * np.arange(n_rolls)
    angles = rng.random((len(axes), 1)) * 2 * np.pi / n_rolls + steps
    u = perpendicular(axes)
    v = np.cross(axes, u)
    z = np.cos(angles)[..., None] * u[:, None] + np.sin(angles)[..., None] * v[:, None]
    y = np.broadcast_to(axes[:, None], z.shape)
    return make_transform(np.stack([np.cross(y, z), y, z], axis=-1), middles[:, None])


def hands_onto(
    points: FloatArray,
    normals: FloatArray,
    tilts: FloatArray,
    n_yaws: int,
    rng: np.random.Generator,
) -> FloatArray:
    """Place hands that come down on surface points along the tilted inward normal.

    Args:
        points: In [m], shape (S, 3).
        normals: Outward, unit, shape (S, 3).
        tilts: Rotation vectors in the hand's frame, applied last, [rad], shape (K, 3).
        n_yaws: Even steps of the jaws over half a turn; the start is random.
        rng: Source of randomness.

    Returns:
        Poses ``T_task_hand``, shape (S, n_yaws * K, 4, 4).
    """
    z = -normals
    x = perpendicular(z)
    upright = np.stack([x, np.cross(z, x), z], axis=-1)
    yaws = np.pi / n_yaws * (rng.random((len(points), 1)) + np.arange(n_yaws))
    cos, sin, zero = np.cos(yaws), np.sin(yaws), np.zeros_like(yaws)
    turn = np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, zero + 1], axis=-1)
    tilt = rotation_matrices(tilts)
    turned = upright[:, None] @ turn.reshape(*yaws.shape, 3, 3)
    rotations = turned[:, :, None] @ tilt
    flat = rotations.reshape(len(points), -1, 3, 3)
    return make_transform(flat, points[:, None])


def rotation_matrices(vectors: FloatArray) -> FloatArray:
    """Return the matrices of rotation vectors by Rodrigues' formula, (K, 3, 3)."""
    angles = np.linalg.norm(vectors, axis=-1)[..., None, None]
    axes = vectors / np.maximum(angles[..., 0], 1e-12)
    cross = np.zeros((*vectors.shape[:-1], 3, 3))
    cross[..., 0, 1], cross[..., 0, 2] = -axes[..., 2], axes[..., 1]
    cross[..., 1, 0], cross[..., 1, 2] = axes[..., 2], -axes[..., 0]
    cross[..., 2, 0], cross[..., 2, 1] = -axes[..., 1], axes[..., 0]
    return np.asarray(
        np.eye(3) + np.sin(angles) * cross + (1 - np.cos(angles)) * cross @ cross
    )
