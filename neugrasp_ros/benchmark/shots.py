# SPDX-License-Identifier: Apache-2.0
"""Depth images to measure on: seeded scenes seen once each, on tables of any size."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.datagen.shards import load_shards
from neugrasp_ros.errors import EmptySceneError
from neugrasp_ros.fusion.tsdf import TsdfVolume, empty_volume, integrate
from neugrasp_ros.geometry.camera import BENCHMARK_INTRINSICS, Intrinsics
from neugrasp_ros.geometry.depth_noise import add_camera_noise
from neugrasp_ros.geometry.mesh import box_mesh
from neugrasp_ros.geometry.raycast import MeshScene
from neugrasp_ros.geometry.transform import look_at, translation
from sim_bridge.objects.registry import object_set, split
from sim_bridge.scene import PlacedObject, Scene, scene_meshes
from sim_bridge.scenes import build_scene
from sim_bridge.world import World

FloatArray = NDArray[np.float64]

TABLE_TOP = 0.05  # [m], as the network learned it
TABLE_THICKNESS = 0.006  # [m]
CUBE = 0.3  # [m], edge of the network's cube
POLAR = (np.deg2rad(15.0), np.deg2rad(60.0))  # of the view, from the vertical
OBJECT_SET = "procedural"  # needs no files
PART = "val"
N_OBJECTS = 5


@dataclass(frozen=True, eq=False)
class Shot:
    """One depth image of one scene.

    Attributes:
        depth: In [m], shape (480, 640); NaN = not measured.
        intrinsics: The camera.
        T_task_camera: Its pose, shape (4, 4).
        size: Edges of the workspace in [m].
        positions: Where the objects stand, in the task frame in [m], shape (K, 3).
    """

    depth: NDArray[np.float32]
    intrinsics: Intrinsics
    T_task_camera: FloatArray
    size: tuple[float, float, float]
    positions: FloatArray

    def fused(self, resolution: int = 64) -> TsdfVolume:
        """Integrate the image into a volume with ``resolution`` voxels per 30 cm."""
        voxels = tuple(round(edge * resolution / CUBE) for edge in self.size)
        volume = empty_volume((voxels[0], voxels[1], voxels[2]), self.size[0])
        return integrate(volume, self.depth, self.intrinsics, self.T_task_camera)


def piles(count: int, seed: int) -> Iterator[Scene]:
    """Drop piles of unseen procedural objects, as the benchmark does."""
    objects = object_set(OBJECT_SET)
    names = split(objects.names, PART)
    with World() as world:
        for index in range(count):
            rng = np.random.default_rng([seed, index])
            scene = build_scene(
                world, "pile", objects, names, rng, count=N_OBJECTS, seed=seed
            )
            if scene.objects:
                yield scene


def recorded(folder: Path, count: int) -> Iterator[Scene]:
    """Yield scenes of shards whose objects need no files.

    Raises:
        EmptySceneError: If the folder holds none.
    """
    found = 0
    for labels in load_shards(folder):
        objects = labels.scene.objects
        if objects and all(item.set_name == OBJECT_SET for item in objects):
            yield labels.scene
            found += 1
        if found == count:
            return
    if not found:
        raise EmptySceneError(f"{folder}: no scene of {OBJECT_SET} objects")


def table(scenes: list[Scene], size: tuple[float, float], count: int) -> Scene:
    """Spread objects of scenes over a large table, one per cell, as they lay."""
    columns = int(np.ceil(np.sqrt(count * size[0] / size[1])))
    rows = -(-count // columns)
    pool = [item for scene in scenes for item in scene.objects][:count]
    placed = []
    for n, item in enumerate(pool):
        pose = item.T_task_object.copy()
        pose[0, 3] = (n % columns + 0.5) * size[0] / columns
        pose[1, 3] = (n // columns + 0.5) * size[1] / rows
        placed.append(PlacedObject(item.set_name, item.name, item.scale, pose))
    return Scene("pile", scenes[0].seed, tuple(placed))


def shoot(
    scene: Scene,
    rng: np.random.Generator,
    size: tuple[float, float, float] = (CUBE, CUBE, CUBE),
) -> Shot:
    """See a scene on its table once, from a random side, with camera noise.

    Args:
        scene: The recipe, in the task frame.
        rng: Draws view and noise.
        size: Edges of the workspace in [m].
    """
    meshes, poses, owners = scene_meshes(scene)
    top = box_mesh(np.array([size[0] + 0.3, size[1] + 0.3, TABLE_THICKNESS]))
    center = np.array([size[0] / 2, size[1] / 2, TABLE_TOP])
    T_task_table = translation(center[0], center[1], TABLE_TOP - TABLE_THICKNESS)
    seen = MeshScene(
        (*meshes, top),
        np.concatenate([poses, T_task_table[None]]),
        (*owners, len(scene.objects)),
    )
    polar, azimuth = rng.uniform(*POLAR), rng.uniform(0, 2 * np.pi)
    away = np.array(
        [
            np.sin(polar) * np.cos(azimuth),
            np.sin(polar) * np.sin(azimuth),
            np.cos(polar),
        ]
    )
    distance = rng.uniform(0.55, 0.75) * max(1.0, 1.3 * max(size[:2]) / 0.7)
    camera, pixels = look_at(center + distance * away, center), BENCHMARK_INTRINSICS
    hits = seen.view(pixels, camera)
    shape = (pixels.height, pixels.width)
    depth = np.where(np.isfinite(hits.distances), hits.distances, np.nan)
    rays = pixels.ray_directions().reshape(-1, 3) @ camera[:3, :3].T
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    cosine = np.abs(np.einsum("ij,ij->i", rays, hits.normals))
    incidence = np.arccos(np.clip(cosine, 0, 1)).reshape(shape)
    noisy = add_camera_noise(depth.reshape(shape).astype(np.float32), incidence, rng)
    where = np.array([item.T_task_object[:3, 3] for item in scene.objects])
    return Shot(noisy, pixels, camera, size, where.reshape(-1, 3))
