# SPDX-License-Identifier: Apache-2.0
"""Scene recipes rendered again: volumes from random views, and true occupancy."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.fusion.tsdf import empty_volume, integrate
from neugrasp_ros.geometry.camera import BENCHMARK_INTRINSICS
from neugrasp_ros.geometry.depth_noise import add_camera_noise, add_mod_dex
from neugrasp_ros.geometry.mesh import box_mesh
from neugrasp_ros.geometry.raycast import MeshScene
from neugrasp_ros.geometry.transform import look_at, translation
from sim_bridge.scene import Scene, scene_meshes

FloatArray = NDArray[np.float64]

EDGE = 0.3  # [m]
TABLE_TOP = 0.05  # [m]
TABLE_ID = -2
VIEW_INTRINSICS = BENCHMARK_INTRINSICS.scaled(0.5)
UNKNOWN = -128  # quantised distance of a voxel that was never observed


@dataclass(frozen=True)
class ViewRange:
    """From where training looks: wider than any test (method sheet, a9).

    Attributes:
        polar: Angle from the vertical in [rad].
        radius: Distance to the foot of the cube's axis in [m].
        noise: Probabilities of no noise, camera noise, and ``mod_dex``.
    """

    polar: tuple[float, float] = (0.0, np.deg2rad(80.0))
    radius: tuple[float, float] = (0.45, 1.0)
    noise: tuple[float, float, float] = (0.35, 0.5, 0.15)


class OccupancySamples(NamedTuple):
    """Points and whether they are inside an object.

    Attributes:
        points: Points in units of the cube's edge, shape (N, 3).
        occupied: Shape (N,).
    """

    points: NDArray[np.float32]
    occupied: NDArray[np.bool_]


def object_scene(scene: Scene) -> MeshScene:
    """Return the scene's objects alone, as rendering and occupancy targets."""
    return MeshScene(*scene_meshes(scene))


def table_scene(scene: Scene) -> MeshScene:
    """Return the objects on their table, as a camera sees them."""
    meshes, poses, owners = scene_meshes(scene)
    table = box_mesh(np.array([0.6, 0.6, 0.006]))
    T_task_table = translation(EDGE / 2, EDGE / 2, TABLE_TOP - 0.006)
    return MeshScene(
        (*meshes, table),
        np.concatenate([poses, T_task_table[None]]),
        (*owners, TABLE_ID),
    )


def random_camera(views: ViewRange, rng: np.random.Generator) -> FloatArray:
    """Draw a pose ``T_task_camera`` that looks at the foot of the cube's axis."""
    polar = rng.uniform(*views.polar)
    azimuth = rng.uniform(0.0, 2 * np.pi)
    radius = rng.uniform(*views.radius)
    center = np.array([EDGE / 2, EDGE / 2, 0.0])
    direction = np.array(
        [
            np.sin(polar) * np.cos(azimuth),
            np.sin(polar) * np.sin(azimuth),
            np.cos(polar),
        ]
    )
    return look_at(center + radius * direction, center)


def render_volume(
    scene: MeshScene,
    T_task_camera: FloatArray,
    views: ViewRange,
    rng: np.random.Generator,
    resolution: int = 64,
) -> NDArray[np.float32]:
    """See a scene once and fuse what is seen.

    Args:
        scene: Objects and table.
        T_task_camera: Camera pose.
        views: Which noise to draw from.
        rng: Source of randomness.
        resolution: Voxels per edge.

    Returns:
        Distances in units of truncation, NaN = never observed, shape (D, D, D).
    """
    hits = scene.view(VIEW_INTRINSICS, T_task_camera)
    shape = (VIEW_INTRINSICS.height, VIEW_INTRINSICS.width)
    depth = np.where(np.isfinite(hits.distances), hits.distances, np.nan)
    depth = depth.reshape(shape).astype(np.float32)
    kind = rng.choice(3, p=views.noise)
    if kind == 1:
        rays = VIEW_INTRINSICS.ray_directions().reshape(-1, 3)
        rays = rays @ T_task_camera[:3, :3].T
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        cosine = np.abs(np.einsum("ij,ij->i", rays, hits.normals))
        incidence = np.arccos(np.clip(cosine, 0, 1)).reshape(shape)
        depth = add_camera_noise(depth, incidence, rng)
    elif kind == 2:
        depth = add_mod_dex(depth, rng)
    volume = empty_volume(resolution, EDGE)
    return integrate(volume, depth, VIEW_INTRINSICS, T_task_camera).distances


def sample_occupancy(
    scene: MeshScene, n_points: int, rng: np.random.Generator
) -> OccupancySamples:
    """Draw points for the occupancy loss and label them.

    Half of them lie within about a centimetre of a surface, then (``boxed_rows``) a
    quarter in the objects' bounding box and 2 cm around it, then a quarter anywhere in
    the cube: near the surface the decision is made, but scene rays travel everywhere
    (method sheet, f3.33).

    Args:
        scene: Objects without the table.
        n_points: How many.
        rng: Source of randomness.
    """
    surface, _, _ = scene.sample_surface(n_points, rng)
    if not len(surface):
        points = rng.uniform(0, EDGE, (n_points, 3))
        return OccupancySamples(
            (points / EDGE).astype(np.float32), np.zeros(n_points, dtype=bool)
        )
    first, end = boxed_rows(n_points)
    near = surface[rng.integers(len(surface), size=first)]
    near = near + rng.normal(0.0, 0.007, near.shape)
    low, high = surface.min(axis=0) - 0.02, surface.max(axis=0) + 0.02
    boxed = rng.uniform(low, high, (end - first, 3))
    anywhere = rng.uniform(0.0, EDGE, (n_points - end, 3))
    points = np.clip(np.concatenate([near, boxed, anywhere]), 0.0, EDGE)
    return OccupancySamples((points / EDGE).astype(np.float32), scene.contains(points))


def boxed_rows(n_points: int) -> tuple[int, int]:
    """Return the first of ``sample_occupancy``'s points in the box, and their end."""
    return n_points // 2, n_points // 2 + n_points // 4


def quantise(distances: NDArray[np.float32]) -> NDArray[np.int8]:
    """Store distances (-1..1, NaN = never observed) as bytes, to 1/127."""
    coarse = np.round(np.clip(np.nan_to_num(distances), -1, 1) * 127)
    return np.where(np.isnan(distances), UNKNOWN, coarse).astype(np.int8)


def dequantise(stored: NDArray[np.int8]) -> NDArray[np.float32]:
    """Undo ``quantise``."""
    distances = stored.astype(np.float32) / 127
    return np.where(stored == UNKNOWN, np.float32(np.nan), distances)
