# SPDX-License-Identifier: Apache-2.0
"""Grasps of a scene scored by the detector, each with the features of its cube."""

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval, fuse_linear_bn_eval

from neugrasp_ros.geometry.transform import canonical_gripper
from neugrasp_ros.grasp.ablation import RENDERED
from neugrasp_ros.grasp.inputs import LocalInputs
from neugrasp_ros.grasp.pointnet import NeuGraspDetector
from neugrasp_ros.model import GraspNetwork
from neugrasp_ros.pipeline.scenes import EncodedScene
from neugrasp_ros.scene.cubes import cut
from neugrasp_ros.scene.encoder import volume_channels
from neugrasp_ros.scene.grid_decoder import read_projected
from neugrasp_ros.scene.grid_reading import read_trilinear
from neugrasp_ros.scene.hand_view import hands_at
from neugrasp_ros.scene.heights import Relief, relief_of
from neugrasp_ros.scene.workers import shared

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]

BATCH = 32  # grasps scored together at most: their activations stay in the cache


class Scorer:
    """The detector prepared for work: normalisation folded, features projected.

    Reading a plane and the detector's first layer are both linear, so the planes are
    multiplied by that layer once per scene: a point then reads a third of the numbers.
    Points that repeat others are left out: they do not change a maximum.

    Args:
        network: The network, in evaluation mode; it is not changed.
        threads: Worker threads.
    """

    def __init__(self, network: GraspNetwork, threads: int = 1) -> None:
        self._network = network
        self._threads = threads
        self._detector: Any = fold_batch_norms(network.detector)
        self._context: Any = None
        if network.context is not None:
            self._context = fold_batch_norms(network.context)
        self._hands: Any = None
        if network.hands is not None:
            self._hands = fold_batch_norms(network.hands)
        self._tables: tuple[EncodedScene, list[Float32Array]] | None = None
        self._grids: tuple[EncodedScene, list[Tensor]] | None = None
        self._reliefs: tuple[EncodedScene, list[Relief]] | None = None

    @torch.no_grad()
    def prepare(self, scene: EncodedScene) -> None:
        """Do what is done once per scene; before several threads score its grasps."""
        if self._works_on_runs(scene) and self._detector.read is not None:
            self._projected(scene)
        if self._context is not None:
            self._context_grids(scene, self._threads)
        if self._hands is not None:
            self._relief(scene)

    def __call__(
        self,
        scene: EncodedScene,
        poses: FloatArray,
        inputs: LocalInputs,
        cubes: NDArray[np.int64],
    ) -> tuple[FloatArray, FloatArray]:
        """Score grasps.

        Args:
            scene: The scene.
            poses: Grasp poses ``T_task_gripper``, shape (G, 4, 4).
            inputs: What is known of each grasp.
            cubes: The cube whose features a grasp reads, shape (G,).

        Returns:
            Quality (G,) and affordances (G, A), as probabilities.
        """
        score = self._score_runs if self._works_on_runs(scene) else self._score
        quality = np.empty(len(cubes))
        affordances = np.empty((len(cubes), len(self._network.config.affordances)))
        for start in range(0, len(cubes), BATCH):
            rows = slice(start, start + BATCH)
            some = LocalInputs._make(part[rows] for part in inputs)
            hands = self._hands_told(scene, poses[rows], cubes[rows])
            logits = score(scene, some, cubes[rows], hands)
            probability = self._network.probability(logits[0])
            afforded = self._network.affordance_probability(logits[1])
            quality[rows] = probability.cpu().double().numpy()
            affordances[rows] = afforded.cpu().double().numpy()
        return quality, affordances

    def _works_on_runs(self, scene: EncodedScene) -> bool:
        detector = self._detector
        on_cpu = scene.planes.device.type == "cpu"
        return on_cpu and isinstance(detector, NeuGraspDetector) and detector.takes_runs

    def _score(
        self,
        scene: EncodedScene,
        inputs: LocalInputs,
        cubes: NDArray[np.int64],
        hands: Tensor | None,
    ) -> tuple[Tensor, Tensor]:
        """Return logits of quality and affordances from all points."""
        device = scene.planes.device
        points = torch.from_numpy(inputs.point_features).to(device)
        tokens = torch.from_numpy(inputs.tokens).to(device)
        arguments = [points, tokens, self._features(scene, inputs, cubes)]
        if self._context is not None:
            n_points = inputs.points_task.shape[1]
            where = inputs.points_task.reshape(-1, 3)
            read = self._context_at(scene, where, np.repeat(cubes, n_points))
            arguments.append(read.unflatten(0, (-1, n_points)))
        if hands is not None:
            arguments.append(hands)
        logits: tuple[Tensor, Tensor] = self._detector(*arguments)
        return logits

    def _score_runs(
        self,
        scene: EncodedScene,
        inputs: LocalInputs,
        cubes: NDArray[np.int64],
        hands: Tensor | None,
    ) -> tuple[Tensor, Tensor]:
        """Return logits of quality and affordances from the distinct points."""
        n_points = inputs.point_features.shape[1]
        counts = np.clip(inputs.hits, 1, n_points).astype(np.int64)
        if self._network.config.local_view != RENDERED:
            counts[:] = n_points
        kept = np.arange(n_points) < counts[:, None]
        points = torch.from_numpy(inputs.point_features[kept])
        where, owners = inputs.points_task[kept], np.repeat(cubes, counts)
        if self._detector.read is not None:
            read = self._read(scene, where, owners)
            points = torch.cat([points, read.relu_()], dim=1)
        context = None
        if self._context is not None:
            context = self._context_at(scene, where, owners)
        tokens = torch.from_numpy(inputs.tokens)
        logits: tuple[Tensor, Tensor] = self._detector.score_runs(
            points, counts, tokens, context, hands
        )
        return logits

    def _hands_told(
        self, scene: EncodedScene, poses: FloatArray, cubes: NDArray[np.int64]
    ) -> Tensor | None:
        """Return what the view along each hand tells, (G, H), if there is one."""
        if self._hands is None:
            return None
        poses = canonical_gripper(poses)
        reliefs = self._relief(scene)
        device = scene.planes.device
        told = torch.empty((len(poses), self._network.config.hand_width), device=device)
        for cube in np.unique(cubes):
            rows = np.flatnonzero(cubes == cube)
            centers, axes = (
                torch.from_numpy(part.astype(np.float32)).to(device)[None]
                for part in (
                    scene.in_cube(cube, poses[rows, :3, 3]),
                    poses[rows, :3, :3],
                )
            )
            features = self._hands(reliefs[cube], hands_at(centers, axes))
            told[torch.from_numpy(rows).to(device)] = self._hands.described(features)
        return told

    def _relief(self, scene: EncodedScene) -> list[Relief]:
        """Return each cube's relief."""
        if self._reliefs is None or self._reliefs[0] is not scene:
            self._reliefs = (
                scene,
                [relief_of(_channels(scene, corner)) for corner in scene.corners],
            )
        return self._reliefs[1]

    def _context_at(
        self, scene: EncodedScene, points: Float32Array, cubes: NDArray[np.int64]
    ) -> Tensor:
        """Return what the context says of points (N, 3) in the task frame in [m].

        Returns:
            Shape (N, K).
        """
        context, grids = self._context, self._context_grids(scene)

        def read(cube: int, x: Tensor) -> Tensor:
            if x.device.type == "cpu":
                table = grids[cube][0].permute(1, 2, 3, 0).numpy()  # contiguous
                rows = read_trilinear(table, context.on_grid(x[0]).numpy())
                features = torch.from_numpy(rows)[None].relu_()
            else:
                features = context.features(grids[cube], x)
            told: Tensor = context.described(features, x)
            return told

        return _read_by_cube(scene, points, cubes, read)

    def _context_grids(self, scene: EncodedScene, threads: int = 1) -> list[Tensor]:
        """Return each cube's feature grid of the context.

        Returns:
            Shape (1, C, R, R, L) each, channels last in memory.
        """
        if self._grids is None or self._grids[0] is not scene:

            def see(corner: NDArray[np.int64]) -> Tensor:
                grid: Tensor = self._context(_channels(scene, corner))
                return grid.contiguous(memory_format=torch.channels_last_3d)

            self._grids = (scene, shared(see, list(scene.corners), threads))
        return self._grids[1]

    def _read(
        self, scene: EncodedScene, points: Float32Array, cubes: NDArray[np.int64]
    ) -> Tensor:
        """Return what the first layer makes of the planes at points (N, 3), (N, F)."""
        tables = self._projected(scene)
        out = np.empty((len(points), tables[0].shape[-1]), dtype=np.float32)
        for cube in np.unique(cubes):
            rows = cubes == cube
            local = scene.in_cube(cube, points[rows]).astype(np.float32)
            out[rows] = read_projected(tables[cube], local)
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
        n_points = inputs.points_task.shape[1]
        read = _read_by_cube(
            scene,
            inputs.points_task.reshape(-1, 3),
            np.repeat(cubes, n_points),
            lambda cube, x: self._network.scene.features(
                scene.planes[cube : cube + 1], x
            ),
        )
        return read.unflatten(0, (-1, n_points))


