# SPDX-License-Identifier: Apache-2.0
"""The one file that knows the order of the stages.

Volume -> encode -> field -> render the scene -> sample -> render locally -> score.
Work that does not depend on a query is done once per volume and kept.
"""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.errors import ConfigError, EmptySceneError, RevisionError, ShapeError
from neugrasp_ros.fusion.tsdf import TsdfVolume
from neugrasp_ros.geometry.grid import ScalarGrid
from neugrasp_ros.geometry.gripper import Gripper, load_gripper
from neugrasp_ros.grasp.ablation import restricted_inputs
from neugrasp_ros.grasp.inputs import MIN_HITS, LocalInputs, assemble_inputs
from neugrasp_ros.grasp.sampling import SamplerConfig, sample_candidates
from neugrasp_ros.grasp.types import GraspSet
from neugrasp_ros.model import GraspNetwork, default_weights, file_sha256, load_network
from neugrasp_ros.scene.encoder import volume_channels
from neugrasp_ros.scene.field import evaluate_field
from neugrasp_ros.scene.rendering import render_surface

FloatArray = NDArray[np.float64]

DEFAULT_SUPPORT_HEIGHT = 0.05  # [m], where the cube's support plane is put
SCORE_BATCH = 64  # grasps scored at once: their activations stay in the cache


@dataclass(frozen=True, eq=False)
class EncodedScene:
    """A volume as the network sees it.

    Attributes:
        revision: Revision of the volume.
        volume: The volume itself.
        planes: Feature planes, shape (1, 3, C, R, R).
        field: Occupancy logits on the volume's grid, positive inside.
        queries: Points that the network was asked for.
    """

    revision: int
    volume: TsdfVolume
    planes: Tensor
    field: ScalarGrid
    queries: int


@dataclass(frozen=True, eq=False)
class RenderedScene:
    """The completed surface.

    Attributes:
        points: Surface points in the task frame in [m], shape (N, 3).
        normals: Outward unit normals, shape (N, 3).
    """

    points: FloatArray
    normals: FloatArray


