# SPDX-License-Identifier: Apache-2.0
"""A grid of feature vectors read at points, compiled for the CPU.

Torch reads a grid channel by channel; here the numbers of a cell lie together, and a
point takes eight rows instead of eight numbers per channel from all over the memory.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float32Array = NDArray[np.float32]


def read_trilinear(table: Float32Array, points: Float32Array) -> Float32Array:
    """Interpolate feature vectors between the centres of cells.

    Args:
        table: Features of the cells, contiguous, shape (X, Y, Z, C).
        points: In units of the grid's edges, shape (N, 3); beyond the grid its border
            is read, and where they are not finite anything at all.

    Returns:
        Shape (N, C), as ``torch.nn.functional.grid_sample`` without aligned corners.
    """
    points = np.ascontiguousarray(points, dtype=np.float32)
    out = np.empty((len(points), table.shape[-1]), dtype=np.float32)
    _read_trilinear(table, points, out)
    return out


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _read_trilinear(table, points, out):  # pragma: no cover - compiled
    cell = np.empty((3, 2), dtype=np.int64)
    share = np.empty((3, 2), dtype=np.float32)
    for n in range(len(points)):
        for axis in range(3):
            size = table.shape[axis]
            at = points[n, axis] * size - np.float32(0.5)
            at = min(max(at, np.float32(0.0)), np.float32(size - 1))
            below = min(max(int(at), 0), size - 1)  # whatever int() makes of a NaN
            cell[axis, 0], cell[axis, 1] = below, min(below + 1, size - 1)
            share[axis, 1] = np.float32(at - below)
            share[axis, 0] = np.float32(1.0) - share[axis, 1]
        out[n] = np.float32(0.0)
        for i in range(2):
            for j in range(2):
                for k in range(2):
                    weight = share[0, i] * share[1, j] * share[2, k]
                    row = table[cell[0, i], cell[1, j], cell[2, k]]
                    for c in range(out.shape[1]):
                        out[n, c] += weight * row[c]
