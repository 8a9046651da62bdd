# SPDX-License-Identifier: Apache-2.0
"""Repeat labelled trials in the benchmark's full execution and compare the outcomes.

In: labelled scenes. Out: how often the short-cut label is the full execution's.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.datagen.labels import SceneLabels
from sim_bridge.gripper import SimGripper
from sim_bridge.scenes import rebuild_scene
from sim_bridge.trial import run_trials, trial_config
from sim_bridge.world import World

FULL_PRESET = "vgn"


@dataclass(frozen=True, slots=True, eq=False)
class Recheck:
    """Trials of one scene to be repeated.

    Attributes:
        labels: The scene.
        rows: Which of its grasps.
    """

    labels: SceneLabels
    rows: NDArray[np.int64]

    def describe(self) -> str:
        """Return what names the job in a log."""
        return f"scene {self.labels.index}"


class Outcomes(NamedTuple):
    """What both executions said of the same grasps.

    Attributes:
        group: Scene kind and gripper.
        labelled: By the label factory, shape (G,).
        full: By the full execution, shape (G,).
    """

    group: str
    labelled: NDArray[np.bool_]
    full: NDArray[np.bool_]


def group_of(labels: SceneLabels) -> str:
    """Return scene kind and gripper, as in ``pile/panda``."""
    return f"{labels.scene.kind}/{labels.gripper.name}"


def draw_rechecks(
    scenes: Iterable[SceneLabels], per_group: int, rng: np.random.Generator
) -> list[Recheck]:
    """Draw tried grasps, at most ``per_group`` of each scene kind and gripper."""
    pools: dict[str, list[tuple[SceneLabels, int]]] = {}
    for labels in scenes:
        pool = pools.setdefault(group_of(labels), [])
        pool += [(labels, int(row)) for row in np.flatnonzero(labels.grasps.tried)]
    chosen: dict[int, tuple[SceneLabels, list[int]]] = {}
    for pool in pools.values():
        for place in rng.permutation(len(pool))[:per_group]:
            labels, row = pool[place]
            chosen.setdefault(id(labels), (labels, []))[1].append(row)
    return [Recheck(labels, np.array(rows)) for labels, rows in chosen.values()]


def possible_openings(
    stored: NDArray[np.float32], max_opening: float
) -> NDArray[np.float64]:
    """Return stored openings as the gripper takes them, in [m], shape (G,).

    Single precision may have rounded fully open jaws to more than fully open.

    Args:
        stored: As in the labels, shape (G,).
        max_opening: Of the gripper in [m].
    """
    return np.minimum(stored.astype(np.float64), max_opening)


def recheck(job: Recheck) -> Outcomes:
    """Try a scene's grasps again as the benchmark does.

    Raises:
        SimulationError: If the engine refuses an object.
    """
    grasps, config = job.labels.grasps, trial_config(FULL_PRESET)
    poses = grasps.poses()
    openings = possible_openings(grasps.openings, job.labels.gripper.max_opening)
    with World(solver_iterations=config.solver_iterations) as world:
        rebuild_scene(world, job.labels.scene)
        hand = SimGripper(world, job.labels.gripper)
        pairs = ((poses[row], float(openings[row])) for row in job.rows)
        full = [result.success for result in run_trials(world, hand, pairs, config)]
    labelled = grasps.labels[job.rows] == 1
    return Outcomes(group_of(job.labels), labelled, np.array(full, dtype=bool))


def count_agreement(outcomes: Sequence[Outcomes]) -> dict[str, dict[str, int]]:
    """Count per group how many grasps there are and which labels differ.

    Returns:
        By group, and for ``all``: ``n``, ``agree``, ``false_positive`` (the label
        says success, the full execution failed) and ``false_negative``.
    """
    groups = sorted({item.group for item in outcomes})
    figures = {}
    for name in [*groups, "all"]:
        mine = [item for item in outcomes if name in (item.group, "all")]
        labelled = np.concatenate([item.labelled for item in mine])
        full = np.concatenate([item.full for item in mine])
        figures[name] = {
            "n": len(full),
            "agree": int((labelled == full).sum()),
            "false_positive": int((labelled & ~full).sum()),
            "false_negative": int((~labelled & full).sum()),
        }
    return figures
