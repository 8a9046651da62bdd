# SPDX-License-Identifier: Apache-2.0
"""A workspace of any size, covered by overlapping cubes of the network's size.

In: a volume's distances. Out: where the cubes lie, and one field from those of the
cubes. A workspace of the network's size is covered by one cube.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

NEAR_SURFACE = 0.5  # [truncation]; a voxel this near to a surface shows it
LEAST_VOXELS = 12  # fewer near a surface are noise, not a thing
BLEND = 8  # [voxel], width of the zone in which neighbouring cubes are mixed


def cover(shape: tuple[int, int, int], size: int, overlap: int) -> IntArray:
    """Place cubes evenly so that they cover a grid.

    Args:
        shape: Voxels of the grid along x, y, z.
        size: Voxels along a cube's edge; a smaller grid gets one cube.
        overlap: Voxels that neighbouring cubes share at least.

    Returns:
        Lower corners in [voxel], shape (B, 3).
    """
    starts = []
    for length in shape:
        way = max(length - size, 0)
        steps = -(-way // max(size - overlap, 1))
        starts.append(np.round(np.linspace(0, way, steps + 1)).astype(np.int64))
    return np.stack(np.meshgrid(*starts, indexing="ij"), axis=-1).reshape(-1, 3)


def cut(distances: Float32Array, corner: IntArray, size: int) -> Float32Array:
    """Return one cube (D, D, D) of a volume; what is beyond it was never observed."""
    x, y, z = (slice(int(c), int(c) + size) for c in corner)
    part = distances[x, y, z]
    if part.shape == (size,) * 3:
        return part
    cube = np.full((size,) * 3, np.nan, dtype=np.float32)
    cube[tuple(slice(0, n) for n in part.shape)] = part
    return cube


def centrality(positions: FloatArray, corners: IntArray, size: int) -> FloatArray:
    """Tell how deep positions lie in cubes.

    Args:
        positions: In [voxel], shape (N, 3).
        corners: Lower corners of the cubes in [voxel], shape (B, 3).
        size: Voxels along a cube's edge.

    Returns:
        Distance from the cube's border in [voxel], negative outside, shape (N, B).
    """
    local = positions[:, None] - corners
    return np.asarray(np.minimum(local, size - local).min(axis=-1))


def busy(
    distances: Float32Array, corners: IntArray, size: int, floor: float
) -> BoolArray:
    """Tell which cubes are needed: those in whose middle something was seen.

    A thing that several cubes see is left to the one in which it lies deepest.

    Args:
        distances: The volume in units of truncation, NaN = never observed.
        corners: Lower corners of the cubes in [voxel], shape (B, 3).
        size: Voxels along a cube's edge.
        floor: Height in [voxel]; what is lower is the support.

    Returns:
        Shape (B,).
    """
    if len(corners) == 1:
        return np.ones(1, dtype=bool)
    first = int(np.ceil(floor))
    seen = np.argwhere(np.abs(distances[:, :, first:]) < NEAR_SURFACE)
    if not len(seen):
        return np.zeros(len(corners), dtype=bool)
    depth = centrality(seen + [0.5, 0.5, first + 0.5], corners, size)
    counts = np.bincount(depth.argmax(axis=1), minlength=len(corners))
    return np.asarray(counts >= LEAST_VOXELS)


def blend_shares(
    corners: IntArray, size: int, shape: tuple[int, int, int]
) -> list[Float32Array]:
    """Return how much each cube counts at its samples; the cubes' shares add up to 1.

    A cube counts fully in its middle and fades out over ``BLEND`` voxels about the
    middle of what it shares with a neighbour; where it is alone it counts to its end.

    Args:
        corners: Lower corners of the cubes in [voxel], shape (B, 3).
        size: Voxels along a cube's edge, D.
        shape: Samples of the whole.

    Returns:
        Shapes (D, D, D).
    """
    weights = [_weight(corner, corners, size) for corner in corners]
    total = np.zeros(shape, dtype=np.float32)
    for weight, corner in zip(weights, corners, strict=True):
        region, inside = _overlap(corner, size, shape)
        total[region] += weight[inside]
    for weight, corner in zip(weights, corners, strict=True):
        region, inside = _overlap(corner, size, shape)
        weight[inside] /= total[region]
    return weights


def shares_at(positions: FloatArray, corners: IntArray, size: int) -> Float32Array:
    """Return how much each cube counts at positions, as ``blend_shares`` does.

    Args:
        positions: In [voxel], shape (N, 3).
        corners: Lower corners of the cubes in [voxel], shape (B, 3).
        size: Voxels along a cube's edge.

    Returns:
        Shape (N, B); rows add up to 1, or to 0 where no cube lies.
    """
    weights = np.zeros((len(positions), len(corners)), dtype=np.float32)
    for number, corner in enumerate(corners):
        local = positions - corner
        rows = np.flatnonzero(((local >= 0) & (local <= size)).all(axis=1))
        weight = np.ones(len(rows), dtype=np.float32)
        for axis in range(3):
            weight *= _profile(local[rows, axis], axis, corner, corners, size)
        weights[rows, number] = weight
    total = weights.sum(axis=1, keepdims=True)
    return np.divide(weights, total, out=weights, where=total > 0)


def _weight(corner: IntArray, corners: IntArray, size: int) -> Float32Array:
    """Return a cube's weight before it is compared with the others', (D, D, D)."""
    at = np.arange(size, dtype=np.float64) + 0.5
    x, y, z = (_profile(at, axis, corner, corners, size) for axis in range(3))
    return np.asarray(x[:, None, None] * y[None, :, None] * z)


def _profile(
    at: FloatArray, axis: int, corner: IntArray, corners: IntArray, size: int
) -> Float32Array:
    """Return a cube's weight along one axis at coordinates (N,) in it, in [voxel]."""
    profile = np.ones(len(at), dtype=np.float32)
    places = np.unique(corners[:, axis])
    place = int(np.searchsorted(places, corner[axis]))
    if place > 0:
        profile *= _ramp(at, (places[place - 1] + size - corner[axis]) / 2)
    if place + 1 < len(places):
        shared = corner[axis] + size - places[place + 1]
        profile *= _ramp(size - at, shared / 2)
    return profile


