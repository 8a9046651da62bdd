# SPDX-License-Identifier: Apache-2.0
"""The paper's scene renderer, literally: the yardstick of the fast one.

Every sample of every ray asks the network: 6.3 million queries a scene (method sheet,
d2). Never the default; ``PlannerConfig.renderer`` chooses it.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from neugrasp_ros.config import ReferenceConfig, RenderConfig
from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.geometry.grid import ScalarGrid
from neugrasp_ros.geometry.ray_search import first_crossings, outward_normals
from neugrasp_ros.geometry.transform import look_at
from neugrasp_ros.scene.field import FREE_LOGIT, LOGIT_LIMIT, CompiledOccupancy
from neugrasp_ros.scene.network import SceneNetwork
from neugrasp_ros.scene.rendering import thin

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]

NORMAL_REACH = 0.0046875  # [m], a voxel, as the fast path's


class NetworkOccupancy:
    """One scene's occupancy, asked from the network point by point.

    Args:
        network: The network.
        planes: Planes of one scene, shape (1, 3, C, R, R).
        edge: Edge of the cube in [m].
        free: Voxels that are known to be free, see ``seen_free``, shape (D, D, D):
            knowledge that both renderers start from.
        compiled: Answers instead of the network, and only where nothing is known to
            be free: the same numbers up to rounding, sooner. None = the network.

    Attributes:
        queries: Points that the network was asked for so far.
    """

    def __init__(
        self,
        network: SceneNetwork,
        planes: Tensor,
        edge: float,
        free: NDArray[np.bool_],
        compiled: CompiledOccupancy | None = None,
    ) -> None:
        self._network, self._planes, self._edge = network, planes, edge
        self._free, self._compiled = free, compiled
        self.queries = 0

    @property
    def edge(self) -> float:
        """Edge of the cube in [m]."""
        return self._edge

    def __call__(self, points: FloatArray) -> Float32Array:
        """Return probabilities (N,) at points (N, 3) in the task frame in [m]."""
        return np.asarray(0.5 + 0.5 * np.tanh(0.5 * self.logits(points)))

    def clipped(self, points: FloatArray) -> Float32Array:
        """Return logits (N,), clipped as the fast path's, whose slope gives normals."""
        return np.clip(self.logits(points), -LOGIT_LIMIT, LOGIT_LIMIT)

    def logits(self, points: FloatArray) -> Float32Array:
        """Return logits (N,) at points (N, 3) in the task frame in [m]."""
        size = self._free.shape[0]
        cells = np.floor(points * (size / self._edge)).astype(np.int64)
        inside = ((cells >= 0) & (cells < size)).all(axis=1)
        x, y, z = np.clip(cells, 0, size - 1).T
        free = self._free[x, y, z] & inside
        if self._compiled is None:
            return np.where(free, FREE_LOGIT, self._asked(points))
        logits = np.full(len(points), FREE_LOGIT, dtype=np.float32)
        rows = np.flatnonzero(~free)
        logits[rows] = self._compiled.at_points(points[rows] / self._edge)
        self.queries += len(rows)
        return logits

    def _asked(self, points: FloatArray) -> Float32Array:
        scaled = torch.from_numpy((points / self._edge).astype(np.float32))
        query = scaled[None].to(self._planes.device)
        self.queries += len(points)
        asked = self._network.occupancy_chunked(self._planes, query)
        return np.asarray(asked[0].cpu().numpy())


def dense_field(
    occupancy: NetworkOccupancy, resolution: int, edge: float
) -> ScalarGrid:
    """Ask the network at every sample of a cubic grid.

    Args:
        occupancy: The scene.
        resolution: Samples per edge.
        edge: Edge of the cube in [m].

    Returns:
        Logits, clipped as the fast path's.
    """
    axis = (np.arange(resolution) + 0.5) * edge / resolution
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    logits = occupancy.logits(points.reshape(-1, 3)).reshape((resolution,) * 3)
    return ScalarGrid(np.clip(logits, -LOGIT_LIMIT, LOGIT_LIMIT), edge / resolution)


def reference_rays(
    config: ReferenceConfig, edge: float
) -> tuple[FloatArray, FloatArray]:
    """Return all rays of the scene cameras in the task frame.

    Returns:
        Origins and unit directions, shape (V * H * W, 3) each.
    """
    pixels = Intrinsics.from_hfov(
        config.image_size, config.image_size, np.deg2rad(config.fov_deg)
    )
    rays = pixels.ray_directions().reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    target = np.array([edge / 2, edge / 2, 0.0])
    elevation = np.deg2rad(config.elevation_deg)
    origins, directions = [], []
    for azimuth in 2 * np.pi * np.arange(config.cameras) / config.cameras:
        offset = np.array([np.cos(azimuth), np.sin(azimuth), np.tan(elevation)])
        eye = target + config.radius * np.cos(elevation) * offset
        T_task_camera = look_at(eye, target)
        directions.append(rays @ T_task_camera[:3, :3].T)
        origins.append(np.broadcast_to(eye, rays.shape))
    return np.concatenate(origins), np.concatenate(directions)


def reference_samples(config: ReferenceConfig) -> FloatArray:
    """Return the distances along a scene ray that are looked at, in [m]."""
    return np.asarray(config.far * np.arange(1, config.samples + 1) / config.samples)


def render_reference(
    occupancy: NetworkOccupancy,
    edge: float,
    reference: ReferenceConfig,
    config: RenderConfig,
) -> tuple[FloatArray, FloatArray]:
    """Render the surface with all scene cameras, asking the network everywhere.

    Args:
        occupancy: The scene.
        edge: Edge of the cube in [m].
        reference: The cameras.
        config: Its ``point_spacing`` is that of the merged cloud.

    Returns:
        Points (N, 3) in [m] inside the cube, one per occupied cell of
        ``point_spacing``, and outward unit normals (N, 3).
    """
    origins, directions = reference_rays(reference, edge)
    samples = reference_samples(reference)
    distances = first_crossings(occupancy, origins, directions, samples)
    hit = np.isfinite(distances)
    points = origins[hit] + distances[hit, None] * directions[hit]
    inside = ((points >= 0) & (points <= edge)).all(axis=1)
    points = thin(points[inside], config.point_spacing)
    return points, outward_normals(occupancy.clipped, points, NORMAL_REACH)
