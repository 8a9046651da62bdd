# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import torch

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.scene.field import FREE_LOGIT, LOGIT_LIMIT, CompiledOccupancy
from neugrasp_ros.scene.network import SceneNetwork
from neugrasp_ros.scene.reference import NetworkOccupancy

EDGE, SIZE = 0.3, 16


@pytest.fixture
def pair() -> tuple[NetworkOccupancy, NetworkOccupancy]:
    """The network asked itself, and through the compiled decoder."""
    torch.manual_seed(0)
    network = SceneNetwork(
        NetworkConfig(
            resolution=SIZE, plane_resolution=8, channels=4, unet_depth=1,
            unet_channels=4, occupancy_hidden=16, occupancy_blocks=2,
        )
    ).eval()  # fmt: skip
    planes = torch.randn(1, 3, 4, 8, 8)
    free = np.zeros((SIZE,) * 3, dtype=bool)
    free[:4] = True
    literal = NetworkOccupancy(network, planes, EDGE, free)
    compiled = CompiledOccupancy(network, planes, 1)
    return literal, NetworkOccupancy(network, planes, EDGE, free, compiled)


def test_the_compiled_decoder_answers_as_the_network_does(pair):
    points = np.random.default_rng(0).uniform(-0.1, 0.4, (500, 3))
    one, other = (np.clip(p.logits(points), -8, LOGIT_LIMIT) for p in pair)
    np.testing.assert_allclose(one, other, atol=1e-4)
    inside = ((points >= 0) & (points <= EDGE)).all(axis=1)
    known = inside & (points[:, 0] < EDGE / 4)
    assert known.any()
    assert (one[known] == FREE_LOGIT).all()
    assert np.ptp(one[~known]) > 0


def test_only_the_network_itself_is_asked_about_what_is_free(pair):
    points = np.full((7, 3), 0.01)
    for occupancy in pair:
        occupancy.logits(points)
    assert [p.queries for p in pair] == [7, 0]
