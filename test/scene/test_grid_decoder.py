# SPDX-License-Identifier: Apache-2.0
"""The compiled decoder gives the numbers of the network itself."""

import numpy as np
import pytest
import torch

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.scene.encoder import sample_planes
from neugrasp_ros.scene.grid_decoder import (
    at_resolution,
    decode_at_points,
    decode_on_grid,
    pack_weights,
    project_planes,
    read_projected,
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

    table = at_resolution(project_planes(network.decoder, planes), resolution)
    logits = decode_on_grid(pack_weights(network.decoder), table, index)

    points = torch.from_numpy(((index + 0.5) / resolution).astype(np.float32))[None]
    expected = network.occupancy_chunked(planes, points)[0].numpy()
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(logits, expected, atol=1e-4)


def test_threads_do_not_change_the_numbers() -> None:
    torch.manual_seed(0)
    network = SceneNetwork(NetworkConfig(plane_resolution=16, resolution=32)).eval()
    table = project_planes(network.decoder, torch.randn(1, 3, 32, 16, 16))
    index = np.random.default_rng(0).integers(16, size=(1000, 3))
    weights = pack_weights(network.decoder)
    one = decode_on_grid(weights, table, index, threads=1)
    two = decode_on_grid(weights, table, index, threads=2)
    np.testing.assert_allclose(one, two, atol=1e-5)
    np.testing.assert_array_equal(at_resolution(table, 32, 2), at_resolution(table, 32))


def test_points_off_the_grid_and_beyond_the_cube_are_decoded_alike() -> None:
    torch.manual_seed(0)
    network = SceneNetwork(NetworkConfig(plane_resolution=16, resolution=32)).eval()
    for block in network.decoder.blocks:
        torch.nn.init.normal_(block.fc1.weight, std=0.2)
    planes = torch.randn(1, 3, 32, 16, 16)
    points = np.random.default_rng(0).uniform(-0.1, 1.1, (300, 3)).astype(np.float32)
    table = project_planes(network.decoder, planes)
    logits = decode_at_points(pack_weights(network.decoder), table, points, threads=2)
    expected = network.occupancy_chunked(planes, torch.from_numpy(points)[None])[0]
    np.testing.assert_allclose(logits, expected.numpy(), atol=1e-4)


def test_projecting_first_gives_what_reading_first_gives() -> None:
    torch.manual_seed(0)
    planes, matrix = torch.randn(1, 3, 6, 8, 8), torch.randn(5, 18)
    points = np.random.default_rng(0).random((100, 3)).astype(np.float32)
    read = sample_planes(planes, torch.from_numpy(points)[None])[0] @ matrix.T
    table = torch.einsum("fpc,pcvu->pvuf", matrix.unflatten(1, (3, 6)), planes[0])
    found = read_projected(np.ascontiguousarray(table.numpy()), points)
    np.testing.assert_allclose(found, read.numpy(), atol=1e-4)
