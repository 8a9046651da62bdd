# SPDX-License-Identifier: Apache-2.0
"""Label a scene: build it, draw grasps, ask the physics.

In: a job (a few names and a seed). Out: the scene's recipe and its labelled grasps.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.datagen.candidates import (
    CandidateConfig,
    Candidates,
    draw_candidates,
    is_side,
)
from neugrasp_ros.datagen.chosen import look_and_choose
from neugrasp_ros.errors import ShapeError, SimulationError
from neugrasp_ros.geometry.gripper import Gripper, load_gripper, varied_gripper
from neugrasp_ros.geometry.raycast import MeshScene
from neugrasp_ros.geometry.transform import pose_from, to_position_quaternion
from sim_bridge.gripper import SimGripper
from sim_bridge.objects.grasp_labels import label_grasps
from sim_bridge.objects.registry import ObjectSet, object_set, part_names
from sim_bridge.scene import Scene, placed_model, scene_meshes
from sim_bridge.scenes import build_scene
from sim_bridge.trial import collision_label, run_trials, trial_config
from sim_bridge.trial_result import FAILURES
from sim_bridge.world import FAST_ITERATIONS, TABLE_HEIGHT, World

FloatArray = NDArray[np.float64]

NOT_TRIED = "not_tried"
REASONS = ("success", *FAILURES, NOT_TRIED)
UNKNOWN = -1  # of ``shake_held``
VARIED = "varied"  # gripper of a job: drawn for the scene
WITHOUT_PHYSICS = "none"  # preset of a job: only what geometry tells


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneJob:
    """Everything that determines one labelled scene.

    Attributes:
        index: Number of the scene in its run.
        seed: Seed of the run.
        kind: Scene kind.
        objects: Object set, by name or folder.
        split: Which part of the set to draw from.
        gripper: Gripper, by name or file, or ``VARIED``.
        preset: Trial preset of ``sim_bridge.trial``, or ``WITHOUT_PHYSICS``.
        candidates: Numbers and kinds of grasps.
        weights: Weights file of the network that chooses the grasps in one view;
            empty draws them on the true surface.
        count: Objects to put on the table; 0 draws their number.
    """

    index: int
    seed: int
    kind: str
    objects: str
    split: str
    gripper: str
    preset: str = "fast_shake"
    candidates: CandidateConfig = field(default_factory=CandidateConfig)
    weights: str = ""
    count: int = 0

    def describe(self) -> str:
        """Return what names the job in a log."""
        return (
            f"scene {self.index} (seed {self.seed}, {self.kind}, {self.objects}, "
            f"{self.gripper})"
        )


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class GraspLabels:
    """G labelled grasps as a structure of arrays.

    Attributes:
        positions: TCPs in the task frame in [m], shape (G, 3).
        quaternions: Orientations of the gripper frame, xyzw, shape (G, 4).
        openings: Jaw opening on approach in [m], shape (G,).
        widths: Jaw opening at the end of the trial in [m]; NaN = not tried.
        stop_depths: How far before the grasp the approach ended in [m]; NaN = not
            tried.
        labels: 1 = success, shape (G,); 0 where it is not known, see ``judged``.
        reasons: Index into ``REASONS``, shape (G,).
        tried: True if it went through physics, shape (G,).
        touched: The hand touched something before the jaws closed, shape (G,).
        hits_pregrasp: The open hand touches something at the pre-grasp, shape (G,).
        hits_approach: The same anywhere between pre-grasp and grasp, shape (G,).
        hits_grasp: The same at the grasp, shape (G,).
        shake_held: 1 = stayed through a shake, 0 = did not, -1 = not tried, (G,).
        object_ids: Index of the object that was lifted; -1 = none, shape (G,).
        sources: Index into ``candidates.SOURCES``, shape (G,).
        affordances: 1 = the grasp affords the class of ``AFFORDANCES``, shape (G, 7).
            Where nothing was lifted, it says what lies between the jaws.
    """

    positions: NDArray[np.float32]
    quaternions: NDArray[np.float32]
    openings: NDArray[np.float32]
    widths: NDArray[np.float32]
    stop_depths: NDArray[np.float32]
    labels: NDArray[np.uint8]
    reasons: NDArray[np.uint8]
    tried: NDArray[np.bool_]
    touched: NDArray[np.bool_]
    hits_pregrasp: NDArray[np.bool_]
    hits_approach: NDArray[np.bool_]
    hits_grasp: NDArray[np.bool_]
    shake_held: NDArray[np.int8]
    object_ids: NDArray[np.int8]
    sources: NDArray[np.uint8]
    affordances: NDArray[np.uint8]

    def __post_init__(self) -> None:
        """Check that all arrays have one row per grasp.

        Raises:
            ShapeError: If one has not.
        """
        for item in fields(self):
            shape = getattr(self, item.name).shape
            if shape[0] != len(self.positions):
                raise ShapeError(item.name, f"({len(self.positions)}, ...)", shape)

    def __len__(self) -> int:
        """Return the number of grasps."""
        return len(self.positions)

    def take(self, kept: NDArray[np.bool_]) -> "GraspLabels":
        """Return the grasps for which ``kept`` (G,) is true."""
        return GraspLabels(
            **{item.name: getattr(self, item.name)[kept] for item in fields(self)}
        )

    def poses(self) -> FloatArray:
        """Return the poses ``T_task_gripper``, shape (G, 4, 4)."""
        return pose_from(
            self.positions.astype(np.float64), self.quaternions.astype(np.float64)
        )

    def judged(self) -> NDArray[np.bool_]:
        """Tell of which grasps it is known whether they succeed, shape (G,)."""
        return np.asarray(self.reasons != REASONS.index(NOT_TRIED))

    def side(self) -> NDArray[np.bool_]:
        """Tell which are side grasps, shape (G,)."""
        return is_side(self.poses())


@dataclass(frozen=True, eq=False, slots=True)
class SceneLabels:
    """A scene and what is known about grasps in it.

    Attributes:
        index: Number of the scene in its run.
        scene: The recipe; its objects are where they were before each trial.
        gripper: The gripper.
        grasps: The labelled grasps.
        T_task_camera: From where a network looked that chose the grasps, shape
            (4, 4); None where they were drawn on the true surface.
    """

    index: int
    scene: Scene
    gripper: Gripper
    grasps: GraspLabels
    T_task_camera: FloatArray | None = None


def label_scene(
    job: SceneJob, sets: Mapping[str, ObjectSet] | None = None
) -> SceneLabels:
    """Build a scene and label grasps in it; the job alone determines the result.

    Args:
        job: What to build.
        sets: Object sets by the name in the job; others come from the registry.

    Raises:
        SimulationError: If no object stayed in the scene.
        EmptySceneError: If a network is to choose and finds nothing.
        NeuGraspError: If a name is unknown or a file broken.
    """
    rng = np.random.default_rng([job.seed, job.index])
    objects = (sets or {}).get(job.objects) or object_set(job.objects)
    names = part_names(objects, job.split)
    varied = job.gripper == VARIED
    gripper = varied_gripper(rng) if varied else load_gripper(job.gripper)
    with World(
        solver_iterations=FAST_ITERATIONS, sleeping=True, rigid_objects=True
    ) as world:
        scene = build_scene(
            world, job.kind, objects, names, rng, count=job.count or None, seed=job.seed
        )
        if not scene.objects:
            raise SimulationError(f"{job.describe()}: no object stayed on the table")
        known = {objects.name: objects}
        camera = None
        if job.weights:
            drawn, camera = look_and_choose(
                world, gripper, job.weights, job.candidates.n_trials, rng
            )
        else:
            meshes = MeshScene(*scene_meshes(scene, known))
            drawn = draw_candidates(meshes, gripper, TABLE_HEIGHT, job.candidates, rng)
        columns = _try_all(world, gripper, drawn, job)
    columns["affordances"] = label_grasps(
        [placed_model(placed, known) for placed in scene.objects],
        [placed.T_task_object for placed in scene.objects],
        drawn.poses,
        drawn.openings,
        rng,
    ).astype(np.uint8)
    return SceneLabels(job.index, scene, gripper, GraspLabels(**columns), camera)


def _try_all(
    world: World, gripper: Gripper, drawn: Candidates, job: SceneJob
) -> dict[str, NDArray[Any]]:
    hand = SimGripper(world, gripper)
    distance = job.candidates.pregrasp_distance
    grasps = list(zip(drawn.poses, drawn.openings.tolist(), strict=True))
    with world.saved_state() as state:
        hits = [collision_label(hand, *grasp, distance) for grasp in grasps]
        world.restore(state)
        hand.park()
    hits_array = np.array(hits, dtype=bool).reshape(-1, 3)
    tried = ~(drawn.blocked & hits_array[:, 0])
    columns = _blank_columns(drawn, hits_array, tried)
    if job.preset == WITHOUT_PHYSICS:
        columns["reasons"][tried] = REASONS.index(NOT_TRIED)
        columns["tried"] = np.zeros_like(tried)
        return columns
    rows = np.flatnonzero(tried)
    trials = run_trials(
        world,
        hand,
        (grasps[i] for i in rows),
        trial_config(job.preset),
    )
    owners = {body: i for i, body in enumerate(world.object_ids)}
    for row, result in zip(rows, trials, strict=True):
        columns["widths"][row] = result.width
        columns["stop_depths"][row] = result.stop_depth
        columns["labels"][row] = result.success
        columns["reasons"][row] = REASONS.index(result.reason or "success")
        columns["touched"][row] = result.touched
        columns["object_ids"][row] = owners.get(result.object_body, -1)
        if result.shake_held is not None:
            columns["shake_held"][row] = result.shake_held
    return columns


def _blank_columns(
    drawn: Candidates,
    hits: NDArray[np.bool_],
    tried: NDArray[np.bool_],
) -> dict[str, NDArray[Any]]:
    """Return the columns of grasps none of which was tried yet."""
    n = len(drawn.poses)
    positions, quaternions = to_position_quaternion(drawn.poses)
    return {
        "positions": positions.astype(np.float32),
        "quaternions": quaternions.astype(np.float32),
        "openings": drawn.openings.astype(np.float32),
        "widths": np.full(n, np.nan, dtype=np.float32),
        "stop_depths": np.full(n, np.nan, dtype=np.float32),
        "labels": np.zeros(n, dtype=np.uint8),
        "reasons": np.full(n, REASONS.index("pregrasp_collision"), dtype=np.uint8),
        "tried": tried,
        "touched": np.ones(n, dtype=bool),
        "hits_pregrasp": hits[:, 0],
        "hits_approach": hits[:, 1],
        "hits_grasp": hits[:, 2],
        "shake_held": np.full(n, UNKNOWN, dtype=np.int8),
        "object_ids": np.full(n, -1, dtype=np.int8),
        "sources": drawn.sources,
    }
