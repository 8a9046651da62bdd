# SPDX-License-Identifier: Apache-2.0
"""What the robot must not hit: points that were seen, and boxes that are known."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.geometry.transform import apply
from neugrasp_ros.robot.bodies import Hulls, pack_hulls

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

CELL = 0.04  # [m]; of the grid that finds points near a link
MAX_CELLS = 2_000_000  # a stray point far away must not take the memory


class Obstacles(NamedTuple):
    """Obstacles in the base frame, sorted for quick questions.

    Attributes:
        points: Points in [m], cell by cell, shape (M, 3).
        starts: Where each cell's points begin, shape (X * Y * Z + 1,).
        origin: Lower corner of the cells in [m], shape (3,).
        cells: Number of cells along x, y, z, shape (3,).
        reach: Every obstacle surface is this near to a point, in [m].
        boxes: Solid boxes.
    """

    points: FloatArray
    starts: IntArray
    origin: FloatArray
    cells: IntArray
    reach: float
    boxes: Hulls


class SolidBox(NamedTuple):
    """A solid box, such as a table top.

    Attributes:
        T_base_box: Pose of its centre, shape (4, 4).
        size: Full edge lengths in [m], shape (3,).
    """

    T_base_box: FloatArray
    size: FloatArray


def make_obstacles(
    points_base: FloatArray | None = None,
    *,
    resolution: float = 0.005,
    boxes: Sequence[SolidBox] = (),
) -> Obstacles:
    """Sort obstacles for collision checks.

    Args:
        points_base: Surface points in the base frame in [m], shape (M, 3).
        resolution: Spacing of the points in [m]; denser ones are thinned to it.
        boxes: Solid boxes in the base frame.

    Raises:
        ShapeError: If the points are not (M, 3).
    """
    points = np.empty((0, 3)) if points_base is None else np.asarray(points_base)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ShapeError("scene points", "(M, 3)", points.shape)
    points = points[np.isfinite(points).all(axis=1)].astype(np.float64)
    hulls = pack_hulls([(-1, box.T_base_box, _corners(box.size)) for box in boxes])
    if not len(points):
        zero = np.zeros(3)
        return Obstacles(
            points, np.zeros(1, np.int64), zero, zero.astype(np.int64), 0.0, hulls
        )
    points = _thin(points, resolution)
    origin = points.min(axis=0)
    cells = np.floor((points.max(axis=0) - origin) / CELL).astype(np.int64) + 1
    if np.prod(cells.astype(float)) > MAX_CELLS:
        near = np.abs(points - np.median(points, axis=0)).max(axis=1) < 2.0
        return make_obstacles(points[near], resolution=resolution, boxes=boxes)
    index = np.floor((points - origin) / CELL).astype(np.int64)
    flat = (index[:, 0] * cells[1] + index[:, 1]) * cells[2] + index[:, 2]
    order = np.argsort(flat, kind="stable")
    counts = np.bincount(flat, minlength=int(np.prod(cells)))
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return Obstacles(points[order], starts, origin, cells, resolution / 2, hulls)


def surface_points(
    distances: NDArray[np.float32],
    voxel_size: float,
    T_base_task: FloatArray,
    *,
    unknown_is_solid: bool = False,
) -> FloatArray:
    """Return the surface that a volume of signed distances holds.

    A point lies where the distance changes its sign between neighbouring voxels that
    were both observed.

    Args:
        distances: Truncated signed distances, NaN = never observed, shape (X, Y, Z).
        voxel_size: Voxel edge in [m].
        T_base_task: Pose of the volume's corner, shape (4, 4).
        unknown_is_solid: Count the border of unobserved space as surface, too.

    Returns:
        Points in the base frame in [m], shape (M, 3).
    """
    found = []
    for axis in range(3):
        near = np.moveaxis(distances, axis, 0)[:-1]
        far = np.moveaxis(distances, axis, 0)[1:]
        crossing = np.argwhere((near > 0) != (far > 0))
        d0 = near[tuple(crossing.T)].astype(np.float64)
        d1 = far[tuple(crossing.T)].astype(np.float64)
        if unknown_is_solid:
            d0 = np.where(np.isnan(d0) & (d1 > 0), -1e-9, d0)
            d1 = np.where(np.isnan(d1) & (d0 > 0), -1e-9, d1)
        valid = np.isfinite(d0) & np.isfinite(d1) & ((d0 > 0) != (d1 > 0))
        points = crossing[valid] + 0.5
        points[:, 0] += (d0 / (d0 - d1))[valid]
        # undo moveaxis: the first column belongs to `axis`
        found.append(np.insert(points[:, 1:], axis, points[:, 0], axis=1))
    return apply(T_base_task, np.concatenate(found) * voxel_size)


def _thin(points: FloatArray, resolution: float) -> FloatArray:
    """Keep one point per voxel."""
    index = np.floor((points - points.min(axis=0)) / resolution).astype(np.int64)
    spans = index.max(axis=0) + 1
    flat = (index[:, 0] * spans[1] + index[:, 1]) * spans[2] + index[:, 2]
    return points[np.unique(flat, return_index=True)[1]]


def _corners(size: FloatArray) -> FloatArray:
    signs = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), axis=-1).reshape(-1, 3)
    return signs * np.asarray(size)
