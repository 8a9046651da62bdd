# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import pytest
import torch

from neugrasp_ros.config import CPU_NETWORK, PAPER_NETWORK, NetworkConfig
from neugrasp_ros.errors import UnknownNameError
from neugrasp_ros.scene import network as module
from neugrasp_ros.scene.network import SceneNetwork

SMALL = NetworkConfig(
    resolution=16,
    plane_resolution=8,
    channels=4,
    unet_depth=2,
    unet_channels=4,
    occupancy_hidden=8,
    occupancy_blocks=2,
)


def small_network() -> SceneNetwork:
    torch.manual_seed(0)
    return SceneNetwork(SMALL)


def test_the_shapes_from_volume_to_logits():
    network = small_network()
    planes = network.encode(torch.randn(2, 3, 16, 16, 16))
    points = torch.rand(2, 7, 3)
    assert network.features(planes, points).shape == (2, 7, 12)
    assert network.occupancy(planes, points).shape == (2, 7)


def test_chunks_give_the_same_logits_without_gradients(monkeypatch):
    network = small_network()
    planes, points = network.encode(torch.randn(1, 3, 16, 16, 16)), torch.rand(1, 50, 3)
    monkeypatch.setattr(module, "CHUNK", 16)
    chunked = network.occupancy_chunked(planes, points)
    torch.testing.assert_close(chunked, network.occupancy(planes, points))
    assert not chunked.requires_grad


def test_an_unknown_encoder_is_answered_with_the_known_ones():
    with pytest.raises(UnknownNameError, match="unknown encoder 'radar'.*voxel"):
        SceneNetwork(replace(SMALL, encoder="radar"))


def test_the_cpu_network_keeps_its_size():
    count = sum(p.numel() for p in SceneNetwork(CPU_NETWORK).parameters())
    assert 2_900_000 < count < 3_200_000


def test_the_papers_scene_network_has_the_papers_size():
    with torch.device("meta"):
        count = sum(p.numel() for p in SceneNetwork(PAPER_NETWORK).parameters())
    assert count == pytest.approx((31.1 + 1.15) * 1e6, rel=0.02)


@pytest.mark.slow
def test_the_papers_network_learns_a_small_batch():
    """All its channels, forward and backward; a coarser volume keeps it short."""
    torch.manual_seed(0)
    network = SceneNetwork(replace(PAPER_NETWORK, resolution=16, plane_resolution=16))
    volumes, points = torch.randn(2, 3, 16, 16, 16), torch.rand(2, 64, 3)
    inside = (points[..., 0] > 0.5).float()
    loss_of = torch.nn.functional.binary_cross_entropy_with_logits
    optimiser = torch.optim.SGD(network.parameters(), lr=0.02)
    losses = []
    for _ in range(2):
        loss = loss_of(network.occupancy(network.encode(volumes), points), inside)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    assert all(torch.isfinite(p.grad).all() for p in network.parameters())
    assert losses[1] < losses[0]
