# SPDX-License-Identifier: Apache-2.0
"""The compiled encoder gives the planes of the network itself."""

from typing import Any

import numpy as np
import pytest
import torch

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.scene.encoder import volume_channels
from neugrasp_ros.scene.fast_encoder import encode_volumes, project_columns
from neugrasp_ros.scene.network import SceneNetwork


def network_of(**changes) -> SceneNetwork:
    torch.manual_seed(0)
    config = NetworkConfig(resolution=16, plane_resolution=8, unet_depth=2, **changes)
    return SceneNetwork(config).eval()


def volumes(count: int) -> list[np.ndarray]:
    """Volumes of free, unseen and seen voxels, in runs along every axis."""
    rng = np.random.default_rng(0)
    found = []
    for _ in range(count):
        coarse = rng.choice([1.0, 0.99, np.nan, 0.3, -0.4], size=(4, 4, 4))
        fine = np.kron(coarse, np.ones((4, 4, 4)))
        mixed = np.where(
            rng.random(fine.shape) < 0.1, rng.normal(size=fine.shape), fine
        )
        found.append(np.minimum(mixed, 1.0).astype(np.float32))
    return found


@pytest.mark.parametrize(
    ("stem", "unet"), [("axis", "plain"), ("axis", "residual"), ("conv3d", "plain")]
)
@pytest.mark.parametrize(("count", "threads"), [(1, 1), (1, 2), (3, 2)])
def test_planes_are_the_networks(
    stem: str, unet: str, count: int, threads: int
) -> None:
    network, seen = network_of(stem=stem, unet=unet), volumes(count)
    channels = torch.from_numpy(np.stack([volume_channels(v) for v in seen]))
    with torch.no_grad():
        expected = network.encode(channels)
    found = encode_volumes(network, seen, threads=threads)
    assert found.shape == expected.shape
    assert expected.std() > 0.01
    torch.testing.assert_close(found, expected, atol=1e-5, rtol=0)
    assert not found.requires_grad


def test_columns_of_one_kind_add_all_its_weights() -> None:
    stem: Any = network_of().encoder.stem
    for value, channel in ((1.0, 1), (np.nan, 2)):
        volume = np.full((16, 16, 16), value, dtype=np.float32)
        planes = project_columns(stem, [volume])
        for plane, conv in zip(planes[0], stem, strict=True):
            weight = conv.weight.unflatten(1, (3, 16))[:, channel]
            expected = torch.relu(weight.sum(dim=(1, 2, 3)) + conv.bias)
            assert torch.allclose(plane, expected[:, None, None], atol=1e-5)
