# SPDX-License-Identifier: Apache-2.0
"""What a depth view is good for: its pixels, the table in it, whether it is new."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import DepthImageError
from neugrasp_ros.fusion.support_plane import find_workspace
from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.geometry.transform import apply
from neugrasp_ros.nodes.settings import FusionConfig, WorkspaceConfig

FloatArray = NDArray[np.float64]

FIND_WIDTH = 320  # [pixel]; an image thinned to it is enough to find a table
SOME_PIXELS = 20000  # of an image are enough to tell metres from millimetres
ABSURD_DEPTH = 50.0  # [m]; a median beyond this is millimetres in a float image


def clean(depth: NDArray[np.float32], config: FusionConfig) -> NDArray[np.float32]:
    """Return an image with NaN wherever it is not to be used.

    Args:
        depth: Depth in [m], shape (H, W).
        config: Range, border, and what infinity means.

    Raises:
        DepthImageError: If the numbers can only be millimetres.
    """
    some = depth.ravel()[:: max(1, depth.size // SOME_PIXELS)]
    finite = some[np.isfinite(some) & (some > 0)]
    if len(finite) and np.median(finite) > ABSURD_DEPTH:
        raise DepthImageError(
            f"the median depth is {np.median(finite):.0f} m; are these "
            "millimetres? 32FC1 holds metres, 16UC1 millimetres"
        )
    within = (depth >= config.min_depth) & (depth <= config.max_depth)
    cleaned = np.where(within, depth, np.float32(np.nan))
    if config.carve_infinite:
        cleaned[np.isposinf(depth)] = config.max_depth
    if border := config.invalid_border:
        inner = np.full(depth.shape, np.nan, dtype=np.float32)
        inside = slice(border, -border)
        inner[inside, inside] = cleaned[inside, inside]
        cleaned = inner
    return cleaned


def workspace_around(
    depth: NDArray[np.float32],
    camera: Intrinsics,
    T_frame_camera: FloatArray,
    config: FusionConfig,
) -> WorkspaceConfig:
    """Return the workspace around what stands on the table that a view shows.

    Args:
        depth: Cleaned depth in [m], shape (H, W).
        camera: Its camera.
        T_frame_camera: The camera's pose in the workspace's frame, whose z is up.
        config: The frame, and the voxel size that edges are a multiple of.

    Raises:
        EmptySceneError: If no level plane is seen.
    """
    some = slice(None, None, max(1, depth.shape[1] // FIND_WIDTH))
    points = (camera.ray_directions() * depth[..., None])[some, some]
    found = find_workspace(apply(T_frame_camera, points.reshape(-1, 3)))
    voxels = np.ceil(found.size / config.voxel_size - 1e-6)
    x, y, z = (float(v) for v in found.origin)
    a, b, c = (float(v) for v in voxels * config.voxel_size)
    return replace(
        config.workspace, origin=(x, y, z), rpy=(0.0, 0.0, 0.0), size=(a, b, c)
    )


def has_moved(
    T_frame_before: FloatArray, T_frame_now: FloatArray, config: FusionConfig
) -> bool:
    """Tell whether a camera has moved by ``min_motion`` or turned by ``min_turn_deg``.

    Args:
        T_frame_before: Its pose then, shape (4, 4).
        T_frame_now: Its pose now.
        config: Both limits.
    """
    way = np.linalg.norm(T_frame_now[:3, 3] - T_frame_before[:3, 3])
    cosine = (np.trace(T_frame_before[:3, :3].T @ T_frame_now[:3, :3]) - 1) / 2
    angle = np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return bool(way >= config.min_motion or angle >= config.min_turn_deg)
