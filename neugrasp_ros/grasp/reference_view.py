# SPDX-License-Identifier: Apache-2.0
"""The paper's local renderer, literally: the yardstick of the fast one.

Every sample of every ray asks the network: 184 thousand queries a grasp (method sheet,
d5). Same result type as ``local_view``.
"""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.gripper import Gripper
from neugrasp_ros.geometry.ray_search import first_crossings, outward_normals
from neugrasp_ros.geometry.transform import apply
from neugrasp_ros.grasp.local_view import (
    FULL_SIZE,
    LocalViews,
    crop_box,
    local_rays,
    sampled_pixels,
)

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]

N_SAMPLES = 15
NEAR, FAR = 0.001, 0.09  # [m], along the ray
NORMAL_REACH = 0.0046875  # [m], a voxel, as the fast path's


class LocalScene(Protocol):
    """What is asked about the scene, point by point, in the task frame in [m]."""

    @property
    def edge(self) -> float:
        """Edge of the cube that is known in [m]."""

    def __call__(self, points: FloatArray) -> Float32Array:
        """Return probabilities (N,) of being occupied at points (N, 3)."""

    def clipped(self, points: FloatArray) -> Float32Array:
        """Return clipped logits (N,), whose slope gives the normals."""


def render_local_reference(
    scene: LocalScene,
    T_task_grippers: FloatArray,
    gripper: Gripper,
    *,
    n_points: int,
    fov: float,
    kept_size: int,
    cast_all: bool = True,
) -> LocalViews:
    """Render the local surface of every grasp, asking the network everywhere.

    Args:
        scene: The scene.
        T_task_grippers: Grasp poses, shape (G, 4, 4).
        gripper: The gripper.
        n_points: Points per grasp, P, as the network takes them.
        fov: Field of view of the cameras in [rad].
        kept_size: Of the whole images, the network gets the pixels nearest to those of
            images of this many rows and columns, as many as it learned from.
        cast_all: Cast also the rays that are not kept, as the paper does; what is
            returned is the same without.

    Returns:
        Views. A grasp with few points keeps them: the authors score it 0 below 50, but
        every second one of those holds, so neither renderer does.
    """
    views = LocalViews(
        np.zeros((len(T_task_grippers), n_points, 3), dtype=np.float32),
        np.zeros((len(T_task_grippers), n_points, 3), dtype=np.float32),
        np.zeros(len(T_task_grippers), dtype=np.int32),
    )
    origins, directions = local_rays(gripper, FULL_SIZE, fov)
    kept = sampled_pixels(FULL_SIZE, kept_size)
    if not cast_all:
        origins, directions = origins[kept], directions[kept]
        kept = np.arange(len(kept))
    for row, T_task_gripper in enumerate(T_task_grippers):
        points = _surface(
            scene, T_task_gripper, (origins, directions), crop_box(gripper, fov)
        )[kept]
        points = points[np.isfinite(points[:, 0])][:n_points]
        if not len(points):
            continue
        normals = outward_normals(
            scene.clipped, apply(T_task_gripper, points), NORMAL_REACH
        )
        repeated = np.arange(n_points) % len(points)
        views.points[row] = points[repeated]
        views.normals[row] = (normals @ T_task_gripper[:3, :3])[repeated]
        views.hits[row] = len(points)
    return views


def _surface(
    scene: LocalScene,
    T_task_gripper: FloatArray,
    rays: tuple[FloatArray, FloatArray],
    crop: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Return what each ray meets, in the gripper frame (R, 3); NaN = nothing kept.

    Kept is what lies in the cropped region and in the cube: nothing is known beyond.
    """
    origins, directions = rays
    eyes = apply(T_task_gripper, origins)
    ways = directions @ T_task_gripper[:3, :3].T
    samples = np.linspace(NEAR, FAR, N_SAMPLES)
    distances = first_crossings(scene, eyes, ways, samples)
    points = origins + distances[:, None] * directions
    low, high = crop
    kept = ((points >= low) & (points <= high)).all(axis=1)
    there = eyes + distances[:, None] * ways
    kept &= ((there >= 0) & (there <= scene.edge)).all(axis=1)
    points[~kept] = np.nan
    return points
