# SPDX-License-Identifier: Apache-2.0
"""Later stages: the detector learns on the network's own renders, alone or jointly."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits as bce

from neugrasp_ros.config import TrainConfig
from neugrasp_ros.errors import EmptySceneError
from neugrasp_ros.grasp.inputs import LocalInputs, mirror_inputs
from neugrasp_ros.model import GraspNetwork
from neugrasp_ros.scene.encoder import volume_channels
from neugrasp_ros.training.cache import POINT_SCALE
from neugrasp_ros.training.grasps import GraspEntry, load_grasps
from neugrasp_ros.training.occupancy import OccupancyStage
from neugrasp_ros.training.views import dequantise

LOCAL_POINTS_PER_SCENE = 512


class GraspCache:
    """The grasp entries of a folder, in memory.

    Args:
        folder: Folder of grasp entries.

    Raises:
        EmptySceneError: If there is none.
    """

    def __init__(self, folder: Path) -> None:
        self.entries = [load_grasps(path) for path in sorted(folder.glob("*.npz"))]
        if not self.entries:
            raise EmptySceneError(f"{folder} holds no grasp entries")

    def __len__(self) -> int:
        """Return the number of entries."""
        return len(self.entries)


@dataclass(frozen=True)
class GraspBatch:
    """B scenes with K grasps each.

    Attributes:
        volumes: Channels, shape (B, 3, D, D, D).
        points: Local surface points in units of the edge, shape (B, K * P, 3).
        point_features: Shape (B * K, P, F).
        tokens: Shape (B * K, T).
        labels: Shape (B * K,).
        local_points: In units of the edge, shape (B, M, 3).
        local_occupied: Shape (B, M).
    """

    volumes: Tensor
    points: Tensor
    point_features: Tensor
    tokens: Tensor
    labels: Tensor
    local_points: Tensor
    local_occupied: Tensor


def make_batch(
    entries: list[GraspEntry], n_grasps: int, rng: np.random.Generator
) -> GraspBatch:
    """Draw grasps of each entry, with replacement where it has too few.

    Half of the grasps, drawn at random, are mirrored.

    Args:
        entries: One view of a scene each.
        n_grasps: Grasps per entry.
        rng: Source of randomness.
    """
    volumes, points, features, tokens, labels, local, occupied = ([] for _ in range(7))
    for entry in entries:
        count = len(entry.labels)
        rows = rng.permutation(count)[:n_grasps]
        if count < n_grasps:
            rows = np.concatenate([rows, rng.integers(count, size=n_grasps - count)])
        inputs = LocalInputs(
            entry.points[rows].astype(np.float32) / np.float32(POINT_SCALE),
            entry.point_features[rows].astype(np.float32),
            entry.tokens[rows],
            np.zeros(len(rows), dtype=np.int32),
        )
        mirrored = mirror_inputs(inputs)
        half = rng.random(len(rows)) < 0.5
        features.append(
            np.where(
                half[:, None, None], mirrored.point_features, inputs.point_features
            )
        )
        tokens.append(np.where(half[:, None], mirrored.tokens, inputs.tokens))
        points.append(inputs.points_task.reshape(-1, 3))
        labels.append(entry.labels[rows])
        volumes.append(volume_channels(dequantise(entry.volume)))
        some = rng.integers(len(entry.local_points), size=LOCAL_POINTS_PER_SCENE)
        local.append(entry.local_points[some].astype(np.float32) / POINT_SCALE)
        occupied.append(entry.local_occupied[some])
    return GraspBatch(
        torch.from_numpy(np.stack(volumes)),
        torch.from_numpy(np.stack(points)),
        torch.from_numpy(np.concatenate(features)),
        torch.from_numpy(np.concatenate(tokens)),
        torch.from_numpy(np.concatenate(labels).astype(np.float32)),
        torch.from_numpy(np.stack(local).astype(np.float32)),
        torch.from_numpy(np.stack(occupied).astype(np.float32)),
    )


def quality_logits(network: GraspNetwork, planes: Tensor, batch: GraspBatch) -> Tensor:
    """Score a batch's grasps with the planes (B, 3, C, R, R) of its scenes."""
    features = network.scene.features(planes, batch.points)
    shape = batch.point_features.shape[:2]
    logits, _ = network.detector(
        batch.point_features,
        batch.tokens,
        features.reshape(*shape, features.shape[-1]),
    )
    return logits


class QualityStage:
    """The detector alone, on a scene network that stays as it is.

    Each view is encoded once, when it is first drawn.

    Args:
        network: The network; only its detector gets gradients.
        cache: Grasp entries.
        config: Batch sizes and weights.
    """

    def __init__(
        self, network: GraspNetwork, cache: GraspCache, config: TrainConfig
    ) -> None:
        self.network = network
        self._cache = cache
        self.config = config
        self._planes: dict[int, Tensor] = {}

    def draw(self, step: int) -> tuple[list[int], GraspBatch]:
        """Draw the entries and the batch of a step, by the seed and the step."""
        rng = np.random.default_rng([self.config.seed, step, 1])
        size = self.config.scenes_per_step
        chosen = rng.integers(len(self._cache), size=size).tolist()
        entries = [self._cache.entries[i] for i in chosen]
        return chosen, make_batch(entries, self.config.grasps_per_scene, rng)

    def __call__(self, step: int) -> dict[str, Tensor]:
        """Return the loss of a step."""
        chosen, batch = self.draw(step)
        planes = torch.stack(
            [self._encoded(i, batch.volumes[row]) for row, i in enumerate(chosen)]
        )
        logits = quality_logits(self.network, planes, batch)
        return {"quality": self.config.w_quality * bce(logits, batch.labels)}

    @torch.no_grad()
    def _encoded(self, index: int, volume: Tensor) -> Tensor:
        if index not in self._planes:
            self._planes[index] = self.network.scene.encode(volume[None])[0].half()
        return self._planes[index].float()


class JointStage(QualityStage):
    """Everything at once: occupancy, local occupancy and quality share the encoder.

    Args:
        network: The network.
        cache: Grasp entries.
        config: Batch sizes and weights.
        occupancy: The first stage's loss, on its own scenes.
    """

    def __init__(
        self,
        network: GraspNetwork,
        cache: GraspCache,
        config: TrainConfig,
        occupancy: OccupancyStage,
    ) -> None:
        super().__init__(network, cache, config)
        self._occupancy = occupancy

    def __call__(self, step: int) -> dict[str, Tensor]:
        """Return the losses of a step."""
        _, batch = self.draw(step)
        planes = self.network.scene.encode(batch.volumes)
        logits = quality_logits(self.network, planes, batch)
        local = self.network.scene.occupancy(planes, batch.local_points)
        return {
            "quality": self.config.w_quality * bce(logits, batch.labels),
            "local": self.config.w_local * bce(local, batch.local_occupied),
            **self._occupancy(step),
        }


@torch.no_grad()
def predict(network: GraspNetwork, cache: GraspCache) -> tuple[np.ndarray, np.ndarray]:
    """Return predicted probabilities and labels of all grasps of a cache, (N,) each."""
    rng = np.random.default_rng(0)
    probabilities, labels = [], []
    for entry in cache.entries:
        batch = make_batch([entry], len(entry.labels), rng)
        planes = network.scene.encode(batch.volumes)
        logits = quality_logits(network, planes, batch)
        probabilities.append(network.probability(logits).numpy())
        labels.append(batch.labels.numpy())
    return np.concatenate(probabilities), np.concatenate(labels)
