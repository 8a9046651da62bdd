# SPDX-License-Identifier: Apache-2.0
"""The surroundings of a grasp as the hand would see them: always the same way round.

Whether a knife can stab is to be seen at its tip, a handle away from the grip, and it
may lie in any direction. A network over the whole scene has to learn tips in every
direction and to carry what it found to the grip. Here the relief of the scene is cut
out around each hand and turned so that the thing that it grips lies along one axis of
the picture, with more of it ahead than behind.
"""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.scene.heights import Relief

LENGTH, WIDTH = 96, 32  # cells of a picture along and across the thing
CELL = 0.004 / 0.3  # of the edge: 4 mm in a cube of 30 cm
WIDTHS = (32, 48, 64, 96)  # channels of the convolutions, each at half the resolution
VOXEL = 1 / 64  # of the edge: unit of the heights that the convolutions see
FINE, COARSE = (-1.0, 3.0), (-1.0, 15.0)  # heights of blades and of mugs in [VOXEL]
FINE_SCALE, COARSE_SCALE = 0.7, 0.2
NEAR = 4.0  # [VOXEL] above and below the hand's middle
CHANNELS = 4
POSE_FEATURES = 5  # the approach along, across and up; the height; the breadth along
HIDDEN = 128
LEAST_HEIGHT = 0.5  # [VOXEL] over the table: what is lower may be noise
LEVEL_BELL = 8.0  # [VOXEL] above or below the hand: things much higher are others
BELLS = ((0.12, 0.12), (0.25, 0.08))  # of the edge: lengths and widths of the bells
LEAST_MASS = 4.0  # cells that make an axis
LEAST_LONG = 0.2  # of the spread: how much longer than wide a thing is


class Hands(NamedTuple):
    """K hands in each of B scenes.

    Attributes:
        centers: Midpoints between the pads in units of the edge, shape (B, K, 3).
        along: Horizontal unit vectors along the hands' breadth, the x axis of the
            gripper frame, or along their approach where the breadth is steeper than it,
            shape (B, K, 2).
        approach: Directions of the approach, shape (B, K, 3).
    """

    centers: Tensor
    along: Tensor
    approach: Tensor


def hands_at(centers: Tensor, axes: Tensor) -> Hands:
    """Return hands by their poses.

    Args:
        centers: In units of the edge, shape (B, K, 3).
        axes: Rotations of the gripper frame (z approach, y closing), mirrored ones too,
            shape (B, K, 3, 3).
    """
    breadth, approach = axes[..., :2, 0], axes[..., :2, 2]
    longer = breadth.norm(dim=-1) >= approach.norm(dim=-1)
    along = torch.where(longer[..., None], breadth, approach)
    return Hands(centers, nn.functional.normalize(along, dim=-1), axes[..., 2])


def along_things(relief: Relief, hands: Hands) -> Hands:
    """Turn hands along what they grip, and move them across onto its middle.

    Friction lets a hand close up to 45 degrees askew, so its breadth does not tell how
    a tool lies. What stands out near the hand at about its height does: its second
    moments under a bell around the hand, and again under a longer and narrower one
    along the axis found. Of the two ways along the axis, the one with more of the thing
    ahead is taken. Where nothing elongated is seen, hands are left as they are.

    Args:
        relief: Of B scenes.
        hands: K in each.
    """
    size = relief.heights.shape[-1]
    line = (torch.arange(size, device=relief.heights.device) + 0.5) / size
    cells = torch.stack(torch.meshgrid(line, line, indexing="ij"), dim=-1).flatten(0, 1)
    heights = relief.heights.flatten(1)[:, None] / VOXEL  # (B, 1, D * D)
    beyond = (heights - _over_table(relief, hands)[..., None]) / LEVEL_BELL
    mass = (heights - LEAST_HEIGHT).clamp(0, 1) * (-(beyond**2)).exp()  # (B, K, D * D)
    offsets = cells - hands.centers[..., None, :2]  # (B, K, D * D, 2)
    along, middle = hands.along, torch.zeros_like(hands.along)
    found = torch.ones_like(hands.along[..., :1], dtype=torch.bool)
    for length, width in BELLS:
        ahead, beside = _components(offsets - middle[..., None, :], along)
        bell = torch.exp(-((ahead / length) ** 2) - (beside / width) ** 2) * mass
        total = bell.sum(dim=-1, keepdim=True)
        share = bell / total.clamp(min=1e-6)
        there = (share[..., None] * offsets).sum(dim=-2)
        axis, long = _long_axis(offsets - there[..., None, :], share)
        found &= (total > LEAST_MASS) & long[..., None]
        along = torch.where(found, axis, hands.along)
        side = _across(along)
        middle = (there * side).sum(dim=-1, keepdim=True) * side * found
    ahead, _ = _components(offsets - middle[..., None, :], along)
    behind = (bell * ahead).sum(dim=-1, keepdim=True) < 0
    along = torch.where(behind & found, -along, along)
    centers = torch.cat([hands.centers[..., :2] + middle, hands.centers[..., 2:]], -1)
    return Hands(centers, along, hands.approach)


def _long_axis(offsets: Tensor, shares: Tensor) -> tuple[Tensor, Tensor]:
    """Return the axis (..., 2) of most spread, and whether it is a long one (...).

    Args:
        offsets: From the middle of mass, shape (..., N, 2).
        shares: Of the mass, shape (..., N).
    """
    x, y = offsets.unbind(dim=-1)
    xx, yy, xy = ((shares * term).sum(dim=-1) for term in (x * x, y * y, x * y))
    angle = torch.atan2(2 * xy, xx - yy) / 2
    long = torch.hypot(2 * xy, xx - yy) > LEAST_LONG * (xx + yy)
    return torch.stack([angle.cos(), angle.sin()], dim=-1), long


