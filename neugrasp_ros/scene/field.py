# SPDX-License-Identifier: Apache-2.0
"""The network's occupancy on a grid, evaluated only where it is not already known."""

import copy
from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.geometry.grid import ScalarGrid
from neugrasp_ros.geometry.grid_refine import doubled, straddling
from neugrasp_ros.scene.encoder import FREE_ABOVE
from neugrasp_ros.scene.grid_decoder import (
    at_resolution,
    decode_at_points,
    decode_on_grid,
    pack_weights,
    project_planes,
)
from neugrasp_ros.scene.network import SceneNetwork

Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

FREE_LOGIT = -8.0  # what is not asked because it was seen to be free
LOGIT_LIMIT = 8.0  # logits are clipped: beyond it interpolation would be lopsided
MARGIN = 2.0  # [logit]; a coarse cell whose corners are all beyond it is not refined
SURFACE_MARGIN = 0.5  # [logit]; the same for cells whose resolution is doubled again

Ask = Callable[[IntArray], Float32Array]
"""Sample indices (N, 3) in, clipped logits (N,) out."""


@torch.no_grad()
def evaluate_field(
    network: SceneNetwork,
    planes: Tensor,
    distances: Float32Array,
    edge: float,
    threads: int = 1,
) -> tuple[ScalarGrid, int]:
    """Evaluate one scene's occupancy logits, coarse to fine.

    Args:
        network: The network.
        planes: Planes of one scene, shape (1, 3, C, R, R).
        distances: The volume that was encoded, NaN = never observed, shape (D, D, D)
            with even D.
        edge: Edge of the cube in [m].
        threads: Worker threads.

    Returns:
        Logits on a grid of 2D samples per edge, positive inside, and the number of
        points that the network was asked for.

    Raises:
        ShapeError: If the volume is not a cube of an even number of voxels per edge.
    """
    ask = CompiledOccupancy(network, planes, threads)
    free = seen_free(distances)
    values, queries = evaluate_samples(ask, free)
    size = len(values)
    field, asked = refined(
        values, free, edge / size, lambda i: ask.on_grid(i, 2 * size), threads
    )
    return field, queries + asked


def evaluate_samples(
    ask: "CompiledOccupancy", free: BoolArray, wanted: BoolArray | None = None
) -> tuple[Float32Array, int]:
    """Evaluate one scene's logits on the grid of its volume.

    First every second sample that was not seen free; then, at full resolution, the
    cells whose coarse corners disagree or are undecided. The rest is interpolated.

    Args:
        ask: The network.
        free: What was seen free, shape (D, D, D) with even D.
        wanted: Where the field matters, shape (D, D, D); it is free elsewhere.

    Returns:
        Logits (D, D, D), and the number of points that were asked for.

    Raises:
        ShapeError: If the volume is not a cube of an even number of voxels per edge.
    """
    size = free.shape[0]
    if free.shape != (size,) * 3 or size % 2:
        raise ShapeError("free", "(D, D, D) with even D", free.shape)
    if wanted is not None:
        free = free | ~wanted
    half = size // 2
    blocks = free.reshape(half, 2, half, 2, half, 2)
    free_blocks = blocks.all(axis=(1, 3, 5))
    coarse = np.full((half,) * 3, FREE_LOGIT, dtype=np.float32)
    index = np.argwhere(~free_blocks)
    coarse[tuple(index.T)] = ask.on_grid(index, half)
    fine = doubled(coarse)
    index_fine = straddling(coarse, MARGIN)
    index_fine = index_fine[~free[tuple(index_fine.T)]]
    fine[tuple(index_fine.T)] = ask.on_grid(index_fine, size)
    fine[free] = FREE_LOGIT
    return fine, len(index) + len(index_fine)


def refined(
    values: Float32Array, free: BoolArray, spacing: float, ask: Ask, threads: int = 1
) -> tuple[ScalarGrid, int]:
    """Double the resolution of logits; ask anew where the surface passes.

    Args:
        values: Logits on the volume's grid, shape (X, Y, Z).
        free: What was seen free, of the same shape.
        spacing: Distance of the samples in [m].
        ask: The network, at samples of the doubled grid.
        threads: Worker threads.

    Returns:
        The field, whose normals compare values over the old spacing, and the number of
        points that were asked for.
    """
    fine = doubled(values, threads)
    index = straddling(values, SURFACE_MARGIN)
    index = index[~free[tuple(index.T // 2)]]
    fine[tuple(index.T)] = ask(index)
    return ScalarGrid(fine, spacing / 2, normal_reach=spacing), len(index)


def seen_free(distances: Float32Array) -> BoolArray:
    """Tell which voxels a camera has seen to be free, with all their neighbours.

    At the border of what was seen the network decides: a surface there follows it
    instead of the voxels' faces.

    Args:
        distances: In units of truncation, NaN = never observed, shape (X, Y, Z).
    """
    free = np.nan_to_num(distances, nan=-1.0) >= FREE_ABOVE
    for axis in range(free.ndim):
        wide = free.copy()
        low, high = np.moveaxis(wide, axis, 0), np.moveaxis(free, axis, 0)
        low[1:] &= high[:-1]
        low[:-1] &= high[1:]
        free = wide
    return np.asarray(free)


class CompiledOccupancy:
    """Asks the network for clipped logits; on a CPU by the compiled decoder.

    Args:
        network: The network.
        planes: Planes of one scene, shape (1, 3, C, R, R).
        threads: Worker threads.
    """

    def __init__(self, network: SceneNetwork, planes: Tensor, threads: int) -> None:
        self._network, self._planes, self._threads = network, planes, threads
        on_cpu = planes.device.type == "cpu"
        self._weights = pack_weights(network.decoder) if on_cpu else None
        self._table: Float32Array | None = None

    def alone(self) -> "CompiledOccupancy":
        """Return the same for a caller that is one of several threads itself."""
        if self._weights is not None:
            self._projected()  # before several threads do
        other = copy.copy(self)
        other._threads = 1
        return other

    def on_grid(self, index: NDArray[np.int64], size: int) -> NDArray[np.float32]:
        """Return logits at samples (N, 3) of a grid with ``size`` per edge."""
        cells = self._planes.shape[-1]
        if self._weights is None or not cells <= size <= 2 * cells:
            return self.at_points((index + 0.5) / size)
        table = at_resolution(self._projected(), size, self._threads)
        return _clipped(decode_on_grid(self._weights, table, index, self._threads))

    def at_points(self, points: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return logits at points (N, 3) in units of the edge."""
        if self._weights is not None:
            table = self._projected()
            return _clipped(
                decode_at_points(self._weights, table, points, self._threads)
            )
        query = torch.from_numpy(points.astype(np.float32))[None]
        occupied = self._network.occupancy_chunked(
            self._planes, query.to(self._planes.device)
        )
        return _clipped(occupied[0].cpu().numpy())

    def _projected(self) -> Float32Array:
        if self._table is None:
            self._table = project_planes(self._network.decoder, self._planes)
        return self._table


def _clipped(logits: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.clip(logits, -LOGIT_LIMIT, LOGIT_LIMIT, out=logits)
