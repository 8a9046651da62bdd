# SPDX-License-Identifier: Apache-2.0
"""Last stage: what things are, for the affordance head alone.

The rest of the network stays as it is, so what it says of success does too. Most of
what is learned comes from points on labelled objects, of which a scene without any
physics has thousands; the head learns on the grasps.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from neugrasp_ros.config import TrainConfig
from neugrasp_ros.datagen.labels import SceneLabels
from neugrasp_ros.errors import ConfigError, EmptySceneError
from neugrasp_ros.grasp.ablation import RENDERED
from neugrasp_ros.model import GraspNetwork
from neugrasp_ros.scene.encoder import volume_channels
from neugrasp_ros.training.batches import GraspCache, make_batch
from neugrasp_ros.training.cache import POINT_SCALE, SceneEntry
from neugrasp_ros.training.device import device_of, moved
from neugrasp_ros.training.grasps import (
    LOCAL_NOISE,
    NOT_KNOWN,
    GraspEntry,
)
from neugrasp_ros.training.hands import HandLoss, turned_axes, twinned
from neugrasp_ros.training.losses import affordance_loss, known_entropy
from neugrasp_ros.training.occupancy import TURNS, SceneCache, turn_points, turn_volume
from neugrasp_ros.training.quality import grasp_logits
from neugrasp_ros.training.stretching import (
    draw_stretch,
    stretched_points,
    stretched_volume,
)
from neugrasp_ros.training.views import EDGE, UNKNOWN, dequantise

POINTS_PER_SCENE = 768
MOVED = 5  # a scene is moved by at most as many voxels along x and y

IntArray = NDArray[np.int64]


class PointBatch(NamedTuple):
    """B scenes with N points on labelled objects each.

    Attributes:
        volumes: Channels, shape (B, 3, D, D, D).
        points: In units of the edge, shape (B, N, 3).
        classes: What the part at each affords, 0 or 1, shape (B, N, A).
        things: What any part of the thing at each affords, alike.
    """

    volumes: Tensor
    points: Tensor
    classes: Tensor
    things: Tensor


class ContextStage:
    """The losses of parts and of affordances, on scenes turned and moved at random.

    Scenes whose points alone are learned from are stretched as well.

    Args:
        network: The network; of it only the context, the view along the hand and the
            affordance head learn: all else is put into evaluation mode and needs no
            gradients from now on.
        grasps: Grasp entries; those that know of no affordance are left out.
        scenes: Scene entries; those without labelled points are left out.
        config: Batch sizes and weights.
        labels: The labelled scenes, whose grasps teach the view along the hand.

    Raises:
        ConfigError: If the network has no context, or does not see local surfaces.
        EmptySceneError: If nothing is labelled.
    """

    def __init__(
        self,
        network: GraspNetwork,
        grasps: GraspCache,
        scenes: SceneCache,
        config: TrainConfig,
        labels: Sequence[SceneLabels] = (),
    ) -> None:
        if network.context is None:
            raise ConfigError("the stage 'context' needs a network with context")
        if network.config.local_view != RENDERED:
            raise ConfigError(
                f"the stage 'context' needs local_view {RENDERED!r}, "
                f"got {network.config.local_view!r}"
            )
        self._network, self._config = network, config
        self._context = network.context
        self._grasps = [entry for entry in map(_known, grasps.entries) if entry]
        named = [scenes[name] for name in scenes.names]
        self._scenes = [entry for entry in named if len(entry.part_points)]
        if not self._grasps or not self._scenes:
            raise EmptySceneError("no scene has grasps or points of labelled objects")
        view = network.hands
        self._hands = HandLoss(view, scenes, config, labels) if view else None
        network.eval().requires_grad_(False)
        detector: Any = network.detector
        for part in (network.context, detector.affordance, network.hands):
            if part is not None:
                part.train().requires_grad_(True)

    def __call__(self, step: int) -> dict[str, Tensor]:
        """Return the losses of a step; its batch depends on the seed and the step."""
        network, config = self._network, self._config
        rng = np.random.default_rng([config.seed, step, 2])
        size = config.scenes_per_step
        chosen = rng.integers(len(self._grasps), size=size)
        turns = rng.integers(TURNS, size=size)
        shifts = rng.integers(-MOVED, MOVED + 1, size=(size, 2))
        entries = [
            turned_entry(self._grasps[i], turn, shift)
            for i, turn, shift in zip(chosen, turns, shifts, strict=True)
        ]
        device = device_of(network)
        batch = make_batch(entries, config.grasps_per_scene, rng)
        axes = torch.from_numpy(twinned(batch.axes.numpy(), rng))
        batch = moved(replace(batch, axes=axes), device)
        drawn = PointBatch(*(values.to(device) for values in self._points(rng)))
        grid = self._context(torch.cat([batch.volumes, drawn.volumes]))
        with torch.no_grad(), torch.autocast(device.type, enabled=False):
            planes = network.scene.encode(batch.volumes)
        _, logits = grasp_logits(network, planes, batch, grid[:size])
        loss = affordance_loss(logits, batch.affordances, batch.known)
        near, _ = self._told(grid[:size], batch.local_points)
        parts, things = self._told(grid[size:], drawn.points)
        inside = ((drawn.points >= 0) & (drawn.points <= 1)).all(dim=-1)
        losses = {
            "affordance": config.w_affordance * loss,
            "parts": config.w_parts
            * (
                known_entropy(near, batch.local_classes, batch.local_known)
                + known_entropy(parts, drawn.classes, inside)
            ),
        }
        if things is not None:
            entropy = known_entropy(things, drawn.things, inside)
            losses["things"] = config.w_parts * entropy
        if self._hands is not None:
            losses["hands"] = self._hands(len(drawn.volumes), rng)
        return losses

    def _told(self, grid: Tensor, points: Tensor) -> tuple[Tensor, Tensor | None]:
        """Return logits of parts and, if the network has the head, of things."""
        context = self._context
        features = context.features(grid, points)
        parts = context.part_logits(features, points)
        if context.things is None:
            return parts, None
        return parts, context.thing_logits(features, points)

    def _points(self, rng: np.random.Generator) -> PointBatch:
        """Draw scenes and points on labelled objects."""
        config = self._config
        columns: list[tuple[Any, ...]] = []
        for number in rng.integers(
            len(self._scenes), size=config.point_scenes * config.scenes_per_step
        ):
            entry: SceneEntry = self._scenes[number]
            turn, stretch = int(rng.integers(TURNS)), draw_stretch(rng)
            view = entry.volumes[rng.integers(len(entry.volumes))]
            rows = rng.integers(len(entry.part_points), size=POINTS_PER_SCENE)
            where = entry.part_points[rows].astype(np.float32) / np.float32(POINT_SCALE)
            where = stretched_points(turn_points(where, turn), stretch)
            noise = rng.normal(0, LOCAL_NOISE / EDGE, where.shape)
            there = stretched_volume(turn_volume(view, turn), stretch)
            columns.append(
                (
                    volume_channels(dequantise(there)),
                    (where + noise).astype(np.float32),
                    entry.part_classes[rows].astype(np.float32),
                    entry.part_things[rows].astype(np.float32),
                )
            )
        lists = zip(*columns, strict=True)
        return PointBatch(*(torch.from_numpy(np.stack(values)) for values in lists))


def turned_entry(entry: GraspEntry, turn: int, shift: IntArray) -> GraspEntry:
    """Turn what was seen as of ``turn_volume``, then move it.

    Grasps keep what is in their own frames: mirrored scenes go with unmirrored hands,
    which ``make_batch`` mirrors at random. Their poses are turned, and mirrored, too.

    Args:
        entry: One view and its grasps.
        turn: The symmetry.
        shift: Along x and y in [voxel], shape (2,).
    """
    size = len(entry.volume)

    def scaled(points: NDArray[np.uint16]) -> NDArray[np.uint16]:
        where = points.astype(np.float32) / np.float32(POINT_SCALE)
        there = turn_points(where, turn) + _step(shift, size)
        return np.round(np.clip(there, 0, 1) * POINT_SCALE).astype(np.uint16)

    poses = entry.poses.copy()
    centers = turn_points(poses[:, :3, 3] / np.float32(EDGE), turn)
    poses[:, :3, 3] = (centers + _step(shift, size)) * np.float32(EDGE)
    poses[:, :3, :3] = turned_axes(poses[:, :3, :3], turn)
    return replace(
        entry,
        volume=moved_volume(turn_volume(entry.volume, turn), shift),
        points=scaled(entry.points),
        local_points=scaled(entry.local_points),
        poses=poses,
    )


def moved_volume(volume: NDArray[np.int8], shift: IntArray) -> NDArray[np.int8]:
    """Move a quantised volume along x and y; what comes in was never observed.

    Args:
        volume: Shape (D, D, D).
        shift: In [voxel], shape (2,).
    """
    out = np.full_like(volume, UNKNOWN)
    size = len(volume)
    (to_x, from_x), (to_y, from_y) = (_spans(int(step), size) for step in shift)
    out[to_x, to_y] = volume[from_x, from_y]
    return out


def _spans(step: int, size: int) -> tuple[slice, slice]:
    """Return where an axis is written and read to move it by a step."""
    ahead, back = max(step, 0), max(-step, 0)
    return slice(ahead, size - back), slice(back, size - ahead)


def _step(shift: IntArray, size: int) -> NDArray[np.float32]:
    return np.array([shift[0] / size, shift[1] / size, 0.0], dtype=np.float32)


def _known(entry: GraspEntry) -> GraspEntry | None:
    """Return an entry with the grasps alone whose affordances are known."""
    rows = np.flatnonzero((entry.affordances != NOT_KNOWN).all(axis=1))
    if not len(rows):
        return None
    return replace(
        entry,
        points=entry.points[rows],
        point_features=entry.point_features[rows],
        tokens=entry.tokens[rows],
        labels=entry.labels[rows],
        judged=entry.judged[rows],
        tried=entry.tried[rows],
        affordances=entry.affordances[rows],
        poses=entry.poses[rows],
    )
