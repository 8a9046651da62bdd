# SPDX-License-Identifier: Apache-2.0
import torch

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.scene.decoder import OccupancyDecoder, ResidualBlock

CONFIG = NetworkConfig(channels=4, occupancy_hidden=8, occupancy_blocks=2)


def decoder_and_query() -> tuple[OccupancyDecoder, torch.Tensor, torch.Tensor]:
    torch.manual_seed(0)
    return OccupancyDecoder(CONFIG), torch.rand(2, 5, 3), torch.randn(2, 5, 12)


def test_a_new_residual_block_adds_only_its_last_bias():
    block = ResidualBlock(8)
    x = torch.randn(3, 8)
    torch.testing.assert_close(block(x), x + block.fc1.bias)


def test_one_logit_a_point_and_each_point_by_itself():
    decoder, points, features = decoder_and_query()
    logits = decoder(points, features)
    assert logits.shape == (2, 5)
    torch.testing.assert_close(decoder(points[1, 3], features[1, 3]), logits[1, 3])


def test_position_and_features_both_matter():
    decoder, points, features = decoder_and_query()
    points.requires_grad_()
    features.requires_grad_()
    decoder(points, features).sum().backward()
    assert points.grad.abs().sum() > 0
    assert features.grad.abs().sum() > 0


def test_every_weight_but_those_behind_the_zero_start_gets_a_gradient():
    decoder, points, features = decoder_and_query()
    decoder(points, features).sum().backward()
    idle = {n for n, p in decoder.named_parameters() if not p.grad.abs().sum()}
    hidden = {f"blocks.{i}.fc0" for i in (0, 1)}
    assert idle == {f"{name}.{part}" for name in hidden for part in ("weight", "bias")}
