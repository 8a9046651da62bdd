# SPDX-License-Identifier: Apache-2.0
"""Where the inside of a sampled field is far: what rays and hands may skip."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float32Array = NDArray[np.float32]

GAP_CELL = 2  # [sample], edge of the cells that tell how far the inside is
GAP_LIMIT = 12  # [cell]; a ray leaps no further at once
BLOCK = 8  # [sample], edge of the blocks that tell where the inside is near


def inside_gaps(values: Float32Array) -> NDArray[np.uint8]:
    """Tell how far each cell is from the nearest one that touches the inside.

    Cell (a, b, c) reaches from sample (2a, 2b, 2c) to (2a + 2, 2b + 2, 2c + 2); it
    touches the inside if one of its 27 samples is positive. From a cell of gap g > 0 a
    ray meets nothing in any cell nearer than g.

    Args:
        values: Samples, shape (X, Y, Z).

    Returns:
        Largest coordinate difference to such a cell in [cell], at most ``GAP_LIMIT``,
        shape (ceil(X / 2), ceil(Y / 2), ceil(Z / 2)).
    """
    values = np.ascontiguousarray(values, dtype=np.float32)
    x, y, z = (-(-n // GAP_CELL) for n in values.shape)
    gaps = np.full((x, y, z), GAP_LIMIT, dtype=np.uint8)
    _touch(values, gaps)
    _spread(gaps)
    _spread(gaps[::-1, ::-1, ::-1])
    return gaps


def occupied_blocks(values: Float32Array) -> NDArray[np.bool_]:
    """Tell which blocks of samples, or their neighbours, hold an inside value."""
    values = np.ascontiguousarray(values, dtype=np.float32)
    a, b, c = (-(-n // BLOCK) for n in values.shape)
    coarse = np.zeros((a, b, c), dtype=bool)
    _occupy(values, coarse)
    grown = np.zeros((a + 2, b + 2, c + 2), dtype=bool)
    for i in range(3):
        for j in range(3):
            for k in range(3):
                grown[i : i + a, j : j + b, k : k + c] |= coarse
    return np.ascontiguousarray(grown[1:-1, 1:-1, 1:-1])


@njit(cache=True, nogil=True)
def _touch(values, gaps):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Write 0 into the cells that touch the inside."""
    nx, ny, nz = values.shape
    highest = np.empty(nz, dtype=np.float32)
    for a in range(gaps.shape[0]):
        for b in range(gaps.shape[1]):
            highest[:] = -np.float32(np.inf)
            for i in range(GAP_CELL * a, min(GAP_CELL * a + 3, nx)):
                for j in range(GAP_CELL * b, min(GAP_CELL * b + 3, ny)):
                    for k in range(nz):
                        highest[k] = max(highest[k], values[i, j, k])
            for k in range(nz):
                if highest[k] > 0:
                    gaps[a, b, k // GAP_CELL] = 0
                    if k % GAP_CELL == 0 and k > 0:
                        gaps[a, b, k // GAP_CELL - 1] = 0


@njit(cache=True, nogil=True)
def _spread(gaps):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Lower each cell to one more than the least of those before it, in one pass."""
    nx, ny, nz = gaps.shape
    least = np.empty(nz + 2, dtype=np.uint8)
    for a in range(nx):
        for b in range(ny):
            least[:] = GAP_LIMIT
            for row in range(4):
                i = a if row == 3 else a - 1
                j = b - 1 if row == 3 else b + row - 1
                if i < 0 or j < 0 or j >= ny:
                    continue
                for k in range(nz):
                    least[k + 1] = min(least[k + 1], gaps[i, j, k])
            for k in range(nz):
                near = min(min(least[k], least[k + 1]), least[k + 2])
                if k > 0:
                    near = min(near, gaps[a, b, k - 1])
                gaps[a, b, k] = min(gaps[a, b, k], near + 1)


@njit(cache=True, nogil=True, fastmath=True)
def _occupy(values, blocks):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Mark the blocks that hold an inside value."""
    nx, ny, nz = values.shape
    highest = np.empty(nz, dtype=np.float32)
    for a in range(blocks.shape[0]):
        for b in range(blocks.shape[1]):
            highest[:] = np.float32(-1.0)
            for i in range(BLOCK * a, min(BLOCK * (a + 1), nx)):
                for j in range(BLOCK * b, min(BLOCK * (b + 1), ny)):
                    for k in range(nz):
                        highest[k] = max(highest[k], values[i, j, k])
            for k in range(nz):
                if highest[k] > 0:
                    blocks[a, b, k // BLOCK] = True
