# SPDX-License-Identifier: Apache-2.0
"""Greatest values over runs of rows, where each grasp has as many points as it has."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from neugrasp_ros.errors import ShapeError

Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]


def run_maxima(values: Float32Array, counts: IntArray) -> Float32Array:
    """Return the greatest value of each column over each run of rows.

    Args:
        values: Rows of all runs, one run after another, shape (N, F).
        counts: Rows of each run, at least 1, shape (G,), adding up to N.

    Returns:
        Shape (G, F).

    Raises:
        ShapeError: If the counts do not add up to the rows, or one is not positive.
    """
    counts = np.asarray(counts, dtype=np.int64)
    if counts.sum() != len(values) or (counts < 1).any():
        raise ShapeError("values", f"({counts.sum()}, F), runs of 1 up", values.shape)
    out = np.empty((len(counts), values.shape[1]), dtype=np.float32)
    _maxima(np.ascontiguousarray(values, dtype=np.float32), counts, out)
    return out


@njit(cache=True, nogil=True, fastmath=True)
def _maxima(values, counts, out):  # type: ignore[no-untyped-def]  # pragma: no cover
    row = 0
    for g in range(len(counts)):
        best = out[g]
        best[:] = values[row]
        for n in range(row + 1, row + counts[g]):
            for f in range(len(best)):
                best[f] = max(best[f], values[n, f])
        row += counts[g]
