# SPDX-License-Identifier: Apache-2.0
"""A sampled field at twice the resolution: interpolated, and where to ask anew.

In: samples at cell centres. Out: samples at the centres of cells half as large.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from neugrasp_ros.geometry.grid import run_in_parts

Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]


def doubled(values: Float32Array, threads: int = 1) -> Float32Array:
    """Double the resolution by linear interpolation between sample centres.

    Args:
        values: Samples, shape (X, Y, Z).
        threads: Worker threads.

    Returns:
        Shape (2X, 2Y, 2Z); beyond the outermost samples the field is constant.
    """
    values = np.ascontiguousarray(values, dtype=np.float32)
    x, y, z = values.shape
    out = np.empty((2 * x, 2 * y, 2 * z), dtype=np.float32)
    run_in_parts(lambda part: _double(values, part.start, out[part]), 2 * x, threads)
    return out


def straddling(values: Float32Array, margin: float) -> IntArray:
    """Find the samples of double resolution that lie in cells of doubt.

    A cell lies between eight samples; it is in doubt if these are neither all at least
    ``margin`` above 0 nor all so far below.

    Args:
        values: Samples, shape (X, Y, Z).
        margin: In units of the field.

    Returns:
        Indices into the result of ``doubled``, shape (N, 3).
    """
    low, high = values < margin, values > -margin
    signs = low.astype(np.uint8) | (high.astype(np.uint8) << 1)
    signs = np.ascontiguousarray(np.pad(signs, 1, mode="edge"))
    found = np.empty((_straddle(signs, np.empty((0, 3), dtype=np.int64)), 3), np.int64)
    _straddle(signs, found)
    return found


@njit(cache=True, nogil=True, fastmath=True)
def _double(values, first, out):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Write rows ``first`` and following of the doubled samples."""
    nx, ny, nz = values.shape
    near, far = np.float32(0.75), np.float32(0.25)
    row = np.empty(nz, dtype=np.float32)
    for i in range(len(out)):
        a = (first + i) // 2
        b = min(max(a + 2 * ((first + i) % 2) - 1, 0), nx - 1)
        for j in range(2 * ny):
            c = j // 2
            d = min(max(c + 2 * (j % 2) - 1, 0), ny - 1)
            for k in range(nz):
                one = near * values[a, c, k] + far * values[a, d, k]
                other = near * values[b, c, k] + far * values[b, d, k]
                row[k] = near * one + far * other
            for k in range(nz):
                out[i, j, 2 * k] = near * row[k] + far * row[max(k - 1, 0)]
                out[i, j, 2 * k + 1] = near * row[k] + far * row[min(k + 1, nz - 1)]


@njit(cache=True, nogil=True)
def _straddle(signs, out):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Write the fine samples of cells with both signs, if there is room; count them."""
    nx, ny, nz = signs.shape
    mixed = np.empty(nz - 1, dtype=np.uint8)
    count = 0
    for a in range(nx - 1):
        for b in range(ny - 1):
            for c in range(nz - 1):
                one = signs[a, b, c] | signs[a, b + 1, c]
                other = signs[a + 1, b, c] | signs[a + 1, b + 1, c]
                after = signs[a, b, c + 1] | signs[a, b + 1, c + 1]
                last = signs[a + 1, b, c + 1] | signs[a + 1, b + 1, c + 1]
                mixed[c] = one | other | after | last
            for c in range(nz - 1):
                if mixed[c] != 3:
                    continue
                for i in range(max(2 * a - 1, 0), min(2 * a + 1, 2 * nx - 4)):
                    for j in range(max(2 * b - 1, 0), min(2 * b + 1, 2 * ny - 4)):
                        for k in range(max(2 * c - 1, 0), min(2 * c + 1, 2 * nz - 4)):
                            if count < len(out):
                                out[count, 0], out[count, 1], out[count, 2] = i, j, k
                            count += 1
    return count
