# SPDX-License-Identifier: Apache-2.0
"""What the planner keeps of a scene, and what little surface is worth."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from diamond import AFFORDING_NETWORK, EDGE, diamond_network

from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.fusion.tsdf import empty_volume
from neugrasp_ros.model import save_network
from neugrasp_ros.pipeline import GraspPlanner


@pytest.fixture(scope="module")
def volume():
    """Seen free above the diamond and nowhere else."""
    nothing = empty_volume(AFFORDING_NETWORK.resolution, EDGE)
    distances = nothing.distances.copy()
    distances[:, :, 20:] = 1.0
    return replace(nothing, distances=distances, view_count=1)


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    path = tmp_path_factory.mktemp("weights") / "diamond.safetensors"
    middle = np.array([0.15, 0.15, 0.09])
    save_network(diamond_network(AFFORDING_NETWORK, middle, 0.04), path)
    return GraspPlanner(PlannerConfig(weights=str(path), gripper="panda", threads=1))


def test_a_grasp_that_meets_little_keeps_its_probability(planner, volume):
    """A thin thing shows a few points; only none at all is worth nothing."""
    scene = planner.encode(volume, revision=1)
    few = planner.sample(scene, seed=3, max_candidates=2)
    evaluator = planner._evaluator
    inputs = evaluator.inputs(scene, few, 0.05)
    inputs = inputs._replace(hits=np.array([0, 1], dtype=np.int32))
    with torch.no_grad():
        quality, _ = evaluator.score(scene, few, inputs)
    assert quality[0] == 0.0 < quality[1]


def test_a_volume_that_came_as_a_message_is_not_encoded_again(planner, volume):
    rounded = replace(volume, voxel_size=float(np.float32(volume.voxel_size)))
    assert rounded.voxel_size != volume.voxel_size
    assert planner.encode(rounded, revision=5) is planner.encode(volume, revision=5)
    other = replace(volume, voxel_size=volume.voxel_size * 1.001)
    assert planner.encode(other, revision=5) is not planner.encode(volume, revision=5)
