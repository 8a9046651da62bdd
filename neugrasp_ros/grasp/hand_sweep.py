# SPDX-License-Identifier: Apache-2.0
"""What the whole hand would meet on its way to a grasp, read off the occupancy field.

A prototype measured that knowing where the hand first touches something is worth five
points of AUC over the local surface alone (learning sheet, 2): the local views cannot
see the hand's body or the way it comes.
"""

from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from neugrasp_ros.geometry.grid import ScalarGrid, run_in_parts, sample_one
from neugrasp_ros.geometry.grid_skips import BLOCK
from neugrasp_ros.geometry.gripper import Gripper

FloatArray = NDArray[np.float64]

STATIONS = (-0.10, -0.08, -0.06, -0.05, -0.04, -0.03, -0.02, -0.01, 0.0)
"""Where the hand is looked at, along its approach before the grasp, in [m]."""

FINGER_LATTICE = 0.008  # [m], greatest spacing of the points that stand for a finger
PALM_LATTICE = 0.016  # [m], the same for the palm's box
PARTS = 3  # left finger, right finger, palm

SWEEP_FEATURES = len(STATIONS) + PARTS + 1
"""Width of the result of ``sweep_hands``."""


@lru_cache(maxsize=64)
def hand_points(gripper: Gripper, opening: float) -> tuple[FloatArray, FloatArray]:
    """Fill the hand's boxes with a lattice that includes their corners.

    Returns:
        Points in the gripper frame in [m], shape (N, 3), and the part (0 left finger,
        1 right finger, 2 palm) of each, shape (N,).
    """
    points, parts = [], []
    for part, (center, half) in enumerate(zip(*gripper.boxes(opening), strict=True)):
        spacing = PALM_LATTICE if part == PARTS - 1 else FINGER_LATTICE
        counts = np.maximum(2, np.ceil(2 * half / spacing).astype(int) + 1)
        axes = [np.linspace(-h, h, n) for h, n in zip(half, counts, strict=True)]
        lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        points.append(center + lattice)
        parts.append(np.full(len(lattice), part))
    return np.concatenate(points), np.concatenate(parts)


def sweep_hands(
    field: ScalarGrid,
    T_task_grippers: FloatArray,
    widths: FloatArray,
    gripper: Gripper,
    *,
    support_height: float,
    threads: int = 1,
) -> NDArray[np.float32]:
    """Look along the way of each hand for what is in it.

    Args:
        field: Occupancy logits, positive inside, in the task frame.
        T_task_grippers: Grasp poses, shape (G, 4, 4).
        widths: Jaw openings in [m], shape (G,); rounded to the nearest 5 mm.
        gripper: The gripper.
        support_height: Height of the support plane in the task frame in [m].
        threads: Worker threads.

    Returns:
        Shape (G, SWEEP_FEATURES): the greatest logit met at each station; the greatest
        logit met by each part at the grasp (-8 where no surface is near); and the
        height of the hand's lowest point above the support plane in [m] at the grasp.
    """
    poses = np.ascontiguousarray(T_task_grippers, dtype=np.float64)
    out = np.zeros((len(poses), SWEEP_FEATURES), dtype=np.float32)
    rounded = np.clip(np.round(np.asarray(widths) / 0.005) * 0.005, 0.005, None)
    rounded = np.minimum(rounded, gripper.max_opening)
    stations, blocks = np.array(STATIONS), field.blocks
    for opening in np.unique(rounded):
        rows = np.flatnonzero(rounded == opening)
        points, parts = hand_points(gripper, float(opening))
        chosen, result = poses[rows], np.zeros((len(rows), SWEEP_FEATURES), np.float32)

        def run(part: slice) -> None:
            _sweep(
                field.values,
                blocks,
                1.0 / field.spacing,
                chosen[part],  # noqa: B023 (called before the loop goes on)
                points,  # noqa: B023
                parts,  # noqa: B023
                stations,
                support_height,
                result[part],  # noqa: B023
            )

        run_in_parts(run, len(rows), threads)
        out[rows] = result
    return out


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _sweep(  # type: ignore[no-untyped-def]  # noqa: PLR0913 (a numba kernel)
    values, blocks, inverse, poses, points, parts, stations, support_height, out
):  # pragma: no cover - compiled
    n_stations = len(stations)
    edge = np.array(values.shape) / inverse
    for g in range(len(poses)):
        T = poses[g]
        out[g, : n_stations + 3] = -8.0
        lowest = 1e9
        for n in range(len(points)):
            a, b, c = points[n]
            x = T[0, 0] * a + T[0, 1] * b + T[0, 2] * c + T[0, 3]
            y = T[1, 0] * a + T[1, 1] * b + T[1, 2] * c + T[1, 3]
            z = T[2, 0] * a + T[2, 1] * b + T[2, 2] * c + T[2, 3]
            lowest = min(lowest, z)
            for s in range(n_stations):
                u = x + stations[s] * T[0, 2]
                v = y + stations[s] * T[1, 2]
                w = z + stations[s] * T[2, 2]
                if u < 0 or v < 0 or w < 0 or u > edge[0] or v > edge[1] or w > edge[2]:
                    continue
                i = min(int(u * inverse / BLOCK), blocks.shape[0] - 1)
                j = min(int(v * inverse / BLOCK), blocks.shape[1] - 1)
                k = min(int(w * inverse / BLOCK), blocks.shape[2] - 1)
                if not blocks[i, j, k]:
                    continue
                value = sample_one(values, inverse, u, v, w)
                out[g, s] = max(out[g, s], value)
                if s == n_stations - 1:
                    slot = n_stations + parts[n]
                    out[g, slot] = max(out[g, slot], value)
        out[g, n_stations + 3] = lowest - support_height
