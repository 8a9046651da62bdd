# SPDX-License-Identifier: Apache-2.0
"""Labelled scenes on disk: recipes and grasps, about 2 kB a scene.

A shard is a compressed npz without pickled objects. Scenes are stored as which object
lies where; views, distance volumes, occupancies and local surfaces are made again from
that. A shard appears whole or not at all: it is written beside its place and renamed.
"""

import json
import os
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.datagen.labels import GraspLabels, SceneLabels
from neugrasp_ros.errors import ShardError
from neugrasp_ros.geometry.gripper import gripper_from
from neugrasp_ros.geometry.transform import pose_from, to_position_quaternion
from sim_bridge.scene import PlacedObject, Scene

FORMAT = 2
PATTERN = "shard_*.npz"
MAX_BYTES = 38_000_000  # of a merged shard, so that none exceeds 40 MB
GRASP_FIELDS = tuple(item.name for item in fields(GraspLabels))

Columns = dict[str, NDArray[Any]]


def shard_paths(folder: str | Path) -> list[Path]:
    """Return the shards of a folder in the order of their names."""
    return sorted(Path(folder).glob(PATTERN))


def next_shard_path(folder: str | Path) -> Path:
    """Return a name after all those there are."""
    paths = shard_paths(folder)
    number = int(paths[-1].stem.split("_")[1]) + 1 if paths else 0
    return Path(folder) / f"shard_{number:06d}.npz"


def write_shard(path: str | Path, scenes: Sequence[SceneLabels]) -> int:
    """Write labelled scenes; the file appears only when it is complete.

    Args:
        path: Where to; an existing file is replaced.
        scenes: At least one.

    Returns:
        The size of the file in bytes.

    Raises:
        ShardError: If there is nothing to write.
        OSError: If the disk is full or the folder is missing.
    """
    if not scenes:
        raise ShardError(f"{path}: a shard needs at least one scene")
    path = Path(path)
    partial = path.with_name(f".{path.name}.partial")
    try:
        with partial.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **_columns(scenes))
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
    return path.stat().st_size


def _columns(scenes: Sequence[SceneLabels]) -> Columns:
    placed = [item for labels in scenes for item in labels.scene.objects]
    poses = np.array([item.T_task_object for item in placed]).reshape(-1, 4, 4)
    positions, quaternions = to_position_quaternion(poses)
    columns: Columns = {
        "format": np.array(FORMAT),
        "scene_index": np.array([s.index for s in scenes], dtype=np.int64),
        "scene_seed": np.array([s.scene.seed for s in scenes], dtype=np.int64),
        "scene_kind": np.array([s.scene.kind for s in scenes]),
        "scene_gripper": np.array([json.dumps(asdict(s.gripper)) for s in scenes]),
        "n_objects": np.array([len(s.scene.objects) for s in scenes], dtype=np.int32),
        "n_grasps": np.array([len(s.grasps) for s in scenes], dtype=np.int32),
        "object_set": np.array([item.set_name for item in placed], dtype=np.str_),
        "object_name": np.array([item.name for item in placed], dtype=np.str_),
        "object_scale": np.array([item.scale for item in placed], dtype=np.float64),
        "object_position": positions,
        "object_quaternion": quaternions,
    }
    nowhere = np.full((4, 4), np.nan)
    columns["scene_camera"] = np.array(
        [nowhere if s.T_task_camera is None else s.T_task_camera for s in scenes]
    )
    for name in GRASP_FIELDS:
        columns[name] = np.concatenate([getattr(s.grasps, name) for s in scenes])
    return columns


def _read_columns(path: Path) -> Columns:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            columns = {name: archive[name] for name in archive.files}
    except FileNotFoundError:
        raise
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise ShardError(f"{path}: damaged or truncated ({error})") from error
    version = int(columns.get("format", np.array(-1)))
    if version != FORMAT:
        raise ShardError(f"{path}: format {version}, expected {FORMAT}")
    missing = {"scene_index", "n_grasps", "object_name", *GRASP_FIELDS} - set(columns)
    if missing:
        raise ShardError(f"{path}: misses {sorted(missing)}")
    if int(columns["n_grasps"].sum()) != len(columns["positions"]):
        raise ShardError(f"{path}: grasps do not add up")
    return columns


def read_shard(path: str | Path) -> list[SceneLabels]:
    """Read all scenes of a shard.

    Raises:
        ShardError: If the file is damaged, truncated, or of another format.
    """
    columns = _read_columns(Path(path))
    object_ends = np.cumsum(columns["n_objects"])
    grasp_ends = np.cumsum(columns["n_grasps"])
    poses = pose_from(columns["object_position"], columns["object_quaternion"])
    scenes = []
    for row, index in enumerate(columns["scene_index"]):
        stop = object_ends[row]
        placed = tuple(
            PlacedObject(
                str(columns["object_set"][i]),
                str(columns["object_name"][i]),
                float(columns["object_scale"][i]),
                poses[i],
            )
            for i in range(stop - columns["n_objects"][row], stop)
        )
        rows = slice(grasp_ends[row] - columns["n_grasps"][row], grasp_ends[row])
        grasps = GraspLabels(**{name: columns[name][rows] for name in GRASP_FIELDS})
        kind, seed = str(columns["scene_kind"][row]), int(columns["scene_seed"][row])
        gripper = gripper_from(
            json.loads(str(columns["scene_gripper"][row])), str(path)
        )
        scene = Scene(kind, seed, placed)
        camera = _camera(columns, row)
        scenes.append(SceneLabels(int(index), scene, gripper, grasps, camera))
    return scenes


def _camera(columns: Columns, row: int) -> NDArray[np.float64] | None:
    """Return from where a scene was looked at; older shards do not know it."""
    if "scene_camera" not in columns or np.isnan(columns["scene_camera"][row]).any():
        return None
    return np.asarray(columns["scene_camera"][row])


def load_shards(folder: str | Path) -> Iterator[SceneLabels]:
    """Yield every labelled scene of a folder, shard by shard.

    Raises:
        ShardError: If there is no shard, or one is damaged.
    """
    paths = shard_paths(folder)
    if not paths:
        raise ShardError(f"{folder}: holds no {PATTERN}")
    for path in paths:
        yield from read_shard(path)


def done_indices(folder: str | Path) -> set[int]:
    """Return the indices of the scenes that a folder holds already.

    Raises:
        ShardError: If a shard is damaged.
    """
    return {
        int(index)
        for path in shard_paths(folder)
        for index in _read_columns(path)["scene_index"]
    }


def merge_shards(
    source: str | Path, target: str | Path, max_bytes: int = MAX_BYTES
) -> list[Path]:
    """Copy a folder's scenes, in the order of their index, into few large shards.

    Args:
        source: Folder with shards.
        target: Folder to write to; made if it is missing.
        max_bytes: Upper limit of a shard, kept by the mean size of a scene with a
            reserve of a tenth.

    Returns:
        The shards written.

    Raises:
        ShardError: If there is no shard, or one is damaged.
    """
    scenes = sorted(load_shards(source), key=lambda labels: labels.index)
    total = sum(path.stat().st_size for path in shard_paths(source))
    per_shard = max(1, int(0.9 * max_bytes * len(scenes) / total))
    Path(target).mkdir(parents=True, exist_ok=True)
    paths = []
    for start in range(0, len(scenes), per_shard):
        path = next_shard_path(target)
        write_shard(path, scenes[start : start + per_shard])
        paths.append(path)
    return paths
