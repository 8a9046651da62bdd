# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
import torch
from labelled import SIDE, TOP, labels_of

from neugrasp_ros.config import TrainConfig
from neugrasp_ros.errors import ConfigError, EmptySceneError
from neugrasp_ros.model import GraspNetwork
from neugrasp_ros.training.batches import GraspCache
from neugrasp_ros.training.cache import POINT_SCALE, SceneEntry, save_entry
from neugrasp_ros.training.context import ContextStage, moved_volume, turned_entry
from neugrasp_ros.training.grasps import NOT_KNOWN, save_grasps
from neugrasp_ros.training.loop import optimise
from neugrasp_ros.training.occupancy import SceneCache
from neugrasp_ros.training.quality import predict
from neugrasp_ros.training.views import UNKNOWN
from test.grasp_entries import CLASSES, NETWORK, SIZE, grasp_entry

CONFIG = TrainConfig(
    stage="context",
    steps=120,
    scenes_per_step=4,
    grasps_per_scene=8,
    learning_rate=1e-2,
    w_affordance=0.1,
)


def half_volume(seed: int) -> np.ndarray:
    """Something on one side of a plane that is square to x or y, free on the other.

    Of even seeds it is deeper inside.
    """
    rng = np.random.default_rng(seed)
    volume = np.full((SIZE,) * 3, 127, dtype=np.int8)
    volume[: int(rng.integers(6, 10))] = -20 if seed % 2 else -100
    return np.rot90(volume, int(rng.integers(4)), axes=(0, 1)).copy()


def parts_of(volume: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The first class where something is, the second where nothing is."""
    cells = (points.astype(float) / POINT_SCALE * SIZE).astype(int).clip(0, SIZE - 1)
    there = volume[tuple(cells.T)] < 0
    return np.stack([there, ~there, np.zeros(len(there))], axis=1).astype(np.uint8)


@pytest.fixture
def caches(tmp_path) -> tuple[GraspCache, SceneCache]:
    rng = np.random.default_rng(0)
    grasps, scenes = tmp_path / "grasps", tmp_path / "scenes"
    grasps.mkdir()
    scenes.mkdir()
    for number in range(4):
        volume = half_volume(number)
        entry = replace(grasp_entry(number), volume=volume)
        classes = parts_of(volume, entry.local_points)
        save_grasps(replace(entry, local_classes=classes), grasps / f"{number}.npz")
        points = rng.integers(0, int(POINT_SCALE), (200, 3)).astype(np.uint16)
        scene = SceneEntry(
            volume[None],
            np.eye(4)[None],
            points[:5],
            np.zeros(5, dtype=bool),
            points,
            parts_of(volume, points),
            np.tile(np.uint8([1, 0, number % 2]), (len(points), 1)),
        )
        save_entry(scene, scenes / f"{number}.npz")
    return GraspCache(grasps), SceneCache(scenes)


@pytest.fixture
def network() -> GraspNetwork:
    torch.manual_seed(0)
    return GraspNetwork(replace(NETWORK, context=4, thing_head=True)).eval()


@pytest.mark.slow
def test_parts_are_learned_and_quality_stays(caches, network, tmp_path):
    before = {k: v.clone() for k, v in network.state_dict().items()}
    quality = predict(network, caches[0].entries).quality
    stage = ContextStage(network, *caches, CONFIG)
    chance = stage(10**6)
    optimise(network, stage, CONFIG, tmp_path / "run")
    learned = stage(10**6)
    assert learned["parts"].item() < 0.5 * chance["parts"].item()
    blind = np.log(2) / 3  # two classes are constant, the third is not
    assert learned["things"].item() < 0.5 * blind
    changed = {
        key for key, now in network.state_dict().items() if (now != before[key]).any()
    }
    assert changed
    assert all(k.startswith(("context.", "detector.affordance.")) for k in changed)
    after = predict(network.eval(), caches[0].entries).quality
    np.testing.assert_array_equal(after, quality)


def test_a_step_is_the_same_whenever_it_is_taken(caches, network):
    stage = ContextStage(network, *caches, CONFIG)
    network.eval()
    assert stage(3) == stage(3)
    assert stage(3) != stage(4)


def test_things_are_not_asked_for_without_their_head(caches):
    torch.manual_seed(0)
    network = GraspNetwork(replace(NETWORK, context=4)).eval()
    assert set(ContextStage(network, *caches, CONFIG)(0)) == {"affordance", "parts"}
    with pytest.raises(ConfigError, match="has no thing_head"):
        network.context.thing_logits(torch.zeros(1, 2, 4), torch.zeros(1, 2, 3))


def test_hands_are_learned_without_their_local_surfaces(caches):
    torch.manual_seed(0)
    network = GraspNetwork(replace(NETWORK, context=4, hand_view=4)).eval()
    stage = ContextStage(network, *caches, CONFIG, [afforded_scene(0)])
    losses = stage(0)
    assert losses["hands"].item() > 0
    sum(losses.values()).backward()
    assert network.hands.told[0].weight.grad.abs().max() > 0
    with pytest.raises(EmptySceneError, match="no scene has grasps of labelled"):
        ContextStage(network, *caches, CONFIG, [afforded_scene(100)])


def afforded_scene(index: int):
    labels = labels_of(TOP, SIDE, index=index)
    afforded = np.zeros((2, len(CLASSES)), dtype=np.uint8)
    afforded[:, 2] = 1
    return replace(labels, grasps=replace(labels.grasps, affordances=afforded))


def test_what_is_not_labelled_is_left_out(caches, network):
    grasps, scenes = caches
    unknown = np.full((12, len(CLASSES)), NOT_KNOWN, dtype=np.uint8)
    grasps.entries[1:] = [replace(e, affordances=unknown) for e in grasps.entries[1:]]
    ContextStage(network, grasps, scenes, CONFIG)
    grasps.entries[:1] = []
    with pytest.raises(EmptySceneError, match="no scene has grasps or points"):
        ContextStage(network, grasps, scenes, CONFIG)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({}, "needs a network with context"),
        ({"context": 4, "local_view": "grid"}, "needs local_view 'rendered', got 'gr"),
    ],
)
def test_a_network_that_cannot_learn_it_is_refused(caches, change, complaint):
    with pytest.raises(ConfigError, match=complaint):
        ContextStage(GraspNetwork(replace(NETWORK, **change)), *caches, CONFIG)


@pytest.mark.parametrize("turn", range(8))
def test_points_go_where_their_voxels_go(turn):
    entry = grasp_entry(0)
    volume = np.full((SIZE,) * 3, 127, dtype=np.int8)
    cell = np.array([5, 9, 3])
    volume[tuple(cell)] = 7
    middle = np.round((cell + 0.5) / SIZE * POINT_SCALE).astype(np.uint16)
    points = np.broadcast_to(middle, entry.points.shape)
    entry = replace(entry, volume=volume, points=points, local_points=points[0])
    shift = np.array([2, -3])
    turned = turned_entry(entry, turn, shift)
    (there,) = np.argwhere(turned.volume == 7)
    expected = (there + 0.5) / SIZE
    for found in (turned.points[0, 0], turned.local_points[0]):
        np.testing.assert_allclose(found / POINT_SCALE, expected, atol=1e-4)


def test_what_comes_in_was_never_observed():
    volume = np.full((4, 4, 4), 9, dtype=np.int8)
    moved = moved_volume(volume, np.array([1, -2]))
    assert (moved[0] == UNKNOWN).all()
    assert (moved[:, 2:] == UNKNOWN).all()
    assert (moved[1:, :2] == 9).all()
