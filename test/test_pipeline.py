# SPDX-License-Identifier: Apache-2.0
"""The planner on a scene known in closed form: a network that completes a diamond."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import torch
from diamond import AFFORDING_NETWORK, EDGE, SLOPE, diamond_network
from field_shapes import hand_at

from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.errors import (
    CheckpointError,
    ConfigError,
    EmptySceneError,
    RevisionError,
    ShapeError,
    UnknownNameError,
)
from neugrasp_ros.fusion.tsdf import TsdfVolume, empty_volume
from neugrasp_ros.geometry.transform import flip_gripper
from neugrasp_ros.grasp.types import GraspSet
from neugrasp_ros.model import file_sha256, save_network
from neugrasp_ros.pipeline import GraspPlanner
from neugrasp_ros.pipeline.scoring import BATCH
from neugrasp_ros.scene.workers import torch_threads

SIZE = AFFORDING_NETWORK.resolution
CENTER, RADIUS = np.array([0.15, 0.15, 0.09]), 0.04  # [m]


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    path = tmp_path_factory.mktemp("weights") / "diamond.safetensors"
    save_network(
        diamond_network(AFFORDING_NETWORK, CENTER, RADIUS), path, {"made": "by hand"}
    )
    return path


def planner_of(path, **changes) -> GraspPlanner:
    return GraspPlanner(
        PlannerConfig(weights=str(path), gripper="panda", threads=1, **changes)
    )


@pytest.fixture(scope="module")
def planner(weights) -> GraspPlanner:
    return planner_of(weights)


@pytest.fixture
def fresh(weights) -> GraspPlanner:
    return planner_of(weights)


def seen_volume(floor: int = 20) -> TsdfVolume:
    """A volume seen free above the diamond and nowhere else."""
    volume = empty_volume(SIZE, EDGE)
    distances = volume.distances.copy()
    distances[:, :, floor:] = 1.0
    return replace(volume, distances=distances, view_count=1)


@pytest.fixture(scope="module")
def scene(planner):
    return planner.encode(seen_volume(), revision=1)


@pytest.fixture(scope="module")
def candidates(planner, scene):
    return planner.sample(scene, seed=3, max_candidates=24)


def test_the_field_is_the_networks(scene):
    points = np.random.default_rng(0).uniform(0.1, 0.18, (200, 3)) * [1, 1, 0.8]
    truth = SLOPE * (RADIUS - np.abs(points - CENTER).sum(axis=1))
    found = scene.field.sample(points)
    clear = np.abs(truth) > 2.5  # kinks of a diamond are rounded by interpolation
    assert ((found > 0) == (truth > 0))[clear].all()
    assert (found > 0).any()
    assert 0 < scene.queries < SIZE**3


def test_a_revision_is_encoded_once(fresh):
    volume = seen_volume()
    first = fresh.encode(volume, revision=5)
    assert fresh.encode(volume, revision=5) is first
    assert fresh.encode(seen_volume(), revision=5) is first  # equal, not the same
    assert fresh.encoder_passes == 1
    assert fresh.encode(volume, revision=6) is not first
    assert fresh.encoder_passes == 2


def test_another_volume_under_an_old_number_is_not_taken_for_the_old_one(fresh):
    first = fresh.encode(seen_volume(), revision=5)
    second = fresh.encode(seen_volume(floor=24), revision=5)
    assert second is not first
    assert fresh.encoder_passes == 2


def test_threads_that_ask_at_once_share_one_pass(fresh):
    volume = seen_volume()
    with ThreadPoolExecutor(4) as pool:
        scenes = list(pool.map(lambda _: fresh.encode(volume, 1), range(8)))
    assert fresh.encoder_passes == 1
    assert all(scene is scenes[0] for scene in scenes)


def test_the_rendered_surface_is_the_diamonds(planner, scene):
    surface = planner.render(scene)
    offsets = surface.points - CENTER
    assert len(surface.points) > 60
    assert np.abs(np.abs(offsets).sum(axis=1) - RADIUS).max() < 0.012
    assert np.median(np.abs(np.abs(offsets).sum(axis=1) - RADIUS)) < 0.004
    outward = np.einsum("ij,ij->i", offsets, surface.normals)
    assert (outward > 0).mean() > 0.99
    assert planner.render(scene) is surface


def test_candidates_follow_the_seed(planner, scene, candidates):
    again = planner.sample(scene, seed=3, max_candidates=24)
    other = planner.sample(scene, seed=4, max_candidates=24)
    assert 0 < len(candidates) <= 24
    np.testing.assert_array_equal(again.poses, candidates.poses)
    assert not np.array_equal(other.poses[:4], candidates.poses[:4])
    assert np.isnan(candidates.quality).all()


def test_a_region_of_interest_holds_all_tcps(planner, scene):
    low, high = np.array([0.15, 0.0, 0.0]), np.array([0.3, 0.3, 0.3])
    grasps = planner.sample(scene, seed=3, roi=(low, high))
    everywhere = planner.sample(scene, seed=3)
    assert 0 < len(grasps) < len(everywhere)
    assert (grasps.poses[:, 0, 3] >= 0.15).all()


def test_scores_keep_the_order_and_names_of_the_grasps(planner, scene, candidates):
    scored = planner.evaluate(scene, candidates)
    assert scored.ids == candidates.ids
    np.testing.assert_array_equal(scored.poses, candidates.poses)
    assert ((scored.quality >= 0) & (scored.quality <= 1)).all()
    assert scored.affordances.shape == (len(candidates), 2)
    assert planner.affordances == ("cut", "pour")


def test_a_score_does_not_depend_on_the_others(planner, scene, candidates):
    together = planner.evaluate(scene, candidates)
    rows = np.array([2, 0])
    alone = planner.evaluate(scene, candidates.take(rows))
    np.testing.assert_allclose(alone.quality, together.quality[rows], atol=1e-6)


def test_more_grasps_than_a_batch_are_all_scored(planner, scene, candidates):
    rows = np.arange(150) % len(candidates)
    many = GraspSet(candidates.poses[rows], candidates.widths[rows])
    quality = planner.evaluate(scene, many).quality
    once = planner.evaluate(scene, candidates).quality
    np.testing.assert_allclose(quality, once[rows], atol=1e-6)


def test_a_grasp_and_its_twin_have_one_score(planner, scene, candidates):
    twins = replace(candidates, poses=flip_gripper(candidates.poses))
    one, other = planner.evaluate(scene, candidates), planner.evaluate(scene, twins)
    np.testing.assert_array_equal(one.quality, other.quality)
    np.testing.assert_array_equal(one.affordances, other.affordances)


def test_a_grasp_that_closes_on_nothing_is_worth_nothing(planner, scene):
    astray = hand_at(np.array([0.06, 0.06, 0.2]), [0, 0, -1], [0, 1, 0])[None]
    scored = planner.evaluate(scene, GraspSet(astray, np.array([0.08])))
    assert scored.quality.tolist() == [0.0]


def test_no_grasps_have_no_scores(planner, scene):
    scored = planner.evaluate(scene, GraspSet(np.zeros((0, 4, 4)), np.zeros(0)))
    assert len(scored) == 0
    assert scored.affordances.shape == (0, 2)


def test_grasps_of_another_revision_are_rejected(planner, scene, candidates):
    planner.evaluate(scene, candidates, revision=1)
    with pytest.raises(RevisionError, match="revision 7, but the scene.*revision 1"):
        planner.evaluate(scene, candidates, revision=7)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_poses_and_widths_must_be_finite(planner, scene, candidates, value):
    poses = candidates.poses.copy()
    poses[1, 0, 3] = value
    widths = candidates.widths.copy()
    widths[0] = value
    for spoilt in (
        replace(candidates, poses=poses),
        replace(candidates, widths=widths),
    ):
        with pytest.raises(ConfigError, match="not a finite number"):
            planner.evaluate(scene, spoilt)


def test_a_scene_without_surface_has_no_candidates(tmp_path):
    path = tmp_path / "nothing.safetensors"
    save_network(diamond_network(AFFORDING_NETWORK, CENTER, -0.1), path)
    planner = planner_of(path)
    scene = planner.encode(seen_volume(), revision=1)
    assert len(planner.render(scene).points) == 0
    grasps = planner.sample(scene)
    assert len(grasps) == 0
    assert len(planner.evaluate(scene, grasps)) == 0


def test_nothing_observed_is_an_error(fresh):
    with pytest.raises(EmptySceneError, match="no voxel .* ever observed"):
        fresh.encode(empty_volume(SIZE, EDGE), revision=1)
    assert fresh.encoder_passes == 0


def test_another_resolution_is_rejected_with_the_right_one(fresh):
    assert fresh.resolution == SIZE
    with pytest.raises(ShapeError, match=r"0.3 m cube; voxel_size 0.004687"):
        fresh.encode(empty_volume(64, EDGE), revision=1)


def test_pads_touch_the_completed_surface(planner, scene, candidates):
    contacts = planner.contacts(scene, candidates)
    assert contacts.shape == (len(candidates), 2, 3)
    known = np.isfinite(contacts).all(axis=(1, 2))
    assert known.mean() > 0.8
    touched = np.abs(contacts[known] - CENTER).sum(axis=-1)
    assert np.abs(touched - RADIUS).max() < 2 * EDGE / SIZE
    across = contacts[known, 0] - contacts[known, 1]
    closing = candidates.poses[known, :3, 1]
    assert (np.einsum("gi,gi->g", across, closing) > 0).all()


def test_stages_are_timed(planner, scene, candidates):
    poses = candidates.poses.copy()
    poses[:, 2, 3] += 1e-5  # not scored yet
    planner.evaluate(scene, replace(candidates, poses=poses))
    stages = {"encoding", "rendering", "sampling", "local_rendering", "quality"}
    assert set(planner.timings) == stages
    assert all(seconds > 0 for seconds in planner.timings.values())


def test_the_weights_are_told(planner, weights):
    assert planner.card == {"made": "by hand"}
    assert planner.weights_sha256 == file_sha256(weights)


def test_a_planner_needs_its_weights_and_gripper(weights, tmp_path):
    with pytest.raises(CheckpointError, match="no such weights file"):
        planner_of(tmp_path / "none.safetensors")
    with pytest.raises(UnknownNameError, match="gripper 'hook'"):
        GraspPlanner(PlannerConfig(weights=str(weights), gripper="hook"))


def test_a_region_gets_as_many_candidates_as_asked_for(planner, scene):
    low, high = np.array([0.15, 0.0, 0.0]), np.array([0.3, 0.3, 0.3])
    few = planner.sample(scene, seed=3, max_candidates=4)
    there = planner.sample(scene, seed=3, max_candidates=4, roi=(low, high))
    assert (few.poses[:, 0, 3] < 0.15).any()
    assert len(there) == 4


def test_a_grasp_of_the_same_scene_is_scored_once(fresh):
    scene = fresh.encode(seen_volume(), revision=1)
    grasps = fresh.sample(scene, seed=3, max_candidates=24)
    first = fresh.evaluate(scene, grasps)
    assert fresh.timings["quality"] > 0
    again = fresh.evaluate(scene, grasps.take(np.array([5, 2])))
    assert fresh.timings["quality"] == 0
    np.testing.assert_array_equal(again.quality, first.quality[[5, 2]])
    higher = fresh.evaluate(scene, grasps, support_height=0.02)
    assert fresh.timings["quality"] > 0  # the support is part of what is scored
    assert not np.array_equal(higher.quality, first.quality)


def test_a_spent_budget_gives_the_best_so_far(fresh):
    decision = fresh.decide(seen_volume(), 1, time_budget=1e-6, seed=3)
    whole = fresh.decide(seen_volume(), 2, seed=3)
    assert decision.budget_spent
    assert not whole.budget_spent
    assert 16 <= len(decision.grasps) <= BATCH  # one batch of the one thread
    assert len(whole.grasps) == whole.sampled == decision.sampled > 2 * BATCH
    assert (np.diff(whole.grasps.quality) <= 0).all()
    assert set(whole.seconds) == {
        "encoding", "rendering", "sampling", "local_rendering", "quality"
    }  # fmt: skip


def test_two_threads_find_and_score_what_one_does(weights, fresh):
    two = GraspPlanner(replace(fresh.config, threads=2))
    one, other = (p.decide(seen_volume(), 1, seed=3) for p in (fresh, two))
    assert one.sampled == other.sampled > 2 * BATCH
    rows = [np.lexsort(d.grasps.poses[:, :3, 3].T) for d in (one, other)]
    first, second = (d.grasps.take(r) for d, r in zip((one, other), rows, strict=True))
    np.testing.assert_allclose(first.poses, second.poses, atol=1e-9)
    np.testing.assert_allclose(first.quality, second.quality, atol=1e-6)
    np.testing.assert_allclose(first.affordances, second.affordances, atol=1e-6)
    assert first.quality.std() > 1e-4  # a network that learned nothing
    assert other.seconds["local_rendering"] > 0
    assert other.seconds["quality"] > 0


def test_each_of_two_threads_has_one_batch_where_the_budget_is_spent(weights, fresh):
    two = GraspPlanner(replace(fresh.config, threads=2))
    decision = two.decide(seen_volume(), 1, time_budget=1e-6, seed=3)
    assert decision.budget_spent
    assert BATCH < len(decision.grasps) <= 2 * BATCH


def test_networks_compute_with_one_thread_of_torch_each(weights, monkeypatch):
    seen = {}

    def noted(name, method):
        def call(*args):
            seen[name] = torch.get_num_threads()
            return method(*args)

        return call

    planner = planner_of(weights)
    planner._network.scene.encoder.unet.register_forward_hook(
        noted("encoder", lambda *_: None)
    )
    scorer = planner._evaluator._scorer
    monkeypatch.setattr(scorer, "prepare", noted("prepare", scorer.prepare))
    monkeypatch.setattr(scorer, "_score_runs", noted("score", scorer._score_runs))
    with torch_threads(3):
        planner.decide(seen_volume(), 1, seed=3, max_candidates=4)
        assert torch.get_num_threads() == 3
    assert seen == {"encoder": 1, "prepare": 1, "score": 1}


def test_a_planner_made_while_another_works_has_all_threads(weights, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    with torch_threads(1):
        planner = GraspPlanner(PlannerConfig(weights=str(weights), gripper="panda"))
    assert planner._threads == 3


@pytest.mark.slow
def test_the_reference_finds_the_same_surface_and_scores(weights, fresh):
    reference = planner_of(weights, renderer="reference")
    fast, slow = (p.encode(seen_volume(), revision=1) for p in (fresh, reference))
    assert slow.queries == (2 * SIZE) ** 3
    truth = reference.render(slow)
    off = np.abs(np.abs(truth.points - CENTER).sum(axis=1) - RADIUS)
    assert len(truth.points) > 30
    assert off.max() < 1e-3
    surface = fresh.render(fast)
    apart = np.linalg.norm(truth.points[:, None] - surface.points, axis=2).min(axis=1)
    assert apart.max() < 0.009  # one point per 5 mm cell in either
    grasps = fresh.sample(fast, seed=3, max_candidates=4)
    gap = (
        reference.evaluate(slow, grasps).quality - fresh.evaluate(fast, grasps).quality
    )
    assert np.abs(gap).max() < 0.1


def test_a_large_workspace_gives_what_its_cubes_give(weights, fresh):
    """The diamond stands in the middle of each cube; two cubes are 20 cm apart."""
    single = seen_volume()
    wide = np.full((53, SIZE, SIZE), np.nan, dtype=np.float32)
    wide[:, :, 20:] = 1.0
    wide[14:18, 14:18, 10:14] = 0.0  # something is seen where both cubes are busy
    wide[35:39, 14:18, 10:14] = 0.0
    weight = np.isfinite(wide).astype(np.uint8)
    volume = replace(single, distances=wide, weights=weight)
    scene = fresh.encode(volume, revision=1)
    assert scene.corners.tolist() == [[0, 0, 0], [21, 0, 0]]
    assert fresh.encoder_passes == 1
    alone = fresh.encode(single, revision=2)
    near = np.array([[0.15, 0.15, 0.09], [0.13, 0.16, 0.09]])
    there = near + [21 * EDGE / SIZE, 0, 0]
    expected = alone.field.sample(near)
    np.testing.assert_allclose(scene.field.sample(near), expected, atol=0.05)
    np.testing.assert_allclose(scene.field.sample(there), expected, atol=0.05)
    grasps = fresh.sample(scene, seed=3)
    places = grasps.poses[:, 0, 3]
    assert (places < 0.2).sum() > 5
    assert (places > 0.3).sum() > 5
    quality = fresh.evaluate(scene, grasps).quality
    assert ((quality >= 0) & (quality <= 1)).all()


def test_a_large_workspace_without_a_thing_has_no_cubes(fresh):
    volume = empty_volume((60, SIZE, SIZE), 60 * EDGE / SIZE)
    volume.distances[:] = 1.0
    scene = fresh.encode(volume, revision=1)
    assert len(scene.corners) == 0
    assert len(fresh.sample(scene)) == 0
    decision = fresh.decide(volume, 1)
    assert len(decision.grasps) == decision.sampled == 0
    assert not decision.budget_spent
    hand = hand_at(np.array([0.2, 0.1, 0.1]), [0, 0, -1], [0, 1, 0])[None]
    asked = fresh.evaluate(scene, GraspSet(hand, np.array([0.08])))
    assert asked.quality.tolist() == [0.0]  # of any origin, it closes on nothing
