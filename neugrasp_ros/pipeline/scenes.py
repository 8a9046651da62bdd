# SPDX-License-Identifier: Apache-2.0
"""A volume of any size as the network sees it: cube by cube, and as one field."""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from neugrasp_ros.config import RenderConfig
from neugrasp_ros.errors import ConfigError, EmptySceneError, ShapeError
from neugrasp_ros.fusion.tsdf import TRUNCATION_VOXELS, TsdfVolume, seen_surface
from neugrasp_ros.geometry.grid import ScalarGrid
from neugrasp_ros.geometry.support import ABOVE_SUPPORT
from neugrasp_ros.scene.cubes import (
    blend_shares,
    busy,
    centrality,
    cover,
    cut,
    merge_fields,
    shares_at,
)
from neugrasp_ros.scene.fast_encoder import encode_volumes
from neugrasp_ros.scene.field import (
    FREE_LOGIT,
    CompiledOccupancy,
    evaluate_samples,
    refined,
    seen_free,
)
from neugrasp_ros.scene.network import SceneNetwork
from neugrasp_ros.scene.reference import NetworkOccupancy, dense_field
from neugrasp_ros.scene.rendering import thinned
from neugrasp_ros.scene.workers import shared

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Box = tuple[FloatArray, FloatArray]

EDGE = 0.3  # [m], of the cube that networks learn
EDGE_TOLERANCE = 0.05  # share of it that a cube may be larger or smaller
ROUNDING = 1e-6  # share of a voxel's edge by which copies of a volume may differ
NEGLIGIBLE = 0.02  # a cube is not asked where it counts for less than this share


@dataclass(frozen=True, kw_only=True)
class EncodeSettings:
    """How a volume is cut and encoded.

    Attributes:
        overlap: What neighbouring cubes share at least, in [m].
        support_height: Height of the support plane in the task frame in [m].
        threads: Worker threads.
        device: Torch device.
        renderer: See ``PlannerConfig``; a reference asks the network at every sample
            instead of coarse to fine.
    """

    overlap: float
    support_height: float
    threads: int
    device: str
    renderer: str = "fast"


@dataclass(frozen=True, eq=False)
class EncodedScene:
    """A volume as the network sees it.

    Attributes:
        revision: Revision of the volume.
        volume: The volume itself.
        corners: Lower corners of the B cubes in [voxel], shape (B, 3).
        planes: Feature planes of each cube, shape (B, 3, C, R, R).
        field: Occupancy logits, two samples per voxel along each axis, positive
            inside.
        free: Voxels that were seen to be free, of the volume's shape.
        queries: Points that the network was asked for.
        cube_voxels: Voxels along a cube's edge, D.
        support_height: Height in [m] up to which the cubes' choice took the support.
        occupancies: The cubes' compiled decoders.
    """

    revision: int
    volume: TsdfVolume
    corners: IntArray
    planes: Tensor
    field: ScalarGrid
    free: BoolArray
    queries: int
    cube_voxels: int
    support_height: float
    occupancies: tuple[CompiledOccupancy, ...] = ()

    @property
    def edge(self) -> float:
        """Edge of a cube in [m]."""
        return self.cube_voxels * self.volume.voxel_size

    def shows(self, volume: TsdfVolume, revision: int, support_height: float) -> bool:
        """Tell whether encoding a volume would give this scene, as ``encode_scene``."""
        if self.revision != revision:
            return False
        alone = volume.distances.shape == (self.cube_voxels,) * 3  # no cube to choose
        if not alone and self.support_height != support_height:
            return False
        return self.volume is volume or same_volume(self.volume, volume)

    @property
    def boxes(self) -> list[Box]:
        """Lower and upper corners of the cubes in [m], within the volume."""
        low = self.corners * self.volume.voxel_size
        return [(c, np.minimum(c + self.edge, self.volume.size)) for c in low]

    def cubes_of(self, positions: FloatArray) -> IntArray:
        """Return the cube in which each position (N, 3) in [m] lies deepest, (N,)."""
        if len(self.corners) == 1:
            return np.zeros(len(positions), dtype=np.int64)
        depth = centrality(
            positions / self.volume.voxel_size, self.corners, self.cube_voxels
        )
        return np.asarray(depth.argmax(axis=1))

    def in_cube(self, cube: int, positions: NDArray[np.floating[Any]]) -> FloatArray:
        """Return positions (..., 3) in [m] in units of a cube's edge."""
        low = self.corners[cube] * self.volume.voxel_size
        return np.asarray((positions - low) / self.edge)

    def depth(self, points: FloatArray) -> Float32Array:
        """Ask the network itself for clipped logits (N,) at points (N, 3) in [m]."""
        owners = self.cubes_of(points)
        logits = np.full(len(points), FREE_LOGIT, dtype=np.float32)
        for cube in np.unique(owners):
            rows = np.flatnonzero(owners == cube)
            local = self.in_cube(cube, points[rows])
            logits[rows] = self.occupancies[cube].at_points(local)
        shape = np.array(self.free.shape)
        cells = np.floor(points / self.volume.voxel_size).astype(np.int64)
        x, y, z = np.clip(cells, 0, shape - 1).T
        logits[self.free[x, y, z]] = FREE_LOGIT
        return logits


