# SPDX-License-Identifier: Apache-2.0
"""Detectors: what is known about a grasp in, logits out."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.grasp.inputs import POINT_FEATURES, TOKEN_FEATURES
from neugrasp_ros.grasp.pooling import run_maxima
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
        flat: Tensor = self.layers(points.flatten(0, 1))
        pooled: Tensor = flat.view(*points.shape[:2], -1).amax(dim=1)
        return pooled

    def pooled(self, points: Tensor, counts: NDArray[np.int64]) -> Tensor:
        """Pool points (N, F), ``counts`` (G,) of each grasp, on a CPU.

        The layers must have been folded, since the last one's bias is added after
        pooling; there are no gradients.
        """
        last: Any = self.layers[-1]
        values = (self.layers[:-1](points) @ last.weight.T).numpy()
        pooled: Tensor = torch.from_numpy(run_maxima(values, counts)) + last.bias
        return pooled


@DETECTORS.register("neugrasp")
class NeuGraspDetector(nn.Module):
    """Quality and affordances from the local surface, with shared plane features.

    Quality and affordances have a point decoder each, on the same inputs; that of the
    affordances reads the context and the view along the hand too, if the network has
    them.

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
        wider = inputs + config.context_width
        self.affordance = None
        if n_classes:
            self.affordance = _Head(wider, n_classes, config, config.hand_width)

    def forward(
        self,
        point_features: Tensor,
        tokens: Tensor,
        plane_features: Tensor,
        context: Tensor | None = None,
        hands: Tensor | None = None,
    ) -> tuple[Tensor, Tensor]:
        """Score grasps.

        Args:
            point_features: Shape (G, P, POINT_FEATURES).
            tokens: Shape (G, TOKEN_FEATURES).
            plane_features: Plane features at the points, shape (G, P, 3 * C).
            context: What ``ContextNet.read`` says of them, shape (G, P, K).
            hands: What ``HandView.described`` says of the grasps, shape (G, H).

        Returns:
            Quality logits (G,) and affordance logits (G, A).
        """
        points = self._points(point_features, plane_features)
        return self._decided(points, tokens, None, context, hands)

    def quality_alone(
        self, point_features: Tensor, tokens: Tensor, plane_features: Tensor
    ) -> Tensor:
        """Return the quality logits (G,) of ``forward``; they need no context."""
        points = self._points(point_features, plane_features)
        logits: Tensor = self.quality(points, tokens, None, None)[:, 0]
        return logits

    def _points(self, point_features: Tensor, plane_features: Tensor) -> Tensor:
        """Join to each point what is read off the planes, if it is asked for."""
        if self.read is None:
            return point_features
        return torch.cat([point_features, self.read(plane_features).relu()], dim=-1)

    @property
    def takes_runs(self) -> bool:
        """Whether ``score_runs`` can be asked: only of this file's point decoder."""
        return isinstance(self.quality.points, PointNet)

    def score_runs(
        self,
        points: Tensor,
        counts: NDArray[np.int64],
        tokens: Tensor,
        context: Tensor | None = None,
        hands: Tensor | None = None,
    ) -> tuple[Tensor, Tensor]:
        """Score grasps on a CPU by folded layers, as many points each as it has.

        Args:
            points: Those of all grasps, with what was read off the planes if that is
                asked for, shape (N, F).
            counts: Points of each grasp, shape (G,).
            tokens: Shape (G, TOKEN_FEATURES).
            context: As of ``forward``, shape (N, K).
            hands: As of ``forward``.

        Returns:
            As ``forward``.
        """
        return self._decided(points, tokens, counts, context, hands)

    def _decided(
        self,
        points: Tensor,
        tokens: Tensor,
        counts: NDArray[np.int64] | None,
        context: Tensor | None,
        hands: Tensor | None,
    ) -> tuple[Tensor, Tensor]:
        quality = self.quality(points, tokens, counts, None)[:, 0]
        if self.affordance is None:
            return quality, quality.new_zeros(len(quality), 0)
        if context is not None:
            points = torch.cat([points, context], dim=-1)
        return quality, self.affordance(points, tokens, counts, hands)


class _Head(nn.Module):
    """A point decoder, joined by the grasp's token, and the layers that decide."""

    def __init__(
        self, inputs: int, outputs: int, config: NetworkConfig, more: int = 0
    ) -> None:
        super().__init__()
        self.points: Any = DECODERS[config.decoder](inputs, config)
        self.token = nn.Sequential(
            nn.Linear(TOKEN_FEATURES, 64), nn.ReLU(), nn.Linear(64, 64), nn.ReLU()
        )
        self.decide = nn.Sequential(
            nn.Linear(config.pointnet_out + 64 + more, 128),
            nn.BatchNorm1d(128),
            nn.ReLU(),
            nn.Dropout(0.2),
            nn.Linear(128, 64),
            nn.ReLU(),
            nn.Linear(64, outputs),
        )

    def forward(
        self,
        points: Tensor,
        tokens: Tensor,
        counts: NDArray[np.int64] | None,
        more: Tensor | None,
    ) -> Tensor:
        """Pool points (G, P, F), or runs of them (N, F), and decide, (G, outputs).

        What else is known of the grasps comes last, shape (G, H).
        """
        local = (
            self.points(points)
            if counts is None
            else self.points.pooled(points, counts)
        )
        known = [local.relu(), self.token(tokens)]
        logits: Tensor = self.decide(
            torch.cat(known if more is None else [*known, more], dim=1)
        )
        return logits
