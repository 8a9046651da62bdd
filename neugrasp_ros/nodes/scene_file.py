# SPDX-License-Identifier: Apache-2.0
"""A fused scene on disk: one ``.npz`` of plain arrays, never a pickle."""

import zipfile
import zlib
from pathlib import Path
from typing import Any, NamedTuple
from uuid import uuid4

import numpy as np

from neugrasp_ros.errors import ConfigError, SceneFileError
from neugrasp_ros.fusion.tsdf import TsdfVolume
from neugrasp_ros.nodes.settings import WorkspaceConfig

FORMAT = 1
SUFFIX = ".npz"
KEYS = {  # name: kind of numbers, dimensions
    "format": ("i", 0),
    "distances": ("f", 3),
    "weights": ("u", 3),
    "voxel_size": ("f", 0),
    "truncation": ("f", 0),
    "view_count": ("i", 0),
    "stamp": ("i", 0),
    "frame": ("U", 0),
    "origin": ("f", 1),
    "rpy": ("f", 1),
    "size": ("f", 1),
}


class SavedScene(NamedTuple):
    """A volume, the workspace that it fills, and its newest image's time in [ns]."""

    volume: TsdfVolume
    workspace: WorkspaceConfig
    stamp: int


def write_scene(path: Path, scene: SavedScene) -> None:
    """Write a scene; a file that is there is replaced as a whole or not at all.

    Args:
        path: The file, ending in ``.npz``; its folder must exist.
        scene: The scene.

    Raises:
        SceneFileError: If the path is none for a scene, or cannot be written.
    """
    path = _checked(path)
    if not path.parent.is_dir():
        raise SceneFileError(path, f"there is no folder {path.parent}")
    volume, workspace = scene.volume, scene.workspace
    arrays: dict[str, Any] = {
        "format": FORMAT,
        "distances": volume.distances,
        "weights": volume.weights,
        "voxel_size": float(volume.voxel_size),
        "truncation": float(volume.truncation),
        "view_count": int(volume.view_count),
        "stamp": int(scene.stamp),
        "frame": workspace.frame,
        "origin": np.array(workspace.origin),
        "rpy": np.array(workspace.rpy),
        "size": np.array(workspace.size),
    }
    try:
        _replace(path, arrays)
    except OSError as error:
        raise SceneFileError(path, f"cannot be written ({error.strerror})") from error


def _replace(path: Path, arrays: dict[str, Any]) -> None:
    draft = path.with_name(f".{uuid4().hex}{SUFFIX}")  # with the mode that others get
    try:
        with draft.open("xb") as file:
            np.savez_compressed(file, **arrays)
        draft.replace(path)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise


def read_scene(path: Path) -> SavedScene:
    """Read a scene.

    Raises:
        SceneFileError: If the file is missing, is no scene, or holds values that no
            scene has; the sentence says which.
    """
    path = _checked(path)
    try:
        arrays = _arrays(path)
    except FileNotFoundError as error:
        raise SceneFileError(path, "there is no such file; save a scene first") from (
            error
        )
    except OSError as error:
        raise SceneFileError(path, f"cannot be read ({error.strerror})") from error
    except (ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise SceneFileError(path, f"is no scene file ({error})") from error
    _require_kinds(path, arrays)
    return _scene(path, arrays)


def _arrays(path: Path) -> dict[str, Any]:
    with path.open("rb") as file:  # numpy leaves a torn one open
        loaded = np.load(file, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            raise ValueError("a single array")
        return {name: loaded[name] for name in loaded.files}


def _checked(path: Path) -> Path:
    if path.suffix != SUFFIX:
        raise SceneFileError(path, f"a scene file ends in {SUFFIX}")
    if path.is_dir():
        raise SceneFileError(path, "is a folder, expected a file")
    return path


def _require_kinds(path: Path, arrays: dict[str, Any]) -> None:
    missing = sorted(set(KEYS) - set(arrays))
    if missing:
        raise SceneFileError(path, f"is no scene file: it lacks {', '.join(missing)}")
    for name, (kind, dimensions) in KEYS.items():
        found = arrays[name]
        if (found.dtype.kind, found.ndim) != (kind, dimensions):
            raise SceneFileError(
                path,
                f"{name} is {found.dtype} with {found.ndim} dimensions, expected kind "
                f"{kind!r} with {dimensions}",
            )
    if arrays["format"] != FORMAT:
        raise SceneFileError(
            path, f"is of format {arrays['format']}, this version reads {FORMAT}"
        )


def _scene(path: Path, arrays: dict[str, Any]) -> SavedScene:
    distances = arrays["distances"].astype(np.float32)
    if (np.abs(distances[~np.isnan(distances)]) > 1).any():
        raise SceneFileError(path, "distances must be within -1..1, or NaN")
    lengths = {name: float(arrays[name]) for name in ("voxel_size", "truncation")}
    if not all(0 < value < 1 for value in lengths.values()):
        raise SceneFileError(path, f"lengths must be within 0..1 m, got {lengths}")
    if arrays["view_count"] < 1:
        raise SceneFileError(path, "holds a scene without any view")
    try:
        volume = TsdfVolume(
            distances,
            arrays["weights"].astype(np.uint8),
            lengths["voxel_size"],
            lengths["truncation"],
            int(arrays["view_count"]),
        )
        workspace = WorkspaceConfig(
            frame=str(arrays["frame"]),
            origin=_triple(arrays["origin"]),
            rpy=_triple(arrays["rpy"]),
            size=_triple(arrays["size"]),
        )
    except ValueError as error:
        raise SceneFileError(path, str(error)) from error
    if np.abs(volume.size - workspace.size).max() > volume.voxel_size:
        raise SceneFileError(
            path, f"{volume.size} m of voxels do not fill {workspace.size} m"
        )
    return SavedScene(volume, workspace, int(arrays["stamp"]))


def _triple(values: np.ndarray) -> tuple[float, float, float]:
    if len(values) != 3:
        raise ConfigError(f"expected x, y, z, got {values.tolist()}")
    x, y, z = map(float, values)
    return x, y, z
