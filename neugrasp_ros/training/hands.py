# SPDX-License-Identifier: Apache-2.0
"""Grasps of which only the pose and what it affords are learned from.

They cost nothing to prepare: no local surface is rendered for them. The stage ``hands``
teaches the view along the hand on them alone, before the affordance head listens to it.
"""

from collections.abc import Sequence
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
from neugrasp_ros.scene.hand_view import hands_at
from neugrasp_ros.scene.heights import relief_of
from neugrasp_ros.training.cache import SceneEntry
from neugrasp_ros.training.device import device_of
from neugrasp_ros.training.grasps import NOT_KNOWN, affordance_targets
from neugrasp_ros.training.losses import known_entropy
from neugrasp_ros.training.occupancy import SceneCache, turn_points, turn_volume
from neugrasp_ros.training.views import EDGE, dequantise

TURNS = 8  # symmetries of ``turn_volume``

Float32Array = NDArray[np.float32]


class SceneHands(NamedTuple):
    """G grasps of a scene.

    Attributes:
        centers: Midpoints between the pads in units of the edge, shape (G, 3).
        axes: Rotations of the gripper frames, shape (G, 3, 3).
        classes: What they afford, 0 or 1, shape (G, A).
        known: Whether that is known, shape (G,).
    """

    centers: Float32Array
    axes: Float32Array
    classes: Float32Array
    known: NDArray[np.bool_]


def unknown_hand(n_classes: int) -> SceneHands:
    """Return what a batch has in place of the hands of a scene without any."""
    return SceneHands(
        np.zeros((1, 3), dtype=np.float32),
        np.eye(3, dtype=np.float32)[None],
        np.zeros((1, n_classes), dtype=np.float32),
        np.zeros(1, dtype=bool),
    )


def scene_hands(labels: SceneLabels) -> SceneHands:
    """Return the grasps of a scene whose affordances are known."""
    targets = affordance_targets(labels)
    rows = np.flatnonzero((targets != NOT_KNOWN).all(axis=1))
    poses = labels.grasps.poses()[rows].astype(np.float32)
    return SceneHands(
        poses[:, :3, 3] / np.float32(EDGE),
        poses[:, :3, :3],
        targets[rows].astype(np.float32),
        np.ones(len(rows), dtype=bool),
    )


def drawn_hands(hands: SceneHands, count: int, rng: np.random.Generator) -> SceneHands:
    """Draw grasps with replacement."""
    rows = rng.integers(len(hands.known), size=count)
    return SceneHands(
        hands.centers[rows], hands.axes[rows], hands.classes[rows], hands.known[rows]
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


class HandStage:
    """The view along the hand alone, on scenes turned at random.

    Nothing is stretched: a scene stretched voxel by voxel has ragged outlines, and
    outlines are what is to be learned.

    Args:
        network: The network; of it only the view along the hand gets gradients.
        scenes: Scene entries, called by their scenes' numbers; those without labelled
            grasps are left out.
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
        self._network, self._config, self._view = network, config, network.hands
        hands = {scene.index: scene_hands(scene) for scene in labels}
        named = [(scenes[name], hands.get(int(name))) for name in scenes.names]
        self._scenes = [(e, h) for e, h in named if h is not None and len(h.known)]
        if not self._scenes:
            raise EmptySceneError("no scene has grasps of labelled objects")
        network.eval().requires_grad_(False)
        network.hands.train().requires_grad_(True)

    def __call__(self, step: int) -> dict[str, Tensor]:
        """Return the loss of a step; its batch depends on the seed and the step."""
        config, device = self._config, device_of(self._network)
        rng = np.random.default_rng([config.seed, step, 3])
        chosen = rng.integers(len(self._scenes), size=config.scenes_per_step)
        drawn = [self._draw(self._scenes[i], rng) for i in chosen]
        volumes = torch.from_numpy(np.stack([volume for volume, _ in drawn]))
        centers, axes, classes, known = (
            torch.from_numpy(np.stack(parts)).to(device)
            for parts in zip(*(hands for _, hands in drawn), strict=True)
        )
        relief = relief_of(volumes.to(device))
        seen = self._view(relief, hands_at(centers, axes))
        said = self._view.classes(seen)
        loss = known_entropy(said, classes.flatten(0, 1), known.flatten(0, 1))
        return {"hands": config.w_hands * loss}

    def _draw(
        self, scene: tuple[SceneEntry, SceneHands], rng: np.random.Generator
    ) -> tuple[Float32Array, SceneHands]:
        """Draw a view of a scene, a turn of it, and grasps."""
        entry, hands = scene
        view, turn = rng.integers(len(entry.volumes)), int(rng.integers(TURNS))
        some = drawn_hands(hands, self._config.hands_per_scene, rng)
        turned = some._replace(
            centers=turn_points(some.centers, turn).astype(np.float32),
            axes=twinned(turned_axes(some.axes, turn), rng),
        )
        volume = turn_volume(entry.volumes[view], turn)
        return volume_channels(dequantise(volume)), turned
