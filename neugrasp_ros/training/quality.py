# SPDX-License-Identifier: Apache-2.0
"""Later stages: the detector learns on the network's own renders, alone or jointly."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits as bce

from neugrasp_ros.config import TrainConfig
from neugrasp_ros.model import GraspNetwork
from neugrasp_ros.scene.hand_view import hands_at
from neugrasp_ros.scene.heights import relief_of
from neugrasp_ros.training.batches import (
    GraspBatch,
    GraspCache,
    make_batch,
    whole_batch,
)
from neugrasp_ros.training.device import device_of, moved
from neugrasp_ros.training.grasps import GraspEntry
from neugrasp_ros.training.losses import affordance_loss, known_entropy
from neugrasp_ros.training.occupancy import OccupancyStage


def grasp_logits(
    network: GraspNetwork,
    planes: Tensor,
    batch: GraspBatch,
    grid: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """Score a batch's grasps with the planes (B, 3, C, R, R) of its scenes.

    Args:
        network: The network.
        planes: The scenes' planes.
        batch: The grasps.
        grid: What the network's context makes of the scenes; made here otherwise.

    Returns:
        Quality logits (B * K,) and affordance logits (B * K, A).
    """
    features = point_plane_features(network, planes, batch)
    arguments = [batch.point_features, batch.tokens, features]
    if network.context is not None:
        grid = network.context(batch.volumes) if grid is None else grid
        told = network.context.read(grid, batch.points)
        arguments.append(told.reshape(*batch.point_features.shape[:2], -1))
    if network.hands is not None:
        hands = hands_at(batch.centers, batch.axes)
        seen = network.hands(relief_of(batch.volumes), hands)
        arguments.append(network.hands.described(seen))
    logits: tuple[Tensor, Tensor] = network.detector(*arguments)
    return logits


def point_plane_features(
    network: GraspNetwork, planes: Tensor, batch: GraspBatch
) -> Tensor:
    """Return the plane features at the grasps' points, shape (B * K, P, 3 * C)."""
    features = network.scene.features(planes, batch.points)
    return features.reshape(*batch.point_features.shape[:2], -1)


def grasp_losses(
    network: GraspNetwork, planes: Tensor, batch: GraspBatch, config: TrainConfig
) -> dict[str, Tensor]:
    """Return the weighted losses of quality and, if there are heads, affordances.

    The affordance head of a network with context learns in the context's own stage.
    """
    losses = {}
    if network.context is None:
        quality, affordance = grasp_logits(network, planes, batch)
        if network.config.affordances:
            loss = affordance_loss(affordance, batch.affordances, batch.known)
            losses["affordance"] = config.w_affordance * loss
    else:
        detector: Any = network.detector
        features = point_plane_features(network, planes, batch)
        quality = detector.quality_alone(batch.point_features, batch.tokens, features)
    entropy = known_entropy(quality, batch.labels, batch.judged)
    return {"quality": config.w_quality * entropy, **losses}


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
        view = self.network.config.local_view
        batch = make_batch(entries, self.config.grasps_per_scene, rng, view)
        return chosen, moved(batch, device_of(self.network))

    def __call__(self, step: int) -> dict[str, Tensor]:
        """Return the loss of a step."""
        chosen, batch = self.draw(step)
        planes = torch.stack(
            [self._encoded(i, batch.volumes[row]) for row, i in enumerate(chosen)]
        )
        return grasp_losses(self.network, planes, batch, self.config)

    @torch.no_grad()
    def _encoded(self, index: int, volume: Tensor) -> Tensor:
        if index not in self._planes:
            with torch.autocast(volume.device.type, enabled=False):
                planes = self.network.scene.encode(volume[None])[0]
            self._planes[index] = planes.half().cpu()
        return self._planes[index].float().to(volume.device)


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
        return {
            **grasp_losses(self.network, planes, batch, self.config),
            **self._local_losses(planes, batch),
            **self._occupancy(step),
        }

    def _local_losses(self, planes: Tensor, batch: GraspBatch) -> dict[str, Tensor]:
        """Return the losses at points near the local surfaces."""
        scene, config = self.network.scene, self.config
        features = scene.features(planes, batch.local_points)
        local = scene.decoder(batch.local_points, features)
        losses = {"local": config.w_local * bce(local.float(), batch.local_occupied)}
        if self.network.config.part_head:
            loss = known_entropy(
                self.network.parts(features), batch.local_classes, batch.local_known
            )
            losses["parts"] = config.w_parts * loss
        return losses


class Predictions(NamedTuple):
    """What a network says about grasps, and the truth.

    Attributes:
        quality: Probability of success, shape (N,).
        labels: 1 = success, shape (N,).
        judged: Grasps whose label is known, shape (N,).
        affordances: Probability per class, shape (N, A).
        afforded: 0 or 1, shape (N, A); meaningless where not known.
        known: Grasps whose affordances are known and that hold, as far as they were
            tried, shape (N,).
    """

    quality: NDArray[np.float32]
    labels: NDArray[np.float32]
    judged: NDArray[np.bool_]
    affordances: NDArray[np.float32]
    afforded: NDArray[np.float32]
    known: NDArray[np.bool_]


def merged(parts: Iterable[Predictions]) -> Predictions:
    """Return the predictions of several entries or scenes as one."""
    columns: list[Any] = [np.concatenate(same) for same in zip(*parts, strict=True)]
    return Predictions(*columns)


@torch.no_grad()
def predict(network: GraspNetwork, entries: Iterable[GraspEntry]) -> Predictions:
    """Score all grasps of entries, in their order."""
    return merged(_predict_entry(network, entry) for entry in entries)


def _predict_entry(network: GraspNetwork, entry: GraspEntry) -> Predictions:
    batch = whole_batch(entry, network.config.local_view)
    planes = network.scene.encode(batch.volumes)
    quality, affordance = grasp_logits(network, planes, batch)
    return Predictions(
        network.probability(quality).numpy(),
        batch.labels.numpy(),
        batch.judged.numpy(),
        network.affordance_probability(affordance).numpy(),
        batch.affordances.numpy(),
        (batch.known & ((batch.labels > 0) | ~batch.judged)).numpy(),
    )
