# SPDX-License-Identifier: Apache-2.0
"""Hands are turned with the scenes that they are in, and learned from."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from diamond import SMALL_NETWORK
from labelled import SIDE, TOP, labels_of

from neugrasp_ros.config import TrainConfig
from neugrasp_ros.datagen.labels import SceneLabels
from neugrasp_ros.errors import ConfigError, EmptySceneError
from neugrasp_ros.model import GraspNetwork
from neugrasp_ros.training.cache import SceneEntry, save_entry
from neugrasp_ros.training.hands import HandStage, turned_axes, twinned
from neugrasp_ros.training.occupancy import SceneCache, turn_points
from sim_bridge.objects.affordances import AFFORDANCE_NAMES

SIZE = 64
AXES = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0][None]
AXES = AXES.astype(np.float32)
CENTER = np.float32([[0.3, 0.6, 0.4]])


@pytest.mark.parametrize("turn", range(8))
def test_an_axis_points_where_a_turned_point_on_it_is(turn):
    ends = CENTER + 0.1 * AXES[0].T  # one on each axis
    there = turn_points(ends, turn) - turn_points(CENTER, turn)
    np.testing.assert_allclose(there.T, 0.1 * turned_axes(AXES, turn)[0], atol=1e-6)


def test_a_twin_keeps_its_approach():
    many = np.repeat(AXES, 200, axis=0)
    twins = twinned(many, np.random.default_rng(0))
    np.testing.assert_array_equal(twins[..., 2], many[..., 2])
    signs = twins[..., :2] / many[..., :2]
    np.testing.assert_array_equal(signs[..., 0], signs[..., 1])
    assert 60 < (signs[:, 0, 0] < 0).sum() < 140


@pytest.fixture
def scenes(tmp_path) -> SceneCache:
    """Scene 7, in which a bar lies on the table, and 8, which nobody has labelled."""
    volume = np.full((SIZE,) * 3, 127, dtype=np.int8)
    volume[..., :10] = -100
    volume[12:50, 29:34, :14] = -100
    points = np.zeros((5, 3), dtype=np.uint16)
    nothing = np.zeros((0, len(AFFORDANCE_NAMES)), dtype=np.uint8)
    for number in (7, 8):
        entry = SceneEntry(
            volume[None], np.eye(4)[None], points, np.zeros(5, dtype=bool),
            points[:0], nothing, nothing,
        )  # fmt: skip
        save_entry(entry, tmp_path / f"{number:07d}.npz")
    return SceneCache(tmp_path)


@pytest.fixture
def network() -> GraspNetwork:
    torch.manual_seed(0)
    shape = replace(SMALL_NETWORK, affordances=AFFORDANCE_NAMES, context=4, hand_view=8)
    return GraspNetwork(shape).eval()


def labelled(index: int, *hands) -> SceneLabels:
    """Hands that afford the first class where they approach from above."""
    labels = labels_of(*hands, index=index)
    afforded = np.zeros((len(hands), len(AFFORDANCE_NAMES)), dtype=np.uint8)
    afforded[:, 0] = [hand is TOP for hand in hands]
    return replace(labels, grasps=replace(labels.grasps, affordances=afforded))


def test_the_view_along_the_hand_alone_learns_what_is_labelled(scenes, network):
    before = {k: v.clone() for k, v in network.state_dict().items()}
    config = TrainConfig(stage="hands", scenes_per_step=4, learning_rate=1e-2)
    labels = [labelled(7, TOP, SIDE), labelled(9, TOP)]
    stage = HandStage(network, scenes, config, labels)
    chance = stage(0)["hands"].item()
    trained = [p for p in network.parameters() if p.requires_grad]
    optimiser = torch.optim.AdamW(trained, lr=config.learning_rate)
    for step in range(40):
        optimiser.zero_grad()
        stage(step)["hands"].backward()
        optimiser.step()
    assert stage(1000)["hands"].item() < 0.2 * chance
    changed = {k for k, v in network.state_dict().items() if (v != before[k]).any()}
    assert changed
    assert all(key.startswith("hands.") for key in changed)


def test_a_step_is_the_same_whenever_it_is_taken(scenes, network):
    config = TrainConfig(stage="hands", scenes_per_step=4)
    stage = HandStage(network, scenes, config, [labelled(7, TOP, SIDE)])
    network.eval()
    assert stage(3) == stage(3)
    assert stage(3) != stage(4)


def test_a_stage_without_what_it_needs_says_so(scenes, network):
    config = TrainConfig(stage="hands")
    with pytest.raises(EmptySceneError, match="no scene has grasps of labelled"):
        HandStage(network, scenes, config, [labelled(9, TOP)])
    blind = GraspNetwork(replace(network.config, hand_view=0))
    with pytest.raises(ConfigError, match="needs a network with hand_view"):
        HandStage(blind, scenes, config, [labelled(7, TOP)])
