# SPDX-License-Identifier: Apache-2.0
"""A volume as a relief: how high above the table the topmost surface seen is.

What a tool is shows in outlines that stand a few millimetres above the table, less than
a voxel. A distance field holds them, but as small differences of numbers that vary far
more with the table's own height; taken apart, they are the first thing to be seen.
"""

from typing import NamedTuple

import torch
from torch import Tensor

TOP = 61 / 64  # of the cube: surfaces higher than that are not looked at
LEVELS = (4 / 64, 20 / 64)  # of the cube: between these lies the table
BINS = 64  # of the histogram over ``LEVELS``: a quarter of a voxel of ours
USUAL_LEVEL = 1 / 6  # of the cube: the table where too little of it is seen
LEAST_SEEN = 30  # cells that make a histogram
MIDDLE = 0.5  # of a voxel or a bin: where its value is


class Relief(NamedTuple):
    """The topmost surfaces of B volumes.

    Attributes:
        heights: Over the table in units of the edge, 0 where none is seen, (B, D, D).
        seen: 1 where a surface is seen from above, else 0, shape (B, D, D).
        levels: Height of the table in the cube in units of the edge, shape (B,).
    """

    heights: Tensor
    seen: Tensor
    levels: Tensor


def relief_of(volume: Tensor) -> Relief:
    """Find the topmost surfaces of volumes, finer than a voxel.

    The level that most of the surface has, between ``LEVELS``, is taken for the
    table's: a flat thing that covers most of the cube is mistaken for it.

    Args:
        volume: Channels of ``volume_channels``, shape (B, 3, D, D, D).
    """
    size = volume.shape[-1]
    signed, free, unknown = volume[..., : round(TOP * size)].unbind(dim=1)
    distances, known = signed + free, unknown == 0
    inside, outside = distances[..., :-1], distances[..., 1:]
    crossed = (inside <= 0) & (outside > 0) & known[..., :-1] & known[..., 1:]
    steps = torch.arange(1, crossed.shape[-1] + 1, device=volume.device)
    top = (crossed * steps).amax(dim=-1)  # 0 where none is crossed
    seen = top > 0
    below = (top - 1).clamp(min=0)[..., None]
    low = inside.gather(-1, below)[..., 0]
    high = outside.gather(-1, below)[..., 0]
    part = low / torch.where(seen, low - high, -1.0)
    heights = (below[..., 0] + part + MIDDLE) / size
    levels = torch.stack([_level(h[s]) for h, s in zip(heights, seen, strict=True)])
    over = torch.where(seen, heights - levels[:, None, None], 0.0)
    return Relief(over, seen.to(over.dtype), levels)


def _level(heights: Tensor) -> Tensor:
    """Return the level that most of N heights have."""
    if len(heights) < LEAST_SEEN:
        return heights.new_tensor(USUAL_LEVEL)
    least, most = LEVELS
    counts = torch.histc(heights.float(), BINS, least, most)
    if not counts.any():
        return heights.median()
    width = (most - least) / BINS
    middle = least + (counts.argmax() + MIDDLE) * width
    return heights[(heights - middle).abs() < 2 * width].median()