class GraspPlanner:
    """From a volume to scored grasps of one gripper.

    Calls may come from several threads; they take turns.

    Args:
        config: Cameras, threads, numbers.
        gripper: The gripper; default the configured one.

    Raises:
        CheckpointError: If the weights cannot be used.
        UnknownNameError: If the gripper is not known.
    """

    def __init__(
        self, config: PlannerConfig | None = None, gripper: Gripper | None = None
    ) -> None:
        self.config = config or PlannerConfig()
        self.gripper = gripper or load_gripper(self.config.gripper)
        path = Path(self.config.weights) if self.config.weights else default_weights()
        network, self.card = load_network(path)
        self.weights_sha256 = file_sha256(path)
        self._network: GraspNetwork = network.to(self.config.device)
        self.affordances = network.config.affordances
        self.encoder_passes = 0
        self.timings: dict[str, float] = {}
        self._threads = self.config.threads or torch.get_num_threads()
        self._lock = threading.RLock()
        self._encoded: EncodedScene | None = None
        self._rendered: tuple[EncodedScene, RenderedScene] | None = None

    @property
    def resolution(self) -> int:
        """Voxels per edge of the volume that the network takes."""
        return self._network.config.resolution

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        with torch.no_grad():
            yield
        self.timings[stage] = time.perf_counter() - start

    def encode(self, volume: TsdfVolume, revision: int) -> EncodedScene:
        """Encode a volume and evaluate its occupancy field, once per revision.

        Args:
            volume: A cube of the network's resolution.
            revision: Its revision; the same one is not encoded twice in a row.

        Raises:
            EmptySceneError: If no voxel was ever observed.
            ShapeError: If the volume does not have the network's resolution.
        """
        with self._lock:
            known = self._encoded
            same = known is not None and known.revision == revision
            if known is not None and same and known.volume is volume:
                return known
            if known is not None and same and _equal(known.volume, volume):
                return known
            expected = (self.resolution,) * 3
            if volume.distances.shape != expected:
                raise ShapeError("volume", str(expected), volume.distances.shape)
            if not volume.observed.any():
                raise EmptySceneError("no voxel of the volume was ever observed")
            with self._timed("encoding"):
                channels = torch.from_numpy(volume_channels(volume.distances))
                planes = self._network.scene.encode(
                    channels[None].to(self.config.device)
                )
                self.encoder_passes += 1
                field, queries = evaluate_field(
                    self._network.scene,
                    planes,
                    volume.distances,
                    float(volume.size[0]),
                    self._threads,
                )
            self._encoded = EncodedScene(revision, volume, planes, field, queries)
            return self._encoded

    def render(self, scene: EncodedScene) -> RenderedScene:
        """Render the completed surface with the virtual scene cameras."""
        with self._lock:
            if self._rendered is not None and self._rendered[0] is scene:
                return self._rendered[1]
            with self._timed("rendering"):
                points, normals = render_surface(
                    scene.field, self.config.render, self._threads
                )
            self._rendered = (scene, RenderedScene(points, normals))
            return self._rendered[1]

    def sample(
        self,
        scene: EncodedScene,
        *,
        support_height: float | None = DEFAULT_SUPPORT_HEIGHT,
        roi: tuple[FloatArray, FloatArray] | None = None,
        max_candidates: int = 0,
        seed: int = 0,
    ) -> GraspSet:
        """Sample candidates on the completed surface.

        Args:
            scene: The scene.
            support_height: Height of the support plane in the task frame in [m].
            roi: Lower and upper corner in the task frame in [m]: only grasps whose
                TCP lies inside.
            max_candidates: 0 takes the configured number.
            seed: Seed of the sampler.

        Returns:
            Candidates, not scored; none if there is no surface. All approach with the
            jaws fully open, as the network learned it.
        """
        surface = self.render(scene)
        with self._lock, self._timed("sampling"):
            if not len(surface.points):
                return GraspSet(np.zeros((0, 4, 4)), np.zeros(0))
            config = SamplerConfig(
                max_candidates=max_candidates or self.config.max_candidates
            )
            points, normals = surface.points, surface.normals
            grasps = sample_candidates(
                points,
                normals,
                self.gripper,
                config,
                np.random.default_rng(seed),
                support_height=support_height,
            )
            opened = np.full(len(grasps), self.gripper.max_opening)
            grasps = replace(grasps, widths=opened)
            if roi is not None and len(grasps):
                position = grasps.poses[:, :3, 3]
                inside = (position >= roi[0]) & (position <= roi[1])
                grasps = grasps.take(np.asarray(inside.all(axis=1)))
            return grasps

    def evaluate(
        self,
        scene: EncodedScene,
        grasps: GraspSet,
        *,
        support_height: float = DEFAULT_SUPPORT_HEIGHT,
        revision: int | None = None,
    ) -> GraspSet:
        """Score grasps of any origin.

        Args:
            scene: The scene that they are in.
            grasps: The grasps.
            support_height: Height of the support plane in the task frame in [m].
            revision: Revision that the grasps were made for, if known.

        Returns:
            The same grasps in the same order, with quality and affordances. A grasp
            that closes on no surface at all has quality 0.

        Raises:
            RevisionError: If ``revision`` is not the scene's.
            ConfigError: If a pose or a width is not finite.
        """
        if not (np.isfinite(grasps.poses).all() and np.isfinite(grasps.widths).all()):
            raise ConfigError("grasps: a pose or a width is not a finite number")
        if revision is not None and revision != scene.revision:
            raise RevisionError(
                f"grasps of volume revision {revision}, but the scene at hand is of "
                f"revision {scene.revision}: sample again"
            )
        with self._lock:
            n_classes = len(self.affordances)
            if not len(grasps):
                return replace(grasps, affordances=np.zeros((0, n_classes)))
            with self._timed("local_rendering"):
                render, shape = self.config.render, self._network.config
                inputs, _ = assemble_inputs(
                    scene.field,
                    scene.volume.distances,
                    grasps.poses,
                    grasps.widths,
                    self.gripper,
                    n_points=shape.local_points,
                    image_size=render.local_image_size,
                    fov=np.deg2rad(render.local_fov_deg),
                    support_height=support_height,
                    threads=self._threads,
                )
                inputs = restricted_inputs(inputs, grasps.poses, shape.local_view)
            with self._timed("quality"):
                quality, affordances = self._score(scene, inputs)
            quality[inputs.hits < MIN_HITS] = 0.0
            return grasps.with_scores(quality, affordances)

    def _score(
        self, scene: EncodedScene, inputs: LocalInputs
    ) -> tuple[FloatArray, FloatArray]:
        edge = float(scene.volume.size[0])
        device = self.config.device
        qualities, affordances = [], []
        for start in range(0, len(inputs.tokens), SCORE_BATCH):
            part = slice(start, start + SCORE_BATCH)
            points = torch.from_numpy(inputs.points_task[part] / np.float32(edge))
            flat = points.to(device).flatten(0, 1)[None]
            features = self._network.scene.features(scene.planes, flat)[0]
            quality, affordance = self._network.detector(
                torch.from_numpy(inputs.point_features[part]).to(device),
                torch.from_numpy(inputs.tokens[part]).to(device),
                features.reshape(*points.shape[:2], -1),
            )
            probability = self._network.probability(quality)
            qualities.append(probability.cpu().double().numpy())
            afforded = self._network.affordance_probability(affordance)
            affordances.append(afforded.cpu().double().numpy())
        return np.concatenate(qualities), np.concatenate(affordances)


def use_threads(count: int) -> None:
    """Let the networks of this process use ``count`` threads."""
    torch.set_num_threads(count)


def _equal(a: TsdfVolume, b: TsdfVolume) -> bool:
    return a.voxel_size == b.voxel_size and bool(
        np.array_equal(a.distances, b.distances, equal_nan=True)
    )
