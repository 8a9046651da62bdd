# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import torch

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.errors import ConfigError
from neugrasp_ros.pipeline.scoring import fold_batch_norms
from neugrasp_ros.scene.context import HEIGHTS, LAYERS, ContextNet
from neugrasp_ros.scene.encoder import volume_channels

CONFIG = NetworkConfig(resolution=32, affordances=("cut", "pour"), context=4)


@pytest.fixture
def context() -> ContextNet:
    """A network whose normalisation has seen numbers."""
    torch.manual_seed(0)
    network = ContextNet(CONFIG)
    with torch.no_grad():
        for _ in range(3):
            network(some_volume(2))
    return network.eval()


def some_volume(count: int) -> torch.Tensor:
    rng = np.random.default_rng(0)
    distances = rng.uniform(-1, 1, (count, 32, 32, 32)).astype(np.float32)
    distances[rng.random(distances.shape) < 0.3] = np.nan
    return torch.from_numpy(volume_channels(distances))


@torch.no_grad()
def test_a_point_is_told_features_and_the_probability_of_each_part(context):
    grid = context(some_volume(2))
    assert grid.shape == (2, 4, 16, 16, LAYERS)
    points = torch.rand(2, 5, 3)
    read = context.read(grid, points)
    assert read.shape == (2, 5, CONFIG.context_width) == (2, 5, 6)
    logits = context.part_logits(read[..., :4], points)
    torch.testing.assert_close(read[..., 4:], logits.sigmoid())
    assert NetworkConfig().context_width == 0


@torch.no_grad()
def test_features_are_those_of_the_cell_that_a_point_is_in(context):
    grid = torch.zeros(1, 4, 16, 16, LAYERS)
    grid[0, :, 3, 11, 5] = torch.tensor([1.0, 2.0, 3.0, -4.0])
    low, high = (round(h * 32) / 32 for h in HEIGHTS)
    height = low + (high - low) * 5.5 / LAYERS
    inside = torch.tensor([[[3.5 / 16, 11.5 / 16, height]]])
    read = context.features(grid, inside)[0, 0]
    torch.testing.assert_close(read, torch.tensor([1.0, 2.0, 3.0, 0.0]))
    elsewhere = torch.tensor([[[11.5 / 16, 3.5 / 16, height]]])
    assert not context.features(grid, elsewhere).any()


@torch.no_grad()
def test_folded_layers_say_the_same_without_normalisation(context):
    folded = fold_batch_norms(context)
    assert not any(isinstance(m, torch.nn.BatchNorm2d) for m in folded.modules())
    volume = some_volume(1)
    torch.testing.assert_close(folded(volume), context(volume), atol=1e-4, rtol=1e-4)


@torch.no_grad()
def test_what_is_below_the_table_and_high_above_says_nothing(context):
    volume = some_volume(1)
    changed = volume.clone()
    low, high = (round(h * 32) for h in HEIGHTS)
    changed[..., :low] = 0
    changed[..., high:] = 0
    assert torch.equal(context(changed), context(volume))


def test_a_volume_that_the_levels_do_not_divide_is_refused():
    config = NetworkConfig(
        resolution=40, plane_resolution=20, affordances=("cut",), context=4
    )
    with pytest.raises(ConfigError, match="that 16 divides, got 40"):
        ContextNet(config)


def test_context_needs_classes():
    with pytest.raises(ConfigError, match="context needs affordances, got none"):
        NetworkConfig(context=4)
