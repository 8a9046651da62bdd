# SPDX-License-Identifier: Apache-2.0
"""Coarse-to-fine evaluation against asking the network everywhere."""

import numpy as np
import pytest
import torch

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.errors import ShapeError
from neugrasp_ros.scene import field as field_module
from neugrasp_ros.scene.decoder import OccupancyDecoder
from neugrasp_ros.scene.field import (
    FREE_LOGIT,
    LOGIT_LIMIT,
    evaluate_field,
    seen_free,
)
from neugrasp_ros.scene.network import SceneNetwork

EDGE, SIZE = 0.3, 32
CENTER, RADIUS = np.array([0.5, 0.45, 0.4]), 0.22  # in units of the edge


def grid_points(size: int = SIZE) -> np.ndarray:
    axis = (np.arange(size) + 0.5) / size
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)


def sphere_logits(points: np.ndarray) -> np.ndarray:
    return 40.0 * (RADIUS - np.linalg.norm(points - CENTER, axis=-1))


class SphereNetwork:
    """Stands in for a trained network: its occupancy is a sphere."""

    def __init__(self) -> None:
        self.asked = 0
        self.decoder = OccupancyDecoder(
            NetworkConfig(channels=4, occupancy_hidden=8, occupancy_blocks=1)
        )

    def occupancy_chunked(
        self, planes: torch.Tensor, points: torch.Tensor
    ) -> torch.Tensor:
        self.asked += points.shape[1]
        logits = sphere_logits(points.double().numpy())
        return torch.from_numpy(logits.astype(np.float32))


@pytest.fixture
def asks_the_network(monkeypatch) -> torch.Tensor:
    """Planes for the stand-in, which is asked itself and not compiled."""
    monkeypatch.setattr(field_module, "pack_weights", lambda decoder: None)
    return torch.zeros(1, 3, 4, SIZE, SIZE)


def half_seen() -> np.ndarray:
    """A volume whose upper part was seen free, down to just above the sphere."""
    distances = np.full((SIZE,) * 3, np.nan, dtype=np.float32)
    distances[grid_points()[..., 2] > CENTER[2] + RADIUS + 0.1] = 1.0
    return distances


def test_the_sphere_is_found_where_it_is(asks_the_network):
    distances = half_seen()
    field, _ = evaluate_field(SphereNetwork(), asks_the_network, distances, EDGE)
    truth = sphere_logits(grid_points(2 * SIZE))
    unknown = np.isnan(distances).repeat(2, 0).repeat(2, 1).repeat(2, 2)
    same_sign = (field.values > 0) == (truth > 0)
    assert same_sign[unknown].mean() >= 0.9999
    near = unknown & (np.abs(truth) < 0.2)
    np.testing.assert_allclose(field.values[near], truth[near], atol=1e-4)
    assert field.spacing == pytest.approx(EDGE / SIZE / 2)
    assert field.reach == pytest.approx(EDGE / SIZE)


def test_what_was_seen_free_stays_free_and_is_not_asked(asks_the_network):
    network, distances = SphereNetwork(), half_seen()
    distances[8:24, 8:24, 8:24] = 1.0  # seen free against what the network thinks
    field, queries = evaluate_field(network, asks_the_network, distances, EDGE)
    assert (field.values[20:44, 20:44, 20:44] == FREE_LOGIT).all()
    assert queries == network.asked


def test_free_is_what_was_seen_free_with_all_its_neighbours():
    distances = np.full((5, 5, 5), 1.0, dtype=np.float32)
    distances[0, 0, 0], distances[4, 2, 2] = np.nan, 0.5
    free = seen_free(distances)
    assert not free[:2, :2, :2].any()
    assert not free[3:, 1:4, 1:4].any()
    assert free.sum() == 5**3 - 8 - 18


def test_most_of_the_volume_is_not_asked_at_full_resolution(asks_the_network):
    nothing_seen = np.full((SIZE,) * 3, np.nan, dtype=np.float32)
    _, queries = evaluate_field(SphereNetwork(), asks_the_network, nothing_seen, EDGE)
    assert (SIZE // 2) ** 3 < queries < 0.2 * (2 * SIZE) ** 3


def test_logits_are_clipped(asks_the_network):
    field, _ = evaluate_field(SphereNetwork(), asks_the_network, half_seen(), EDGE)
    assert np.abs(field.values).max() <= LOGIT_LIMIT


def test_the_volume_is_left_alone(asks_the_network):
    distances = half_seen()
    evaluate_field(SphereNetwork(), asks_the_network, distances, EDGE)
    np.testing.assert_array_equal(distances, half_seen())


@pytest.mark.parametrize("plane_resolution", [8, 16])
def test_a_network_is_evaluated_as_if_it_were_asked_everywhere(plane_resolution):
    """On a CPU the compiled decoder answers; it must not be told from the network."""
    torch.manual_seed(1)
    network = SceneNetwork(
        NetworkConfig(
            resolution=SIZE, plane_resolution=plane_resolution, channels=4,
            unet_depth=1, unet_channels=4, occupancy_hidden=16, occupancy_blocks=2,
        )
    ).eval()  # fmt: skip
    coarse = torch.randn(1, 12, 3, 3) * 2  # smooth planes
    planes = torch.nn.functional.interpolate(
        coarse, size=(plane_resolution,) * 2, mode="bilinear"
    ).reshape(1, 3, 4, plane_resolution, plane_resolution)
    size = 2 * SIZE
    points = torch.from_numpy(grid_points(size).astype(np.float32)).reshape(1, -1, 3)
    with torch.no_grad():
        network.decoder.logit.weight.mul_(6.0)
        dense = network.occupancy_chunked(planes, points)
        network.decoder.logit.bias.sub_(dense.median())
        dense = network.occupancy_chunked(planes, points)[0].numpy()
    dense = dense.reshape((size,) * 3)
    distances = np.full((SIZE,) * 3, np.nan, dtype=np.float32)
    field, queries = evaluate_field(network, planes, distances, EDGE)
    assert 0.2 < (dense > 0).mean() < 0.8
    assert ((field.values > 0) == (dense > 0)).mean() >= 0.999
    assert queries > (SIZE // 2) ** 3
    near = np.abs(dense) < 0.05
    assert (np.abs(field.values - dense)[near] < 1e-3).mean() > 0.998


@pytest.mark.parametrize("shape", [(7, 7, 7), (8, 8, 6), (8, 8)])
def test_only_an_even_cube_is_accepted(asks_the_network, shape):
    with pytest.raises(ShapeError, match="even D"):
        evaluate_field(
            SphereNetwork(), asks_the_network, np.zeros(shape, np.float32), EDGE
        )
