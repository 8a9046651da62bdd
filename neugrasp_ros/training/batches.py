# SPDX-License-Identifier: Apache-2.0
"""Cached grasps as tensors: batches to learn from, or all of an entry in order."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from neugrasp_ros.errors import EmptySceneError
from neugrasp_ros.geometry.transform import canonical_gripper
from neugrasp_ros.grasp.ablation import RENDERED, restricted_inputs
from neugrasp_ros.grasp.inputs import LocalInputs, mirror_inputs, perturbed
from neugrasp_ros.scene.encoder import volume_channels
from neugrasp_ros.training.cache import POINT_SCALE
from neugrasp_ros.training.grasps import NOT_KNOWN, GraspEntry, load_grasps
from neugrasp_ros.training.views import EDGE, dequantise

LOCAL_POINTS_PER_SCENE = 512


class GraspCache:
    """The grasp entries of a folder, in memory.

    Args:
        folder: Folder of grasp entries.
        choose: Returns those of its files to read.

    Raises:
        EmptySceneError: If there is none.
    """

    def __init__(
        self, folder: Path, choose: Callable[[Sequence[Path]], Sequence[Path]] = list
    ) -> None:
        paths = choose(sorted(folder.glob("*.npz")))
        self.entries = [load_grasps(path) for path in paths]
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
        judged: Grasps whose label is known, shape (B * K,).
        affordances: 0 or 1, shape (B * K, A); 0 where not known.
        known: Grasps whose affordances are known, shape (B * K,).
        local_points: In units of the edge, shape (B, M, 3).
        local_occupied: Shape (B, M).
        local_classes: 0 or 1, shape (B, M, A); 0 where not known.
        local_known: Points whose classes are known, shape (B, M).
        centers: Midpoints between the pads in units of the edge, shape (B, K, 3).
        axes: Rotations of the canonical gripper frames, shape (B, K, 3, 3).
    """

    volumes: Tensor
    points: Tensor
    point_features: Tensor
    tokens: Tensor
    labels: Tensor
    judged: Tensor
    affordances: Tensor
    known: Tensor
    local_points: Tensor
    local_occupied: Tensor
    local_classes: Tensor
    local_known: Tensor
    centers: Tensor
    axes: Tensor


def make_batch(
    entries: Sequence[GraspEntry],
    n_grasps: int,
    rng: np.random.Generator,
    local_view: str = RENDERED,
) -> GraspBatch:
    """Draw grasps of each entry, with replacement where it has too few.

    Half of the grasps, drawn at random, are mirrored, and rendered views are
    ``perturbed``.

    Args:
        entries: One view of a scene each.
        n_grasps: Grasps per entry.
        rng: Source of randomness.
        local_view: What the detector may see, see ``restricted_inputs``.
    """
    rows, inputs, local = [], [], []
    for entry in entries:
        count = len(entry.labels)
        drawn = rng.permutation(count)[:n_grasps]
        if count < n_grasps:
            drawn = np.concatenate([drawn, rng.integers(count, size=n_grasps - count)])
        rows.append(drawn)
        seen = half_mirrored(inputs_of(entry, drawn, local_view), rng)
        inputs.append(perturbed(seen, rng) if local_view == RENDERED else seen)
        local.append(rng.integers(len(entry.local_points), size=LOCAL_POINTS_PER_SCENE))
    return _stack(entries, rows, inputs, local)


def whole_batch(entry: GraspEntry, local_view: str = RENDERED) -> GraspBatch:
    """Return all grasps of an entry in their order, as they were seen."""
    rows = np.arange(len(entry.labels))
    inputs = inputs_of(entry, rows, local_view)
    return _stack([entry], [rows], [inputs], [np.arange(len(entry.local_points))])


def inputs_of(
    entry: GraspEntry, rows: NDArray[np.int64], local_view: str = RENDERED
) -> LocalInputs:
    """Return the detector's inputs of some grasps; points are in units of the edge."""
    inputs = LocalInputs(
        entry.points[rows].astype(np.float32) / np.float32(POINT_SCALE),
        entry.point_features[rows].astype(np.float32),
        entry.tokens[rows],
        np.zeros(len(rows), dtype=np.int32),
    )
    poses = entry.poses[rows].astype(np.float64)
    return restricted_inputs(inputs, poses, local_view, EDGE)


def half_mirrored(inputs: LocalInputs, rng: np.random.Generator) -> LocalInputs:
    """Mirror each grasp or not, as the coin falls."""
    mirrored = mirror_inputs(inputs)
    half = rng.random(len(inputs.tokens)) < 0.5
    return inputs._replace(
        point_features=np.where(
            half[:, None, None], mirrored.point_features, inputs.point_features
        ),
        tokens=np.where(half[:, None], mirrored.tokens, inputs.tokens),
    )


def _stack(
    entries: Sequence[GraspEntry],
    rows: Sequence[NDArray[np.int64]],
    inputs: Sequence[LocalInputs],
    local_rows: Sequence[NDArray[np.int64]],
) -> GraspBatch:
    pairs = list(zip(entries, rows, strict=True))
    targets = np.concatenate([entry.affordances[some] for entry, some in pairs])
    known = (targets != NOT_KNOWN).all(axis=1)
    local = list(zip(entries, local_rows, strict=True))
    classes = np.stack([e.local_classes[some] for e, some in local])
    classes_known = (classes != NOT_KNOWN).all(axis=2)
    volumes = [volume_channels(dequantise(entry.volume)) for entry in entries]
    poses = np.stack([entry.poses[some] for entry, some in pairs]).astype(np.float64)
    return GraspBatch(
        torch.from_numpy(np.stack(volumes)),
        torch.from_numpy(np.stack([i.points_task.reshape(-1, 3) for i in inputs])),
        torch.from_numpy(np.concatenate([i.point_features for i in inputs])),
        torch.from_numpy(np.concatenate([i.tokens for i in inputs])),
        _floats(np.concatenate([entry.labels[some] for entry, some in pairs])),
        torch.from_numpy(np.concatenate([e.judged[some] for e, some in pairs])),
        _floats(np.where(known[:, None], targets, 0)),
        torch.from_numpy(known),
        _floats(np.stack([e.local_points[some] / POINT_SCALE for e, some in local])),
        _floats(np.stack([e.local_occupied[some] for e, some in local])),
        _floats(np.where(classes_known[..., None], classes, 0)),
        torch.from_numpy(classes_known),
        _floats(poses[..., :3, 3] / EDGE),
        _floats(canonical_gripper(poses)[..., :3, :3]),
    )


def _floats(values: NDArray[np.generic]) -> Tensor:
    return torch.from_numpy(values.astype(np.float32))
