# SPDX-License-Identifier: Apache-2.0
"""The compiled decoder gives the numbers of the network itself."""

import numpy as np
import pytest
import torch

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.scene.grid_decoder import (
    decode_on_grid,
    pack_weights,
    project_planes,
)
from neugrasp_ros.scene.network import SceneNetwork


@pytest.mark.parametrize("resolution", [16, 32, 40])
def test_grid_decoder_equals_the_network(resolution: int) -> None:
    torch.manual_seed(0)
    network = SceneNetwork(NetworkConfig(plane_resolution=16, resolution=32)).eval()
    for block in network.decoder.blocks:
        torch.nn.init.normal_(block.fc1.weight, std=0.2)
    planes = torch.randn(1, 3, 32, 16, 16)
    index = np.random.default_rng(0).integers(resolution, size=(700, 3))

    table = project_planes(network.decoder, planes, resolution)
    logits = decode_on_grid(pack_weights(network.decoder), table, index)

    points = torch.from_numpy(((index + 0.5) / resolution).astype(np.float32))[None]
    expected = network.occupancy_chunked(planes, points)[0].numpy()
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(logits, expected, atol=1e-4)


def test_threads_do_not_change_the_numbers() -> None:
    torch.manual_seed(0)
    network = SceneNetwork(NetworkConfig(plane_resolution=16, resolution=32)).eval()
    table = project_planes(network.decoder, torch.randn(1, 3, 32, 16, 16), 16)
    index = np.random.default_rng(0).integers(16, size=(1000, 3))
    weights = pack_weights(network.decoder)
    one = decode_on_grid(weights, table, index, threads=1)
    two = decode_on_grid(weights, table, index, threads=2)
    np.testing.assert_allclose(one, two, atol=1e-5)
