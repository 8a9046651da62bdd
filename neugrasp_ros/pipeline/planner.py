# SPDX-License-Identifier: Apache-2.0
"""From a volume to scored grasps of one gripper."""

import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.config import PlannerConfig, ReferenceConfig
from neugrasp_ros.errors import ConfigError, RevisionError
from neugrasp_ros.fusion.tsdf import TsdfVolume
from neugrasp_ros.geometry.gripper import Gripper, load_gripper
from neugrasp_ros.grasp.contacts import expected_contacts
from neugrasp_ros.grasp.coverage import propose_everywhere
from neugrasp_ros.grasp.sampling import Proposals, SamplerConfig, choose
from neugrasp_ros.grasp.types import GraspSet
from neugrasp_ros.model import default_weights, file_sha256, load_network, placed
from neugrasp_ros.pipeline.evaluation import Evaluator, Scored, ScoreMemory
from neugrasp_ros.pipeline.scenes import (
    EncodedScene,
    EncodeSettings,
    RenderedScene,
    encode_scene,
    seen_scene,
)
from neugrasp_ros.scene.reference import NetworkOccupancy, render_reference
from neugrasp_ros.scene.rendering import render_surface, trace_surface
from neugrasp_ros.scene.workers import torch_threads, usual_threads

FloatArray = NDArray[np.float64]
Box = tuple[FloatArray, FloatArray]

DEFAULT_SUPPORT_HEIGHT = 0.05  # [m], where the cube's support plane is put


@dataclass(frozen=True, eq=False)
class Decision:
    """What came of one call of ``GraspPlanner.decide``.

    Attributes:
        grasps: The scored grasps, best first.
        sampled: How many candidates were proposed.
        budget_spent: Whether the time budget ended the scoring before its end.
        seconds: Time of each stage in [s].
    """

    grasps: GraspSet
    sampled: int
    budget_spent: bool
    seconds: dict[str, float] = field(default_factory=dict)


@dataclass(eq=False)
class _Known:
    """What was worked out about a scene and does not depend on the query."""

    scene: EncodedScene
    scores: ScoreMemory
    surface: RenderedScene | None = None
    proposals: dict[tuple[float | None, int], Proposals] = field(default_factory=dict)


