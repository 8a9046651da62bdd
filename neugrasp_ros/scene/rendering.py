# SPDX-License-Identifier: Apache-2.0
"""The implicit scene seen by virtual cameras: a completed surface.

In: the occupancy field. Out: surface points with outward normals in the task frame.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.config import RenderConfig
from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.geometry.grid import ScalarGrid, march
from neugrasp_ros.geometry.ray_search import refine_crossings
from neugrasp_ros.geometry.transform import look_at
from neugrasp_ros.scene.workers import shared

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
Box = tuple[FloatArray, FloatArray]

REFINE_REACH = 1.2  # [sample]; the field and its network disagree by less, mostly
REFINE_STEPS = 4


def scene_cameras(config: RenderConfig, size: FloatArray) -> FloatArray:
    """Place the virtual cameras on a circle about the cube.

    Args:
        config: Number, elevation and distance of the cameras.
        size: Edge lengths of the cube in [m], shape (3,).

    Returns:
        Poses ``T_task_camera``, shape (V, 4, 4).
    """
    target = np.array([size[0] / 2, size[1] / 2, size[2] / 4])
    elevation = np.deg2rad(config.elevation_deg)
    azimuths = 2 * np.pi * np.arange(config.cameras) / config.cameras
    offsets = np.stack(
        [
            np.cos(azimuths) * np.cos(elevation),
            np.sin(azimuths) * np.cos(elevation),
            np.full(config.cameras, np.sin(elevation)),
        ],
        axis=1,
    )
    return np.stack([look_at(target + config.radius * o, target) for o in offsets])


def render_surface(
    field: ScalarGrid,
    config: RenderConfig,
    threads: int = 1,
    *,
    boxes: Sequence[Box] | None = None,
    depth: Callable[[FloatArray], Float32Array] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Render the field's surface with all scene cameras and merge the points.

    Args:
        field: Occupancy logits, positive inside.
        config: Cameras and the spacing of the merged cloud.
        threads: Worker threads.
        boxes: Lower and upper corners in [m] of the parts of the field that get
            cameras of their own; default the whole.
        depth: The network itself, points (N, 3) in, logits (N,) out: the points that
            remain are moved onto its surface.

    Returns:
        Points (N, 3) in [m], one per occupied cell of ``point_spacing``, and outward
        unit normals (N, 3).
    """
    boxes = boxes or [(np.zeros(3), field.size)]
    each = threads if len(boxes) == 1 else 1
    seen = shared(lambda b: _look_into(field, b, config, each), boxes, threads)
    points, directions = (np.concatenate(parts) for parts in zip(*seen, strict=True))
    rows = thinned(points, config.point_spacing)
    points = points[rows]
    if depth is not None and len(points):
        reach = REFINE_REACH * field.spacing
        points = refine_crossings(depth, points, directions[rows], reach, REFINE_STEPS)
    return points, field.normals(points)


def trace_surface(
    field: ScalarGrid,
    origins: FloatArray,
    directions: FloatArray,
    depth: Callable[[FloatArray], Float32Array],
    threads: int = 1,
) -> FloatArray:
    """Find where single rays meet the surface, refined like ``render_surface``.

    Args:
        field: Occupancy logits, positive inside.
        origins: Ray origins in [m], shape (R, 3).
        directions: Unit directions, shape (R, 3).
        depth: The network itself, points (N, 3) in, logits (N,) out.
        threads: Worker threads.

    Returns:
        Distances along the rays in [m], shape (R,); NaN where nothing is met.
    """
    distances = march(field, origins, directions, threads=threads)
    hit = np.flatnonzero(np.isfinite(distances))
    if len(hit):
        met = origins[hit] + distances[hit, None] * directions[hit]
        reach = REFINE_REACH * field.spacing
        refined = refine_crossings(depth, met, directions[hit], reach, REFINE_STEPS)
        distances[hit] += np.einsum("ij,ij->i", refined - met, directions[hit])
    return distances


def _look_into(
    field: ScalarGrid, box: Box, config: RenderConfig, threads: int
) -> tuple[FloatArray, FloatArray]:
    """Return what a box's cameras see in it, and along which rays, (N, 3) each."""
    low, high = box
    origins, directions = _scene_rays(
        config, tuple(round(float(e), 6) for e in high - low)
    )
    origins = low + origins
    distances = march(field, origins, directions, box=box, threads=threads)
    hit = np.flatnonzero(np.isfinite(distances))
    directions = directions[hit]
    return origins[hit] + distances[hit, None] * directions, directions


@lru_cache(maxsize=4)
def _scene_rays(
    config: RenderConfig, size: tuple[float, ...]
) -> tuple[FloatArray, FloatArray]:
    """Return all cameras' rays about a box at the origin, (R, 3) each."""
    pixels = Intrinsics.from_hfov(
        config.image_size, config.image_size, np.deg2rad(config.fov_deg)
    )
    rays = pixels.ray_directions().reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    poses = scene_cameras(config, np.array(size))
    directions = np.einsum("vij,rj->vri", poses[:, :3, :3], rays).reshape(-1, 3)
    return np.repeat(poses[:, :3, 3], len(rays), axis=0), directions


def thin(points: FloatArray, spacing: float) -> FloatArray:
    """Keep one point, the first, of each cell of a cubic grid.

    Args:
        points: Points in [m], shape (N, 3), at non-negative coordinates.
        spacing: Cell edge in [m].
    """
    return np.asarray(points[thinned(points, spacing)])


def thinned(points: FloatArray, spacing: float) -> NDArray[np.int64]:
    """Return the rows that ``thin`` keeps."""
    cells = np.floor(points / spacing).astype(np.int64) + 1024
    keys = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
    _, first = np.unique(keys, return_index=True)
    return np.sort(first)
