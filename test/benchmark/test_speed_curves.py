# SPDX-License-Identifier: Apache-2.0
from types import SimpleNamespace

import numpy as np

from neugrasp_ros.benchmark.shots import Shot
from neugrasp_ros.benchmark.speed_curves import by_resolution, objects_without
from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.geometry.transform import look_at, translation

POSITIONS = np.array([[0.08, 0.08, 0.05], [0.22, 0.22, 0.05]])  # [m]


def shot_of_boxes() -> Shot:
    """Two boxes on a table, seen from straight above."""
    pixels = Intrinsics.from_hfov(120, 120, 0.6)
    camera = look_at(np.array([0.15, 0.15, 0.8]), np.array([0.15, 0.15, 0.0]))
    rays = pixels.ray_directions().reshape(-1, 3) @ camera[:3, :3].T
    depth = np.full(len(rays), 0.75)
    for position in POSITIONS:
        met = camera[:3, 3] + rays * 0.68  # the height of the lids
        depth[(np.abs(met[:, :2] - position[:2]) < 0.03).all(axis=1)] = 0.68
    image = depth.reshape(120, 120).astype(np.float32)
    return Shot(image, pixels, camera, (0.3, 0.3, 0.3), POSITIONS)


class OneSidedPlanner:
    """Proposes grasps on the first object only."""

    resolution = 64

    def encode(self, volume, revision):
        return volume

    def sample(self, scene):
        return SimpleNamespace(poses=translation(0.09, 0.07, 0.1)[None])


def test_objects_in_view_without_a_candidate_are_counted():
    assert objects_without(OneSidedPlanner(), shot_of_boxes()) == (2, 1)


def test_every_resolution_is_timed():
    found = by_resolution(shot_of_boxes(), repeats=1)
    assert list(found) == [40, 64, 96, 128]
    assert all(min(row.values()) > 0 for row in found.values())
    assert found[128]["encoder_ms"] > found[40]["encoder_ms"]