@dataclass(frozen=True, eq=False)
class RenderedScene:
    """A surface to sample grasps on: completed, or what was seen.

    Attributes:
        points: Surface points in the task frame in [m], shape (N, 3).
        normals: Outward unit normals, shape (N, 3).
    """

    points: FloatArray
    normals: FloatArray


def seen_scene(
    volume: TsdfVolume, support_height: float | None, render: RenderConfig
) -> RenderedScene:
    """Return what was seen of the objects, without completion.

    Args:
        volume: A volume with at least one view.
        support_height: Height of the support plane in the task frame in [m], which is
            left out; None = there is none.
        render: Says how dense a rendered surface is.

    Raises:
        EmptySceneError: If no image was integrated.
    """
    points, normals = seen_surface(volume)
    if support_height is not None:
        above = points[:, 2] > support_height + ABOVE_SUPPORT
        points, normals = points[above], normals[above]
    rows = thinned(points, render.point_spacing)
    return RenderedScene(points[rows], normals[rows])


def check_volume(volume: TsdfVolume, size: int) -> None:
    """Refuse a volume that a network cannot take.

    Args:
        volume: The volume.
        size: Voxels along the edge of the network's cube, D.

    Raises:
        ConfigError: If its distances are truncated elsewhere than those that networks
            learn.
        ShapeError: If D voxels do not span the cube that networks learn.
        EmptySceneError: If no voxel was ever observed.
    """
    edge = size * volume.voxel_size
    if abs(edge - EDGE) > EDGE_TOLERANCE * EDGE:
        raise ShapeError(
            "volume",
            f"voxels of {EDGE / size:.6f} m, {size} along the {EDGE} m cube; "
            f"voxel_size {volume.voxel_size:.6f}",
            volume.distances.shape,
        )
    truncation = volume.truncation / volume.voxel_size
    if abs(truncation - TRUNCATION_VOXELS) > EDGE_TOLERANCE * TRUNCATION_VOXELS:
        raise ConfigError(
            f"volume: its distances are truncated at {truncation:.2f} voxels; networks "
            f"learn those that are at {TRUNCATION_VOXELS}"
        )
    if not volume.observed.any():
        raise EmptySceneError("no voxel of the volume was ever observed")


def same_volume(a: TsdfVolume, b: TsdfVolume) -> bool:
    """Compare volumes; a message rounds the voxel size to single precision."""
    return abs(a.voxel_size - b.voxel_size) <= ROUNDING * a.voxel_size and bool(
        np.array_equal(a.distances, b.distances, equal_nan=True)
    )


