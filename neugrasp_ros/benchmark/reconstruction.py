# SPDX-License-Identifier: Apache-2.0
"""How well the completed scene fills the objects that are really there."""

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.grid import ScalarGrid
from neugrasp_ros.geometry.raycast import MeshScene

FloatArray = NDArray[np.float64]


def field_iou(
    field: ScalarGrid, objects: MeshScene, support_height: float
) -> float | None:
    """Return the volume that both fill over the volume that either fills.

    The field is coarse inside and outside and fine where the surface passes, as in
    multi-resolution surface extraction (MISE): every sample above the support counts
    once.

    Args:
        field: Occupancy logits in the task frame, positive inside.
        objects: The true objects, without their support.
        support_height: In the task frame in [m].

    Returns:
        Between 0 and 1; None if neither fills anything.
    """
    predicted = field.values > 0
    centers = [(np.arange(n) + 0.5) * field.spacing for n in predicted.shape]
    lowest = int(np.searchsorted(centers[2], support_height))
    predicted = predicted[:, :, lowest:]
    points = np.stack(
        np.meshgrid(centers[0], centers[1], centers[2][lowest:], indexing="ij"), axis=-1
    )
    true = objects.contains(points.reshape(-1, 3)).reshape(predicted.shape)
    union = int((predicted | true).sum())
    return int((predicted & true).sum()) / union if union else None
