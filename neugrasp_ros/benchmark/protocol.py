# SPDX-License-Identifier: Apache-2.0
"""Rounds of the clutter-removal benchmark: look, plan, grasp, until nothing is left.

In: a suite (scene kind, view, objects, gripper, protocol) and a policy. Out: one
record per round with every attempt and why it failed.
"""

import time
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.benchmark.reconstruction import field_iou
from neugrasp_ros.benchmark.records import AttemptRecord, RoundRecord
from neugrasp_ros.errors import EmptySceneError, UnknownNameError
from neugrasp_ros.geometry.grid import ScalarGrid
from neugrasp_ros.geometry.gripper import Gripper, load_gripper
from neugrasp_ros.grasp.types import GraspSet
from sim_bridge.gripper import SimGripper
from sim_bridge.objects.registry import ObjectSet, object_set, part_names
from sim_bridge.observation import (
    DepthView,
    draw_view,
    mesh_scene,
    observe,
    world_meshes,
)
from sim_bridge.scene import PlacedObject, Scene, SceneMeshes
from sim_bridge.scenes import BENCHMARK_COUNT, build_scene
from sim_bridge.trial import run_trial, run_trials, trial_config
from sim_bridge.trial_result import TrialResult
from sim_bridge.world import TABLE_HEIGHT, World

FloatArray = NDArray[np.float64]

FAILURES_TO_STOP = 2  # in a row


@dataclass(frozen=True, slots=True)
class Protocol:
    """Rules that hold for all suites run under them.

    Attributes:
        name: Its name, also that of its trial preset.
        noise: Depth noise of every image.
        any_azimuth: Whether the camera may stand on any side.
        empty_answers: How many end a round.
        forgets_empty: Whether an answer with a grasp clears the count of empty ones.
        full_opening: Whether the jaws always approach fully open.
    """

    name: str
    noise: str
    any_azimuth: bool
    empty_answers: int
    forgets_empty: bool
    full_opening: bool


