# SPDX-License-Identifier: Apache-2.0
"""What a mask in the depth camera's image covers: where to look, which grasps count."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Image

from neugrasp_ros.errors import ConfigError
from neugrasp_ros.fusion.tsdf import seen_surface
from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.geometry.transform import apply, invert
from neugrasp_ros.nodes.compat.images import read_mask
from neugrasp_ros.nodes.conversions import from_stamp
from neugrasp_ros.nodes.grasp_list import GraspList
from neugrasp_ros.nodes.outcomes import Code, DetectionError
from neugrasp_ros.nodes.planner_stages import Box, in_box
from neugrasp_ros.nodes.scene_view import SceneView

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

HIDDEN = 0.10  # [m] that a target may reach behind what is seen of it
MARGIN = 0.03  # [m] that a grasp's TCP may lie beside what it holds


class Camera(NamedTuple):
    """The depth camera: its intrinsics and its optical frame."""

    intrinsics: Intrinsics
    frame_id: str


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """A mask and the camera whose image it belongs to.

    Attributes:
        pixels: True where the target is, shape (H, W).
        camera: The camera.
        stamp: Of the image in [ns]; 0 = that of the scene, which is the newest
            transform for a loaded scene.
    """

    pixels: BoolArray
    camera: Camera
    stamp: int = 0

    def covers(self, points: FloatArray, T_frame_camera: FloatArray) -> BoolArray:
        """Tell which points (N, 3) of a frame lie in pixels of the mask.

        Args:
            points: Points in the frame in [m]; NaN lies nowhere.
            T_frame_camera: The camera's pose in the frame, shape (4, 4).
        """
        x, y, z = apply(invert(T_frame_camera), points).T
        camera = self.camera.intrinsics
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.floor(camera.fx * x / z + camera.cx + 0.5)
            v = np.floor(camera.fy * y / z + camera.cy + 0.5)
            inside = (z > 0) & (u >= 0) & (u < camera.width)
            inside &= (v >= 0) & (v < camera.height)
        rows, columns = v[inside].astype(int), u[inside].astype(int)
        inside[inside] = self.pixels[rows, columns]
        return np.asarray(inside)

    def region(
        self, view: SceneView, T_frame_camera: FloatArray, roi: Box | None
    ) -> Box:
        """Return the box, in the scene's frame, in which grasps may hold the target.

        Args:
            view: The scene.
            T_frame_camera: The camera's pose in the scene's frame, shape (4, 4).
            roi: Region that the target must lie in; None = everywhere.

        Raises:
            DetectionError: EMPTY_WORKSPACE, if no seen surface is under the mask.
        """
        points, _ = seen_surface(view.volume)
        points = apply(view.T_frame_task, points)
        points = points[in_box(points, roi)]
        points = points[self.covers(points, T_frame_camera)]
        if not len(points):
            where = "workspace" if roi is None else "region of interest"
            raise DetectionError(
                Code.EMPTY_WORKSPACE,
                f"the mask covers no surface that was seen in the {where}",
            )
        rays = points - T_frame_camera[:3, 3]
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        reached = np.concatenate([points, points + HIDDEN * rays])
        low, high = reached.min(axis=0) - MARGIN, reached.max(axis=0) + MARGIN
        T_frame_box = np.eye(4)
        T_frame_box[:3, 3] = (low + high) / 2
        return Box(T_frame_box, high - low)

    def held_by(self, grasps: GraspList, T_frame_camera: FloatArray) -> BoolArray:
        """Tell which grasps, in the camera's reference frame, hold the target, (G,).

        A grasp counts by the pixel of the middle between its contacts, or of its TCP
        where no contacts are known.
        """
        middle = grasps.contacts.mean(axis=1)
        positions = grasps.grasps.poses[:, :3, 3]
        middle = np.where(np.isfinite(middle), middle, positions)
        return self.covers(middle, T_frame_camera)


def read_target(
    mask: Image, camera: Camera | None, no_camera: str = ""
) -> Target | None:
    """Return the target of a request's mask; None where the mask is left empty.

    Args:
        mask: The mask.
        camera: The depth camera, as far as it is known.
        no_camera: Why it is not known; empty = nothing has come yet.

    Raises:
        ConfigError: If the mask has another size or frame than the depth camera's
            images, or no pixel is set.
        DepthImageError: If its encoding or its data are none of a mask.
        DetectionError: NO_CAMERA_INFO, if the camera is not known yet.
    """
    if not (mask.width or mask.height or len(mask.data)):
        return None
    pixels = read_mask(mask)
    if camera is None:
        raise DetectionError(
            Code.NO_CAMERA_INFO,
            f"a mask needs depth/camera_info; {no_camera or 'none has come yet'}",
        )
    size = (camera.intrinsics.height, camera.intrinsics.width)
    if pixels.shape != size:
        raise ConfigError(
            f"mask is {mask.width}x{mask.height}, but depth/camera_info says "
            f"{size[1]}x{size[0]}"
        )
    frame = mask.header.frame_id
    if frame and frame != camera.frame_id:
        raise ConfigError(
            f"mask is of camera {frame!r}, but depth/camera_info is of "
            f"{camera.frame_id!r}"
        )
    if not pixels.any():
        raise ConfigError("mask: no pixel is set; leave it empty to look everywhere")
    return Target(pixels, camera, from_stamp(mask.header.stamp))
