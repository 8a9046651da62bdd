# SPDX-License-Identifier: Apache-2.0
"""The demonstration of affordances: one cluttered table, asked about every class."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
from neugrasp_msgs.srv import DetectGrasps, ListAffordances, SpawnScene

from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.nodes.conversions import from_grasp_array
from neugrasp_ros.nodes.demo_client import (
    START_TIMEOUT,
    DemoClient,
    DemoError,
    demo_node,
)
from neugrasp_ros.nodes.outcomes import Code
from neugrasp_ros.pictures.answers import ClassAnswer, draw_answers
from neugrasp_ros.pictures.decision import Attempt, Decision

GRIPPER = "robotiq_2f85"
KIND = "affordance"


@dataclass
class Answers:
    """What came of asking one scene.

    Attributes:
        objects: Names of the objects.
        classes: The answer for each class.
        decision: What was seen; None if no class was answered.
        attempt: What came of the query's first grasp; None if it had none.
    """

    objects: tuple[str, ...]
    classes: tuple[ClassAnswer, ...] = ()
    decision: Decision | None = None
    attempt: Attempt | None = None


class AffordanceClient(DemoClient):
    """Ask a scene about every class, then have one answer tried.

    Args:
        spin: Called to let callbacks run for up to the given time in [s].
    """

    def __init__(self, spin: Callable[[float], None]) -> None:
        super().__init__(spin)
        self._list = self.create_client(ListAffordances, "list_affordances")

    def ask_every_class(self, seed: int, n_objects: int, query: str) -> Answers:
        """Spawn affordance objects and ask for each class; try the query's answer.

        Args:
            seed: Seed of the scene and of the sampler.
            n_objects: Objects asked for.
            query: What is tried in the end.

        Raises:
            DemoError: If a service does not answer, the scene cannot be made, or the
                query is refused.
        """
        spawned = self._call(
            self._spawn, SpawnScene.Request(kind=KIND, seed=seed, objects=n_objects)
        )
        if not spawned.success:
            raise DemoError(f"spawn_scene: {spawned.message}")
        found = Answers(tuple(spawned.names))
        final = self._ask(seed, query)
        if final.report.code == Code.UNKNOWN_AFFORDANCE:
            raise DemoError(final.report.message)
        classes = []
        for label in self._call(self._list, ListAffordances.Request()).labels:
            answer = self._ask(seed, label)
            classes.append(_class_answer(label, answer))
            if answer.success and found.decision is None:
                found.decision = self._decision(answer.grasps)
        if final.success:
            found.decision = found.decision or self._decision(final.grasps)
            found.attempt = self._attempt(final.grasps)
            classes = [_tried(item, query, found.attempt) for item in classes]
        found.classes = tuple(classes)
        return found


def _class_answer(label: str, answer: DetectGrasps.Response) -> ClassAnswer:
    if not answer.success:
        nothing = np.zeros((0, 4, 4)), np.zeros(0)
        return ClassAnswer(label, *nothing, 0.0, Code(answer.report.code).name.lower())
    grasps = from_grasp_array(answer.grasps)
    return ClassAnswer(
        label,
        grasps.grasps.poses,
        grasps.grasps.widths,
        float(grasps.affordance[0]),
    )


def _tried(answer: ClassAnswer, query: str, attempt: Attempt) -> ClassAnswer:
    """Say at the class that was asked for what came of its first grasp."""
    if answer.name != query.strip().lower():
        return answer
    return replace(answer, remark=f"tried: {attempt.result}")


def run_affordance_demo(
    *,
    seed: int,
    n_objects: int,
    query: str,
    picture: Path,
    say: Callable[[str], None],
    stopping: Event,
) -> dict[str, Any]:
    """Ask a cluttered scene about every class, try one answer, draw them all.

    Args:
        seed: Seed of scene and sampler.
        n_objects: Objects asked for.
        query: What is tried in the end.
        picture: Where the picture goes.
        say: Shows a line to the user.
        stopping: Set to end the demonstration early.

    Returns:
        JSON-able: ``lifted``, ``objects``, ``attempts``, ``answers``, ``seed``,
        ``scene``, and ``error`` where the demonstration broke off.
    """
    found, error = Answers(()), ""
    with demo_node(AffordanceClient, stopping) as client:
        try:
            client.wait_for_suite(START_TIMEOUT)
            found = client.ask_every_class(seed, n_objects, query)
        except DemoError as problem:
            error = str(problem)
    if found.objects:
        say("on the table: " + ", ".join(found.objects))
    for answer in found.classes:
        say(f"{answer.name:<9} {_said(answer)}")
    if found.decision is not None:
        _draw(found, picture, f"neugrasp: affordances, seed {seed}, asked for {query}")
        say(f"picture: {picture}")
    return {
        "scene": KIND,
        "seed": seed,
        "query": query,
        "objects": len(found.objects),
        "object_names": list(found.objects),
        "lifted": int(found.attempt is not None and found.attempt.success),
        "attempts": [vars(found.attempt)] if found.attempt else [],
        "answers": {
            answer.name: {
                "grasps": len(answer.grasps),
                "probability": answer.probability,
                "remark": answer.remark,
            }
            for answer in found.classes
        },
        **({"error": error} if error else {}),
    }


def _said(answer: ClassAnswer) -> str:
    if not len(answer.grasps):
        return f"none ({answer.remark})"
    text = f"{answer.probability:.2f}, {len(answer.grasps)} grasps"
    return f"{text}, {answer.remark}" if answer.remark else text


def _draw(found: Answers, picture: Path, title: str) -> None:
    assert found.decision is not None
    draw_answers(
        found.decision.depth,
        found.decision.surface,
        found.classes,
        load_gripper(GRIPPER),
        picture,
        title,
    )
