# SPDX-License-Identifier: Apache-2.0
"""Reach asked first against reach asked last: the same scenes, the same time."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from neugrasp_ros.benchmark.robot_detection import Detector, Found
from neugrasp_ros.benchmark.robot_hardware import SimulatedRobot
from neugrasp_ros.benchmark.robot_round import KINDS, OBJECTS

ORDERS = ("last", "first")


def compare_orders(
    robot: SimulatedRobot,
    detector: Detector,
    *,
    scenes: int,
    budgets: Sequence[float],
    seed: int,
    say: Callable[[str], None],
) -> dict[str, Any]:
    """Detect in each scene with both orders and every budget.

    Last has a budget for the scores, and its check comes on top of it. First gets as
    much as that took in all.

    Args:
        robot: The robot and its world.
        detector: Finds grasps.
        scenes: How many, of all furniture in turn.
        budgets: Seconds for scoring where the check comes last; 0 = no budget.
        seed: Of scenes, stances and sampler.
        say: Told of every scene.

    Returns:
        For each budget and order the reachable good grasps per scene, their mean, in
        how many scenes there were any, and how many candidates were scored.
    """
    rows: list[dict[str, Any]] = []
    for index in range(scenes):
        robot.spawn(KINDS[index % len(KINDS)], seed + index, OBJECTS)
        scene, around = robot.look(), robot.surroundings()
        q = robot.configuration()
        for number, budget in enumerate(budgets):
            allowed = budget
            for order in ORDERS:
                reach_first = order == "first"
                # another revision: what one order scored must not help the other
                revision = 2 * (index * len(budgets) + number) + reach_first
                found = detector.find(
                    scene._replace(revision=revision),
                    around,
                    q,
                    seed=seed + index,
                    reach_first=reach_first,
                    budget=allowed,
                )
                rows.append(_row(index, budget, order, found))
                allowed = _spent(found.seconds) if budget else 0.0
        say(
            f"scene {index}: {[row['grasps'] for row in rows if row['scene'] == index]}"
        )
    return {
        "scenes": scenes,
        "seed": seed,
        "kinds": list(KINDS),
        "table": [_cell(rows, budget, order) for budget in budgets for order in ORDERS],
        "rows": rows,
    }


def _row(scene: int, budget: float, order: str, found: Found) -> dict[str, Any]:
    return {
        "scene": scene,
        "budget": budget,
        "order": order,
        "grasps": len(found.poses),
        "best": float(found.quality.max()) if len(found.quality) else None,
        "sampled": found.sampled,
        "scored": found.scored,
        "why": found.why,
        "seconds": dict(found.seconds),
    }


def _cell(rows: Sequence[dict[str, Any]], budget: float, order: str) -> dict[str, Any]:
    own = [r for r in rows if r["budget"] == budget and r["order"] == order]
    return {
        "budget": budget,
        "order": order,
        "grasps_mean": float(np.mean([r["grasps"] for r in own])),
        "scenes_with_any": sum(r["grasps"] > 0 for r in own),
        "scored_mean": float(np.mean([r["scored"] for r in own])),
        "sampled_mean": float(np.mean([r["sampled"] for r in own])),
        "seconds_mean": float(np.mean([_spent(r["seconds"]) for r in own])),
    }


def _spent(seconds: Mapping[str, float]) -> float:
    """Return the time from candidates to answer in [s]."""
    return seconds.get("scoring", 0.0) + seconds.get("reachability", 0.0)
