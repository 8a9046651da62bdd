# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
import torch

from neugrasp_ros.config import NetworkConfig, TrainConfig
from neugrasp_ros.errors import EmptySceneError
from neugrasp_ros.grasp.inputs import POINT_FEATURES, TOKEN_FEATURES
from neugrasp_ros.model import GraspNetwork
from neugrasp_ros.training.cache import POINT_SCALE
from neugrasp_ros.training.grasps import GraspEntry, save_grasps
from neugrasp_ros.training.loop import optimise
from neugrasp_ros.training.metrics import roc_auc
from neugrasp_ros.training.quality import (
    LOCAL_POINTS_PER_SCENE,
    GraspCache,
    JointStage,
    QualityStage,
    make_batch,
    predict,
)

SIZE, POINTS = 16, 16
NETWORK = NetworkConfig(
    resolution=SIZE,
    plane_resolution=8,
    channels=4,
    unet_depth=1,
    unet_channels=4,
    occupancy_hidden=8,
    occupancy_blocks=1,
    local_points=POINTS,
    pointnet_width=16,
    pointnet_out=32,
)
CONFIG = TrainConfig(
    stage="quality",
    steps=60,
    scenes_per_step=4,
    grasps_per_scene=8,
    learning_rate=5e-3,
)
NORMAL_X = 3  # of the point features; mirroring leaves it alone


def grasp_entry(seed: int, count: int = 12) -> GraspEntry:
    """Grasps that hold where the surface's normals look along x."""
    rng = np.random.default_rng(seed)
    labels = (np.arange(count) % 2).astype(np.uint8)
    features = rng.normal(0, 0.3, (count, POINTS, POINT_FEATURES))
    features[..., NORMAL_X] += 2.0 * labels[:, None] - 1.0
    local = rng.integers(0, int(POINT_SCALE), (30, 3)).astype(np.uint16)
    return GraspEntry(
        rng.integers(-127, 128, (SIZE,) * 3).astype(np.int8),
        rng.integers(0, int(POINT_SCALE), (count, POINTS, 3)).astype(np.uint16),
        features.astype(np.float16),
        rng.normal(size=(count, TOKEN_FEATURES)).astype(np.float32),
        labels,
        np.ones(count, dtype=bool),
        local,
        local[:, 2] < POINT_SCALE / 2,
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


def test_a_batch_has_its_shapes(cache):
    batch = make_batch(cache.entries[:3], 5, np.random.default_rng(0))
    assert batch.volumes.shape == (3, 3, SIZE, SIZE, SIZE)
    assert batch.points.shape == (3, 5 * POINTS, 3)
    assert batch.point_features.shape == (15, POINTS, POINT_FEATURES)
    assert batch.tokens.shape == (15, TOKEN_FEATURES)
    assert batch.labels.shape == (15,)
    assert batch.local_points.shape == (3, LOCAL_POINTS_PER_SCENE, 3)
    assert batch.local_occupied.shape == (3, LOCAL_POINTS_PER_SCENE)
    assert all(tensor.dtype == torch.float32 for tensor in vars(batch).values())


def test_all_grasps_come_before_any_comes_again(cache):
    entry = cache.entries[0]
    batch = make_batch([entry], 20, np.random.default_rng(0))
    tokens = np.abs(batch.tokens.numpy())[:, 0]  # gravity's x: no mirror changes it
    assert len(set(tokens[:12].tolist())) == 12
    assert set(tokens.tolist()) == set(np.abs(entry.tokens[:, 0]).tolist())


def test_labels_stay_with_their_grasps_and_about_half_are_mirrored():
    entry = grasp_entry(0, count=200)
    batch = make_batch([entry], 200, np.random.default_rng(0))
    means = batch.point_features[..., NORMAL_X].mean(dim=1)
    assert torch.equal((means > 0).float(), batch.labels)
    row_of = {value: row for row, value in enumerate(entry.tokens[:, 0].tolist())}
    rows = [row_of[value] for value in batch.tokens[:, 0].tolist()]
    mirrored = batch.tokens[:, 1].numpy() == -entry.tokens[rows, 1]
    assert 0.35 < mirrored.mean() < 0.65


def test_points_are_in_units_of_the_edge(cache):
    batch = make_batch(cache.entries, 8, np.random.default_rng(0))
    for points in (batch.points, batch.local_points):
        assert 0 <= points.min() < 0.05
        assert 0.95 < points.max() <= 1


def test_the_detector_alone_overfits_and_the_scene_stays(cache, network, tmp_path):
    before = {k: v.clone() for k, v in network.scene.state_dict().items()}
    stage = QualityStage(network, cache, CONFIG)
    optimise(network.detector, stage, CONFIG, tmp_path / "run")
    probabilities, labels = predict(network.eval(), cache)
    assert roc_auc(probabilities, labels) > 0.95
    for key, value in network.scene.state_dict().items():
        assert torch.equal(value, before[key]), key


def test_a_joint_step_trains_everything_and_weighs_its_losses(cache, network):
    calls = []

    def scene_loss(step: int) -> dict[str, torch.Tensor]:
        calls.append(step)
        planes = network.scene.encode(torch.zeros(1, 3, SIZE, SIZE, SIZE))
        logits = network.scene.occupancy(planes, torch.rand(1, 4, 3))
        return {"occupancy": logits.square().mean()}

    network.eval()  # dropout would make the two calls differ
    stage = JointStage(network, cache, CONFIG, scene_loss)
    losses = stage(3)
    assert set(losses) == {"quality", "local", "occupancy"}
    assert calls == [3]
    sum(losses.values()).backward()
    idle = [n for n, p in network.named_parameters() if p.grad is None]
    assert idle == []
    weighted = replace(CONFIG, w_quality=3.0, w_local=0.0)
    again = JointStage(network, cache, weighted, scene_loss)(3)
    torch.testing.assert_close(again["quality"], 3 * losses["quality"])
    assert again["local"] == 0.0


def test_predictions_are_calibrated_probabilities_with_their_labels(cache, network):
    probabilities, labels = predict(network.eval(), cache)
    assert probabilities.shape == labels.shape == (48,)
    assert ((probabilities > 0) & (probabilities < 1)).all()
    assert labels.mean() == 0.5
    network.calibration.copy_(torch.tensor([0.0, 2.0]))
    calibrated, _ = predict(network, cache)
    np.testing.assert_allclose(calibrated, 1 / (1 + np.exp(-2.0)), rtol=1e-6)


def test_an_empty_folder_is_told(tmp_path):
    with pytest.raises(EmptySceneError, match="holds no grasp entries"):
        GraspCache(tmp_path)
