# SPDX-License-Identifier: Apache-2.0
"""Local views and scores of grasps, and the memory of those that were scored."""

import time
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.geometry.gripper import Gripper
from neugrasp_ros.geometry.transform import canonical_gripper
from neugrasp_ros.grasp.ablation import restricted_inputs
from neugrasp_ros.grasp.inputs import LocalInputs, assemble_inputs
from neugrasp_ros.grasp.reference_view import render_local_reference
from neugrasp_ros.grasp.types import GraspSet
from neugrasp_ros.model import GraspNetwork
from neugrasp_ros.pipeline.scenes import EncodedScene
from neugrasp_ros.pipeline.scoring import BATCH, Scorer
from neugrasp_ros.scene.reference import NetworkOccupancy
from neugrasp_ros.scene.workers import shared, torch_threads

FloatArray = NDArray[np.float64]

KEPT_SCORES = 20_000  # grasps of a scene whose scores are kept


class Scored(NamedTuple):
    """Scores of a batch.

    Attributes:
        rows: Which grasps, shape (N,).
        quality: Shape (N,).
        affordances: Shape (N, A).
        rendering: Time that the local views and all other inputs took in [s].
        scoring: Time that the detector took in [s].
    """

    rows: NDArray[np.int64]
    quality: FloatArray
    affordances: FloatArray
    rendering: float
    scoring: float


class Evaluator:
    """Renders the local views of grasps and scores them.

    Args:
        network: The network.
        gripper: The gripper.
        config: Cameras, and which renderer.
        threads: Worker threads.
    """

    def __init__(
        self,
        network: GraspNetwork,
        gripper: Gripper,
        config: PlannerConfig,
        threads: int,
    ) -> None:
        self._network, self._gripper, self._config = network, gripper, config
        self._threads = threads
        self._scorer = Scorer(network, threads)

    def reference(self, scene: EncodedScene) -> NetworkOccupancy:
        """Return a scene of one cube as the reference renderer asks it."""
        literal = self._config.renderer == "reference"
        return NetworkOccupancy(
            self._network.scene,
            scene.planes,
            scene.edge,
            scene.free,
            compiled=None if literal else scene.occupancies[0],
        )

    def prepare(self, scene: EncodedScene) -> None:
        """Do what is done once per scene, whatever its grasps are."""
        if len(scene.corners):
            with torch_threads(1):
                self._scorer.prepare(scene)

    def evaluate(
        self,
        scene: EncodedScene,
        grasps: GraspSet,
        support_height: float,
        deadline: float | None = None,
    ) -> list[Scored]:
        """Render local views and score, batch by batch, several at the same time.

        A score does not depend on the batch, but for rounding. What all batches need
        of the scene is there already if it was ``prepare``d.

        Args:
            scene: The scene.
            grasps: The grasps, in the task frame.
            support_height: Height of the support plane in the task frame in [m].
            deadline: Of ``time.perf_counter()`` after which no batch is begun; the
                first one of each thread always is.

        Returns:
            The batches that were begun, which have no row in common; none if there are
            no grasps.
        """
        if not len(grasps):
            return []
        if not len(scene.corners):
            return [self._worthless(len(grasps))]
        n_batches = min(len(grasps), _batches(len(grasps), self._threads))
        batches = np.array_split(np.arange(len(grasps)), n_batches)

        def run(number: int) -> Scored | None:
            start = time.perf_counter()
            if number >= self._threads and deadline is not None and start > deadline:
                return None
            batch = grasps.take(batches[number])
            inputs = self.inputs(scene, batch, support_height)
            rendered = time.perf_counter()
            scores = self.score(scene, batch, inputs)
            end = time.perf_counter()
            return Scored(batches[number], *scores, rendered - start, end - rendered)

        found = shared(run, range(n_batches), self._threads)
        return [scored for scored in found if scored is not None]

    def _worthless(self, count: int) -> Scored:
        """Return scores of grasps in a scene where nothing stands."""
        affordances = np.zeros((count, len(self._network.config.affordances)))
        return Scored(np.arange(count), np.zeros(count), affordances, 0.0, 0.0)

    def inputs(
        self, scene: EncodedScene, grasps: GraspSet, support_height: float
    ) -> LocalInputs:
        """Render local views and describe each grasp to the network.

        Args:
            scene: The scene.
            grasps: The grasps, in the task frame.
            support_height: Height of the support plane in the task frame in [m].
        """
        render, n_points = self._config.render, self._network.config.local_points
        fov = float(np.deg2rad(render.local_fov_deg))
        views = None
        if self._config.renderer != "fast":
            views = render_local_reference(
                self.reference(scene),
                canonical_gripper(grasps.poses),
                self._gripper,
                n_points=n_points,
                fov=fov,
                kept_size=render.local_image_size,
                cast_all=self._config.renderer == "reference",
            )
        inputs, _ = assemble_inputs(
            scene.field,
            scene.volume.distances,
            grasps.poses,
            grasps.widths,
            self._gripper,
            n_points=n_points,
            image_size=render.local_image_size,
            fov=fov,
            support_height=support_height,
            views=views,
        )
        local_view = self._network.config.local_view
        return restricted_inputs(inputs, grasps.poses, local_view)

    def score(
        self, scene: EncodedScene, grasps: GraspSet, inputs: LocalInputs
    ) -> tuple[FloatArray, FloatArray]:
        """Return quality (G,) and affordances (G, A); 0 quality without a surface."""
        cubes = scene.cubes_of(grasps.poses[:, :3, 3])
        quality, affordances = self._scorer(scene, grasps.poses, inputs, cubes)
        quality[inputs.hits == 0] = 0.0
        return quality, affordances


def _batches(count: int, threads: int) -> int:
    """Return into how many batches grasps are divided: equally many for each thread."""
    return threads * -(-count // (threads * BATCH))


@dataclass(eq=False)
class ScoreMemory:
    """Scores of one scene's grasps, by pose, width and support height.

    Attributes:
        n_classes: Affordance classes, A.
    """

    n_classes: int
    _scores: dict[bytes, tuple[float, FloatArray]] = field(default_factory=dict)

    def missing(self, grasps: GraspSet, support_height: float) -> NDArray[np.int64]:
        """Return the rows of grasps that were not scored."""
        if len(self._scores) > KEPT_SCORES:
            self._scores.clear()
        keys = _keys(grasps, support_height)
        return np.flatnonzero([key not in self._scores for key in keys])

    def keep(
        self,
        grasps: GraspSet,
        support_height: float,
        quality: FloatArray,
        affordances: FloatArray,
    ) -> None:
        """Remember quality (G,) and affordances (G, A) of grasps."""
        keys = _keys(grasps, support_height)
        for key, q, a in zip(keys, quality, affordances, strict=True):
            self._scores[key] = (float(q), a)

    def fill(self, grasps: GraspSet, support_height: float) -> GraspSet:
        """Return grasps with their scores; NaN where there is none."""
        quality = np.full(len(grasps), np.nan)
        affordances = np.full((len(grasps), self.n_classes), np.nan)
        for row, key in enumerate(_keys(grasps, support_height)):
            if key in self._scores:
                quality[row], affordances[row] = self._scores[key]
        return grasps.with_scores(quality, affordances)


def _keys(grasps: GraspSet, support_height: float) -> list[bytes]:
    """Return what a score depends on besides the scene, as one value per grasp."""
    table = np.empty((len(grasps), 18))
    table[:, :16] = grasps.poses.reshape(-1, 16)
    table[:, 16], table[:, 17] = grasps.widths, support_height
    return [row.tobytes() for row in table]
