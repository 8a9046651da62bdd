# SPDX-License-Identifier: Apache-2.0
"""Grasps of which only the pose and what it affords are learned from.

They cost nothing to prepare: no local surface is rendered for them. The stage ``hands``
teaches the view along the hand on them alone, before the affordance head listens to it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from neugrasp_ros.config import TrainConfig
from neugrasp_ros.datagen.labels import SceneLabels
from neugrasp_ros.errors import ConfigError, EmptySceneError
from neugrasp_ros.model import GraspNetwork
from neugrasp_ros.scene.encoder import volume_channels
from neugrasp_ros.scene.hand_view import HandView, hands_at
from neugrasp_ros.scene.heights import Relief, relief_of
from neugrasp_ros.training.cache import SceneEntry
from neugrasp_ros.training.device import device_of, moved
from neugrasp_ros.training.grasps import NOT_KNOWN, affordance_targets
from neugrasp_ros.training.losses import focal_loss
from neugrasp_ros.training.occupancy import TURNS, SceneCache, turn_points, turn_volume
from neugrasp_ros.training.views import EDGE, dequantise

Float32Array = NDArray[np.float32]


class SceneHands(NamedTuple):
    """G grasps of a scene, what each affords being known, and V views of it.

    Attributes:
        centers: Midpoints between the pads in units of the edge, shape (G, 3).
        axes: Rotations of the gripper frames, shape (G, 3, 3).
        classes: What they afford, 0 or 1, shape (G, A).
        heights: Of the reliefs in units of the edge, half precision, shape (V, D, D).
        seen: Of the reliefs, shape (V, D, D).
        levels: Of the reliefs, shape (V,).
    """

    centers: Float32Array
    axes: Float32Array
    classes: Float32Array
    heights: NDArray[np.float16]
    seen: NDArray[np.bool_]
    levels: Float32Array


@dataclass(frozen=True)
class HandBatch:
    """K hands in each of B scenes, and what is seen of each scene in one view.

    Attributes:
        centers: As of ``SceneHands``, shape (B, K, 3).
        axes: As of ``SceneHands``, shape (B, K, 3, 3).
        classes: As of ``SceneHands``, shape (B, K, A).
        heights: Of the reliefs, shape (B, D, D).
        seen: Of the reliefs, shape (B, D, D).
        levels: Of the reliefs, shape (B,).
    """

    centers: Tensor
    axes: Tensor
    classes: Tensor
    heights: Tensor
    seen: Tensor
    levels: Tensor


def scene_hands(labels: SceneLabels, entry: SceneEntry) -> SceneHands | None:
    """Return the grasps of a scene whose affordances are known; None without any."""
    targets = affordance_targets(labels)
    rows = np.flatnonzero((targets != NOT_KNOWN).all(axis=1))
    if not len(rows):
        return None
    poses = labels.grasps.poses()[rows].astype(np.float32)
    volumes = [volume_channels(dequantise(view)) for view in entry.volumes]
    relief = relief_of(torch.from_numpy(np.stack(volumes)))
    return SceneHands(
        poses[:, :3, 3] / np.float32(EDGE),
        poses[:, :3, :3],
        targets[rows].astype(np.float32),
        relief.heights.half().numpy(),
        relief.seen.bool().numpy(),
        relief.levels.numpy(),
    )


def turned_axes(axes: Float32Array, turn: int) -> Float32Array:
    """Turn axes (G, 3, 3) as ``turn_points`` turns points; some turns mirror them."""
    ends = turn_points(np.eye(3, dtype=np.float32), turn)
    origin = turn_points(np.zeros((1, 3), dtype=np.float32), turn)
    return np.asarray((ends - origin).T @ axes, dtype=np.float32)


def twinned(axes: Float32Array, rng: np.random.Generator) -> Float32Array:
    """Turn hands (..., 3, 3) half about their approach, or not, as the coin falls."""
    signs = np.ones((*axes.shape[:-2], 1, 3), dtype=np.float32)
    signs[..., :2] = rng.choice([-1, 1], axes.shape[:-2])[..., None, None]
    return axes * signs


class HandLoss:
    """What the view along the hand gets wrong, on scenes turned at random.

    Nothing is stretched: a scene stretched voxel by voxel has ragged outlines, and
    outlines are what is to be learned.

    Args:
        view: The view along the hand.
        scenes: Scene entries, called by their scenes' numbers; of them only reliefs are
            kept, and of those without labelled grasps nothing.
        config: How many hands are drawn in a scene, and the weight of the loss.
        labels: The labelled scenes.

    Raises:
        EmptySceneError: If nothing is labelled.
    """

    def __init__(
        self,
        view: HandView,
        scenes: SceneCache,
        config: TrainConfig,
        labels: Sequence[SceneLabels],
    ) -> None:
        self._view, self._config = view, config
        entries = {int(name): scenes[name] for name in scenes.names}
        found = (
            scene_hands(scene, entries[scene.index])
            for scene in labels
            if scene.index in entries
        )
        self._scenes = [hands for hands in found if hands is not None]
        if not self._scenes:
            raise EmptySceneError("no scene has grasps of labelled objects")

    def __call__(self, n_scenes: int, rng: np.random.Generator) -> Tensor:
        """Return the loss on some scenes."""
        chosen = rng.integers(len(self._scenes), size=n_scenes)
        drawn = zip(*(self._draw(self._scenes[i], rng) for i in chosen), strict=True)
        batch = HandBatch(*(torch.from_numpy(np.stack(parts)) for parts in drawn))
        batch = moved(batch, device_of(self._view))
        relief = Relief(batch.heights, batch.seen, batch.levels)
        said = self._view.classes(
            self._view(relief, hands_at(batch.centers, batch.axes))
        )
        return self._config.w_hands * focal_loss(said, batch.classes.flatten(0, 1))

    def _draw(
        self, scene: SceneHands, rng: np.random.Generator
    ) -> tuple[Float32Array, ...]:
        """Draw a view of a scene, a turn of it, and grasps, with replacement."""
        view, turn = rng.integers(len(scene.levels)), int(rng.integers(TURNS))
        rows = rng.integers(len(scene.classes), size=self._config.hands_per_scene)
        maps = np.stack([scene.heights[view], scene.seen[view]])[..., None]
        heights, seen = turn_volume(maps, turn)[..., 0].astype(np.float32)
        return (
            turn_points(scene.centers[rows], turn),
            twinned(turned_axes(scene.axes[rows], turn), rng),
            scene.classes[rows],
            heights,
            seen,
            scene.levels[view],
        )


class HandStage:
    """The view along the hand alone, before the affordance head listens to it.

    Args:
        network: The network; of it only the view along the hand gets gradients.
        scenes: Scene entries, see ``HandLoss``.
        config: Batch sizes.
        labels: The labelled scenes.

    Raises:
        ConfigError: If the network has no view along the hand.
        EmptySceneError: If nothing is labelled.
    """

    def __init__(
        self,
        network: GraspNetwork,
        scenes: SceneCache,
        config: TrainConfig,
        labels: Sequence[SceneLabels],
    ) -> None:
        if network.hands is None:
            raise ConfigError("the stage 'hands' needs a network with hand_view")
        self._config = config
        self._loss = HandLoss(network.hands, scenes, config, labels)
        network.eval().requires_grad_(False)
        network.hands.train().requires_grad_(True)

    def __call__(self, step: int) -> dict[str, Tensor]:
        """Return the loss of a step; its batch depends on the seed and the step."""
        rng = np.random.default_rng([self._config.seed, step, 3])
        return {"hands": self._loss(self._config.scenes_per_step, rng)}
