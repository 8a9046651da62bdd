# SPDX-License-Identifier: Apache-2.0
"""Detectors: what is known about a grasp in, logits out."""

import torch
from torch import Tensor, nn

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.grasp.inputs import POINT_FEATURES, TOKEN_FEATURES
from neugrasp_ros.registry import Registry

DETECTORS: Registry[type[nn.Module]] = Registry("detector")
DECODERS: Registry[type[nn.Module]] = Registry("decoder")

READ_WIDTH = 32  # plane features are reduced to this width before the PointNet


@DECODERS.register("pointnet")
class PointNet(nn.Module):
    """Shared layers per point, then the maximum over the points (method sheet, c5).

    Args:
        inputs: Features of a point.
        config: Widths of the first layer (the second has twice as many) and of the
            pooled feature.
    """

    def __init__(self, inputs: int, config: NetworkConfig) -> None:
        super().__init__()
        width, outputs = config.pointnet_width, config.pointnet_out
        self.layers = nn.Sequential(
            nn.Linear(inputs, width),
            nn.BatchNorm1d(width),
            nn.ReLU(),
            nn.Linear(width, 2 * width),
            nn.BatchNorm1d(2 * width),
            nn.ReLU(),
            nn.Linear(2 * width, outputs),
            nn.BatchNorm1d(outputs),
        )

    def forward(self, points: Tensor) -> Tensor:
        """Pool points (G, P, F) to (G, outputs); their order does not matter."""
        last, flat = self.layers[-1], self.layers[:-1](points.flatten(0, 1))
        pooled: Tensor
        if isinstance(last, nn.Linear):  # normalisation folded: the bias may wait
            pooled = (flat @ last.weight.T).unflatten(0, points.shape[:2]).amax(dim=1)
            return pooled + last.bias
        pooled = last(flat).unflatten(0, points.shape[:2]).amax(dim=1)
        return pooled


@DETECTORS.register("neugrasp")
class NeuGraspDetector(nn.Module):
    """Quality and affordances from the local surface, with shared plane features.

    Quality and affordances have a point decoder each, on the same inputs.

    Args:
        config: The network's shape.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        shared = config.point_features == "shared"
        self.read = nn.Linear(3 * config.channels, READ_WIDTH) if shared else None
        inputs = POINT_FEATURES + (READ_WIDTH if shared else 0)
        self.quality = _Head(inputs, 1, config)
        n_classes = len(config.affordances)
        self.affordance = _Head(inputs, n_classes, config) if n_classes else None

    def forward(
        self, point_features: Tensor, tokens: Tensor, plane_features: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Score grasps.

        Args:
            point_features: Shape (G, P, POINT_FEATURES).
            tokens: Shape (G, TOKEN_FEATURES).
            plane_features: Plane features at the points, shape (G, P, 3 * C).

        Returns:
            Quality logits (G,) and affordance logits (G, A).
        """
        read = None if self.read is None else self.read(plane_features)
        return self.score(point_features, tokens, read)

    def score(
        self, point_features: Tensor, tokens: Tensor, read: Tensor | None
    ) -> tuple[Tensor, Tensor]:
        """Score grasps whose plane features went through ``read``, shape (G, P, R)."""
        points = point_features
        if read is not None:
            points = torch.cat([points, read.relu()], dim=-1)
        quality = self.quality(points, tokens)[:, 0]
        if self.affordance is None:
            return quality, quality.new_zeros(len(quality), 0)
        return quality, self.affordance(points, tokens)


class _Head(nn.Module):
    """A point decoder, joined by the grasp's token, and the layers that decide."""

    def __init__(self, inputs: int, outputs: int, config: NetworkConfig) -> None:
        super().__init__()
        self.points = DECODERS[config.decoder](inputs, config)
        self.token = nn.Sequential(
            nn.Linear(TOKEN_FEATURES, 64), nn.ReLU(), nn.Linear(64, 64), nn.ReLU()
        )
        self.decide = nn.Sequential(
            nn.Linear(config.pointnet_out + 64, 128),
            nn.BatchNorm1d(128),
            nn.ReLU(),
            nn.Dropout(0.2),
            nn.Linear(128, 64),
            nn.ReLU(),
            nn.Linear(64, outputs),
        )

    def forward(self, points: Tensor, tokens: Tensor) -> Tensor:
        pooled = torch.cat([self.points(points).relu(), self.token(tokens)], dim=1)
        logits: Tensor = self.decide(pooled)
        return logits