def _channels(scene: EncodedScene, corner: NDArray[np.int64]) -> Tensor:
    """Return the channels of the cube at a corner, shape (1, 3, D, D, D)."""
    part = cut(scene.volume.distances, corner, scene.cube_voxels)
    return torch.from_numpy(volume_channels(part))[None].to(scene.planes.device)


def _read_by_cube(
    scene: EncodedScene,
    points: Float32Array,
    cubes: NDArray[np.int64],
    read: Callable[[int, Tensor], Tensor],
) -> Tensor:
    """Ask each point's cube about it.

    Args:
        scene: The scene.
        points: In the task frame in [m], shape (N, 3), at least one.
        cubes: The cube of each point, shape (N,).
        read: Takes a cube and points (1, n, 3) in units of its edge; returns (1, n, K).

    Returns:
        Shape (N, K).
    """
    parts, rows = [], []
    for cube in np.unique(cubes):
        rows.append(np.flatnonzero(cubes == cube))
        local = scene.in_cube(cube, points[rows[-1]]).astype(np.float32)
        parts.append(read(cube, torch.from_numpy(local).to(scene.planes.device)[None]))
    back = torch.from_numpy(np.argsort(np.concatenate(rows)))
    return torch.cat(parts, dim=1)[0][back.to(scene.planes.device)]


def fold_batch_norms(module: nn.Module) -> nn.Module:
    """Return a copy whose layers do what the normalisation after them did."""
    return _fold(copy.deepcopy(module).eval())


def _fold(module: nn.Module) -> nn.Module:
    for name, child in list(module.named_children()):
        setattr(module, name, _fold(child))
    return _folded(module) if isinstance(module, nn.Sequential) else module


def _folded(layers: nn.Sequential) -> nn.Sequential:
    kept: list[nn.Module] = []
    for layer in layers:
        if isinstance(layer, nn.BatchNorm1d) and isinstance(kept[-1], nn.Linear):
            kept[-1] = fuse_linear_bn_eval(kept[-1], layer)
        elif isinstance(layer, nn.BatchNorm2d) and isinstance(kept[-1], nn.Conv2d):
            kept[-1] = fuse_conv_bn_eval(kept[-1], layer)
        elif isinstance(layer, nn.ReLU) and kept and isinstance(kept[-1], nn.Linear):
            kept.append(nn.ReLU(inplace=True))  # nobody else has the layer's result
        else:
            kept.append(layer)
    return nn.Sequential(*kept)
