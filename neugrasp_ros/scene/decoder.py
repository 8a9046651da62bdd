# SPDX-License-Identifier: Apache-2.0
"""Features at a point in, occupancy logit out (method sheet, c4)."""

from torch import Tensor, nn

from neugrasp_ros.config import NetworkConfig


class ResidualBlock(nn.Module):
    """``x + fc1(relu(fc0(relu(x))))`` with ``fc1`` zero at the start."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.fc0 = nn.Linear(width, width)
        self.fc1 = nn.Linear(width, width)
        nn.init.zeros_(self.fc1.weight)

    def forward(self, x: Tensor) -> Tensor:
        """Map (..., H) to (..., H)."""
        return x + self.fc1(self.fc0(x.relu()).relu())


class OccupancyDecoder(nn.Module):
    """Occupancy logit of a point from its position and plane features.

    Args:
        config: The network's shape.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        width = config.occupancy_hidden
        self.position = nn.Linear(3, width)
        self.injections = nn.ModuleList(
            nn.Linear(3 * config.channels, width)
            for _ in range(config.occupancy_blocks)
        )
        self.blocks = nn.ModuleList(
            ResidualBlock(width) for _ in range(config.occupancy_blocks)
        )
        self.logit = nn.Linear(width, 1)

    def forward(self, points: Tensor, features: Tensor) -> Tensor:
        """Decode occupancy.

        Args:
            points: Points in units of the cube's edge, shape (..., 3).
            features: Their plane features, shape (..., 3 * C).

        Returns:
            Logits, shape (...); positive is occupied.
        """
        x = self.position(points - 0.5)
        for inject, block in zip(self.injections, self.blocks, strict=True):
            x = block(x + inject(features))
        return self.logit(x.relu()).squeeze(-1)
