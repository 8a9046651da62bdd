# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.training.figures import (
    MACRO,
    affordance_figures,
    average_precisions,
    intervals,
    quality_figures,
)
from neugrasp_ros.training.quality import Predictions


def scores_of(quality, labels, affordances=None, afforded=None) -> Predictions:
    """Grasps that hold are those whose affordances are known."""
    nothing = np.zeros((len(labels), 1))
    return Predictions(
        np.array(quality, dtype=np.float32),
        np.array(labels, dtype=np.float32),
        np.array(labels) >= 0,
        np.array(nothing if affordances is None else affordances, dtype=np.float32),
        np.array(nothing if afforded is None else afforded, dtype=np.float32),
        np.array(labels) > 0,
    )


SCORES = scores_of(
    [0.9, 0.2, 0.8, 0.7],
    [1, 0, 1, 1],
    [[0.9, 0.1], [0.95, 0.9], [0.1, 0.3], [0.8, 0.2]],
    [[1, 0], [0, 1], [0, 0], [0, 1]],
)


def test_figures_of_a_class_count_only_grasps_that_are_known():
    assert quality_figures(SCORES)["auc"] == 1.0
    figures = affordance_figures(SCORES, ("pour", "cut"))
    assert figures["pour"]["grasps"] == 3
    assert figures["pour"]["positives"] == 1
    assert figures["pour"]["prevalence"] == pytest.approx(1 / 3)
    assert figures["pour"]["ap"] == figures["pour"]["auc"] == 1.0
    assert figures["cut"]["ap"] == 0.5  # second of three


def test_a_class_that_nothing_is_known_of_has_no_figures():
    figures = affordance_figures(scores_of([0.1, 0.2], [0, 0]), ("pour",))["pour"]
    assert figures["grasps"] == 0
    assert np.isnan(figures["ap"])
    assert np.isnan(figures["prevalence"])


def test_the_mean_is_over_classes_that_occur():
    assert average_precisions(SCORES, ("pour", "cut")) == {
        "pour": 1.0, "cut": 0.5, MACRO: 0.75,
    }  # fmt: skip
    never = SCORES._replace(afforded=np.zeros((4, 2), dtype=np.float32))
    assert np.isnan(average_precisions(never, ("pour", "cut"))[MACRO])


def rate(scores: Predictions) -> dict[str, float]:
    return {"rate": float(scores.labels.mean()), "none": float("nan")}


def test_scenes_are_drawn_whole():
    # a scene is all or nothing: 20 scenes, half of them 1, as 20 coins
    parts = [scores_of([0.5] * 50, [i % 2] * 50) for i in range(20)]
    bounds = intervals(parts, rate, np.random.default_rng(0), n_draws=2000)
    assert bounds["rate"] == pytest.approx([0.28, 0.72], abs=0.04)
    assert bounds["none"] is None
