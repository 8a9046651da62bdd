# SPDX-License-Identifier: Apache-2.0
"""Grasps of a scene scored by the detector, each with the features of its cube."""

import copy
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_linear_bn_eval

from neugrasp_ros.grasp.ablation import RENDERED
from neugrasp_ros.grasp.inputs import LocalInputs
from neugrasp_ros.grasp.pointnet import NeuGraspDetector
from neugrasp_ros.model import GraspNetwork
from neugrasp_ros.pipeline.scenes import EncodedScene
from neugrasp_ros.scene.grid_decoder import read_projected

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]

CHUNK = 32  # grasps scored together: their activations stay in the cache


class Scorer:
    """The detector prepared for work: normalisation folded, features projected.

    Reading a plane and the detector's first layer are both linear, so the planes are
    multiplied by that layer once per scene: a point then reads a third of the numbers.
    Points that repeat others are left out: they do not change a maximum.

    Args:
        network: The network, in evaluation mode; it is not changed.
        threads: Worker threads.
    """

    def __init__(self, network: GraspNetwork, threads: int) -> None:
        self._network = network
        self._threads = threads
        self._detector = fold_batch_norms(network.detector)
        self._tables: tuple[EncodedScene, list[Float32Array]] | None = None

    def __call__(
        self, scene: EncodedScene, inputs: LocalInputs, cubes: NDArray[np.int64]
    ) -> tuple[FloatArray, FloatArray]:
        """Score grasps.

        Args:
            scene: The scene.
            inputs: What is known of each grasp.
            cubes: The cube whose features a grasp reads, shape (G,).

        Returns:
            Quality (G,) and affordances (G, A), as probabilities.
        """
        n_points = inputs.point_features.shape[1]
        distinct = np.clip(inputs.hits, 1, n_points)
        if self._network.config.local_view != RENDERED:
            distinct[:] = n_points
        order = np.argsort(distinct, kind="stable")
        quality = np.empty(len(order))
        affordances = np.empty((len(order), len(self._network.config.affordances)))
        for start in range(0, len(order), CHUNK):
            rows = order[start : start + CHUNK]
            most = int(distinct[rows].max())
            some = LocalInputs(
                inputs.points_task[rows, :most],
                inputs.point_features[rows, :most],
                inputs.tokens[rows],
                inputs.hits[rows],
            )
            quality[rows], affordances[rows] = self._score(scene, some, cubes[rows])
        return quality, affordances

    def _score(
        self, scene: EncodedScene, inputs: LocalInputs, cubes: NDArray[np.int64]
    ) -> tuple[FloatArray, FloatArray]:
        """Score grasps with about as many distinct points each."""
        device = scene.planes.device
        points = torch.from_numpy(inputs.point_features).to(device)
        tokens = torch.from_numpy(inputs.tokens).to(device)
        detector = self._detector
        if isinstance(detector, NeuGraspDetector) and device.type == "cpu":
            read = None if detector.read is None else self._read(scene, inputs, cubes)
            quality, affordance = detector.score(points, tokens, read)
        else:
            features = self._features(scene, inputs, cubes)
            quality, affordance = detector(points, tokens, features)
        probability = self._network.probability(quality)
        afforded = self._network.affordance_probability(affordance)
        return probability.cpu().double().numpy(), afforded.cpu().double().numpy()

    def _read(
        self, scene: EncodedScene, inputs: LocalInputs, cubes: NDArray[np.int64]
    ) -> Tensor:
        tables = self._projected(scene)
        width = tables[0].shape[-1]
        out = np.empty((*inputs.points_task.shape[:2], width), dtype=np.float32)
        for cube in np.unique(cubes):
            rows = np.flatnonzero(cubes == cube)
            local = scene.in_cube(cube, inputs.points_task[rows]).astype(np.float32)
            read = read_projected(tables[cube], local.reshape(-1, 3), self._threads)
            out[rows] = read.reshape(len(rows), -1, width)
        return torch.from_numpy(out)

    def _projected(self, scene: EncodedScene) -> list[Float32Array]:
        """Return each cube's planes times the detector's first layer, (3, R, R, F)."""
        if self._tables is None or self._tables[0] is not scene:
            layer: Any = self._detector.read
            channels = scene.planes.shape[2]
            weight = layer.weight.unflatten(1, (3, channels))  # (F, 3, C)
            tables = torch.einsum("fpc,bpcvu->bpvuf", weight, scene.planes)
            tables[:, 0] += layer.bias
            self._tables = (scene, [np.ascontiguousarray(t.numpy()) for t in tables])
        return self._tables[1]

    def _features(
        self, scene: EncodedScene, inputs: LocalInputs, cubes: NDArray[np.int64]
    ) -> Tensor:
        """Read the plane features at all points, shape (G, P, 3C)."""
        parts = torch.zeros(0)
        for cube in np.unique(cubes):
            rows = np.flatnonzero(cubes == cube)
            local = scene.in_cube(cube, inputs.points_task[rows]).astype(np.float32)
            query = torch.from_numpy(local).to(scene.planes.device)
            planes = scene.planes[cube : cube + 1]
            read = self._network.scene.features(planes, query.flatten(0, 1)[None])[0]
            if not len(parts):
                parts = read.new_zeros((*inputs.points_task.shape[:2], read.shape[-1]))
            parts[torch.from_numpy(rows)] = read.unflatten(0, query.shape[:2])
        return parts


def fold_batch_norms(module: nn.Module) -> nn.Module:
    """Return a copy whose linear layers do what the normalisation after them did."""
    module = copy.deepcopy(module).eval()
    for parent in list(module.modules()):
        for name, child in list(parent.named_children()):
            if isinstance(child, nn.Sequential):
                setattr(parent, name, _folded(child))
    return module


def _folded(layers: nn.Sequential) -> nn.Sequential:
    kept: list[nn.Module] = []
    for layer in layers:
        if isinstance(layer, nn.BatchNorm1d) and isinstance(kept[-1], nn.Linear):
            kept[-1] = fuse_linear_bn_eval(kept[-1], layer)
        else:
            kept.append(layer)
    return nn.Sequential(*kept)