PROTOCOLS = {
    "vgn": Protocol("vgn", "none", False, 3, False, True),
    "strict": Protocol("strict", "strict", True, 2, True, False),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Suite:
    """What is benchmarked.

    Attributes:
        scene: Scene kind.
        view: Name of the view.
        objects: Object set, by name or folder.
        part: Part of the set to draw from: ``train``, ``tune``, ``val``, ``all``, or
            ``held_out``: affordance objects of styles or seeds never learned from.
        gripper: Gripper, by name or file.
        protocol: A name of ``PROTOCOLS``.
        seed: Seed of the run; round k depends on the seed and k alone.
        count: Objects asked for in each round.
        table: Whether the table is seen.
        noise: Depth noise; empty takes the protocol's.
    """

    scene: str = "pile"
    view: str = "random"
    objects: str = "procedural"
    part: str = "val"
    gripper: str = "panda"
    protocol: str = "vgn"
    seed: int = 0
    count: int = BENCHMARK_COUNT
    table: bool = True
    noise: str = ""

    def __post_init__(self) -> None:
        """Check the protocol's name.

        Raises:
            UnknownNameError: If there is no such protocol.
        """
        if self.protocol not in PROTOCOLS:
            raise UnknownNameError("protocol", self.protocol, PROTOCOLS)


class Look(NamedTuple):
    """What a policy may use; ``truth`` and ``holds`` are for oracles only.

    Attributes:
        view: The depth image.
        gripper: The hand that will execute the grasp.
        table_height: Height of the support plane in [m].
        failed: Poses that failed in this round, each (4, 4).
        truth: The objects' true shapes where they lie.
        holds: Tells of each grasp in turn whether it would hold.
    """

    view: DepthView
    gripper: Gripper
    table_height: float
    failed: tuple[FloatArray, ...]
    truth: SceneMeshes
    holds: Callable[[GraspSet], Generator[bool]]


class Plan(NamedTuple):
    """What a policy answers.

    Attributes:
        grasps: Grasps, best first; empty if it finds none good enough.
        timings: Seconds per stage.
        n_candidates: How many grasps it looked at.
        classes: Names of the grasps' affordance classes.
        candidates: The grasps that it looked at, for whoever draws them.
        surface: The surface that it completed in the task frame in [m], shape (N, 3).
        field: The occupancy that it completed in the task frame.
    """

    grasps: GraspSet
    timings: Mapping[str, float] = {}
    n_candidates: int = 0
    classes: tuple[str, ...] = ()
    candidates: GraspSet = GraspSet(np.zeros((0, 4, 4)), np.zeros(0))
    surface: FloatArray = np.zeros((0, 3))
    field: ScalarGrid | None = None


Policy = Callable[[Look, np.random.Generator], Plan]


class Attempt(NamedTuple):
    """Everything about one attempt, for whoever watches (pictures, calibration).

    Attributes:
        look: What was seen.
        plan: What the policy answered.
        result: What came of the first grasp.
        scene: The objects before the attempt.
    """

    look: Look
    plan: Plan
    result: TrialResult
    scene: Scene


Watcher = Callable[[AttemptRecord, Attempt], None]


def run_round(
    suite: Suite,
    index: int,
    policy: Policy,
    watch: Watcher | None = None,
    sets: Mapping[str, ObjectSet] | None = None,
) -> RoundRecord:
    """Clear one scene as far as the policy and the rules let it.

    Args:
        suite: What is benchmarked.
        index: Number of the round.
        policy: Who chooses grasps; the first grasp of each answer is executed.
        watch: Called after each attempt.
        sets: Object sets by the name in the suite; others come from the registry.

    Raises:
        ConfigError: If the part of the set that the suite names is empty.
    """
    with World() as world:
        round_ = Round(suite, index, world)
        scene = round_.build(sets)
        ended = round_.run(policy, watch)
        return RoundRecord(
            index=index,
            n_objects=len(scene.objects),
            n_uncounted=len(world.object_ids) if ended == "empty_view" else 0,
            ended=ended,
            attempts=tuple(round_.attempts),
            scene=scene.as_record(),
            iou=round_.iou,
        )


def nearest_object(scene: Scene, position: FloatArray) -> str:
    """Return the name of the object whose origin is nearest; empty if there is none.

    Args:
        scene: The objects.
        position: In the task frame in [m], shape (3,).
    """
    objects = scene.objects
    places = np.array([item.T_task_object[:3, 3] for item in objects]).reshape(-1, 3)
    distances = np.linalg.norm(places - position, axis=1)
    return objects[int(distances.argmin())].name if objects else ""


class Round:
    """State of one round.

    Args:
        suite: What is benchmarked.
        index: Number of the round; with the suite's seed it determines everything.
        world: The world to use.
    """

    def __init__(self, suite: Suite, index: int, world: World) -> None:
        self._suite, self._world, self._index = suite, world, index
        self._protocol = PROTOCOLS[suite.protocol]
        self.trial = trial_config(suite.protocol)
        self.gripper = load_gripper(suite.gripper)
        self._failed: list[FloatArray] = []
        self.placed: dict[int, PlacedObject] = {}
        self.attempts: list[AttemptRecord] = []
        self.iou: float | None = None  # of the first look
        streams = np.random.SeedSequence([suite.seed, index]).spawn(4)
        generators = [np.random.default_rng(stream) for stream in streams]
        self._scene_rng, self._view_rng, self._noise_rng, self.policy_rng = generators

    def build(self, sets: Mapping[str, ObjectSet] | None = None) -> Scene:
        """Put the round's objects into the world, and return where they lie.

        Raises:
            ConfigError: If the part of the set that the suite names is empty.
        """
        suite = self._suite
        objects = (sets or {}).get(suite.objects) or object_set(suite.objects)
        scene = build_scene(
            self._world,
            suite.scene,
            objects,
            part_names(objects, suite.part),
            self._scene_rng,
            count=suite.count,
            seed=suite.seed,
        )
        self.placed = dict(zip(self._world.object_ids, scene.objects, strict=True))
        return scene

    def run(self, policy: Policy, watch: Watcher | None) -> str:
        """Attempt until the round ends; return why it ended."""
        failures = empty_answers = 0
        while self._world.object_ids:
            try:
                look = self.look()
                plan, seconds = self._plan(policy, look)
            except EmptySceneError:
                return "empty_view"
            if not len(plan.grasps):
                empty_answers += 1
                if empty_answers >= self._protocol.empty_answers:
                    return "no_grasp"
                continue
            if self._protocol.forgets_empty:
                empty_answers = 0
            record = self._attempt(look, plan, seconds, watch)
            failures = 0 if record.success else failures + 1
            if failures >= FAILURES_TO_STOP:
                return "failures"
        return "cleared"

    def look(self) -> Look:
        """Take the next picture."""
        truth = world_meshes(self._world)
        pose = draw_view(
            self._suite.view, self._view_rng, any_azimuth=self._protocol.any_azimuth
        )
        view = observe(
            mesh_scene(truth, table=self._suite.table),
            pose,
            self._noise_rng,
            noise=self._suite.noise or self._protocol.noise,
        )
        failed = tuple(self._failed)
        return Look(view, self.gripper, TABLE_HEIGHT, failed, truth, self.holds)

    def holds(self, grasps: GraspSet) -> Generator[bool]:
        """Try each grasp by the protocol and undo it; close it if not exhausted."""
        hand = SimGripper(self._world, self.gripper)
        openings = self.openings(grasps).tolist()
        try:
            for pair in zip(grasps.poses, openings, strict=True):
                (result,) = run_trials(self._world, hand, [pair], self.trial)
                yield result.success
        finally:
            hand.remove()

    def _plan(self, policy: Policy, look: Look) -> tuple[Plan, float]:
        start = time.perf_counter()
        plan = policy(look, self.policy_rng)
        seconds = time.perf_counter() - start
        if self.iou is None and plan.field is not None:
            objects = mesh_scene(look.truth, table=False)
            self.iou = field_iou(plan.field, objects, look.table_height)
        return plan, seconds

    def openings(self, grasps: GraspSet) -> FloatArray:
        """Return how far the jaws open for grasps by the protocol, in [m], (G,)."""
        limit = self.gripper.max_opening
        if self._protocol.full_opening:
            return np.full(len(grasps), limit)
        return np.clip(grasps.widths, 0.0, limit)

    def _attempt(
        self, look: Look, plan: Plan, seconds: float, watch: Watcher | None
    ) -> AttemptRecord:
        T_task_gripper = plan.grasps.poses[0]
        opening = float(self.openings(plan.grasps)[0])
        before = self._scene()
        hand = SimGripper(self._world, self.gripper)
        result = run_trial(self._world, hand, T_task_gripper, opening, self.trial)
        record = AttemptRecord(
            round_index=self._index,
            number=len(self.attempts),
            reason=result.reason,
            quality=float(plan.grasps.quality[0]),
            T_task_gripper=tuple(T_task_gripper[:3].ravel().tolist()),
            opening=opening,
            width=result.width,
            stop_depth=result.stop_depth,
            object_name=self._remove(result),
            n_candidates=plan.n_candidates,
            n_grasps=len(plan.grasps),
            timings={**plan.timings, "plan": seconds},
            target=nearest_object(before, T_task_gripper[:3, 3]),
        )
        hand.remove()
        self._world.clear_outside()
        if not result.success:
            self._failed.append(T_task_gripper)
        self.attempts.append(record)
        if watch is not None:
            watch(record, Attempt(look, plan, result, before))
        return record

    def _scene(self) -> Scene:
        return Scene(
            self._suite.scene,
            self._suite.seed,
            tuple(
                self.placed[body].at(self._world.pose(body))
                for body in self._world.object_ids
            ),
        )

    def _remove(self, result: TrialResult) -> str:
        """Take away what was cleared and return its name."""
        if result.object_body not in self.placed:
            return ""
        self._world.remove(result.object_body)
        return self.placed[result.object_body].name
