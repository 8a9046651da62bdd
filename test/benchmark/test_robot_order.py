# SPDX-License-Identifier: Apache-2.0
"""Both orders in the same scenes, with a detector whose answers are made up."""

from types import SimpleNamespace

import numpy as np
import pytest

from neugrasp_ros.benchmark.robot_detection import Found
from neugrasp_ros.benchmark.robot_order import compare_orders
from neugrasp_ros.benchmark.robot_round import KINDS, OBJECTS
from neugrasp_ros.manipulation.scene_watch import SeenScene


class Robot:
    def __init__(self) -> None:
        self.spawned = []

    def spawn(self, *scene):
        self.spawned.append(scene)

    def look(self):
        return SeenScene(None, np.eye(4), 77, 0)

    def surroundings(self):
        return SimpleNamespace()

    def configuration(self):
        return np.zeros(2)


class Detector:
    """Finds three grasps where reach is asked first, and one in every other scene."""

    def __init__(self) -> None:
        self.asked = []

    def find(self, scene, around, q, *, seed, reach_first, budget):
        self.asked.append((scene.revision, seed, reach_first, budget))
        count = 3 if reach_first else seed % 2
        return Found(
            poses=np.tile(np.eye(4), (count, 1, 1)),
            quality=np.linspace(0.5, 0.9, count),
            sampled=10,
            scored=5 if budget else 10,
            seconds={"proposing": 9.0, "scoring": 0.2, "reachability": 0.1},
            why="" if count else "NONE_REACHABLE",
        )


@pytest.fixture(scope="module")
def compared():
    robot, detector, told = Robot(), Detector(), []
    found = compare_orders(
        robot, detector, scenes=4, budgets=(0.0, 0.5), seed=10, say=told.append
    )
    return robot, detector, told, found


def test_both_orders_and_all_budgets_see_the_same_scenes(compared):
    robot, detector, told, _ = compared
    assert robot.spawned == [(KINDS[i], 10 + i, OBJECTS) for i in range(4)]
    assert len(detector.asked) == 16 and len(told) == 4
    for index in range(4):
        asked = detector.asked[4 * index : 4 * index + 4]
        assert {seed for _, seed, _, _ in asked} == {10 + index}
        assert [(first, budget) for _, _, first, budget in asked[:3]] == [
            (False, 0.0), (True, 0.0), (False, 0.5)
        ]  # fmt: skip


def test_first_has_the_time_that_last_took_in_all(compared):
    for _, _, first, budget in compared[1].asked[3::4]:
        assert first and budget == pytest.approx(0.2 + 0.1)


def test_no_question_finds_what_another_has_scored(compared):
    revisions = [revision for revision, *_ in compared[1].asked]
    assert len(set(revisions)) == len(revisions)


def test_the_table_holds_means_over_scenes(compared):
    cells = {(c["budget"], c["order"]): c for c in compared[3]["table"]}
    first, last = cells[0.5, "first"], cells[0.5, "last"]
    assert first["grasps_mean"] == 3.0 and first["scenes_with_any"] == 4
    assert last["grasps_mean"] == 0.5 and last["scenes_with_any"] == 2
    assert last["scored_mean"] == 5.0 and cells[0.0, "last"]["scored_mean"] == 10.0
    assert last["seconds_mean"] == pytest.approx(0.3), "without proposing"


def test_a_scene_without_a_grasp_has_no_best(compared):
    rows = compared[3]["rows"]
    assert all((row["best"] is None) == (row["grasps"] == 0) for row in rows)
    assert {row["why"] for row in rows} == {"", "NONE_REACHABLE"}
