# SPDX-License-Identifier: Apache-2.0
"""The implicit scene seen by virtual cameras: a completed surface.

In: the occupancy field. Out: surface points with outward normals in the task frame.
"""

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.config import RenderConfig
from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.geometry.grid import ScalarGrid, march
from neugrasp_ros.geometry.transform import look_at

FloatArray = NDArray[np.float64]


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
    field: ScalarGrid, config: RenderConfig, threads: int = 1
) -> tuple[FloatArray, FloatArray]:
    """Render the field's surface with all scene cameras and merge the points.

    Args:
        field: Occupancy logits, positive inside.
        config: Cameras and the spacing of the merged cloud.
        threads: Worker threads.

    Returns:
        Points (N, 3) in [m], one per occupied cell of ``point_spacing``, and outward
        unit normals (N, 3).
    """
    pixels = Intrinsics.from_hfov(
        config.image_size, config.image_size, np.deg2rad(config.fov_deg)
    )
    rays = pixels.ray_directions().reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    poses = scene_cameras(config, field.size)
    directions = np.einsum("vij,rj->vri", poses[:, :3, :3], rays).reshape(-1, 3)
    origins = np.repeat(poses[:, :3, 3], len(rays), axis=0)
    distances = march(field, origins, directions, threads=threads)
    hit = np.isfinite(distances)
    points = origins[hit] + distances[hit, None] * directions[hit]
    points = thin(points, config.point_spacing)
    return points, field.normals(points)


def thin(points: FloatArray, spacing: float) -> FloatArray:
    """Keep one point, the first, of each cell of a cubic grid.

    Args:
        points: Points in [m], shape (N, 3), at non-negative coordinates.
        spacing: Cell edge in [m].
    """
    cells = np.floor(points / spacing).astype(np.int64) + 1024
    keys = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
    _, first = np.unique(keys, return_index=True)
    return np.asarray(points[np.sort(first)])