class HandView(nn.Module):
    """Relief and hands in; features, and what each grasp affords by them alone, out.

    Args:
        config: The network's shape; ``hand_view`` is the number of features.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        inputs = CHANNELS
        for level, width in enumerate(WIDTHS):
            layers += _convolution(inputs, width, stride=2 if level else 1)
            if level:
                layers += _convolution(width, width)
            inputs = width
        self.layers = nn.Sequential(*layers)
        self.told = nn.Sequential(
            nn.Linear(3 * inputs + POSE_FEATURES, HIDDEN),
            nn.ReLU(),
            nn.Dropout(0.2),
            nn.Linear(HIDDEN, config.hand_view),
            nn.ReLU(),
        )
        self.classes = nn.Linear(config.hand_view, len(config.affordances))

    def forward(self, relief: Relief, hands: Hands) -> Tensor:
        """Look at the surroundings of hands.

        Args:
            relief: Of B scenes.
            hands: K in each.

        Returns:
            Features, shape (B * K, C).
        """
        turned = along_things(relief, hands)
        x = self.layers(pictures(relief, turned))
        rows, columns = x.shape[2] // 2, x.shape[3] // 2
        middle = x[:, :, rows - 1 : rows + 1, columns - 1 : columns + 1]
        pooled = [x.amax(dim=(2, 3)), x.mean(dim=(2, 3)), middle.mean(dim=(2, 3))]
        poses = _poses(relief, hands, turned)
        told: Tensor = self.told(torch.cat([*pooled, poses], dim=1))
        return told

    def described(self, features: Tensor) -> Tensor:
        """Return what the affordance head is told, (N, ``hand_width``), of (N, C)."""
        return torch.cat([features, self.classes(features).sigmoid()], dim=1)


def pictures(relief: Relief, hands: Hands) -> Tensor:
    """Cut the relief out around hands, along and across ``Hands.along``.

    Args:
        relief: Of B scenes.
        hands: K in each.

    Returns:
        Shape (B * K, CHANNELS, LENGTH, WIDTH): fine and coarse heights over the table,
        those over the hand's middle, and what is seen.
    """
    heights = relief.heights / VOXEL
    maps = torch.stack(
        [
            FINE_SCALE * heights.clamp(*FINE) * relief.seen,
            COARSE_SCALE * heights.clamp(*COARSE) * relief.seen,
            relief.seen,
            heights * relief.seen,
        ],
        dim=1,
    )
    n_scenes, n_hands = hands.along.shape[:2]
    along = hands.along[..., None, None, :]
    across = _across(along)
    u, v = (
        ((torch.arange(n, device=maps.device) - (n - 1) / 2) * CELL).to(maps.dtype)
        for n in (LENGTH, WIDTH)
    )
    where = hands.centers[..., None, None, :2] + u[:, None, None] * along
    where = where + v[:, None] * across  # (B, K, LENGTH, WIDTH, 2)
    read = nn.functional.grid_sample(
        maps,
        (2 * where - 1).flip(-1).flatten(1, 2),
        mode="bilinear",
        padding_mode="zeros",
        align_corners=False,
    )  # (B, 4, K * LENGTH, WIDTH)
    read = read.unflatten(2, (n_hands, LENGTH)).transpose(1, 2)  # (B, K, 4, L, W)
    fine, coarse, seen, over = read.unbind(dim=2)
    middle = _over_table(relief, hands)[..., None, None]
    near = (over - middle * seen).clamp(-NEAR, NEAR) / NEAR
    return torch.stack([fine, coarse, near, seen], dim=2).flatten(0, 1)


def _poses(relief: Relief, hands: Hands, turned: Hands) -> Tensor:
    """Return the hands' poses as the pictures have them, (B * K, POSE_FEATURES)."""
    ahead = (hands.approach[..., :2] * turned.along).sum(dim=-1)
    beside = (hands.approach[..., :2] * _across(turned.along)).sum(dim=-1)
    height = COARSE_SCALE * _over_table(relief, hands)
    askew = (hands.along * turned.along).sum(dim=-1).abs()
    return torch.stack(
        [ahead, beside, hands.approach[..., 2], height, askew], dim=-1
    ).flatten(0, 1)


def _components(offsets: Tensor, along: Tensor) -> tuple[Tensor, Tensor]:
    """Return the parts of offsets (..., N, 2) along and across axes (..., 2)."""
    axes = along[..., None, :], _across(along)[..., None, :]
    ahead, beside = ((offsets * axis).sum(dim=-1) for axis in axes)
    return ahead, beside


def _across(along: Tensor) -> Tensor:
    return torch.stack([-along[..., 1], along[..., 0]], dim=-1)


def _over_table(relief: Relief, hands: Hands) -> Tensor:
    """Return the heights of the hands' middles over the table in [VOXEL], (B, K)."""
    return (hands.centers[..., 2] - relief.levels[:, None]) / VOXEL


def _convolution(inputs: int, outputs: int, stride: int = 1) -> list[nn.Module]:
    return [
        nn.Conv2d(inputs, outputs, 3, stride=stride, padding=1, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(),
    ]
