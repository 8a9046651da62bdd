# SPDX-License-Identifier: Apache-2.0
"""A workspace found in a depth image: the support plane and what stands on it.

In: measured points in a frame whose z is up. Out: a box for the volume. The one place
that uses Open3D for planes.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import EmptySceneError
from neugrasp_ros.geometry.open3d_engine import o3d

FloatArray = NDArray[np.float64]

SPACING = 0.01  # [m], one point per cell is enough for a plane
PLANE_NOISE = 0.012  # [m], points this near belong to the plane
LEVEL_COSINE = 0.97  # a plane more than 14 degrees off level supports nothing
PLANES_TRIED = 4  # walls and cupboards may be larger than the table
LEAST_POINTS = 30  # of a plane
LEAST_THINGS = 10  # cells of things: the smallest that a hand can hold show as many
ABOVE = 0.015  # [m], what reaches less far above the plane is the plane
BELOW = 0.05  # [m], of the support plane above the workspace's floor
MARGIN = 0.08  # [m], beside and above what stands there
LEAST_EDGE = 0.3  # [m], the network's cube
LARGEST = np.array([1.2, 0.8, 0.4])  # [m]


class FoundWorkspace(NamedTuple):
    """A box for the volume, level, with the axes of the points' frame.

    Attributes:
        origin: Lower corner in [m], shape (3,).
        size: Edges in [m], shape (3,).
        support: Height of the support plane in [m]; 5 cm above the lower corner.
    """

    origin: FloatArray
    size: FloatArray
    support: float


def find_workspace(points: FloatArray) -> FoundWorkspace:
    """Find what stands on the largest level plane.

    Args:
        points: Measured points in a frame whose z is up, in [m], shape (N, 3).

    Returns:
        The box around what stands on the plane, or around the middle of the plane if
        nothing does. At most ``LARGEST``, then about the median of what stands there.

    Raises:
        EmptySceneError: If there is no level plane.
    """
    points = _thin(points[np.isfinite(points).all(axis=1)])
    plane = _level_plane(points)
    support = float(np.median(plane[:, 2]))
    low, high = np.percentile(plane, [2, 98], axis=0)
    beside = ((points >= low) & (points <= high))[:, :2].all(axis=1)
    height = points[:, 2] - support
    things = points[beside & (height > ABOVE) & (height < LARGEST[2])]
    if len(things) < LEAST_THINGS:
        middle = (low + high) / 2
        things = np.array([middle, middle])
        things[:, 2] = support
    low, high = np.percentile(things, [0.5, 99.5], axis=0)
    size = high - low + 2 * MARGIN
    size[2] = high[2] - support + MARGIN + BELOW
    size = np.clip(size, LEAST_EDGE, LARGEST)
    middle = np.where(high - low > size, np.median(things, axis=0), (low + high) / 2)
    origin = middle - size / 2
    origin[2] = support - BELOW
    return FoundWorkspace(origin, size, support)


def _thin(points: FloatArray) -> FloatArray:
    """Keep one point per cell of 1 cm."""
    cells = np.floor(points / SPACING).astype(np.int64)
    return np.asarray(points[np.unique(cells, axis=0, return_index=True)[1]])


def _level_plane(points: FloatArray) -> FloatArray:
    """Return the points of the largest level plane."""
    o3d.utility.random.seed(0)
    rest = points
    for _ in range(PLANES_TRIED):
        if len(rest) < LEAST_POINTS:
            break
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(rest))
        (a, b, c, _), rows = cloud.segment_plane(PLANE_NOISE, 3, 300)
        if len(rows) < LEAST_POINTS:
            break
        if abs(c) / np.linalg.norm([a, b, c]) >= LEVEL_COSINE:
            return np.asarray(rest[rows])
        rest = np.delete(rest, rows, axis=0)
    raise EmptySceneError(
        f"no level plane among {len(points)} measured points: does the camera see a "
        "table, and is the z of the workspace's frame up?"
    )
