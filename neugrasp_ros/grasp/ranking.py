# SPDX-License-Identifier: Apache-2.0
"""Choose among grasps: distinct ones, spread over the surface."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

FAILURE_REACH = 0.06  # [m] around a failed grasp's TCP: probably the same object
FAILURE_COST = 0.3  # of quality, for a grasp so near


@njit(cache=True, nogil=True)
def _suppress(
    poses: FloatArray, order: IntArray, distance: float, min_trace: float
) -> IntArray:
    kept = np.empty(len(order), dtype=np.int64)
    n_kept = 0
    for candidate in order:
        a = poses[candidate]
        is_new = True
        for k in range(n_kept):
            b = poses[kept[k]]
            gap = (
                (a[0, 3] - b[0, 3]) ** 2
                + (a[1, 3] - b[1, 3]) ** 2
                + (a[2, 3] - b[2, 3]) ** 2
            )
            if gap > distance * distance:
                continue
            across = 0.0
            along = 0.0
            for i in range(3):
                across += a[i, 0] * b[i, 0] + a[i, 1] * b[i, 1]
                along += a[i, 2] * b[i, 2]
            if along + abs(across) > min_trace:  # abs: the twin, half a turn about z
                is_new = False
                break
        if is_new:
            kept[n_kept] = candidate
            n_kept += 1
    return kept[:n_kept]


def distinct(
    T_task_gripper: FloatArray, scores: FloatArray, distance: float, angle: float
) -> IntArray:
    """Keep the best of every group of grasps that are nearly the same.

    Two grasps are nearly the same when their TCPs are closer than ``distance`` and
    the rotation between them, or between one and the other's twin (turned 180 degrees
    about the approach axis), is smaller than ``angle``.

    Args:
        T_task_gripper: Grasp poses, shape (G, 4, 4).
        scores: Higher is kept first, shape (G,).
        distance: In [m].
        angle: In [rad].

    Returns:
        Indices of the kept grasps, best first.
    """
    order = np.argsort(-np.asarray(scores), kind="stable")
    poses = np.ascontiguousarray(T_task_gripper, dtype=np.float64)
    return np.asarray(_suppress(poses, order, distance, 1.0 + 2.0 * np.cos(angle)))


def spread(
    positions: FloatArray, scores: FloatArray, cell: float, n_max: int
) -> IntArray:
    """Order grasps so that every region's best comes before any region's second.

    Args:
        positions: Points that tell the region, in [m], shape (G, 3).
        scores: Higher comes first within a region and within a round, shape (G,).
        cell: Edge of the cubic regions in [m].
        n_max: How many to return at most.

    Returns:
        Indices of shape (min(G, n_max),).
    """
    cells = np.floor(np.asarray(positions) / cell).astype(np.int64)
    _, region = np.unique(cells, axis=0, return_inverse=True)
    order = np.lexsort((-np.asarray(scores), region.reshape(-1)))
    starts = np.searchsorted(region.reshape(-1)[order], np.arange(region.max() + 1)) \
        if len(order) else np.zeros(0, dtype=np.int64)  # fmt: skip
    rank = np.empty(len(order), dtype=np.int64)
    if len(order):
        rank[order] = np.arange(len(order)) - starts[region.reshape(-1)[order]]
    return np.lexsort((-np.asarray(scores), rank))[:n_max]


def quality_after_failures(
    positions: FloatArray, quality: FloatArray, failed: FloatArray
) -> FloatArray:
    """Return what is left of quality where grasps have failed.

    Why a grasp that looked good has failed is often the object's and cannot be seen,
    as its mass: then the next one on the same object fails as well. Of the grasps that
    the network chose for itself on training objects fewer than half held next to two
    that had failed (see the model card): after two failures no quality is left that
    makes another attempt at the same place worth while.

    Args:
        positions: TCPs in any frame in [m], shape (G, 3).
        quality: Shape (G,).
        failed: TCPs of grasps that failed in this scene, in that frame, shape (F, 3).

    Returns:
        Lowered for each failure nearby, so it may be below 0, shape (G,).
    """
    quality = np.array(quality, dtype=np.float64)
    for position in failed:
        near = np.linalg.norm(positions - position, axis=1) < FAILURE_REACH
        quality[near] -= FAILURE_COST
    return quality
