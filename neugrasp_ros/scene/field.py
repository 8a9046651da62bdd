# SPDX-License-Identifier: Apache-2.0
"""The network's occupancy on a grid, evaluated only where it is not already known."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from neugrasp_ros.geometry.grid import ScalarGrid
from neugrasp_ros.scene.encoder import FREE_ABOVE
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

    Returns:
        Logits on the volume's grid, positive inside, and the number of points that
        the network was asked for.
    """
    size = distances.shape[0]
    free = np.nan_to_num(distances, nan=-1.0) >= FREE_ABOVE
    half = size // 2
    blocks = free.reshape(half, 2, half, 2, half, 2)
    free_blocks = blocks.all(axis=(1, 3, 5))
    coarse = np.full((half,) * 3, FREE_LOGIT, dtype=np.float32)
    index = np.argwhere(~free_blocks)
    coarse[tuple(index.T)] = _ask(network, planes, (index + 0.5) / half)
    undecided = _undecided(coarse) & ~free_blocks

    fine = _upsample(coarse)
    ask = np.repeat(np.repeat(np.repeat(undecided, 2, 0), 2, 1), 2, 2) & ~free
    index_fine = np.argwhere(ask)
    fine[tuple(index_fine.T)] = _ask(network, planes, (index_fine + 0.5) / size)
    fine[free] = FREE_LOGIT
    return ScalarGrid(fine, edge / size), len(index) + len(index_fine)


def _ask(
    network: SceneNetwork, planes: Tensor, points: NDArray[np.float64]
) -> NDArray[np.float32]:
    query = torch.from_numpy(points.astype(np.float32)).to(planes.device)[None]
    logits = network.occupancy_chunked(planes, query)[0]
    return logits.clamp(-LOGIT_LIMIT, LOGIT_LIMIT).cpu().numpy()


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
        before = np.concatenate(
            [out.take([0], axis=axis), out], axis=axis
        ).take(range(out.shape[axis]), axis=axis)
        after = np.concatenate(
            [out, out.take([-1], axis=axis)], axis=axis
        ).take(range(1, out.shape[axis] + 1), axis=axis)
        pair = np.stack([0.75 * out + 0.25 * before, 0.75 * out + 0.25 * after], axis + 1)
        shape = list(out.shape)
        shape[axis] *= 2
        out = pair.reshape(shape)
    return np.ascontiguousarray(out, dtype=np.float32)
