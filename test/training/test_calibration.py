# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
import torch
from diamond import diamond_network
from labelled import CENTER, SIDE, TOP, labels_of

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.training.batches import GraspCache
from neugrasp_ros.training.calibration import (
    affordance_figures,
    calibrate,
    quality_figures,
)
from neugrasp_ros.training.quality import Predictions, predict
from neugrasp_ros.training.run import render_scenes

NETWORK = NetworkConfig(
    plane_resolution=8,
    channels=4,
    unet_depth=1,
    unet_channels=4,
    occupancy_hidden=8,
    occupancy_blocks=1,
    local_points=64,
    pointnet_width=8,
    pointnet_out=16,
    affordances=("cut", "pour", "wear"),
)
HANDS = [translation(0, 0, 0.001 * i) @ hand for i in range(26) for hand in (TOP, SIDE)]


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    render_scenes([labels_of(TOP, index=7)], folder / "tune_scenes", workers=1)
    return folder


def test_calibration_brings_means_to_their_rates_and_says_how_good_it_is(rendered):
    network = diamond_network(NETWORK, CENTER, 0.04)
    labels = labels_of(*HANDS, index=7)
    n = len(labels.grasps)
    affordances = np.zeros((n, 3), dtype=np.uint8)
    affordances[np.arange(n) % 4 == 1, 1] = 1  # every other grasp that holds
    affordances[1, 2] = 1  # too rare to fit a line to
    labels = replace(labels, grasps=replace(labels.grasps, affordances=affordances))
    card = calibrate(network, rendered, [labels])
    assert set(card["tune"]) == {"grasps", "positive", "auc", "ap", "ece", "iou"}
    assert 0 <= card["tune"]["iou"] <= 1
    assert card["tune_affordances"]["pour"]["positives"] >= 10
    same = torch.tensor([1.0, 0.0])
    assert not torch.equal(network.calibration, same)
    assert torch.equal(network.affordance_calibration[0], same)
    assert not torch.equal(network.affordance_calibration[1], same)
    assert torch.equal(network.affordance_calibration[2], same)
    scores = predict(network, GraspCache(rendered / "tune_grasps").entries)
    assert scores.quality.mean() == pytest.approx(scores.labels.mean(), abs=0.02)
    pour = scores.affordances[scores.known, 1].mean()
    assert pour == pytest.approx(scores.afforded[scores.known, 1].mean(), abs=0.02)


def test_figures_of_a_class_count_only_grasps_that_are_known():
    scores = Predictions(
        quality=np.array([0.9, 0.2, 0.8, 0.7], dtype=np.float32),
        labels=np.array([1, 0, 1, 1], dtype=np.float32),
        affordances=np.array([[0.9], [0.95], [0.1], [0.8]], dtype=np.float32),
        afforded=np.array([[1], [0], [0], [0]], dtype=np.float32),
        known=np.array([True, False, True, True]),
    )
    assert quality_figures(scores)["auc"] == 1.0
    figures = affordance_figures(scores, ("pour",))["pour"]
    assert figures["grasps"] == 3
    assert figures["positives"] == 1
    assert figures["prevalence"] == pytest.approx(1 / 3)
    assert figures["ap"] == figures["auc"] == 1.0


def test_a_class_that_nothing_is_known_of_has_no_figures():
    nothing = np.zeros((2, 1), dtype=np.float32)
    scores = Predictions(
        nothing[:, 0], nothing[:, 0], nothing, nothing, np.zeros(2, dtype=bool)
    )
    figures = affordance_figures(scores, ("pour",))["pour"]
    assert figures["grasps"] == 0
    assert np.isnan(figures["ap"])
    assert np.isnan(figures["prevalence"])
