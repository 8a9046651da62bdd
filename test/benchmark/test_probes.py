# SPDX-License-Identifier: Apache-2.0
import json
from dataclasses import replace

import numpy as np
import pytest
from sim_shapes import looking_down, model_of

from neugrasp_ros.benchmark import probes
from neugrasp_ros.benchmark.probes import (
    NONE,
    first_answers,
    offered_classes,
    probe_from_record,
    probe_scene,
)
from neugrasp_ros.benchmark.protocol import Plan, Suite
from neugrasp_ros.errors import ConfigError, UnknownAffordanceError
from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.grasp.types import GraspSet
from sim_bridge.objects.affordances import AFFORDANCE_NAMES
from sim_bridge.objects.model import Part
from sim_bridge.objects.registry import ObjectSet
from sim_bridge.scene import PlacedObject, Scene

HALF = 0.02  # [m], of a cube that is the body of a mug
MUG = replace(model_of(Part("box", (HALF, HALF, HALF), label="body")), category="mug")
SETS = {"mugs": ObjectSet("mugs", ["one"], {"one": MUG}.__getitem__)}
SUITE = Suite(scene="packed", objects="mugs", part="all", count=1)


def two_grasps(classes: tuple[str, ...], affordances: list[list[float]]):
    """Return a policy: across the cube that it knows of, and in the air."""

    def policy(look, rng):
        center = look.truth.poses[0][:3, 3]
        across = looking_down(*center)
        across[:3, :2] = look.truth.poses[0][:3, :2] @ np.diag([1, -1])
        poses = np.stack([across, looking_down(0.15, 0.15, 0.3)])
        grasps = GraspSet(poses, np.full(2, 0.08)).with_scores(
            np.array([0.9, 0.8]), np.array(affordances)
        )
        return Plan(grasps, {}, 2, classes)

    return policy


def test_a_class_is_answered_by_the_best_that_is_good_enough():
    grasps = GraspSet(np.tile(np.eye(4), (3, 1, 1)), np.zeros(3)).with_scores(
        np.array([0.9, 0.6, 0.4]),
        np.array([[0.6, 0.2, 0.6], [0.95, 0.1, 0.5], [1.0, 0.9, 0.1]]),
    )
    assert first_answers(grasps) == [1, NONE, 0]  # 0.54 < 0.57; poor; 0.54 > 0.30
    assert first_answers(grasps, min_quality=0.0) == [1, 2, 0]
    assert first_answers(grasps, min_affordance=0.7) == [1, NONE, NONE]


def test_a_probe_tells_what_holds_what_it_affords_and_what_was_answered():
    classes = ("pour", "cut", "wrap", "wear")
    policy = two_grasps(classes, [[0.9, 0.8, 0.1, 0.3], [0.2, 0.1, 0.7, 0.1]])
    probe = probe_scene(SUITE, 0, policy, SETS)
    assert probe.n_tried == 2
    assert probe.predicted == ((0.9, 0.8, 0.1, 0.3),)  # the air does not hold
    assert probe.afforded == ((True, False, True, False),)
    pour, cut, wrap, wear = probe.answers
    assert (pour.exists, pour.success, pour.affords) == (True, True, True)
    assert (cut.exists, cut.success, cut.affords) == (False, True, False)
    assert (wrap.exists, wrap.answered, wrap.success) == (True, True, False)
    assert (wear.exists, wear.answered) == (False, False)
    again = probe_from_record(json.loads(json.dumps(probe.as_record())))
    assert replace(again, scene=probe.scene) == probe
    with pytest.raises(ConfigError, match="not a probe record"):
        probe_from_record({"index": 0})


def test_whether_a_grasp_exists_is_open_where_none_was_found():
    policy = two_grasps(("pour",), [[0.9], [0.2]])
    probe = probe_scene(SUITE, 0, policy, SETS, n_candidates=0)
    assert probe.predicted == ()
    assert probe.answers[0].exists is None
    assert probe.answers[0].success and probe.answers[0].affords


def test_more_candidates_are_predicted_and_leave_the_queries_as_they_are(monkeypatch):
    monkeypatch.setattr(probes, "N_CANDIDATES", 1)
    policy = two_grasps(("pour",), [[0.9], [0.2]])
    few, many = (
        [probe_scene(SUITE, index, policy, SETS, n_candidates=n) for index in range(4)]
        for n in (1, 2)
    )
    assert [probe.answers for probe in few] == [probe.answers for probe in many]
    assert [len(probe.predicted) for probe in many] == [1, 1, 1, 1]
    exist = [bool(probe.answers[0].exists) for probe in many]
    assert [len(probe.predicted) for probe in few] == exist
    assert set(exist) == {True, False}


def test_a_class_without_true_labels_is_refused():
    with pytest.raises(UnknownAffordanceError, match="fly"):
        probe_scene(SUITE, 0, two_grasps(("fly",), [[0.9], [0.2]]), SETS)


def test_classes_are_offered_by_the_parts_of_the_objects():
    scene = Scene(
        "packed", 0, (PlacedObject("mugs", "one", 1.0, translation(0, 0, 0)),)
    )
    offered = offered_classes(scene, SETS)
    assert {AFFORDANCE_NAMES[i] for i in np.flatnonzero(offered)} == {"wrap", "pour"}
    assert not offered_classes(Scene("empty", 0, ())).any()
