# SPDX-License-Identifier: Apache-2.0
"""U-Nets over feature planes: the paper's (method sheet, c2) and a residual one."""

from collections.abc import Mapping
from types import MappingProxyType

import torch
from torch import Tensor, nn


def _double_conv(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, padding=1),
        nn.ReLU(),
        nn.Conv2d(outputs, outputs, 3, padding=1),
        nn.ReLU(),
    )


class UNet(nn.Module):
    """Convolve planes at several resolutions, without normalisation layers.

    Args:
        channels: Channels C of the planes that come and go.
        depth: Number of levels; each halves the resolution of the one before.
        start: Channels of the first level; each level doubles them.
    """

    def __init__(self, channels: int, depth: int, start: int) -> None:
        super().__init__()
        widths = [start * 2**level for level in range(depth)]
        ins = [channels, *widths[:-1]]
        self.down = nn.ModuleList(
            _double_conv(a, b) for a, b in zip(ins, widths, strict=True)
        )
        self.grow = nn.ModuleList(
            nn.ConvTranspose2d(b, a, 2, stride=2)
            for a, b in zip(widths[-2::-1], widths[:0:-1], strict=True)
        )
        self.up = nn.ModuleList(_double_conv(2 * a, a) for a in widths[-2::-1])
        self.last = nn.Conv2d(start, channels, 1)

    def forward(self, planes: Tensor) -> Tensor:
        """Map planes (B, C, R, R) to planes (B, C, R, R); 2^(depth-1) divides R."""
        skips = []
        x = planes
        for level, block in enumerate(self.down):
            if level:
                x = nn.functional.max_pool2d(x, 2)
            x = block(x)
            skips.append(x)
        for grow, block, skip in zip(
            self.grow, self.up, reversed(skips[:-1]), strict=True
        ):
            x = block(torch.cat([grow(x), skip], dim=1))
        return self.last(x)


LEVEL_WIDTHS = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0)  # channels of a level over the first's
LEVEL_BLOCKS = (1, 1, 2, 2, 2, 2)  # residual blocks of a level on the way down


class Residual(nn.Module):
    """Two convolutions beside a way past them."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(channels, channels, 3, padding=1, bias=False),
            nn.BatchNorm2d(channels),
            nn.ReLU(),
            nn.Conv2d(channels, channels, 3, padding=1, bias=False),
            nn.BatchNorm2d(channels),
        )

    def forward(self, x: Tensor) -> Tensor:
        """Add what the layers make of x (B, C, H, W)."""
        return torch.relu(x + self.layers(x))


class ResidualUNet(nn.Module):
    """Like ``UNet``, of residual blocks with normalisation.

    In the same nine minutes of a core it learned more (``MODEL_CARD.md``).

    Args:
        channels: Channels C of the planes that come and go.
        depth: Number of levels; each halves the resolution of the one before.
        start: Channels of the first level, which ``LEVEL_WIDTHS`` multiplies.
    """

    def __init__(self, channels: int, depth: int, start: int) -> None:
        super().__init__()
        widths = [round(factor * start) for factor in LEVEL_WIDTHS[:depth]]
        ins = [channels, *widths[:-1]]
        self.down = nn.ModuleList(
            nn.Sequential(
                nn.Conv2d(
                    a, b, 2 if level else 1, stride=2 if level else 1, bias=False
                ),
                nn.BatchNorm2d(b),
                nn.ReLU(),
                *(Residual(b) for _ in range(blocks)),
            )
            for level, (a, b, blocks) in enumerate(
                zip(ins, widths, LEVEL_BLOCKS[:depth], strict=True)
            )
        )
        pairs = list(zip(widths[:0:-1], widths[-2::-1], strict=True))
        self.grow = nn.ModuleList(nn.Conv2d(a, b, 1) for a, b in pairs)
        self.up = nn.ModuleList(Residual(b) for _, b in pairs)
        self.last = nn.Conv2d(start, channels, 1)

    def forward(self, planes: Tensor) -> Tensor:
        """Map planes (B, C, R, R) to planes (B, C, R, R); 2^(depth-1) divides R."""
        return self.last(down_and_up(planes, self.down, self.grow, self.up))


def down_and_up(
    x: Tensor, down: nn.ModuleList, grow: nn.ModuleList, up: nn.ModuleList
) -> Tensor:
    """Go down the levels of a U-Net and up again, adding what each level had.

    Args:
        x: Shape (B, C, H, W).
        down: One module a level; each but perhaps the first halves the resolution.
        grow: Each brings the level below to the channels of one, from below.
        up: What is done with the sum.

    Returns:
        What the first level has in the end.
    """
    skips = []
    for level in down:
        x = level(x)
        skips.append(x)
    for widen, block, skip in zip(grow, up, skips[-2::-1], strict=True):
        doubled = nn.functional.interpolate(
            widen(x), scale_factor=2, mode="bilinear", align_corners=False
        )
        x = block(skip + doubled)
    return x


UNETS: Mapping[str, type[UNet] | type[ResidualUNet]] = MappingProxyType(
    {"plain": UNet, "residual": ResidualUNet}
)
