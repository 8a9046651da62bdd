# SPDX-License-Identifier: Apache-2.0
"""A small U-Net over feature planes (method sheet, c2)."""

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
