# SPDX-License-Identifier: Apache-2.0
"""What the affordance heads are worth: held-out scenes, asked about every class.

A probe looks at one scene once. It tries random candidates, for the average precision
over those that hold, and it executes the first answer to the query of each class.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.benchmark.protocol import Plan, Policy, Round, Suite
from neugrasp_ros.errors import ConfigError, EmptySceneError
from neugrasp_ros.grasp.queries import KNOWN_FROM, expected_gain
from neugrasp_ros.grasp.types import GraspSet
from sim_bridge.gripper import SimGripper
from sim_bridge.objects.affordances import AFFORDANCE_NAMES, affordance_index
from sim_bridge.objects.grasp_labels import class_points, label_grasps
from sim_bridge.objects.registry import ObjectSet
from sim_bridge.scene import Scene, placed_model
from sim_bridge.trial import run_trials
from sim_bridge.world import World

N_CANDIDATES = 24  # random candidates that tell whether a true grasp is there
MIN_QUALITY = 0.5
NONE = -1  # row of an answer that was not given

BoolArray = NDArray[np.bool_]
Sets = Mapping[str, ObjectSet]


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What came of the query of one class.

    Attributes:
        affordance: The class.
        exists: A true grasp is there: one of the first ``N_CANDIDATES`` random ones
            holds and affords it. False if no part of any object affords it; None =
            cannot be told.
        answered: The network returned a grasp.
        success: It held.
        affords: It truly affords the class.
    """

    affordance: str
    exists: bool | None
    answered: bool
    success: bool = False
    affords: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class ProbeRecord:
    """One scene, looked at once.

    Attributes:
        index: Number of the scene.
        n_tried: Random candidates that were tried.
        predicted: Probability per class of those that held, shape (N, A).
        afforded: Whether they truly afford it, shape (N, A).
        answers: One per class.
        scene: The recipe.
    """

    index: int
    n_tried: int
    predicted: tuple[tuple[float, ...], ...]
    afforded: tuple[tuple[bool, ...], ...]
    answers: tuple[Answer, ...]
    scene: Mapping[str, Any]

    def as_record(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return asdict(self)


def probe_from_record(record: Mapping[str, Any]) -> ProbeRecord:
    """Read a probe from the values that ``ProbeRecord.as_record`` wrote.

    Raises:
        ConfigError: If values are missing or unknown.
    """
    try:
        rows = {
            name: tuple(tuple(row) for row in record[name])
            for name in ("predicted", "afforded")
        }
        answers = tuple(Answer(**answer) for answer in record["answers"])
        return ProbeRecord(**{**record, **rows, "answers": answers})
    except (KeyError, TypeError) as error:
        raise ConfigError(f"not a probe record: {error}") from error


class Truth(NamedTuple):
    """What physics and the objects' parts say about grasps.

    Attributes:
        held: Which grasps hold, shape (G,).
        affords: Which class each affords, if it holds, shape (G, A).
    """

    held: BoolArray
    affords: BoolArray


def probe_scene(
    suite: Suite,
    index: int,
    policy: Policy,
    sets: Sets | None = None,
    n_candidates: int = N_CANDIDATES,
) -> ProbeRecord:
    """Ask one scene about every class.

    Args:
        suite: What is benchmarked; scene and view are those of the round ``index``.
        index: Number of the scene.
        policy: Returns all candidates, scored, and the names of its classes.
        sets: Object sets by the name in the suite; others come from the registry.
        n_candidates: Random candidates to try; more make the average precision surer
            and leave the queries as they are.

    Raises:
        UnknownAffordanceError: If a class has no true labels.
    """
    with World() as world:
        round_ = Round(suite, index, world)
        scene = round_.build(sets)
        try:
            plan = policy(round_.look(), round_.policy_rng)
        except EmptySceneError:
            plan = Plan(GraspSet(np.zeros((0, 4, 4)), np.zeros(0)))
        columns = [affordance_index(name) for name in plan.classes]
        rows = round_.policy_rng.permutation(len(plan.grasps))[:n_candidates]
        firsts = first_answers(plan.grasps)
        wanted = {*rows.tolist(), *firsts} - {NONE}
        truth = _try(round_, world, plan, wanted, (scene, sets))
    good = rows[truth.held[rows]]
    found = truth.affords[rows[:N_CANDIDATES]] & truth.held[rows[:N_CANDIDATES], None]
    offered = offered_classes(scene, sets)[columns]
    answers = tuple(
        Answer(
            affordance=name,
            exists=_exists(bool(offered[c]), found[:, c]),
            answered=row != NONE,
            success=row != NONE and bool(truth.held[row]),
            affords=row != NONE and bool(truth.affords[row, c]),
        )
        for c, (name, row) in enumerate(zip(plan.classes, firsts, strict=True))
    )
    return ProbeRecord(
        index=index,
        n_tried=len(rows),
        predicted=tuple(tuple(plan.grasps.affordances[r].tolist()) for r in good),
        afforded=tuple(tuple(truth.affords[r].tolist()) for r in good),
        answers=answers,
        scene=scene.as_record(),
    )


def first_answers(
    grasps: GraspSet,
    min_quality: float = MIN_QUALITY,
    min_affordance: float = KNOWN_FROM,
) -> list[int]:
    """Return which grasp a query of each class returns first; ``NONE`` if none does.

    Args:
        grasps: Scored grasps.
        min_quality: Least probability of success.
        min_affordance: Least probability of the class.
    """
    firsts = []
    for affordance in grasps.affordances.T:
        allowed = (grasps.quality >= min_quality) & (affordance >= min_affordance)
        gain = np.where(allowed, expected_gain(grasps.quality, affordance), -1.0)
        firsts.append(int(gain.argmax()) if allowed.any() else NONE)
    return firsts


def offered_classes(scene: Scene, sets: Sets | None = None) -> BoolArray:
    """Tell which classes any part of any object of a scene affords, shape (7,)."""
    offered = np.zeros(len(AFFORDANCE_NAMES), dtype=bool)
    rng = np.random.default_rng(0)
    for placed in scene.objects:
        offered |= class_points(placed_model(placed, sets), rng).classes.any(axis=0)
    return offered


def _exists(offered: bool, found: BoolArray) -> bool | None:
    """Tell whether a true grasp is there; None where none was found but might be."""
    if not offered:
        return False
    return True if found.any() else None


def _try(
    round_: Round,
    world: World,
    plan: Plan,
    wanted: set[int],
    recipe: tuple[Scene, Sets | None],
) -> Truth:
    """Execute the wanted grasps, each from the scene as it is."""
    scene, sets = recipe
    n = len(plan.grasps)
    truth = Truth(np.zeros(n, bool), np.zeros((n, len(plan.classes)), bool))
    rows = np.array(sorted(wanted), dtype=np.int64)
    poses, openings = plan.grasps.poses[rows], round_.openings(plan.grasps)[rows]
    hand = SimGripper(world, round_.gripper)
    pairs = zip(poses, openings.tolist(), strict=True)
    for row, result in zip(
        rows, run_trials(world, hand, pairs, round_.trial), strict=True
    ):
        truth.held[row] = result.success
    labels = label_grasps(
        [placed_model(placed, sets) for placed in scene.objects],
        [placed.T_task_object for placed in scene.objects],
        poses,
        openings,
        np.random.default_rng(0),
    )
    columns = [affordance_index(name) for name in plan.classes]
    truth.affords[rows] = labels[:, columns]
    return truth
