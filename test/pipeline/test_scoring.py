# SPDX-License-Identifier: Apache-2.0
import numpy as np
import torch
from torch import nn

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.grasp.inputs import POINT_FEATURES
from neugrasp_ros.grasp.pointnet import PointNet
from neugrasp_ros.pipeline.scoring import fold_batch_norms


def trained_pointnet() -> PointNet:
    """A point decoder whose normalisation has seen numbers."""
    torch.manual_seed(0)
    decoder = PointNet(POINT_FEATURES, NetworkConfig())
    decoder(3 * torch.randn(8, 20, POINT_FEATURES) + 1)
    return decoder.eval()


def test_a_folded_decoder_says_the_same_without_normalisation():
    decoder = trained_pointnet()
    folded = fold_batch_norms(decoder)
    assert not any(isinstance(m, nn.BatchNorm1d) for m in folded.modules())
    assert any(isinstance(m, nn.BatchNorm1d) for m in decoder.modules())
    points = torch.randn(5, 12, POINT_FEATURES)
    with torch.no_grad():
        torch.testing.assert_close(folded(points), decoder(points), atol=1e-5, rtol=0)


def test_runs_of_points_are_pooled_like_as_many_points_each():
    folded = fold_batch_norms(trained_pointnet())
    points = torch.randn(3, 7, POINT_FEATURES)
    with torch.no_grad():
        whole = folded(points)
        runs = folded.pooled(points.flatten(0, 1), np.array([7, 7, 7]))
        torch.testing.assert_close(runs, whole)
        some = torch.cat([points[0], points[1, :2], points[2]])
        shorter = folded.pooled(some, np.array([7, 2, 7]))
        repeated = points.clone()
        repeated[1] = points[1, [0, 1, 0, 1, 0, 1, 0]]  # repeats change no maximum
        torch.testing.assert_close(shorter, folded(repeated))
    assert not torch.allclose(shorter, whole)
