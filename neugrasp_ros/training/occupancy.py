# SPDX-License-Identifier: Apache-2.0
"""First stage: the scene network learns to complete what one view shows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from neugrasp_ros.config import TrainConfig
from neugrasp_ros.errors import EmptySceneError
from neugrasp_ros.scene.encoder import volume_channels
from neugrasp_ros.scene.network import SceneNetwork
from neugrasp_ros.training.cache import POINT_SCALE, SceneEntry, entry_paths, load_entry
from neugrasp_ros.training.device import device_of, moved
from neugrasp_ros.training.losses import known_entropy, overlap_loss
from neugrasp_ros.training.stretching import (
    draw_stretch,
    stretched_points,
    stretched_volume,
)
from neugrasp_ros.training.views import boxed_rows, dequantise

Voxel = TypeVar("Voxel", bound=np.generic)

SHAPE_SPREAD = 0.15  # of a stretch, see ``draw_stretch``
TURNS = 8  # symmetries of ``turn_volume``
RESCAN_STEPS = 100  # how often new entries of the cache are looked for


@dataclass(frozen=True)
class OccupancyBatch:
    """Scenes as tensors.

    Attributes:
        volumes: Channels, shape (B, 3, D, D, D).
        points: In units of the edge, shape (B, N, 3).
        occupied: Labels 0 or 1, shape (B, N).
        inside: Points that a stretch has left in the cube, shape (B, N).
        boxed: Those among them that were drawn evenly, shape (B, N).
    """

    volumes: Tensor
    points: Tensor
    occupied: Tensor
    inside: Tensor
    boxed: Tensor


def turn_volume(volume: NDArray[Voxel], turn: int) -> NDArray[Voxel]:
    """Turn a volume (..., X, Y, Z) by one of the eight symmetries about z.

    Args:
        volume: The volume.
        turn: Quarter turns 0..3, plus 4 to mirror x first.
    """
    if turn >= 4:
        volume = np.flip(volume, axis=-3)
    return np.rot90(volume, turn % 4, axes=(-3, -2))


def turn_points(points: NDArray[np.float32], turn: int) -> NDArray[np.float32]:
    """Turn points (..., 3) in units of the edge like ``turn_volume``."""
    x, y, z = np.moveaxis(points, -1, 0)
    if turn >= 4:
        x = 1 - x
    for _ in range(turn % 4):
        x, y = 1 - y, x
    return np.stack([x, y, z], axis=-1)


class SceneCache:
    """The entries of a folder, read once and kept; the folder may grow meanwhile.

    Args:
        folder: Folder of scene entries.
        choose: Returns those of its files to read.

    Raises:
        EmptySceneError: If there is none yet.
    """

    def __init__(
        self, folder: Path, choose: Callable[[Sequence[Path]], Sequence[Path]] = list
    ) -> None:
        self._folder, self._choose = folder, choose
        self._entries: dict[str, SceneEntry] = {}
        self.rescan()
        if not self._entries:
            raise EmptySceneError(f"{folder} holds no scene entries")

    def rescan(self) -> None:
        """Read entries that are new."""
        for path in self._choose(list(entry_paths(self._folder))):
            if path.stem not in self._entries:
                self._entries[path.stem] = load_entry(path)
        self.names = list(self._entries)

    def __getitem__(self, name: str) -> SceneEntry:
        """Return the entry called ``name``."""
        return self._entries[name]


def draw_batch(
    cache: SceneCache, config: TrainConfig, rng: np.random.Generator
) -> OccupancyBatch:
    """Draw scenes, a view of each, points, a symmetry for each, and some stretches."""
    volumes, points, occupied, boxed = [], [], [], []
    for name in rng.choice(cache.names, size=config.scenes_per_step):
        entry = cache[str(name)]
        turn = int(rng.integers(TURNS))
        view = rng.integers(len(entry.volumes))
        rows = rng.integers(len(entry.points), size=config.points_per_scene)
        volume = turn_volume(entry.volumes[view], turn)
        where = entry.points[rows].astype(np.float32) / np.float32(POINT_SCALE)
        where = turn_points(where, turn)
        if rng.random() < config.stretched_share:
            stretch = draw_stretch(rng, SHAPE_SPREAD)
            volume = stretched_volume(volume, stretch)
            where = stretched_points(where, stretch)
        volumes.append(volume_channels(dequantise(volume)))
        points.append(where)
        occupied.append(entry.occupied[rows])
        first, end = boxed_rows(len(entry.points))
        boxed.append((rows >= first) & (rows < end))
    positions = torch.from_numpy(np.stack(points))
    inside = ((positions >= 0) & (positions <= 1)).all(dim=-1)
    return OccupancyBatch(
        torch.from_numpy(np.stack(volumes)),
        positions,
        torch.from_numpy(np.stack(occupied).astype(np.float32)),
        inside,
        inside & torch.from_numpy(np.stack(boxed)),
    )


class OccupancyStage:
    """Losses of the first stage, step by step.

    Args:
        network: The network to train.
        cache: Scenes.
        config: Batch sizes and weights.
    """

    def __init__(
        self, network: SceneNetwork, cache: SceneCache, config: TrainConfig
    ) -> None:
        self._network = network
        self._cache = cache
        self._config = config

    def __call__(self, step: int) -> dict[str, Tensor]:
        """Return the losses of a step; its batch depends on the seed and the step."""
        if step % RESCAN_STEPS == RESCAN_STEPS - 1:
            self._cache.rescan()
        rng = np.random.default_rng([self._config.seed, step])
        batch = draw_batch(self._cache, self._config, rng)
        batch = moved(batch, device_of(self._network))
        planes = self._network.encode(batch.volumes)
        logits = self._network.occupancy(planes, batch.points)
        entropy = known_entropy(logits, batch.occupied, batch.inside)
        overlap = overlap_loss(logits, batch.occupied, batch.boxed)
        return {
            "occupancy": self._config.w_occupancy * entropy,
            "overlap": self._config.w_overlap * overlap,
        }


@torch.no_grad()
def occupancy_iou(network: SceneNetwork, cache: SceneCache, n_scenes: int) -> float:
    """Return the mean IoU over the first views of a cache's scenes, on its points."""
    scores = []
    for name in cache.names[:n_scenes]:
        entry = cache[name]
        volume = volume_channels(dequantise(entry.volumes[0]))
        planes = network.encode(torch.from_numpy(volume)[None])
        points = entry.points.astype(np.float32) / np.float32(POINT_SCALE)
        logits = network.occupancy(planes, torch.from_numpy(points)[None])[0]
        inside = logits.numpy() > 0
        union = (inside | entry.occupied).sum()
        if union:
            scores.append((inside & entry.occupied).sum() / union)
    return float(np.mean(scores))