def _ramp(distance: FloatArray, middle: float) -> Float32Array:
    """Rise from nearly 0 to 1 over ``BLEND`` voxels around ``middle``."""
    rise = (distance - middle) / BLEND + 0.5
    return np.clip(rise, 1e-3, 1.0).astype(np.float32)


def _overlap(
    corner: IntArray, size: int, shape: tuple[int, int, int]
) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Return where a cube lies in the whole, and which part of it does."""
    ends = [min(int(c) + size, n) for c, n in zip(corner, shape, strict=True)]
    region = tuple(slice(int(c), e) for c, e in zip(corner, ends, strict=True))
    return region, tuple(slice(0, r.stop - r.start) for r in region)


def merge_fields(
    fields: Sequence[Float32Array],
    shares: Sequence[Float32Array],
    corners: IntArray,
    shape: tuple[int, int, int],
    empty: float,
) -> Float32Array:
    """Mix the cubes' fields into one.

    Args:
        fields: Samples of each cube, shapes (D, D, D).
        shares: Of ``blend_shares``.
        corners: Lower corners of the cubes in [voxel], shape (B, 3).
        shape: Samples of the whole.
        empty: Value where no cube lies.

    Returns:
        The mean of the cubes at each sample, shape ``shape``.
    """
    mixed = np.zeros(shape, dtype=np.float32)
    covered = np.zeros(shape, dtype=bool)
    for values, share, corner in zip(fields, shares, corners, strict=True):
        region, inside = _overlap(corner, len(values), shape)
        mixed[region] += values[inside] * share[inside]
        covered[region] = True
    return np.where(covered, mixed, np.float32(empty))
