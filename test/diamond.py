# SPDX-License-Identifier: Apache-2.0
"""A network whose completed scene is known: a diamond, whatever was seen.

Its decoder's weights are set by hand, ``logit = slope * (radius - |p - center|_1)``;
encoder and detector keep random weights.
"""

import numpy as np
import torch

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.model import GraspNetwork

EDGE = 0.3  # [m]
SLOPE = 200.0  # [logit/m]
SMALL_NETWORK = NetworkConfig(
    plane_resolution=8,
    channels=4,
    unet_depth=1,
    unet_channels=4,
    occupancy_hidden=8,
    occupancy_blocks=1,
    local_points=64,
    pointnet_width=8,
    pointnet_out=16,
)

AFFORDING_NETWORK = NetworkConfig(
    resolution=32,
    plane_resolution=8,
    channels=4,
    unet_depth=2,
    unet_channels=4,
    occupancy_hidden=8,
    occupancy_blocks=1,
    local_points=32,
    pointnet_width=8,
    pointnet_out=16,
    affordances=("cut", "pour"),
)


@torch.no_grad()
def diamond_network(
    config: NetworkConfig, center: np.ndarray, radius: float
) -> GraspNetwork:
    """Build the network; ``config`` needs one block and eight hidden units."""
    torch.manual_seed(0)
    network = GraspNetwork(config).eval()
    decoder = network.scene.decoder
    for part in (decoder.position, decoder.injections[0], decoder.logit):
        part.weight.zero_()
        part.bias.zero_()
    decoder.blocks[0].fc1.bias.zero_()
    middle = torch.from_numpy(center / EDGE - 0.5).float()
    for axis in range(3):
        for row, sign in ((2 * axis, 1.0), (2 * axis + 1, -1.0)):
            decoder.position.weight[row, axis] = sign
            decoder.position.bias[row] = -sign * middle[axis]
    decoder.logit.weight[0, :6] = -SLOPE * EDGE
    decoder.logit.bias[0] = SLOPE * radius
    return network
