# SPDX-License-Identifier: Apache-2.0
"""The network's occupancy on a grid, evaluated only where it is not already known."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.geometry.grid import ScalarGrid
from neugrasp_ros.scene.encoder import FREE_ABOVE
from neugrasp_ros.scene.grid_decoder import (
    decode_at_points,
    decode_on_grid,
    pack_weights,
    project_planes,
)
from neugrasp_ros.scene.network import SceneNetwork

FREE_LOGIT = -8.0  # what is not asked because it was seen to be free
LOGIT_LIMIT = 8.0  # logits are clipped: beyond it interpolation would be lopsided
MARGIN = 3.0  # [logit]; a coarse cell whose corners are all beyond it is not refined


@torch.no_grad()
def evaluate_field(
    network: SceneNetwork,
    planes: Tensor,
    distances: NDArray[np.float32],
    edge: float,
    threads: int = 1,
    wanted: NDArray[np.bool_] | None = None,
) -> tuple[ScalarGrid, int]:
    """Evaluate one scene's occupancy logits, coarse to fine.

    First every second sample that was not seen free; then, at full resolution, the
    cells whose coarse corners disagree or are undecided. The rest is interpolated.

    Args:
        network: The network.
        planes: Planes of one scene, shape (1, 3, C, R, R).
        distances: The volume that was encoded, NaN = never observed, shape (D, D, D)
            with even D.
        edge: Edge of the cube in [m].
        threads: Worker threads.
        wanted: Where the field matters, shape (D, D, D); it is free elsewhere.

    Returns:
        Logits on the volume's grid, positive inside, and the number of points that
        the network was asked for.

    Raises:
        ShapeError: If the volume is not a cube of an even number of voxels per edge.
    """
    size = distances.shape[0]
    if distances.shape != (size,) * 3 or size % 2:
        raise ShapeError("distances", "(D, D, D) with even D", distances.shape)
    free = seen_free(distances)
    if wanted is not None:
        free |= ~wanted
    half = size // 2
    blocks = free.reshape(half, 2, half, 2, half, 2)
    free_blocks = blocks.all(axis=(1, 3, 5))
    ask = CompiledOccupancy(network, planes, threads)
    coarse = np.full((half,) * 3, FREE_LOGIT, dtype=np.float32)
    index = np.argwhere(~free_blocks)
    coarse[tuple(index.T)] = ask.on_grid(index, half)
    undecided = _undecided(coarse) & ~free_blocks

    fine = _upsample(coarse)
    wanted = np.repeat(np.repeat(np.repeat(undecided, 2, 0), 2, 1), 2, 2) & ~free
    index_fine = np.argwhere(wanted)
    fine[tuple(index_fine.T)] = ask.on_grid(index_fine, size)
    fine[free] = FREE_LOGIT
    return ScalarGrid(fine, edge / size), len(index) + len(index_fine)


def seen_free(distances: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Tell which voxels a camera has seen to be free, well in front of any surface."""
    return np.asarray(np.nan_to_num(distances, nan=-1.0) >= FREE_ABOVE)


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
        self._table: NDArray[np.float32] | None = None  # for points off the grid

    def on_grid(self, index: NDArray[np.int64], size: int) -> NDArray[np.float32]:
        """Return logits at samples (N, 3) of a grid with ``size`` per edge."""
        if self._weights is None or size < self._planes.shape[-1]:
            return self.at_points((index + 0.5) / size)
        table = project_planes(self._network.decoder, self._planes, size)
        return _clipped(decode_on_grid(self._weights, table, index, self._threads))

    def at_points(self, points: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return logits at points (N, 3) in units of the edge."""
        if self._weights is not None:
            if self._table is None:
                own = self._planes.shape[-1]
                self._table = project_planes(self._network.decoder, self._planes, own)
            return _clipped(
                decode_at_points(self._weights, self._table, points, self._threads)
            )
        query = torch.from_numpy(points.astype(np.float32))[None]
        occupied = self._network.occupancy_chunked(
            self._planes, query.to(self._planes.device)
        )
        return _clipped(occupied[0].cpu().numpy())


def _clipped(logits: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.clip(logits, -LOGIT_LIMIT, LOGIT_LIMIT)


def _undecided(coarse: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Tell which coarse samples have a surface, or doubt, in their neighbourhood."""
    padded = np.pad(coarse, 1, mode="edge")
    low, high = padded, padded
    n = coarse.shape[0]
    for axis in range(3):
        shape = [slice(None)] * 3
        views = []
        for offset in range(3):
            shape[axis] = slice(offset, offset + n)
            views.append((low[tuple(shape)], high[tuple(shape)]))
        low = np.minimum(np.minimum(views[0][0], views[1][0]), views[2][0])
        high = np.maximum(np.maximum(views[0][1], views[1][1]), views[2][1])
    return (high > -MARGIN) & (low < MARGIN)


def _upsample(coarse: NDArray[np.float32]) -> NDArray[np.float32]:
    """Double the resolution by linear interpolation between sample centres."""
    out = coarse
    for axis in range(3):
        last = out.shape[axis] - 1
        before = out.take(np.maximum(np.arange(last + 1) - 1, 0), axis=axis)
        after = out.take(np.minimum(np.arange(last + 1) + 1, last), axis=axis)
        pair = np.stack([3 * out + before, 3 * out + after], axis + 1) / 4
        shape = list(out.shape)
        shape[axis] *= 2
        out = pair.reshape(shape)
    return np.ascontiguousarray(out, dtype=np.float32)
