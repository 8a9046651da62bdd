# SPDX-License-Identifier: Apache-2.0
"""What stands around a grasp: one U-Net over the whole volume, seen from above.

What a grasp affords is a matter of the whole object, of which the local surface shows a
piece: a mug's handle and a bag's are alike between the jaws. The planes that complete
the surface see far enough for that, but what they hold is busy with occupancy. Here the
heights of a column are the channels of a two-dimensional U-Net, so that one pass tells
of every surface point which part of which thing it may be.
"""

import torch
from torch import Tensor, nn

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.errors import ConfigError
from neugrasp_ros.scene.unet import Residual, down_and_up

WIDTHS = (2.0, 3.5, 5.5, 8.0)  # of the levels, times the channels of the features
BLOCKS = (1, 2, 2, 2)  # residual blocks of a level on the way down
HEIGHTS = (9 / 64, 57 / 64)  # of the cube: from just below the table top
LAYERS = 8  # of the feature grid along z
HEIGHT_SCALE = 4.0  # of a point's height in edges, as the part layers take it
PART_WIDTH = 64  # of the hidden layer that tells parts, and of that for things
COARSEST = 2 ** len(WIDTHS)  # voxels of a cell of the last level


class ContextNet(nn.Module):
    """Volume in; features, and what the part there affords, at any point out.

    Args:
        config: The network's shape; ``context`` is the number of features.

    Raises:
        ConfigError: If the U-Net's levels do not divide the volume.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        if config.resolution % COARSEST:
            raise ConfigError(
                f"a network with context needs a resolution that {COARSEST} divides, "
                f"got {config.resolution}"
            )
        channels = config.context
        self._low, self._high = (round(h * config.resolution) for h in HEIGHTS)
        self._span = (self._low / config.resolution, self._high / config.resolution)
        self._channels = channels
        widths = [round(factor * channels) for factor in WIDTHS]
        inputs = [2 * (self._high - self._low), *widths[:-1]]
        self.down = nn.ModuleList(
            nn.Sequential(
                _halving(a, b, first=level == 0), *(Residual(b) for _ in range(blocks))
            )
            for level, (a, b, blocks) in enumerate(
                zip(inputs, widths, BLOCKS, strict=True)
            )
        )
        pairs = list(zip(widths[:0:-1], widths[-2::-1], strict=True))
        self.grow = nn.ModuleList(nn.Conv2d(a, b, 1) for a, b in pairs)
        self.up = nn.ModuleList(Residual(b) for _, b in pairs)
        self.last = nn.Conv2d(widths[0], channels * LAYERS, 1)
        classes = len(config.affordances)
        self.parts = _point_layers(channels, classes)
        self.things = _point_layers(channels, classes) if config.thing_head else None

    def forward(self, volume: Tensor) -> Tensor:
        """See volumes.

        Args:
            volume: Channels of ``volume_channels``, shape (B, 3, D, D, D).

        Returns:
            A feature grid, shape (B, C, D / 2, D / 2, LAYERS), over the cube's whole
            width and ``HEIGHTS``.
        """
        signed, free, unknown = volume[..., self._low : self._high].unbind(dim=1)
        distances, known = signed + free, 1 - unknown  # free space is at distance 1
        columns = torch.cat([distances, known], dim=-1).permute(0, 3, 1, 2)
        x = down_and_up(columns, self.down, self.grow, self.up)
        grid: Tensor = self.last(x).unflatten(1, (self._channels, LAYERS))
        return grid.permute(0, 1, 3, 4, 2)

    def on_grid(self, points: Tensor) -> Tensor:
        """Return points (..., 3), given in units of the edge, in those of the grid."""
        low, high = self._span
        x, y, z = points.unbind(dim=-1)
        return torch.stack([x, y, (z - low) / (high - low)], dim=-1)

    def features(self, grid: Tensor, points: Tensor) -> Tensor:
        """Read features (B, N, C) at points (B, N, 3) in units of the edge."""
        where = self.on_grid(points).flip(-1)
        read = nn.functional.grid_sample(
            grid,
            (2 * where - 1)[:, :, None, None],
            mode="bilinear",
            padding_mode="border",
            align_corners=False,
        )  # (B, C, N, 1, 1)
        return read[..., 0, 0].transpose(1, 2).relu()

    def part_logits(self, features: Tensor, points: Tensor) -> Tensor:
        """Say what the part at each point affords, logits (B, N, A)."""
        logits: Tensor = self.parts(_with_height(features, points))
        return logits

    def thing_logits(self, features: Tensor, points: Tensor) -> Tensor:
        """Say what any part of the thing at each point affords, logits (B, N, A).

        Nobody asks for it at work. Learning it tells the features of a blade whether
        it has a point, from near, before those of the handle have to know.

        Raises:
            ConfigError: If the network has no ``thing_head``.
        """
        if self.things is None:
            raise ConfigError("the network has no thing_head")
        logits: Tensor = self.things(_with_height(features, points))
        return logits

    def read(self, grid: Tensor, points: Tensor) -> Tensor:
        """Return what the affordance head is told of points.

        Args:
            grid: Of ``forward``.
            points: In units of the edge, shape (B, N, 3).

        Returns:
            Features, then probabilities of the parts, shape
            (B, N, ``NetworkConfig.context_width``).
        """
        return self.described(self.features(grid, points), points)

    def described(self, features: Tensor, points: Tensor) -> Tensor:
        """Return what ``read`` does, of what ``features`` returned (B, N, C)."""
        parts = self.part_logits(features, points).sigmoid()
        return torch.cat([features, parts], dim=-1)


def _point_layers(channels: int, outputs: int) -> nn.Sequential:
    """Return layers from a point's features and height."""
    return nn.Sequential(
        nn.Linear(channels + 1, PART_WIDTH), nn.ReLU(), nn.Linear(PART_WIDTH, outputs)
    )


def _with_height(features: Tensor, points: Tensor) -> Tensor:
    return torch.cat([features, HEIGHT_SCALE * points[..., 2:]], dim=-1)


def _halving(inputs: int, outputs: int, *, first: bool) -> nn.Sequential:
    """Return a convolution to half the resolution; the first one's cells overlap."""
    size, padding = (3, 1) if first else (2, 0)
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, size, stride=2, padding=padding, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(),
    )
