# SPDX-License-Identifier: Apache-2.0
"""Pictures of objects side by side, shaded by their normals."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.geometry.raycast import MeshScene
from neugrasp_ros.geometry.transform import look_at
from sim_bridge.objects.model import ObjectModel

ImageArray = NDArray[np.uint8]

LIGHT = np.array([0.35, -0.5, 0.8])  # direction to the lamp, not yet unit
AMBIENT = 0.35
BACKGROUND = 255
FIELD_OF_VIEW = 0.5  # [rad]
TINTS = np.array(
    [[205, 205, 200], [222, 120, 90], [95, 150, 205], [125, 185, 110], [235, 190, 80],
     [170, 120, 195], [110, 195, 190], [225, 145, 180]]
)  # one per part label, the first for no label  # fmt: skip


def render_object(
    model: ObjectModel, size: int = 160, azimuth: float = -0.9, elevation: float = 0.6
) -> ImageArray:
    """Draw one object on white, coloured by part label.

    Args:
        model: The object.
        size: Edge of the picture in pixels.
        azimuth: Direction of the camera about z in [rad].
        elevation: Its height above the horizon in [rad].

    Returns:
        RGB image, shape (size, size, 3).
    """
    labels = sorted(set(model.part_labels()) - {""})
    tints = [1 + labels.index(label) if label else 0 for label in model.part_labels()]
    if len(model.visuals) != len(model.parts):
        tints = [0] * len(model.visuals)
    poses = np.broadcast_to(np.eye(4), (len(model.visuals), 4, 4))
    scene = MeshScene(model.visuals, poses, tints)
    lower, upper = model.bounds()
    radius = 0.55 * float(np.linalg.norm(upper - lower))
    direction = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    center = (lower + upper) / 2
    eye = center + direction * radius / np.sin(FIELD_OF_VIEW / 2)
    intrinsics = Intrinsics.from_hfov(size, size, FIELD_OF_VIEW)
    hits = scene.view(intrinsics, look_at(eye, center))
    shade = AMBIENT + (1 - AMBIENT) * np.clip(
        hits.normals @ (LIGHT / np.linalg.norm(LIGHT)), 0, 1
    )
    color = TINTS[hits.bodies % len(TINTS)] * shade[:, None]
    image = np.where((hits.bodies >= 0)[:, None], color, BACKGROUND)
    return image.reshape(size, size, 3).astype(np.uint8)


def contact_sheet(
    models: Sequence[ObjectModel], columns: int = 12, size: int = 160
) -> ImageArray:
    """Draw objects in a grid, row by row.

    Args:
        models: The objects.
        columns: Pictures per row.
        size: Edge of each in pixels.

    Returns:
        RGB image, shape (rows * size, columns * size, 3).
    """
    rows = -(-len(models) // columns)
    sheet = np.full((rows * size, columns * size, 3), BACKGROUND, dtype=np.uint8)
    for index, model in enumerate(models):
        y, x = (index // columns) * size, (index % columns) * size
        sheet[y : y + size, x : x + size] = render_object(model, size)
    return sheet
