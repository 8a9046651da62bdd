# SPDX-License-Identifier: Apache-2.0
"""What the benchmark's camera sees: where it stands, what it draws, how it errs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import UnknownNameError
from neugrasp_ros.geometry.camera import BENCHMARK_INTRINSICS, Intrinsics
from neugrasp_ros.geometry.depth_noise import add_camera_noise, add_mod_dex
from neugrasp_ros.geometry.mesh import box_mesh
from neugrasp_ros.geometry.raycast import MeshScene, RayHits
from neugrasp_ros.geometry.transform import look_at, translation
from sim_bridge.scene import SceneMeshes, posed_meshes
from sim_bridge.world import (
    TABLE_CENTER,
    TABLE_HEIGHT,
    TABLE_SIZE,
    WORKSPACE_EDGE,
    World,
)

FloatArray = NDArray[np.float64]

VIEW_CENTER = np.array([*TABLE_CENTER, 0.0])  # looked at [m], 5 cm below the table top
FAR = 2.0  # beyond this the benchmark's camera sees nothing [m]
TABLE_BODY = -2  # id of the table in segmentations


@dataclass(frozen=True, slots=True)
class ViewRange:
    """Where a camera may stand, in spherical coordinates about ``VIEW_CENTER``.

    Attributes:
        polar: Least and largest angle from straight above in [rad].
        radius: Least and largest distance in [m].
        azimuth: Least and largest angle about the vertical in [rad].
    """

    polar: tuple[float, float]
    radius: tuple[float, float]
    azimuth: tuple[float, float] = (0.0, 0.0)


def _degrees(lower: float, upper: float) -> tuple[float, float]:
    return float(np.deg2rad(lower)), float(np.deg2rad(upper))


RADII = (1.6 * WORKSPACE_EDGE, 2.4 * WORKSPACE_EDGE)
FULL_TURN = (0.0, 2.0 * np.pi)
VIEWS = {
    "fixed": ViewRange(_degrees(30, 30), (2 * WORKSPACE_EDGE, 2 * WORKSPACE_EDGE)),
    "random": ViewRange(_degrees(15, 75), RADII),
    "hard": ViewRange(_degrees(75, 75), RADII),
    "train": ViewRange(_degrees(0, 75), RADII, FULL_TURN),
}


def draw_view(
    view: str, rng: np.random.Generator, *, any_azimuth: bool = False
) -> FloatArray:
    """Draw a camera pose.

    Args:
        view: A name of ``VIEWS``.
        rng: Source of randomness.
        any_azimuth: Draw the azimuth from the full turn, as the strict protocol does;
            the benchmark's test views all have azimuth 0.

    Returns:
        ``T_task_camera``, shape (4, 4).

    Raises:
        UnknownNameError: If there is no such view.
    """
    if view not in VIEWS:
        raise UnknownNameError("view", view, VIEWS)
    ranges = VIEWS[view]
    polar = rng.uniform(*ranges.polar)
    radius = rng.uniform(*ranges.radius)
    azimuth = rng.uniform(*(FULL_TURN if any_azimuth else ranges.azimuth))
    direction = np.array(
        [
            np.sin(polar) * np.cos(azimuth),
            np.sin(polar) * np.sin(azimuth),
            np.cos(polar),
        ]
    )
    return look_at(VIEW_CENTER + radius * direction, VIEW_CENTER)


def _no_noise(
    depth: NDArray[np.float32], incidence: FloatArray, rng: np.random.Generator
) -> NDArray[np.float32]:
    return depth


def _mod_dex(
    depth: NDArray[np.float32], incidence: FloatArray, rng: np.random.Generator
) -> NDArray[np.float32]:
    return add_mod_dex(depth, rng)


NoiseModel = Callable[
    [NDArray[np.float32], FloatArray, np.random.Generator], NDArray[np.float32]
]
NOISE_MODELS: Mapping[str, NoiseModel] = {
    "none": _no_noise,
    "mod_dex": _mod_dex,
    "strict": add_camera_noise,
}


class DepthView(NamedTuple):
    """A depth image and where it was taken.

    Attributes:
        depth: Along the optical axis in [m], NaN = not measured, shape (H, W).
        intrinsics: The camera.
        T_task_camera: Its pose, shape (4, 4).
    """

    depth: NDArray[np.float32]
    intrinsics: Intrinsics
    T_task_camera: FloatArray


def table_meshes() -> SceneMeshes:
    """Return the table as one mesh with the id ``TABLE_BODY``."""
    center = translation(*TABLE_CENTER, TABLE_HEIGHT - TABLE_SIZE[2] / 2)
    return SceneMeshes(
        (box_mesh(np.asarray(TABLE_SIZE) / 2),), center[None], (TABLE_BODY,)
    )


def mesh_scene(objects: SceneMeshes, *, table: bool) -> MeshScene:
    """Return objects, with or without the table, ready to be looked at."""
    if not table:
        return MeshScene(*objects)
    support = table_meshes()
    return MeshScene(
        [*objects.meshes, *support.meshes],
        np.concatenate([objects.poses, support.poses]),
        [*objects.body_ids, *support.body_ids],
    )


def world_meshes(world: World) -> SceneMeshes:
    """Return the true shapes of a world's objects where they now are.

    Ids count ``world.object_ids``.
    """
    bodies = world.object_ids
    return posed_meshes(
        [world.model(body) for body in bodies], [world.pose(body) for body in bodies]
    )


def observe(
    scene: MeshScene,
    T_task_camera: FloatArray,
    rng: np.random.Generator,
    *,
    noise: str = "none",
    intrinsics: Intrinsics = BENCHMARK_INTRINSICS,
) -> DepthView:
    """Take a depth image.

    Args:
        scene: What there is to see.
        T_task_camera: Where from, shape (4, 4).
        rng: Source of the noise.
        noise: A name of ``NOISE_MODELS``.
        intrinsics: The camera.

    Raises:
        UnknownNameError: If there is no such noise model.
    """
    if noise not in NOISE_MODELS:
        raise UnknownNameError("noise model", noise, NOISE_MODELS)
    hits = scene.view(intrinsics, T_task_camera)
    shape = (intrinsics.height, intrinsics.width)
    depth = np.where(hits.distances <= FAR, hits.distances, np.nan)
    depth = depth.reshape(shape).astype(np.float32)
    incidence = _incidence(hits, intrinsics, T_task_camera).reshape(shape)
    return DepthView(
        NOISE_MODELS[noise](depth, incidence, rng), intrinsics, T_task_camera
    )


def _incidence(
    hits: RayHits, intrinsics: Intrinsics, T_task_camera: FloatArray
) -> FloatArray:
    """Return the angle between each pixel's ray and the normal it meets in [rad]."""
    rays = intrinsics.ray_directions().reshape(-1, 3) @ T_task_camera[:3, :3].T
    cosine = -np.einsum("ij,ij->i", rays, hits.normals) / np.linalg.norm(rays, axis=1)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))
