# SPDX-License-Identifier: Apache-2.0
"""Grasps that a network would take itself: where it is wrong costs most.

In: a world and the weights. Out: the best of what the network proposes in one view,
and some of the rest. Random grasps teach what works; these teach what the network
takes for good, and from where it looked when it did.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.datagen.candidates import SOURCES, Candidates
from neugrasp_ros.errors import EmptySceneError
from neugrasp_ros.fusion.tsdf import empty_volume, integrate
from neugrasp_ros.geometry.gripper import Gripper
from neugrasp_ros.geometry.transform import canonical_gripper
from neugrasp_ros.grasp.queries import expected_gain
from neugrasp_ros.grasp.ranking import distinct
from neugrasp_ros.grasp.types import GraspSet
from neugrasp_ros.pipeline import GraspPlanner
from sim_bridge.observation import draw_view, mesh_scene, observe, world_meshes
from sim_bridge.world import TABLE_HEIGHT, World

FloatArray = NDArray[np.float64]

BEST_SHARE = 0.6  # of the grasps: the network's first; the others lie anywhere below
ASKED_FROM = 0.3  # of a class: what a query just leaves out is learned from, too
PER_CLASS = 2  # answers to a query for it
LEAST_QUALITY = 0.2  # what the network itself calls bad, random grasps teach as well
DISTANCE = 0.012  # [m], and
ANGLE = 0.3  # [rad]: nearer grasps are the same
NOISES = ("none", "strict")
VIEWS = ("train", "hard")  # from the side a network errs most


def look_and_choose(
    world: World,
    gripper: Gripper,
    weights: str,
    count: int,
    rng: np.random.Generator,
) -> tuple[Candidates, FloatArray]:
    """Look at a world once, and return what a network would grasp.

    Args:
        world: The objects on their table.
        gripper: The hand.
        weights: Weights file.
        count: How many grasps at most.
        rng: Draws the view, its noise, and the grasps.

    Returns:
        The grasps, and the camera's pose ``T_task_camera``, shape (4, 4).

    Raises:
        EmptySceneError: If nothing is seen, or the network finds nothing to grasp.
        CheckpointError: If the weights cannot be used.
    """
    noise, view_name = (str(rng.choice(names)) for names in (NOISES, VIEWS))
    camera = draw_view(view_name, rng, any_azimuth=True)
    seen = mesh_scene(world_meshes(world), table=True)
    view = observe(seen, camera, rng, noise=noise)
    planner = _planner(weights, gripper)
    volume = empty_volume(planner.resolution)
    volume = integrate(volume, view.depth, view.intrinsics, view.T_task_camera)
    seed = int(rng.integers(1, 2**31))
    decision = planner.decide(volume, seed, support_height=TABLE_HEIGHT, seed=seed)
    chosen = choose_some(decision.grasps, count, rng)
    if not len(chosen):
        raise EmptySceneError("the network finds nothing to grasp in this view")
    drawn = Candidates(
        canonical_gripper(chosen.poses),
        chosen.widths,
        np.full(len(chosen), SOURCES.index("chosen"), dtype=np.uint8),
        np.zeros(len(chosen), dtype=bool),
    )
    return drawn, camera


def choose_some(grasps: GraspSet, count: int, rng: np.random.Generator) -> GraspSet:
    """Return the best distinct grasps and some of the others, in random order.

    The best are the answers to queries for each class of affordance, as many as fit,
    then those of highest quality.

    Args:
        grasps: Scored grasps.
        count: How many at most.
        rng: Draws the others.
    """
    rows = distinct(grasps.poses, grasps.quality, DISTANCE, ANGLE)
    rows = rows[grasps.quality[rows] >= LEAST_QUALITY]
    answers = answers_per_class(grasps, rows, rng)
    ordered = np.array(list(dict.fromkeys([*answers, *rows.tolist()])), dtype=np.int64)
    n_best = round(BEST_SHARE * count)
    others = rng.permutation(ordered[n_best:])[: count - n_best]
    return grasps.take(rng.permutation(np.concatenate([ordered[:n_best], others])))


def answers_per_class(
    grasps: GraspSet, rows: NDArray[np.int64], rng: np.random.Generator
) -> list[int]:
    """Return what queries for one class each are answered: all first ones first.

    Args:
        grasps: Scored grasps.
        rows: Which of them may be answered.
        rng: Draws the order of the classes.
    """
    answers: list[tuple[int, int]] = []
    for column in rng.permutation(grasps.affordances[rows].T):
        asked = np.flatnonzero(column >= ASKED_FROM)
        gain = expected_gain(grasps.quality[rows[asked]], column[asked])
        best = rows[asked[np.argsort(-gain)[:PER_CLASS]]]
        answers += list(enumerate(best.tolist()))
    return [row for _, row in sorted(answers, key=lambda answer: answer[0])]


@lru_cache(maxsize=4)
def _planner(weights: str, gripper: Gripper) -> GraspPlanner:
    return GraspPlanner(PlannerConfig(weights=weights, threads=1), gripper)
