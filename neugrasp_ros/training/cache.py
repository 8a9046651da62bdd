# SPDX-License-Identifier: Apache-2.0
"""What training reads of a scene, rendered once and kept in a cache folder."""

import os
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import ShardError
from neugrasp_ros.training.views import (
    EDGE,
    ViewRange,
    object_scene,
    quantise,
    random_camera,
    render_volume,
    sample_occupancy,
    table_scene,
)
from sim_bridge.objects.affordance import SET_NAME as AFFORDANCE_SET
from sim_bridge.objects.affordances import AFFORDANCES
from sim_bridge.objects.grasp_labels import scene_class_points
from sim_bridge.objects.model import PointLabels
from sim_bridge.scene import Scene, placed_model

POINT_SCALE = 65535.0  # quantisation of coordinates in [0, 1]: 5 um in a 30 cm cube


@dataclass(frozen=True, eq=False)
class SceneEntry:
    """One scene as training sees it.

    Attributes:
        volumes: Quantised distances of each view, shape (V, D, D, D).
        cameras: Camera poses ``T_task_camera`` of the views, shape (V, 4, 4).
        points: Occupancy points in units of the edge times 65535, shape (N, 3).
        occupied: Their labels, shape (N,).
        part_points: Points on labelled objects, scaled like ``points``, shape (M, 3).
        part_classes: What the part at each affords, 0 or 1, shape (M, A).
        part_things: What any part of the whole thing at each affords, shape (M, A).
    """

    volumes: NDArray[np.int8]
    cameras: NDArray[np.float64]
    points: NDArray[np.uint16]
    occupied: NDArray[np.bool_]
    part_points: NDArray[np.uint16]
    part_classes: NDArray[np.uint8]
    part_things: NDArray[np.uint8]


def render_entry(
    scene: Scene,
    views: ViewRange,
    rng: np.random.Generator,
    *,
    n_views: int = 3,
    n_points: int = 8192,
    n_part_points: int = 4096,
) -> SceneEntry:
    """Render a scene for training.

    Args:
        scene: The recipe.
        views: From where, and with which noise.
        rng: Source of randomness.
        n_views: Views of the scene.
        n_points: Occupancy points, shared by the views.
        n_part_points: Points on labelled objects at most, shared as well.
    """
    seen = table_scene(scene)
    cameras = np.stack([random_camera(views, rng) for _ in range(n_views)])
    volumes = [quantise(render_volume(seen, camera, views, rng)) for camera in cameras]
    samples = sample_occupancy(object_scene(scene), n_points, rng)
    parts, things = _labelled_points(scene, rng)
    rows = rng.permutation(len(parts.points))[:n_part_points]
    return SceneEntry(
        np.stack(volumes),
        cameras,
        np.round(samples.points * POINT_SCALE).astype(np.uint16),
        samples.occupied,
        np.round(parts.points[rows] / EDGE * POINT_SCALE).astype(np.uint16),
        parts.classes[rows].astype(np.uint8),
        things[rows].astype(np.uint8),
    )


def _labelled_points(
    scene: Scene, rng: np.random.Generator
) -> tuple[PointLabels, NDArray[np.bool_]]:
    """Return points on the scene's labelled objects, within the cube.

    Returns:
        The points with what their part affords, and what any part of the thing that
        they are on affords, shape (M, A).
    """
    none = PointLabels(np.zeros((0, 3)), np.zeros((0, len(AFFORDANCES)), dtype=bool))
    drawn = [none] + [
        scene_class_points([placed_model(item)], [item.T_task_object], rng)
        for item in scene.objects
        if item.set_name == AFFORDANCE_SET
    ]
    points, classes = (np.concatenate(parts) for parts in zip(*drawn, strict=True))
    things = np.concatenate([np.broadcast_to(c.any(axis=0), c.shape) for _, c in drawn])
    kept = ((points >= 0) & (points <= EDGE)).all(axis=1) & classes.any(axis=1)
    return PointLabels(points[kept], classes[kept]), things[kept]


def save_entry(entry: SceneEntry, path: Path) -> None:
    """Write an entry; the file appears only when it is whole."""
    part = path.with_suffix(".part")
    with part.open("wb") as stream:
        np.savez_compressed(
            stream,
            volumes=entry.volumes,
            cameras=entry.cameras,
            points=entry.points,
            occupied=np.packbits(entry.occupied),
            part_points=entry.part_points,
            part_classes=entry.part_classes,
            part_things=entry.part_things,
        )
    os.replace(part, path)


def load_entry(path: Path) -> SceneEntry:
    """Read an entry.

    Raises:
        ShardError: If the file is damaged or lacks a part.
    """
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            points = file["points"]
            return SceneEntry(
                file["volumes"],
                file["cameras"],
                points,
                np.unpackbits(file["occupied"], count=len(points)).astype(bool),
                *_parts_of(file, path),
            )
    except (KeyError, ValueError, OSError, EOFError, BadZipFile, zlib.error) as error:
        raise ShardError(f"{path}: not a whole scene entry ({error})") from error


def _parts_of(
    file: Any, path: Path
) -> tuple[NDArray[np.uint16], NDArray[np.uint8], NDArray[np.uint8]]:
    """Return the labelled points of an entry; those of older caches have none.

    Raises:
        ShardError: If its points were labelled before things were.
    """
    if "part_points" in file.files and "part_things" not in file.files:
        raise ShardError(
            f"{path}: its points lack what the whole thing affords; remove the file, "
            "and the next run renders it again"
        )
    if "part_points" not in file.files:
        none = np.zeros((0, len(AFFORDANCES)), dtype=np.uint8)
        return np.zeros((0, 3), dtype=np.uint16), none, none
    return file["part_points"], file["part_classes"], file["part_things"]


def entry_paths(folder: Path) -> Iterator[Path]:
    """Yield the entries of a cache folder in the order of their names."""
    yield from sorted(folder.glob("*.npz"))
