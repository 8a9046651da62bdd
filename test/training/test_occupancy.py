# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
import torch

from neugrasp_ros.config import NetworkConfig, TrainConfig
from neugrasp_ros.errors import EmptySceneError
from neugrasp_ros.scene.network import SceneNetwork
from neugrasp_ros.training import occupancy
from neugrasp_ros.training.cache import POINT_SCALE, SceneEntry, save_entry
from neugrasp_ros.training.loop import optimise
from neugrasp_ros.training.occupancy import (
    OccupancyStage,
    SceneCache,
    draw_batch,
    occupancy_iou,
    turn_points,
    turn_volume,
)
from neugrasp_ros.training.views import quantise

SIZE = 16
NETWORK = NetworkConfig(
    resolution=SIZE,
    plane_resolution=8,
    channels=8,
    unet_depth=2,
    unet_channels=8,
    occupancy_hidden=16,
    occupancy_blocks=2,
)
CONFIG = TrainConfig(
    steps=200, scenes_per_step=4, points_per_scene=256, learning_rate=5e-3
)


def ball_entry(seed: int) -> SceneEntry:
    """A ball somewhere in the cube, seen all round."""
    rng = np.random.default_rng(seed)
    center = rng.uniform(0.35, 0.65, 3)
    axis = (np.arange(SIZE) + 0.5) / SIZE
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    distances = (np.linalg.norm(grid - center, axis=-1) - 0.22) / 0.25
    volume = np.where(distances > -1, np.minimum(distances, 1), np.nan)
    points = rng.random((2000, 3))
    return SceneEntry(
        quantise(volume.astype(np.float32))[None],
        np.eye(4)[None],
        np.round(points * POINT_SCALE).astype(np.uint16),
        np.linalg.norm(points - center, axis=1) < 0.22,
        np.zeros((0, 3), dtype=np.uint16),
        np.zeros((0, 7), dtype=np.uint8),
        np.zeros((0, 7), dtype=np.uint8),
    )


@pytest.fixture
def folder(tmp_path):
    for number in range(4):
        save_entry(ball_entry(number), tmp_path / f"{number:05d}.npz")
    return tmp_path


@pytest.mark.parametrize("turn", range(8))
def test_points_turn_with_the_volume(turn):
    voxel = np.array([1, 6, 3])
    volume = np.zeros((8, 8, 8), dtype=np.float32)
    volume[tuple(voxel)] = 1.0
    point = ((voxel + 0.5) / 8).astype(np.float32)
    turned = np.argwhere(turn_volume(volume, turn) == 1.0)[0]
    np.testing.assert_array_equal(
        np.floor(turn_points(point[None], turn)[0] * 8), turned
    )
    assert turned[2] == voxel[2]  # about the vertical


def test_the_eight_turns_differ():
    point = np.array([[0.1, 0.3, 0.7]], dtype=np.float32)
    assert len({tuple(turn_points(point, turn)[0].tolist()) for turn in range(8)}) == 8


def test_a_batch_has_its_shapes_and_follows_the_generator(folder):
    cache = SceneCache(folder)
    first, second = (draw_batch(cache, CONFIG, np.random.default_rng(1)) for _ in "ab")
    assert first.volumes.shape == (4, 3, SIZE, SIZE, SIZE)
    assert first.points.shape == (4, 256, 3)
    assert first.occupied.shape == (4, 256)
    for name in ("volumes", "points", "occupied"):
        assert torch.equal(getattr(first, name), getattr(second, name))


def test_the_labels_of_a_batch_fit_its_turned_volumes(folder):
    batch = draw_batch(SceneCache(folder), CONFIG, np.random.default_rng(2))
    cell = (batch.points * SIZE).long().clamp(0, SIZE - 1)
    for volume, index, inside in zip(batch.volumes, cell, batch.occupied, strict=True):
        distance, free = volume[0], volume[1]
        x, y, z = index.T
        clear = (distance[x, y, z].abs() > 0.3) | (free[x, y, z] > 0)
        negative = (distance[x, y, z] < 0).float()
        assert clear.sum() > 50
        assert torch.equal(negative[clear], inside[clear])


def test_points_that_a_stretch_pushes_out_do_not_count(folder):
    config = replace(CONFIG, stretched_share=1.0, points_per_scene=2000)
    batch = draw_batch(SceneCache(folder), config, np.random.default_rng(3))
    out = ((batch.points < 0) | (batch.points > 1)).any(dim=-1)
    assert out.any()
    assert torch.equal(batch.inside, ~out)
    assert not batch.boxed[out].any()
    assert batch.boxed.float().mean() == pytest.approx(0.25, abs=0.06)


def test_the_cache_finds_entries_that_come_later(folder, monkeypatch):
    cache = SceneCache(folder)
    monkeypatch.setattr(occupancy, "RESCAN_STEPS", 2)
    stage = OccupancyStage(SceneNetwork(NETWORK), cache, CONFIG)
    save_entry(ball_entry(9), folder / "00009.npz")
    stage(0)
    assert len(cache.names) == 4
    stage(1)
    assert cache.names[-1] == "00009"


def test_an_empty_folder_is_told(tmp_path):
    with pytest.raises(EmptySceneError, match="holds no scene entries"):
        SceneCache(tmp_path)


def test_a_step_can_be_repeated(folder):
    torch.manual_seed(0)
    stage = OccupancyStage(SceneNetwork(NETWORK), SceneCache(folder), CONFIG)
    assert stage(7)["occupancy"] == stage(7)["occupancy"]
    assert stage(7)["occupancy"] != stage(8)["occupancy"]


@pytest.mark.slow
def test_a_tiny_network_overfits_four_scenes(folder, tmp_path):
    torch.manual_seed(0)
    network, cache = SceneNetwork(NETWORK), SceneCache(folder)
    before = occupancy_iou(network, cache, 4)
    stage = OccupancyStage(network, cache, CONFIG)
    optimise(network, stage, CONFIG, tmp_path / "run")
    after = occupancy_iou(network, cache, 4)
    assert before < 0.3
    assert after > 0.7


@pytest.mark.slow
def test_resuming_draws_the_same_batches(folder, tmp_path):
    """Two runs to step 6: at once, and stopped after 3."""
    runs = []
    for stops in ((6,), (3, 6)):
        for stop in stops:
            torch.manual_seed(0)
            network = SceneNetwork(NETWORK)
            config = replace(CONFIG, steps=stop, constant_share=1.0)
            stage = OccupancyStage(network, SceneCache(folder), config)
            optimise(network, stage, config, tmp_path / f"run{len(stops)}")
        runs.append(network.state_dict())
    for key, value in runs[0].items():
        assert torch.equal(value, runs[1][key]), key
