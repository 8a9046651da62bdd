# SPDX-License-Identifier: Apache-2.0
"""The convolutional occupancy network: encode once, ask anywhere."""

import torch
from torch import Tensor, nn

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.scene.decoder import OccupancyDecoder
from neugrasp_ros.scene.encoder import ENCODERS, sample_planes

CHUNK = 8192  # points decoded at once: their activations stay in the cache


class SceneNetwork(nn.Module):
    """Encoder, feature planes and occupancy decoder.

    Args:
        config: The network's shape.

    Raises:
        UnknownNameError: If the configured encoder is not in the registry.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        self.encoder = ENCODERS[config.encoder](config)
        self.decoder = OccupancyDecoder(config)

    def encode(self, volume: Tensor) -> Tensor:
        """Map volume channels (B, 3, D, D, D) to planes (B, 3, C, R, R)."""
        planes: Tensor = self.encoder(volume)
        return planes

    def features(self, planes: Tensor, points: Tensor) -> Tensor:
        """Read plane features (B, N, 3C) at points (B, N, 3) in units of the edge."""
        return sample_planes(planes, points)

    def occupancy(self, planes: Tensor, points: Tensor) -> Tensor:
        """Decode occupancy logits (B, N) at points (B, N, 3) in units of the edge."""
        logits: Tensor = self.decoder(points, self.features(planes, points))
        return logits

    @torch.no_grad()
    def occupancy_chunked(self, planes: Tensor, points: Tensor) -> Tensor:
        """Like ``occupancy`` for one scene (1, N, 3), in chunks, without gradients."""
        parts = [self.occupancy(planes, part) for part in points.split(CHUNK, dim=1)]
        return torch.cat(parts, dim=1)
