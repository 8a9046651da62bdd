# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import pytest
import torch

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.grasp.inputs import POINT_FEATURES, TOKEN_FEATURES
from neugrasp_ros.grasp.pointnet import NeuGraspDetector, PointNet

CONFIG = NetworkConfig(channels=4, pointnet_width=8, pointnet_out=16)


def detector_of(**changes) -> NeuGraspDetector:
    torch.manual_seed(0)
    return NeuGraspDetector(replace(CONFIG, **changes)).eval()


def some_inputs(grasps: int = 3, points: int = 10) -> tuple[torch.Tensor, ...]:
    generator = torch.Generator().manual_seed(1)
    return (
        torch.randn(grasps, points, POINT_FEATURES, generator=generator),
        torch.randn(grasps, TOKEN_FEATURES, generator=generator),
        torch.randn(grasps, points, 12, generator=generator),
    )


@torch.no_grad()
def test_the_order_of_points_does_not_matter_nor_do_repeats():
    torch.manual_seed(0)
    net = PointNet(5, CONFIG).eval()
    points = torch.randn(2, 9, 5)
    pooled = net(points)
    assert pooled.shape == (2, 16)
    torch.testing.assert_close(net(points.flip(1)), pooled)
    torch.testing.assert_close(net(torch.cat([points, points[:, :4]], 1)), pooled)


@torch.no_grad()
def test_quality_does_not_depend_on_the_order_of_points():
    detector = detector_of()
    features, tokens, planes = some_inputs()
    order = torch.randperm(10, generator=torch.Generator().manual_seed(2))
    quality, _ = detector(features, tokens, planes)
    again, _ = detector(features[:, order], tokens, planes[:, order])
    torch.testing.assert_close(again, quality)


@torch.no_grad()
def test_each_grasp_is_scored_by_itself():
    detector = detector_of()
    inputs = some_inputs()
    alone = detector(*(tensor[1:2] for tensor in inputs))[0]
    torch.testing.assert_close(alone, detector(*inputs)[0][1:2])


@pytest.mark.parametrize("affordances", [(), ("cut",), ("cut", "pour", "open")])
def test_there_is_a_logit_for_each_affordance(affordances):
    quality, affordance = detector_of(affordances=affordances)(*some_inputs())
    assert quality.shape == (3,)
    assert affordance.shape == (3, len(affordances))


@pytest.mark.parametrize("which", [0, 1, 2])
def test_all_that_is_known_of_a_grasp_matters(which):
    inputs = list(some_inputs())
    inputs[which].requires_grad_()
    detector_of()(*inputs)[0].sum().backward()
    assert inputs[which].grad.abs().sum() > 0


def test_without_shared_features_the_planes_do_not_matter():
    features, tokens, planes = some_inputs()
    detector = detector_of(point_features="none")
    assert detector.read is None
    first, _ = detector(features, tokens, planes)
    second, _ = detector(features, tokens, planes + 1.0)
    assert torch.equal(first, second)


def test_every_weight_gets_a_gradient():
    detector = detector_of(affordances=("cut", "pour")).train()
    quality, affordance = detector(*some_inputs(grasps=16))
    (quality.sum() + affordance.square().sum()).backward()
    idle = [n for n, p in detector.named_parameters() if p.grad is None]
    assert idle == []
