# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
import torch
from grasp_entries import CLASSES, NETWORK, SIZE, grasp_entry
from torch.nn.functional import binary_cross_entropy_with_logits

from neugrasp_ros.config import TrainConfig
from neugrasp_ros.model import GraspNetwork
from neugrasp_ros.training.batches import GraspCache
from neugrasp_ros.training.grasps import NOT_KNOWN, save_grasps
from neugrasp_ros.training.loop import optimise
from neugrasp_ros.training.metrics import average_precision, roc_auc
from neugrasp_ros.training.quality import (
    JointStage,
    QualityStage,
    grasp_logits,
    grasp_losses,
    predict,
)

CONFIG = TrainConfig(
    stage="quality",
    steps=60,
    scenes_per_step=4,
    grasps_per_scene=8,
    learning_rate=5e-3,
    w_affordance=1.0,
)


@pytest.fixture
def cache(tmp_path) -> GraspCache:
    for number in range(4):
        save_grasps(grasp_entry(number), tmp_path / f"{number}.npz")
    return GraspCache(tmp_path)


@pytest.fixture
def network() -> GraspNetwork:
    torch.manual_seed(0)
    return GraspNetwork(NETWORK).train()


@pytest.mark.slow
def test_the_detector_alone_overfits_and_the_scene_stays(cache, network, tmp_path):
    before = {k: v.clone() for k, v in network.scene.state_dict().items()}
    stage = QualityStage(network, cache, CONFIG)
    optimise(network.detector, stage, CONFIG, tmp_path / "run")
    scores = predict(network.eval(), cache.entries)
    assert roc_auc(scores.quality, scores.labels) > 0.95
    for column in (0, 1):
        predicted = scores.affordances[scores.known, column]
        assert average_precision(predicted, scores.afforded[scores.known, column]) > 0.9
    assert scores.affordances[:, 2].max() < 0.5
    for key, value in network.scene.state_dict().items():
        assert torch.equal(value, before[key]), key


def test_grasps_that_were_not_judged_leave_the_quality_alone(cache, network):
    network.eval()  # dropout would make the two calls differ
    stage = QualityStage(network, cache, CONFIG)
    chosen, batch = stage.draw(0)
    planes = network.scene.encode(batch.volumes)
    rows = torch.arange(len(batch.labels)) % 3 > 0
    part = replace(batch, judged=rows, labels=batch.labels.where(rows, 1.0))
    logits, _ = grasp_logits(network, planes, batch)
    expected = binary_cross_entropy_with_logits(logits[rows], batch.labels[rows])
    loss = grasp_losses(network, planes, part, CONFIG)["quality"]
    torch.testing.assert_close(loss, CONFIG.w_quality * expected)
    nobody = replace(batch, judged=torch.zeros_like(rows))
    assert grasp_losses(network, planes, nobody, CONFIG)["quality"] == 0.0


def test_the_heads_of_a_network_with_context_learn_in_its_own_stage(cache):
    network = GraspNetwork(replace(NETWORK, context=4)).eval()
    stage = QualityStage(network, cache, CONFIG)
    chosen, batch = stage.draw(0)
    planes = network.scene.encode(batch.volumes)
    losses = grasp_losses(network, planes, batch, CONFIG)
    assert set(losses) == {"quality"}
    both, _ = grasp_logits(network, planes, batch)
    alone = binary_cross_entropy_with_logits(both, batch.labels)
    torch.testing.assert_close(losses["quality"], CONFIG.w_quality * alone)


def test_without_heads_there_is_no_affordance_loss(cache):
    network = GraspNetwork(replace(NETWORK, affordances=())).train()
    assert set(QualityStage(network, cache, CONFIG)(0)) == {"quality"}


def scene_loss_of(network: GraspNetwork, calls: list[int]):
    def scene_loss(step: int) -> dict[str, torch.Tensor]:
        calls.append(step)
        planes = network.scene.encode(torch.zeros(1, 3, SIZE, SIZE, SIZE))
        logits = network.scene.occupancy(planes, torch.rand(1, 4, 3))
        return {"occupancy": logits.square().mean()}

    return scene_loss


def test_a_joint_step_trains_everything_and_weighs_its_losses(cache, network):
    calls = []
    scene_loss = scene_loss_of(network, calls)
    network.eval()  # dropout would make the two calls differ
    losses = JointStage(network, cache, CONFIG, scene_loss)(3)
    assert set(losses) == {"quality", "affordance", "local", "occupancy"}
    assert calls == [3]
    sum(losses.values()).backward()
    idle = [n for n, p in network.named_parameters() if p.grad is None]
    assert idle == []
    weighted = replace(CONFIG, w_quality=3.0, w_local=0.0, w_affordance=0.5)
    again = JointStage(network, cache, weighted, scene_loss)(3)
    torch.testing.assert_close(again["quality"], 3 * losses["quality"])
    torch.testing.assert_close(again["affordance"], 0.5 * losses["affordance"])
    assert again["local"] == 0.0


def test_the_part_head_learns_at_points_in_the_joint_stage_alone(cache):
    network = GraspNetwork(replace(NETWORK, part_head=True)).eval()
    assert "parts" not in QualityStage(network, cache, CONFIG)(3)
    stage = JointStage(network, cache, CONFIG, scene_loss_of(network, []))
    losses = stage(3)
    losses["parts"].backward()
    reached = {n for n, p in network.named_parameters() if p.grad is not None}
    assert {"parts.weight", "parts.bias"} < reached
    assert all(n.startswith(("parts.", "scene.encoder.")) for n in reached)
    weighted = replace(CONFIG, w_parts=0.0)
    again = JointStage(network, cache, weighted, scene_loss_of(network, []))(3)
    assert again["parts"] == 0.0 < losses["parts"]


def test_predictions_are_calibrated_probabilities_with_their_labels(cache, network):
    scores = predict(network.eval(), cache.entries)
    assert scores.quality.shape == scores.labels.shape == (48,)
    assert scores.affordances.shape == scores.afforded.shape == (48, len(CLASSES))
    assert ((scores.quality > 0) & (scores.quality < 1)).all()
    assert scores.labels.mean() == 0.5
    np.testing.assert_array_equal(scores.known, scores.labels == 1)
    entry = cache.entries[0]
    untried = replace(
        entry,
        judged=np.zeros(12, dtype=bool),
        labels=np.zeros(12, dtype=np.uint8),
        affordances=np.where(entry.labels[:, None] > 0, 1, NOT_KNOWN).astype(np.uint8),
    )
    np.testing.assert_array_equal(predict(network, [untried]).known, entry.labels == 1)
    network.calibration.copy_(torch.tensor([0.0, 2.0]))
    network.affordance_calibration[1] = torch.tensor([0.0, -1.0])
    calibrated = predict(network, cache.entries)
    np.testing.assert_allclose(calibrated.quality, 1 / (1 + np.exp(-2.0)), rtol=1e-6)
    expected = scores.affordances.copy()
    expected[:, 1] = 1 / (1 + np.exp(1.0))
    np.testing.assert_allclose(calibrated.affordances, expected, rtol=1e-6)