class GraspPlanner:
    """From a volume to scored grasps of one gripper.

    Calls may come from several threads; they take turns. What does not depend on a
    query (planes, field, surface, proposals, scores) is kept for the newest scene.

    Args:
        config: Cameras, threads, numbers.
        gripper: The gripper; default the configured one.

    Raises:
        CheckpointError: If the weights cannot be used.
        ConfigError: If torch does not have the device here.
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
        self._network = placed(network, self.config.device)
        self.affordances = network.config.affordances
        self.encoder_passes = 0
        self.timings: dict[str, float] = {}
        self._threads = self.config.threads or usual_threads()
        self._evaluator = Evaluator(
            self._network, self.gripper, self.config, self._threads
        )
        self._lock = threading.RLock()
        self._known: _Known | None = None

    @property
    def resolution(self) -> int:
        """Voxels per edge of the cube that the network takes."""
        return self._network.config.resolution

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        """Add the time of a stage; torch has threads of its own in the reference."""
        start = time.perf_counter()
        with torch_threads(1 if self.config.renderer == "fast" else self._threads):
            yield
        elapsed = time.perf_counter() - start
        self.timings[stage] = self.timings.get(stage, 0.0) + elapsed

    def encode(
        self,
        volume: TsdfVolume,
        revision: int,
        *,
        support_height: float = DEFAULT_SUPPORT_HEIGHT,
    ) -> EncodedScene:
        """Encode a volume and evaluate its occupancy field, once per revision.

        A volume larger than the network's cube is covered by overlapping cubes; those
        in whose middle nothing stands are skipped.

        Args:
            volume: A volume with voxels of the network's size.
            revision: Its revision; the same one is not encoded twice in a row.
            support_height: Height of the support plane in the task frame in [m]; says
                in which cubes something stands.

        Raises:
            EmptySceneError: If no voxel was ever observed.
            ShapeError: If the voxels do not have the network's size.
            ConfigError: If the reference renderer is asked for more than one cube.
        """
        with self._lock:
            known = self._known.scene if self._known else None
            if known and known.shows(volume, revision, support_height):
                return known
            self.timings.pop("encoding", None)
            with self._timed("encoding"):
                settings = EncodeSettings(
                    overlap=self.config.cube_overlap,
                    support_height=support_height,
                    threads=self._threads,
                    device=self.config.device,
                    renderer=self.config.renderer,
                )
                scene = encode_scene(self._network.scene, volume, revision, settings)
                self.encoder_passes += 1
            return self._about(scene).scene

    def _about(self, scene: EncodedScene) -> _Known:
        """Return what is known about a scene; forget what was known of another."""
        if self._known is None or self._known.scene is not scene:
            self._known = _Known(scene, ScoreMemory(len(self.affordances)))
        return self._known

    def render(self, scene: EncodedScene) -> RenderedScene:
        """Render the completed surface with the virtual scene cameras."""
        with self._lock:
            known = self._about(scene)
            if known.surface is not None:
                return known.surface
            self.timings.pop("rendering", None)
            with self._timed("rendering"):
                render = self.config.render
                if self.config.renderer != "fast":
                    found = render_reference(
                        self._evaluator.reference(scene),
                        scene.edge,
                        ReferenceConfig(),
                        render,
                    )
                else:
                    found = render_surface(
                        scene.field,
                        render,
                        self._threads,
                        boxes=scene.boxes,
                        depth=scene.depth,
                    )
            known.surface = RenderedScene(*found)
            return known.surface

    def surface(self, scene: EncodedScene, support: float | None) -> RenderedScene:
        """Return what grasps are sampled on: see ``scene_render``, ``seen_scene``."""
        if self.config.scene_render:
            return self.render(scene)
        with self._lock, self._timed("rendering"):
            return seen_scene(scene.volume, support, self.config.render)

    def trace(
        self, scene: EncodedScene, origins: FloatArray, directions: FloatArray
    ) -> FloatArray:
        """Find where rays meet the completed surface, as ``render`` does.

        Args:
            scene: The scene.
            origins: Ray origins in the task frame in [m], shape (R, 3).
            directions: Unit directions, shape (R, 3).

        Returns:
            Distances along the rays in [m], shape (R,); NaN where nothing is met.
        """
        with self._lock:
            return trace_surface(
                scene.field, origins, directions, scene.depth, self._threads
            )

    def reference(self, scene: EncodedScene) -> NetworkOccupancy:
        """Return a scene of one cube as the reference renderer asks it."""
        return self._evaluator.reference(scene)

    def sample(
        self,
        scene: EncodedScene,
        *,
        support_height: float | None = DEFAULT_SUPPORT_HEIGHT,
        roi: Box | None = None,
        max_candidates: int = 0,
        seed: int = 0,
    ) -> GraspSet:
        """Sample candidates on the scene's ``surface``.

        Args:
            scene: The scene.
            support_height: Height of the support plane in the task frame in [m]; None
                = there is none.
            roi: Lower and upper corner in the task frame in [m]: only grasps whose
                TCP lies inside; the number of candidates counts those.
            max_candidates: 0 takes the configured number.
            seed: Seed of the sampler; the same one on the same scene is not sampled
                twice.

        Returns:
            Candidates, not scored; none if there is no surface. All approach with the
            jaws fully open, as the network learned it.
        """
        surface = self.surface(scene, support_height)
        with self._lock:
            self.timings.pop("sampling", None)
            with self._timed("sampling"):
                found = self._proposals(scene, surface, support_height, seed)
                if roi is not None:
                    position = found.poses[:, :3, 3]
                    inside = (position >= roi[0]) & (position <= roi[1])
                    found = found.take(np.flatnonzero(inside.all(axis=1)))
                grasps = choose(found, max_candidates or self.config.max_candidates)
                opened = np.full(len(grasps), self.gripper.max_opening)
                return replace(grasps, widths=opened)

    def _proposals(
        self,
        scene: EncodedScene,
        surface: RenderedScene,
        support_height: float | None,
        seed: int,
    ) -> Proposals:
        known = self._about(scene).proposals
        key = (support_height, seed)
        if key not in known:
            known[key] = propose_everywhere(
                surface.points,
                surface.normals,
                self.gripper,
                SamplerConfig(threads=self._threads),
                np.random.default_rng(seed),
                support_height=support_height,
            )
        return known[key]

    def contacts(self, scene: EncodedScene, grasps: GraspSet) -> FloatArray:
        """Return where grasps will touch, see ``grasp.contacts``, shape (G, 2, 3)."""
        with self._lock, self._timed("local_rendering"):
            return expected_contacts(
                scene.field, grasps.poses, self.gripper, threads=self._threads
            )

    def prepare(self, scene: EncodedScene) -> None:
        """Do what scores need once per scene, before there are grasps."""
        with self._lock, self._timed("encoding"):
            self._evaluator.prepare(scene)

    def evaluate(
        self,
        scene: EncodedScene,
        grasps: GraspSet,
        *,
        support_height: float = DEFAULT_SUPPORT_HEIGHT,
        revision: int | None = None,
        deadline: float | None = None,
    ) -> GraspSet:
        """Score grasps of any origin.

        Args:
            scene: The scene that they are in.
            grasps: The grasps.
            support_height: Height of the support plane in the task frame in [m].
            revision: Revision that the grasps were made for, if known.
            deadline: Of ``time.perf_counter()`` after which no further batch is
                begun; the first of each thread always is.

        Returns:
            The same grasps in the same order, with quality and affordances; NaN where
            the deadline came first. A grasp that closes on no surface at all has
            quality 0.

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
            scores = self._about(scene).scores
            rows = scores.missing(grasps, support_height)
            if len(rows):
                self.prepare(scene)
            start, new = time.perf_counter(), grasps.take(rows)
            found = self._evaluator.evaluate(scene, new, support_height, deadline)
            for part in found:
                kept = new.take(part.rows)
                scores.keep(kept, support_height, part.quality, part.affordances)
            self._note_evaluation(time.perf_counter() - start, found)
            return scores.fill(grasps, support_height)

    def _note_evaluation(self, elapsed: float, found: Sequence[Scored]) -> None:
        """Divide the time among its two stages as the threads' times are divided."""
        spent = {
            "local_rendering": sum(part.rendering for part in found),
            "quality": sum(part.scoring for part in found),
        }
        whole = max(sum(spent.values()), 1e-9)
        for stage, seconds in spent.items():
            self.timings[stage] = elapsed * seconds / whole

    def decide(
        self,
        volume: TsdfVolume,
        revision: int,
        *,
        support_height: float = DEFAULT_SUPPORT_HEIGHT,
        roi: Box | None = None,
        max_candidates: int = 0,
        time_budget: float = 0.0,
        seed: int = 0,
    ) -> Decision:
        """Run all stages, as far as the budget allows.

        Args:
            volume: As of ``encode``.
            revision: Its revision.
            support_height: Height of the support plane in the task frame in [m].
            roi: As of ``sample``.
            max_candidates: 0 takes the configured number.
            time_budget: After so many seconds no further candidates are scored; 0 =
                no budget. One batch of each thread always is.
            seed: Seed of the sampler.

        Returns:
            The scored grasps, best first, and what the stages took.

        Raises:
            EmptySceneError: As ``encode``, like the others.
        """
        with self._lock:
            self.timings.clear()
            start = time.perf_counter()
            scene = self.encode(volume, revision, support_height=support_height)
            grasps = self.sample(
                scene,
                support_height=support_height,
                roi=roi,
                max_candidates=max_candidates,
                seed=seed,
            )
            scored = self.evaluate(
                scene,
                grasps,
                support_height=support_height,
                deadline=start + time_budget if time_budget else None,
            )
            known = np.isfinite(scored.quality)
            return Decision(
                scored.take(known).ranked(),
                len(grasps),
                not bool(known.all()),
                dict(self.timings),
            )
