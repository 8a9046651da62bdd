# SPDX-License-Identifier: Apache-2.0
"""The bridge's depth camera: draws a snapshot, and not twice what has not moved."""

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.geometry.raycast import RayHits
from sim_bridge.bridge_world import Snapshot
from sim_bridge.observation import mesh_scene
from sim_bridge.scene import posed_meshes

FloatArray = NDArray[np.float64]

STILL = 2e-4  # [m] and [-]; poses that differ by less in every entry are the same
FAR = 8.0  # [m], as the robot's camera


class BridgeCamera:
    """A fixed camera over the table.

    Args:
        intrinsics: The camera.
        T_task_camera: Its pose, shape (4, 4).
    """

    def __init__(self, intrinsics: Intrinsics, T_task_camera: FloatArray) -> None:
        self.intrinsics = intrinsics
        self.T_task_camera = T_task_camera
        self._drawn: Snapshot | None = None
        self._depth = np.zeros((0, 0), dtype=np.float32)
        self._labels = np.zeros((0, 0), dtype=np.int32)
        self.renderings = 0

    def depth(self, snapshot: Snapshot) -> NDArray[np.float32]:
        """Return depth in [m], shape (H, W); NaN where nothing is met."""
        self._draw(snapshot)
        return self._depth

    def labels(self, snapshot: Snapshot) -> NDArray[np.int32]:
        """Return 1 + the object's index for each pixel, 0 for table and nothing."""
        self._draw(snapshot)
        return self._labels

    def _draw(self, snapshot: Snapshot) -> None:
        if self._drawn is not None and self.is_still(self._drawn, snapshot):
            return
        hits = self._view(snapshot)
        shape = (self.intrinsics.height, self.intrinsics.width)
        depth = np.where(hits.distances <= FAR, hits.distances, np.nan)
        self._depth = depth.reshape(shape).astype(np.float32)
        self._labels = np.maximum(hits.bodies, -1).reshape(shape) + 1
        self._drawn = snapshot
        self.renderings += 1

    def _view(self, snapshot: Snapshot) -> RayHits:
        meshes = posed_meshes(list(snapshot.models), list(snapshot.poses))
        return mesh_scene(meshes, table=True).view(self.intrinsics, self.T_task_camera)

    def is_still(self, before: Snapshot, now: Snapshot) -> bool:
        """Tell whether two snapshots would give the same picture."""
        return before.names == now.names and bool(
            (np.abs(before.poses - now.poses) < STILL).all()
        )
