# SPDX-License-Identifier: Apache-2.0
"""Grasp entries that can be learned in seconds."""

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.grasp.inputs import POINT_FEATURES, TOKEN_FEATURES
from neugrasp_ros.training.cache import POINT_SCALE
from neugrasp_ros.training.grasps import NOT_KNOWN, GraspEntry

SIZE, POINTS = 16, 16
CLASSES = ("cut", "pour", "wear")
NETWORK = NetworkConfig(
    resolution=SIZE,
    plane_resolution=8,
    channels=4,
    unet_depth=1,
    unet_channels=4,
    occupancy_hidden=8,
    occupancy_blocks=1,
    local_points=POINTS,
    pointnet_width=16,
    pointnet_out=32,
    affordances=CLASSES,
)
NORMAL_X, NORMAL_Z = 3, 5  # of the point features; mirroring leaves them alone


def grasp_entry(seed: int, count: int = 12) -> GraspEntry:
    """Grasps that hold where the surface's normals look along x.

    Those that hold afford the first class where the normals look along z, the second
    where they do not, and never the third.
    """
    rng = np.random.default_rng(seed)
    labels = (np.arange(count) % 2).astype(np.uint8)
    upward = np.arange(count) % 4 > 1
    features = rng.normal(0, 0.3, (count, POINTS, POINT_FEATURES))
    features[..., NORMAL_X] += 2.0 * labels[:, None] - 1.0
    features[..., NORMAL_Z] += 2.0 * upward[:, None] - 1.0
    affordances = np.stack([upward, ~upward, np.zeros(count)], axis=1).astype(np.uint8)
    affordances[labels == 0] = NOT_KNOWN
    local = rng.integers(0, int(POINT_SCALE), (30, 3)).astype(np.uint16)
    return GraspEntry(
        rng.integers(-127, 128, (SIZE,) * 3).astype(np.int8),
        rng.integers(0, int(POINT_SCALE), (count, POINTS, 3)).astype(np.uint16),
        features.astype(np.float16),
        rng.normal(size=(count, TOKEN_FEATURES)).astype(np.float32),
        labels,
        np.ones(count, dtype=bool),
        np.ones(count, dtype=bool),
        affordances,
        np.tile(np.eye(4, dtype=np.float32), (count, 1, 1)),
        local,
        local[:, 2] < POINT_SCALE / 2,
        local_classes(local),
    )


def local_classes(local: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """The first class below the middle, the second above; unknown at the rim."""
    low = local[:, 0] < POINT_SCALE / 2
    classes = np.stack([low, ~low, np.zeros(len(low))], axis=1).astype(np.uint8)
    classes[local[:, 1] > 0.9 * POINT_SCALE] = NOT_KNOWN
    return classes
