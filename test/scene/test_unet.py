# SPDX-License-Identifier: Apache-2.0
import pytest
import torch

from neugrasp_ros.scene.unet import ResidualUNet, UNet


@pytest.mark.parametrize("kind", [UNet, ResidualUNet])
@pytest.mark.parametrize("depth", [1, 2, 3])
def test_planes_keep_their_shape(kind, depth):
    planes = torch.randn(2, 5, 16, 16, generator=torch.Generator().manual_seed(0))
    assert kind(5, depth, 4)(planes).shape == planes.shape


def test_the_channels_double_from_level_to_level():
    net = UNet(8, 4, 16)
    assert [block[0].out_channels for block in net.down] == [16, 32, 64, 128]
    assert [grow.out_channels for grow in net.grow] == [64, 32, 16]


def test_the_papers_unet_has_31_million_weights():
    with torch.device("meta"):
        count = sum(p.numel() for p in UNet(128, 5, 64).parameters())
    assert count == pytest.approx(31.1e6, rel=0.01)


@pytest.mark.parametrize(("depth", "reach"), [(1, 2), (2, 10)])
def test_a_deeper_net_sees_further(depth, reach):
    torch.manual_seed(0)
    net = UNet(3, depth, 4)
    planes = torch.zeros(1, 3, 32, 32, requires_grad=True)
    net(planes)[0, :, 16, 16].sum().backward()
    rows = torch.nonzero(planes.grad.abs().sum(dim=(0, 1, 3)))[:, 0]
    seen = int((rows - 16).abs().max())
    assert reach // 2 <= seen <= reach


@pytest.mark.parametrize("kind", [UNet, ResidualUNet])
def test_every_level_gets_a_gradient(kind):
    torch.manual_seed(0)
    net = kind(3, 3, 4)
    net(torch.randn(1, 3, 16, 16)).square().sum().backward()
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in net.parameters())
