# SPDX-License-Identifier: Apache-2.0
"""Volumes in, three feature planes out.

Conventions of all planes: plane 0 drops x, plane 1 drops y, plane 2 drops z. A plane
tensor is indexed [second kept axis, first kept axis], so that ``grid_sample`` takes
the coordinates in the order (first, second). Cell i of R covers [i / R, (i + 1) / R) of
the cube, in the encoder as in the sampling (``align_corners=False``).
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.errors import ConfigError
from neugrasp_ros.registry import Registry
from neugrasp_ros.scene.unet import UNETS

ENCODERS: Registry[type[nn.Module]] = Registry("encoder")

INPUT_CHANNELS = 3
KEPT_AXES = ((1, 2), (0, 2), (0, 1))  # of planes 0, 1, 2; x, y, z = 0, 1, 2
FREE_ABOVE = 0.99  # [truncation]; observed and at least this far in front of a surface


def volume_channels(distances: NDArray[np.float32]) -> NDArray[np.float32]:
    """Separate what was seen near a surface, seen free, and never seen.

    Args:
        distances: Distances in units of truncation, NaN = never observed, shape
            (..., X, Y, Z).

    Returns:
        Channels (..., 3, X, Y, Z): the distance where observed and 0 elsewhere;
        1 where observed free; 1 where never observed.
    """
    unknown = np.isnan(distances)
    known = np.where(unknown, np.float32(0), distances)
    free = known >= FREE_ABOVE
    signed = np.where(free, np.float32(0), known)
    return np.stack([signed, free, unknown], axis=-4).astype(np.float32)


def _check_sizes(config: NetworkConfig) -> None:
    if config.resolution % config.plane_resolution:
        raise ConfigError(
            f"plane_resolution must divide resolution {config.resolution}, "
            f"got {config.plane_resolution}"
        )
    coarsest = 2 ** (config.unet_depth - 1)
    if config.plane_resolution % coarsest:
        raise ConfigError(
            f"plane_resolution must be a multiple of {coarsest} for a U-Net of "
            f"unet_depth {config.unet_depth}, got {config.plane_resolution}"
        )


@ENCODERS.register("voxel")
class VoxelEncoder(nn.Module):
    """Volume to planes to one shared U-Net (method sheet, c2).

    The ``conv3d`` stem is the paper's: a 3x3x3 convolution and the mean over the
    dropped axis. The ``axis`` stem treats the dropped axis as channels of a strided
    two-dimensional convolution: it sees the whole column at once, at a tenth of the
    cost (learning sheet, 3).

    Args:
        config: The network's shape.

    Raises:
        ConfigError: If the planes do not divide the volume, or the U-Net's levels do
            not divide the planes.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        _check_sizes(config)
        channels = config.channels
        if config.stem == "conv3d":
            self.stem: nn.Module = nn.Conv3d(INPUT_CHANNELS, channels, 3, padding=1)
        else:
            stride = config.resolution // config.plane_resolution
            columns = INPUT_CHANNELS * config.resolution
            self.stem = nn.ModuleList(
                nn.Conv2d(columns, channels, stride, stride=stride) for _ in KEPT_AXES
            )
        self.unet = UNETS[config.unet](
            channels, config.unet_depth, config.unet_channels
        )

    def forward(self, volume: Tensor) -> Tensor:
        """Encode volumes.

        Args:
            volume: Channels of ``volume_channels``, shape (B, 3, D, D, D).

        Returns:
            Feature planes, shape (B, 3, C, R, R).
        """
        planes = self._project(volume)  # (B, 3, C, R, R)
        batch = planes.shape[0]
        return self.unet(planes.flatten(0, 1)).unflatten(0, (batch, 3))

    def _project(self, volume: Tensor) -> Tensor:
        if isinstance(self.stem, nn.ModuleList):
            planes = []
            for dropped, conv in enumerate(self.stem):
                first, second = KEPT_AXES[dropped]
                order = (0, 1, 2 + dropped, 2 + second, 2 + first)
                planes.append(conv(volume.permute(order).flatten(1, 2)))
            return torch.relu(torch.stack(planes, dim=1))
        cells = torch.relu(self.stem(volume))  # (B, C, D, D, D)
        planes = [cells.mean(dim=2 + dropped).transpose(-1, -2) for dropped in range(3)]
        stacked = torch.stack(planes, dim=1)
        size = self.config.plane_resolution
        if stacked.shape[-1] == size:
            return stacked
        flat = nn.functional.adaptive_avg_pool2d(stacked.flatten(0, 1), size)
        return flat.unflatten(0, stacked.shape[:2])


def sample_planes(planes: Tensor, points: Tensor) -> Tensor:
    """Read features at points, bilinearly on each plane.

    Args:
        planes: Feature planes, shape (B, 3, C, R, R).
        points: Points in units of the cube's edge, [0, 1], shape (B, N, 3); beyond it
            the border's feature is read.

    Returns:
        Concatenated features, shape (B, N, 3 * C).
    """
    batch, _, channels = planes.shape[:3]
    coordinates = 2.0 * points - 1.0
    kept = torch.stack([coordinates[..., list(axes)] for axes in KEPT_AXES], dim=1)
    read = nn.functional.grid_sample(
        planes.flatten(0, 1),
        kept.flatten(0, 1).unsqueeze(2),
        mode="bilinear",
        padding_mode="border",
        align_corners=False,
    )  # (B * 3, C, N, 1)
    return read.reshape(batch, 3 * channels, -1).transpose(1, 2)
