# SPDX-License-Identifier: Apache-2.0
"""Scenes stretched at random: things of proportions that no generator made.

What a part affords does not change when the whole thing is a little longer, slimmer or
flatter. Hands do not stretch, so this is for points on objects and not for grasps.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.training.views import EDGE, TABLE_TOP, UNKNOWN

FloatArray = NDArray[np.float64]
Voxels = NDArray[np.int8]

SPREAD = 0.09  # standard deviation of the factors' logarithm, where parts are learned
FACTORS = 0.8, 1.25  # least and greatest
TURNED = 0.4  # [rad] to either side, in half of the draws
SHIFT = 0.08  # of the edge to either side, along x and y


class Stretch(NamedTuple):
    """An affine map of the cube that keeps the table where it is.

    Attributes:
        matrix: Of x and y about the cube's axis, shape (2, 2).
        shift: Of x and y in units of the edge, shape (2,).
        height: Factor of z about the table top.
    """

    matrix: FloatArray
    shift: FloatArray
    height: float


def draw_stretch(rng: np.random.Generator, spread: float = SPREAD) -> Stretch:
    """Draw a stretch along two random directions and z, a turn, and a shift.

    Args:
        rng: Source of randomness.
        spread: Standard deviation of the factors' logarithm.
    """
    factors = np.exp(rng.normal(0, spread, 3)).clip(*FACTORS)
    along = _turn(rng.uniform(0, np.pi))
    turn = _turn(rng.uniform(-TURNED, TURNED) if rng.random() < 0.5 else 0.0)
    matrix = turn @ along @ np.diag(factors[:2]) @ along.T
    return Stretch(matrix, rng.uniform(-SHIFT, SHIFT, 2), float(factors[2]))


def stretched_points(
    points: NDArray[np.float32], stretch: Stretch
) -> NDArray[np.float32]:
    """Map points (N, 3) in units of the edge."""
    table = TABLE_TOP / EDGE
    level = 0.5 + (points[:, :2] - 0.5) @ stretch.matrix.T + stretch.shift
    height = table + stretch.height * (points[:, 2:] - table)
    return np.concatenate([level, height], axis=1).astype(np.float32)


def stretched_volume(volume: Voxels, stretch: Stretch) -> Voxels:
    """Map a quantised volume (D, D, D); what comes in was never observed.

    Voxels take the nearest value, and distances stay as they are: they are truncated
    after a few voxels, of which a stretch changes a quarter at most.
    """
    size = len(volume)
    table = TABLE_TOP / EDGE
    centers = (np.arange(size) + 0.5) / size
    level = np.stack(np.meshgrid(centers, centers, indexing="ij"), axis=-1)
    back = np.linalg.inv(stretch.matrix)
    source = 0.5 + (level - 0.5 - stretch.shift) @ back.T
    column = np.floor(source * size).astype(np.int64)
    there = ((column >= 0) & (column < size)).all(axis=-1)
    x, y = np.moveaxis(column.clip(0, size - 1), -1, 0)
    height = table + (centers - table) / stretch.height
    z = np.floor(height * size).astype(np.int64)
    out = volume[x[..., None], y[..., None], z.clip(0, size - 1)]
    out[~there] = UNKNOWN
    out[..., (z < 0) | (z >= size)] = UNKNOWN
    return out


def _turn(angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])
