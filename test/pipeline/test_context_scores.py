# SPDX-License-Identifier: Apache-2.0
"""What stands around a grasp reaches the affordances, and nothing else."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch
from diamond import AFFORDING_NETWORK, EDGE, diamond_network

from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.fusion.tsdf import empty_volume
from neugrasp_ros.geometry.transform import canonical_gripper, flip_gripper
from neugrasp_ros.model import save_network
from neugrasp_ros.pipeline import GraspPlanner
from neugrasp_ros.pipeline.scoring import Scorer
from neugrasp_ros.scene.encoder import volume_channels
from neugrasp_ros.scene.hand_view import hands_at
from neugrasp_ros.scene.heights import relief_of

CONTEXT_NETWORK = replace(AFFORDING_NETWORK, context=4, hand_view=4)
SIZE = CONTEXT_NETWORK.resolution


@pytest.fixture(scope="module")
def network():
    return diamond_network(CONTEXT_NETWORK, np.array([0.15, 0.15, 0.09]), 0.04)


@pytest.fixture(scope="module")
def planner(network, tmp_path_factory):
    path = tmp_path_factory.mktemp("weights") / "context.safetensors"
    save_network(network, path)
    return GraspPlanner(PlannerConfig(weights=str(path), gripper="panda", threads=1))


def seen_volume(length: int = SIZE):
    """Seen free above the diamond; something stands at either end."""
    nothing = empty_volume((length, SIZE, SIZE), EDGE * length / SIZE)
    distances = nothing.distances.copy()
    distances[:, :, 20:] = 1.0
    for end in (slice(1, 8), slice(length - 8, length - 1)):
        distances[end, 2:30, 6:20] = -0.4
    return replace(nothing, distances=distances, view_count=1)


@pytest.mark.parametrize("length", [SIZE, SIZE + 16])
def test_distinct_points_are_told_what_all_are(network, planner, length):
    scene = planner.encode(seen_volume(length), revision=length)
    assert len(scene.corners) == (1 if length == SIZE else 2)
    grasps = planner.sample(scene, seed=3, max_candidates=12)
    inputs = planner._evaluator.inputs(scene, grasps, 0.05)
    cubes = scene.cubes_of(grasps.poses[:, :3, 3])
    scorer = Scorer(network, threads=2)
    with torch.no_grad():
        hands = scorer._hands_told(scene, grasps.poses, cubes)
        some = scorer._score_runs(scene, inputs, cubes, hands)
        every = scorer._score(scene, inputs, cubes, hands)
    for one, other in zip(some, every, strict=True):
        torch.testing.assert_close(one, other, atol=1e-4, rtol=1e-4)
    assert some[1].std() > 1e-3


@torch.no_grad()
def test_points_are_told_what_the_network_itself_tells(network, planner):
    scene = planner.encode(seen_volume(), revision=1)
    scorer = Scorer(network)
    scorer.prepare(scene)
    rng = np.random.default_rng(0)
    points = rng.uniform(0, EDGE, (50, 3)).astype(np.float32)
    told = scorer._context_at(scene, points, np.zeros(50, dtype=np.int64))
    volume = torch.from_numpy(volume_channels(scene.volume.distances))[None]
    where = torch.from_numpy(points / np.float32(EDGE))[None]
    expected = network.context.read(network.context(volume), where)[0]
    torch.testing.assert_close(told, expected, atol=1e-4, rtol=1e-4)


@torch.no_grad()
def test_hands_are_told_what_the_network_itself_tells(network, planner):
    scene = planner.encode(seen_volume(), revision=1)
    grasps = planner.sample(scene, seed=3, max_candidates=6)
    cubes = np.zeros(len(grasps), dtype=np.int64)
    told = Scorer(network)._hands_told(scene, grasps.poses, cubes)
    twins = Scorer(network)._hands_told(scene, flip_gripper(grasps.poses), cubes)
    torch.testing.assert_close(told, twins, atol=1e-5, rtol=1e-4)
    volume = torch.from_numpy(volume_channels(scene.volume.distances))[None]
    poses = torch.from_numpy(canonical_gripper(grasps.poses).astype(np.float32))[None]
    hands = hands_at(poses[..., :3, 3] / EDGE, poses[..., :3, :3])
    seen = network.hands(relief_of(volume), hands)
    expected = network.hands.described(seen)
    torch.testing.assert_close(told, expected, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("part", ["context.last", "hands.classes"])
def test_context_changes_what_a_grasp_affords_and_not_whether_it_holds(
    network, planner, part
):
    scene = planner.encode(seen_volume(), revision=1)
    grasps = planner.sample(scene, seed=3, max_candidates=6)
    inputs = planner._evaluator.inputs(scene, grasps, 0.05)
    cubes = scene.cubes_of(grasps.poses[:, :3, 3])
    other = copy.deepcopy(network)
    with torch.no_grad():
        other.get_submodule(part).bias.add_(1.0)
        (held, first), (still_held, second) = (
            Scorer(n)(scene, grasps.poses, inputs, cubes) for n in (network, other)
        )
    np.testing.assert_array_equal(held, still_held)
    assert np.abs(first - second).min() > 1e-6
