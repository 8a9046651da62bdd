# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
import torch
from diamond import SMALL_NETWORK, diamond_network
from labelled import CENTER, SIDE, TOP, labels_of

from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.training.batches import GraspCache
from neugrasp_ros.training.calibration import calibrate
from neugrasp_ros.training.quality import predict
from neugrasp_ros.training.run import render_scenes

NETWORK = replace(SMALL_NETWORK, affordances=("cut", "pour", "wear"))
HANDS = [translation(0, 0, 0.001 * i) @ hand for i in range(26) for hand in (TOP, SIDE)]


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    render_scenes([labels_of(TOP, index=7)], folder / "tune_scenes", workers=1)
    return folder


@pytest.mark.slow
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
    (renders,) = rendered.glob("tune_grasps*")
    scores = predict(network, GraspCache(renders).entries)
    assert scores.quality.mean() == pytest.approx(scores.labels.mean(), abs=0.02)
    pour = scores.affordances[scores.known, 1].mean()
    assert pour == pytest.approx(scores.afforded[scores.known, 1].mean(), abs=0.02)
    was = network.calibration.clone()
    network.calibration[1] += 0.5
    network.affordance_calibration[1] = same
    calibrate(network, rendered, [labels], quality=False)
    assert network.calibration[1] == was[1] + 0.5
    assert not torch.equal(network.affordance_calibration[1], same)
    assert list(rendered.glob("tune_grasps*")) == [renders]
    calibrate(diamond_network(NETWORK, CENTER, 0.05), rendered, [labels])
    (others,) = rendered.glob("tune_grasps*")  # another network's own renders
    assert others != renders
