# SPDX-License-Identifier: Apache-2.0
"""A network chooses grasps on a diamond that it takes a cube for."""

from types import SimpleNamespace

import numpy as np
import pytest
from diamond import SMALL_NETWORK, diamond_network
from sim_shapes import block_set, box_model, looking_down, standing

from neugrasp_ros.datagen import chosen, labels
from neugrasp_ros.datagen.candidates import SOURCES, CandidateConfig
from neugrasp_ros.datagen.chosen import answers_per_class, choose_some, look_and_choose
from neugrasp_ros.datagen.labels import SceneJob, label_scene
from neugrasp_ros.errors import EmptySceneError
from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.grasp.types import GraspSet
from neugrasp_ros.model import save_network
from sim_bridge.objects.registry import SPLIT_REMAINDERS
from sim_bridge.world import World

GRIPPER = load_gripper("panda")


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    """A network that sees a diamond wherever it looks, and likes some grasps."""
    path = tmp_path_factory.mktemp("weights") / "diamond.safetensors"
    network = diamond_network(SMALL_NETWORK, np.array([0.15, 0.15, 0.09]), 0.04)
    save_network(network, path, {})
    return str(path)


def scored(qualities):
    poses = np.stack([looking_down(0.02 * i, 0.1, 0.1) for i in range(len(qualities))])
    count = len(qualities)
    return GraspSet(poses, np.full(count, 0.08)).with_scores(
        np.array(qualities), np.zeros((count, 0))
    )


def test_most_are_the_best_and_some_are_others_but_none_that_it_calls_bad():
    qualities = [0.9, 0.8, 0.7, *[0.5] * 20, 0.1, 0.05]
    picked = choose_some(scored(qualities), 5, np.random.default_rng(0))
    assert sorted(picked.quality)[::-1] == [0.9, 0.8, 0.7, 0.5, 0.5]
    other = choose_some(scored(qualities), 5, np.random.default_rng(1))
    assert not np.array_equal(picked.poses, other.poses)
    assert len(choose_some(scored([0.1, 0.0]), 5, np.random.default_rng(0))) == 0


def test_first_answers_to_a_class_come_before_better_grasps_that_serve_nothing():
    grasps = scored([0.9, 0.8, 0.5, 0.4, 0.3, 0.3])
    classes = np.zeros((6, 2))
    classes[[2, 3, 4], 0] = 0.5, 0.9, 0.4  # products 0.25, 0.36, 0.12: two are asked
    classes[5, 1] = 0.2  # too unlikely to be asked for
    grasps = grasps.with_scores(grasps.quality, classes)
    assert answers_per_class(grasps, np.arange(6), np.random.default_rng(0)) == [3, 2]
    picked = choose_some(grasps, 5, np.random.default_rng(0))
    assert {0.4, 0.5, 0.9} < set(picked.quality)
    assert len(set(picked.ids)) == 5
    bad = grasps.with_scores(np.full(6, 0.1), classes)
    assert len(choose_some(bad, 5, np.random.default_rng(0))) == 0


def test_more_answers_than_fit_leave_no_class_out_for_good():
    grasps = scored([0.9, 0.8, 0.7, 0.6])
    grasps = grasps.with_scores(grasps.quality, np.eye(4))
    firsts = {
        answers_per_class(grasps, np.arange(4), np.random.default_rng(seed))[0]
        for seed in range(20)
    }
    assert firsts == {0, 1, 2, 3}


def test_grasps_that_are_nearly_the_same_count_once():
    twice = scored([0.9, 0.8])
    twice = GraspSet(twice.poses[[0, 0]], twice.widths).with_scores(
        twice.quality, twice.affordances
    )
    assert choose_some(twice, 5, np.random.default_rng(0)).quality.tolist() == [0.9]


def test_a_network_chooses_in_one_view_where_it_sees_a_surface(weights):
    with World() as world:
        world.load_object(box_model(0.03, 0.03, 0.03), standing(0.03))
        drawn, camera = look_and_choose(
            world, GRIPPER, weights, 8, np.random.default_rng(3)
        )
    assert 0 < len(drawn.poses) <= 8
    assert set(drawn.sources) == {SOURCES.index("chosen")}
    assert (drawn.openings == GRIPPER.max_opening).all() and not drawn.blocked.any()
    assert (np.abs(drawn.poses[:, :3, 3] - [0.15, 0.15, 0.09]).max(axis=1) < 0.09).all()
    assert np.linalg.norm(camera[:3, 3] - [0.15, 0.15, 0.0]) > 0.4


def test_where_it_finds_nothing_good_the_scene_is_refused(weights, monkeypatch):
    monkeypatch.setattr(chosen, "LEAST_QUALITY", 1.1)
    with World() as world, pytest.raises(EmptySceneError, match="nothing to grasp"):
        world.load_object(box_model(0.03, 0.03, 0.03), standing(0.03))
        look_and_choose(world, GRIPPER, weights, 8, np.random.default_rng(3))


def test_a_labelled_scene_keeps_the_view_and_tries_every_grasp(weights, monkeypatch):
    monkeypatch.setitem(SPLIT_REMAINDERS, "train", tuple(range(8)))
    monkeypatch.setattr(
        labels, "run_trials", lambda world, hand, grasps, config: [
            SimpleNamespace(width=0.03, stop_depth=0.0, success=True, reason="",
                            touched=False, object_body=-1, shake_held=None)
            for _ in grasps
        ],
    )  # fmt: skip
    job = SceneJob(
        index=1, seed=2, kind="packed", objects="blocks", split="train",
        gripper="panda", candidates=CandidateConfig(n_trials=6), weights=weights,
    )  # fmt: skip
    result = label_scene(job, {"blocks": block_set()})
    assert result.grasps.tried.all() and 0 < len(result.grasps) <= 6
    assert result.T_task_camera is not None
    assert result.T_task_camera.shape == (4, 4)
