# SPDX-License-Identifier: Apache-2.0
import json
from dataclasses import replace

import numpy as np
import pytest
from diamond import SMALL_NETWORK, diamond_network
from labelled import ASTRAY, CENTER, SIDE, TOP, labels_of

from neugrasp_ros.training.evaluation import ViewScores, report, score_scene
from neugrasp_ros.training.quality import Predictions

NETWORK = replace(SMALL_NETWORK, affordances=("cut", "pour"))


def view_of(index: int, *, gripper: str = "panda", known: bool = True) -> ViewScores:
    """Four grasps, ranked well, two of them tried and one that affords pouring."""
    rng = np.random.default_rng(index)
    labels = np.array([1, 1, 0, 0], dtype=np.float32)
    scores = Predictions(
        labels * 0.5 + rng.random(4).astype(np.float32) * 0.49,
        labels,
        labels >= 0,
        np.array([[0.1, 0.9], [0.2, 0.3], [0, 0], [0, 0]], dtype=np.float32),
        np.array([[0, 1], [0, 0], [0, 0], [0, 0]], dtype=np.float32),
        (labels > 0) & known,
    )
    tried = np.array([True, True, True, False])
    return ViewScores(index, "pile", "blocks", gripper, scores, tried, 3, 1)


def test_a_scene_is_scored_and_what_is_left_out_is_counted():
    network = diamond_network(NETWORK, CENTER, 0.04)
    scored = score_scene(network, labels_of(TOP, ASTRAY, SIDE), seed=0, view=0)
    assert (scored.kind, scored.objects, scored.gripper) == (
        "packed", "procedural", "panda",
    )  # fmt: skip
    assert scored.scores.labels.tolist() == [0, 0]
    assert scored.scores.affordances.shape == (2, 2)
    assert (scored.left_out, scored.left_out_positive) == (1, 1)
    assert score_scene(network, labels_of(ASTRAY), seed=0, view=0) is None


def test_the_report_has_the_whole_and_its_parts():
    views = [view_of(0), view_of(1, gripper="robotiq_2f85"), view_of(2, known=False)]
    figures = report(views, NETWORK.affordances, np.random.default_rng(0))
    assert (figures["scenes"], figures["left_out"]) == (3, 9)
    assert figures["quality"]["grasps"] == 12
    assert figures["quality"]["auc"] == 1.0
    assert figures["quality"]["auc_ci"] == [1.0, 1.0]
    assert figures["tried"]["positive"] == pytest.approx(2 / 3)
    assert figures["by"]["gripper"]["robotiq_2f85"]["grasps"] == 4
    assert figures["by"]["gripper"]["panda"]["grasps"] == 8
    assert figures["ap"] == {"cut": None, "pour": 1.0}
    assert figures["prevalence"] == {"cut": 0.0, "pour": 0.5}
    assert figures["affordances"]["pour"]["grasps"] == 4
    assert figures["ap_macro"] == 1.0
    assert json.loads(json.dumps(figures, allow_nan=False)) == figures


def test_without_heads_or_labels_there_are_no_affordance_figures():
    rng = np.random.default_rng(0)
    assert "ap" not in report([view_of(0)], (), rng)
    unknown = [view_of(0, known=False)]
    assert "ap" not in report(unknown, NETWORK.affordances, rng)


def test_views_of_one_scene_are_drawn_together():
    views = [view_of(index) for index in range(3)]
    views[1].scores.labels[:2] = 0
    once, twice = (
        report(some, (), np.random.default_rng(0)) for some in (views, [*views, *views])
    )
    assert (twice["scenes"], twice["views"]) == (3, 6)
    assert twice["quality"]["grasps"] == 2 * once["quality"]["grasps"]
    assert twice["quality"]["ece_ci"] == pytest.approx(once["quality"]["ece_ci"])
    assert twice["tried"]["ece_ci"] == pytest.approx(once["tried"]["ece_ci"])


def test_what_nobody_tried_has_no_figures():
    view = view_of(0)
    view.tried[:] = False
    figures = report([view], (), np.random.default_rng(0))
    assert figures["tried"]["grasps"] == 0
    assert figures["tried"]["ece"] is None and figures["tried"]["ece_ci"] is None
