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
        self.clear()

    def clear(self) -> None:
        self.boxes: list[np.ndarray] = []
        self._image: np.ndarray | None = None

    def add_box(self, center) -> None:
        """Put a 4 cm cube, its centre in the task frame."""
        self.boxes.append(np.asarray(center, dtype=float))
        self._image = None

    def depth(self) -> np.ndarray:
        if self._image is None:
            table = box_mesh((1.0, 1.0, 0.02))
            cube = box_mesh((BOX / 2,) * 3)
            poses = [translation(0.15, 0.15, TABLE_Z - 0.02)]
            poses += [translation(*center) for center in self.boxes]
            meshes = [table] + [cube] * len(self.boxes)
            scene = MeshScene(meshes, self.T_base_task @ np.array(poses))
            self._image = scene.depth(CAMERA, self.T_base_camera)
        return self._image.copy()


def depth_image(depth: np.ndarray, stamp: int, encoding: str = "32FC1"):
    return write_depth(depth, encoding, CAMERA_FRAME, to_stamp(stamp))


def camera_info(stamp: int = 0):
    return write_intrinsics(CAMERA, CAMERA_FRAME, to_stamp(stamp))