def encode_scene(
    network: SceneNetwork, volume: TsdfVolume, revision: int, settings: EncodeSettings
) -> EncodedScene:
    """Encode all cubes of a volume in which something stands, in one batch.

    Args:
        network: The network.
        volume: A volume of any size.
        revision: Its revision.
        settings: How.

    Raises:
        ShapeError: If the voxels do not have the network's size.
        EmptySceneError: If no voxel was ever observed.
        ConfigError: If the reference is asked for more than one cube.
    """
    size = network.config.resolution
    check_volume(volume, size)
    distances, shape = volume.distances, volume.distances.shape
    voxel = volume.voxel_size
    corners = cover(shape, size, round(settings.overlap / voxel))
    floor = (settings.support_height + ABOVE_SUPPORT) / voxel
    corners = corners[busy(distances, corners, size, floor)]
    free = seen_free(distances)
    if not len(corners):
        nothing = np.full(shape, FREE_LOGIT, dtype=np.float32)
        none, support = torch.zeros(0), settings.support_height
        field = ScalarGrid(nothing, voxel)
        return EncodedScene(
            revision, volume, corners, none, field, free, 0, size, support
        )
    parts = [cut(distances, corner, size) for corner in corners]
    planes = encode_volumes(network, parts, settings.device, settings.threads)
    cubes = _Cubes(
        tuple(
            CompiledOccupancy(network, planes[b : b + 1], settings.threads)
            for b in range(len(corners))
        ),
        corners,
        size,
        settings.threads,
    )
    if settings.renderer != "fast":
        compiled = settings.renderer == "compiled_reference"
        ask = cubes.occupancies[0] if compiled else None
        grid, queries = _dense(network, planes, free, voxel, ask)
    else:
        values, queries = _samples(cubes, free, parts, settings.threads)
        grid, asked = refined(values, free, voxel, cubes.ask, settings.threads)
        queries += asked
    return EncodedScene(
        revision,
        volume,
        corners,
        planes,
        grid,
        free,
        queries,
        size,
        settings.support_height,
        cubes.occupancies,
    )


class _Cubes(NamedTuple):
    """The cubes of a volume, each with its decoder."""

    occupancies: tuple[CompiledOccupancy, ...]
    corners: IntArray  # [voxel], (B, 3)
    size: int  # [voxel]
    threads: int

    def ask(self, index: IntArray) -> Float32Array:
        """Return logits (N,) at samples (N, 3) of the grid with half a voxel's edge."""
        if len(self.corners) == 1:
            local = ((index + 0.5) / 2 - self.corners[0]) / self.size
            return self.occupancies[0].at_points(local)
        asked = tuple(occupancy.alone() for occupancy in self.occupancies)
        parts = np.array_split(index, max(1, min(len(index), 2 * self.threads)))
        found = shared(lambda part: self._mixed(part, asked), parts, self.threads)
        return np.concatenate(found)

    def _mixed(
        self, index: IntArray, occupancies: tuple[CompiledOccupancy, ...]
    ) -> Float32Array:
        positions = (index + 0.5) / 2  # [voxel]
        shares = shares_at(positions, self.corners, self.size)
        shares[shares < NEGLIGIBLE] = 0
        shares /= np.maximum(shares.sum(axis=1, keepdims=True), NEGLIGIBLE)
        logits = np.where(shares.any(axis=1), 0, FREE_LOGIT).astype(np.float32)
        for cube, (ask, corner) in enumerate(
            zip(occupancies, self.corners, strict=True)
        ):
            rows = np.flatnonzero(shares[:, cube])
            local = (positions[rows] - corner) / self.size
            logits[rows] += shares[rows, cube] * ask.at_points(local)
        return logits


def _samples(
    cubes: _Cubes, free: BoolArray, parts: list[Float32Array], threads: int
) -> tuple[Float32Array, int]:
    """Evaluate each cube's logits where they count, and mix them."""
    shape = (free.shape[0], free.shape[1], free.shape[2])
    if len(parts) == 1 and shape == (cubes.size,) * 3:
        return evaluate_samples(cubes.occupancies[0], free)
    shares = blend_shares(cubes.corners, cubes.size, shape)
    asked = [occupancy.alone() for occupancy in cubes.occupancies]

    def run(cube: int) -> tuple[Float32Array, int]:
        wanted = shares[cube] > NEGLIGIBLE
        return evaluate_samples(asked[cube], seen_free(parts[cube]), wanted)

    values, queries = zip(*shared(run, range(len(parts)), threads), strict=True)
    mixed = merge_fields(values, shares, cubes.corners, shape, FREE_LOGIT)
    return mixed, sum(queries)


def _dense(
    network: SceneNetwork,
    planes: Tensor,
    free: BoolArray,
    voxel: float,
    compiled: CompiledOccupancy | None,
) -> tuple[ScalarGrid, int]:
    if len(planes) > 1:
        raise ConfigError(
            f"the reference renderers take one cube, the volume needs {len(planes)}"
        )
    edge = len(free) * voxel
    occupancy = NetworkOccupancy(network, planes, edge, free, compiled)
    field = dense_field(occupancy, 2 * len(free), edge)
    return replace(field, normal_reach=voxel), occupancy.queries
