# SPDX-License-Identifier: Apache-2.0
"""A table with boxes and a camera over it, in closed form, as messages."""

import numpy as np

from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.geometry.mesh import box_mesh
from neugrasp_ros.geometry.raycast import MeshScene
from neugrasp_ros.geometry.transform import look_at, translation
from neugrasp_ros.nodes.compat.images import write_depth, write_intrinsics
from neugrasp_ros.nodes.conversions import to_stamp
from neugrasp_ros.nodes.depth_fusion import workspace_pose
from neugrasp_ros.nodes.settings import WorkspaceConfig

CAMERA = Intrinsics.from_hfov(160, 120, 1.1)
CAMERA_FRAME = "camera_optical"
TABLE_Z = 0.05  # top face in the task frame [m]
BOX = 0.04  # edge [m]


class Scene:
    """A table top at 5 cm in the workspace, boxes on it, a fixed camera.

    Args:
        workspace: Where the cube is.
    """

    def __init__(self, workspace: WorkspaceConfig) -> None:
        self.T_base_task = workspace_pose(workspace)
        eye = self.T_base_task @ np.array([-0.25, 0.15, 0.65, 1.0])
        target = self.T_base_task @ np.array([0.15, 0.15, 0.05, 1.0])
        self.T_base_camera = look_at(eye[:3], target[:3])
        self._version = 0  # a camera may look from another thread meanwhile
        self._seen = (-1, np.zeros(0))
        self.clear()

    def clear(self) -> None:
        self.boxes: tuple[np.ndarray, ...] = ()
        self._version += 1

    def add_box(self, center) -> None:
        """Put a 4 cm cube, its centre in the task frame."""
        self.boxes = (*self.boxes, np.asarray(center, dtype=float))
        self._version += 1

    def depth(self) -> np.ndarray:
        version, boxes = self._version, self.boxes
        if self._seen[0] != version:
            table = box_mesh((1.0, 1.0, 0.02))
            cube = box_mesh((BOX / 2,) * 3)
            poses = [translation(0.15, 0.15, TABLE_Z - 0.02)]
            poses += [translation(*center) for center in boxes]
            meshes = [table] + [cube] * len(boxes)
            scene = MeshScene(meshes, self.T_base_task @ np.array(poses))
            self._seen = (version, scene.depth(CAMERA, self.T_base_camera))
        return self._seen[1].copy()


def depth_image(depth: np.ndarray, stamp: int, encoding: str = "32FC1"):
    return write_depth(depth, encoding, CAMERA_FRAME, to_stamp(stamp))


def camera_info(stamp: int = 0):
    return write_intrinsics(CAMERA, CAMERA_FRAME, to_stamp(stamp))
