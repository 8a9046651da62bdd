# SPDX-License-Identifier: Apache-2.0
"""Which cubes of a large workspace are encoded depends on where its support is."""

import numpy as np
import pytest
from diamond import AFFORDING_NETWORK, EDGE, diamond_network

from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.fusion.tsdf import TsdfVolume
from neugrasp_ros.model import save_network
from neugrasp_ros.pipeline import GraspPlanner

SIZE = AFFORDING_NETWORK.resolution
LOW, USUAL = 0.0, 0.05  # [m]


@pytest.fixture
def planner(tmp_path) -> GraspPlanner:
    path = tmp_path / "diamond.safetensors"
    network = diamond_network(AFFORDING_NETWORK, np.array([0.15, 0.15, 0.09]), 0.04)
    save_network(network, path, {"made": "by hand"})
    return GraspPlanner(PlannerConfig(weights=str(path), gripper="panda", threads=1))


def flat_thing(length: int) -> TsdfVolume:
    """A volume of so many voxels along x with a thing 4.7 cm high in it."""
    distances = np.ones((length, SIZE, SIZE), dtype=np.float32)
    distances[14:18, 14:18, 1:5] = 0.0
    weights = np.ones_like(distances, np.uint8)
    return TsdfVolume(distances, weights, EDGE / SIZE, 4 * EDGE / SIZE, 1)


def test_a_flat_thing_on_a_low_support_is_encoded(planner):
    wide = flat_thing(53)
    assert not len(planner.encode(wide, 1, support_height=USUAL).corners)
    low = planner.encode(wide, 1, support_height=LOW)
    assert low.corners.tolist() == [[0, 0, 0]]
    assert planner.encode(wide, 1, support_height=LOW) is low
    assert planner.encoder_passes == 2


def test_a_workspace_of_one_cube_is_the_same_above_any_support(planner):
    alone = flat_thing(SIZE)
    scene = planner.encode(alone, 1, support_height=USUAL)
    assert planner.encode(alone, 1, support_height=LOW) is scene
    assert planner.encoder_passes == 1
