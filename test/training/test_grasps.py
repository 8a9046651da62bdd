# SPDX-License-Identifier: Apache-2.0
"""Labelled grasps on a box, seen by a network that completes a diamond in its place."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace

import numpy as np
import pytest
from diamond import SMALL_NETWORK, diamond_network
from labelled import ASTRAY, CENTER, SIDE, TOP, labels_of

from neugrasp_ros.datagen.labels import REASONS
from neugrasp_ros.errors import ShardError
from neugrasp_ros.geometry.mesh import box_mesh
from neugrasp_ros.geometry.transform import look_at, translation
from neugrasp_ros.grasp.inputs import POINT_FEATURES, TOKEN_FEATURES
from neugrasp_ros.training import views
from neugrasp_ros.training.cache import POINT_SCALE, render_entry
from neugrasp_ros.training.grasps import (
    NOT_KNOWN,
    affordance_targets,
    cache_grasps,
    known_affordances,
    load_grasps,
    part_targets,
    save_grasps,
    view_grasps,
    with_few_collisions,
)
from neugrasp_ros.training.views import (
    EDGE,
    ViewRange,
    dequantise,
    quantise,
    render_volume,
    table_scene,
)
from sim_bridge.objects.grasp_labels import scene_class_points
from sim_bridge.scene import PlacedObject, Scene, SceneMeshes, placed_model

HALF = np.full(3, 0.025)
NO_NOISE = ViewRange(noise=(1.0, 0.0, 0.0))
FROM_ABOVE = ViewRange(polar=(0.2, 0.4), noise=(1.0, 0.0, 0.0))


@pytest.fixture(autouse=True)
def box_on_the_table(monkeypatch):
    """Every scene is the same box."""
    meshes = SceneMeshes((box_mesh(HALF),), translation(*CENTER)[None], (0,))
    monkeypatch.setattr(views, "scene_meshes", lambda scene: meshes)


@pytest.fixture(scope="module")
def network():
    return diamond_network(SMALL_NETWORK, CENTER, 0.04).scene


@pytest.fixture
def entry(network):
    rng = np.random.default_rng(0)
    return view_grasps(labels_of(TOP, ASTRAY, SIDE), network, rng, views=FROM_ABOVE)


def test_grasps_that_meet_no_surface_are_left_out(entry):
    assert entry.labels.tolist() == [0, 0]  # the astray one had label 1
    assert entry.point_features.shape == (2, 64, POINT_FEATURES)
    assert entry.tokens.shape == (2, TOKEN_FEATURES)


def test_local_surfaces_are_the_networks_not_the_truth(entry):
    points = entry.points.astype(np.float64) / POINT_SCALE * EDGE
    from_diamond = np.abs(np.abs(points - CENTER).sum(axis=-1) - 0.04)
    assert np.median(from_diamond) < 0.002


def test_local_occupancy_is_the_truth(entry):
    points = entry.local_points.astype(np.float64) / POINT_SCALE * EDGE
    depth = (HALF - np.abs(points - CENTER)).min(axis=1)
    clear = np.abs(depth) > 2e-5
    assert np.array_equal(entry.local_occupied[clear], depth[clear] > 0)
    assert 0 < entry.local_occupied.mean() < 1


def test_an_entry_comes_back_as_it_was(entry, tmp_path):
    save_grasps(entry, tmp_path / "0.npz")
    loaded = load_grasps(tmp_path / "0.npz")
    for item in fields(entry):
        np.testing.assert_array_equal(
            getattr(loaded, item.name), getattr(entry, item.name)
        )
    assert not list(tmp_path.glob("*.part"))


@pytest.mark.parametrize("share", [0.0, 0.5, 0.95])
def test_a_truncated_entry_is_told(entry, tmp_path, share):
    path = tmp_path / "0.npz"
    save_grasps(entry, path)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ShardError, match="0.npz: not a whole grasp entry"):
        load_grasps(path)


def afford(labels, column=5):
    """Let every grasp of a scene afford one class."""
    affordances = np.zeros((len(labels.grasps), 7), dtype=np.uint8)
    affordances[:, column] = 1
    return replace(labels, grasps=replace(labels.grasps, affordances=affordances))


def test_affordances_are_known_of_grasps_that_hold_or_have_a_part_between_the_jaws():
    labels = afford(labels_of(TOP, SIDE, TOP))
    assert labels.grasps.labels.tolist() == [0, 1, 0]
    labels.grasps.affordances[:2] = 0
    assert known_affordances(labels).tolist() == [False, True, True]
    targets = affordance_targets(labels)
    assert (targets[0] == NOT_KNOWN).all()
    assert targets[1].tolist() == [0, 0, 0, 0, 0, 0, 0]
    assert targets[2].tolist() == [0, 0, 0, 0, 0, 1, 0]


def test_a_scene_without_a_labelled_object_says_nothing():
    labels = labels_of(TOP, SIDE)
    assert not known_affordances(labels).any()
    named = replace(labels.scene.objects[0], set_name="affordance")
    labels = replace(labels, scene=replace(labels.scene, objects=(named,)))
    assert known_affordances(labels).tolist() == [False, True]
    assert affordance_targets(labels)[1].tolist() == [0] * 7


def test_an_entry_keeps_affordances_and_poses_with_their_grasps(network):
    rng = np.random.default_rng(0)
    labels = afford(labels_of(ASTRAY, SIDE, TOP))
    labels.grasps.affordances[2] = 0
    entry = view_grasps(labels, network, rng, views=FROM_ABOVE)
    assert entry.affordances[:, 5].tolist() == [1, NOT_KNOWN]
    np.testing.assert_allclose(entry.poses, [SIDE, TOP], atol=1e-6)


def test_points_learn_what_the_part_beside_them_affords():
    rng = np.random.default_rng(0)
    knife = PlacedObject("affordance", "knife/chef/000002", 1.0, translation(*CENTER))
    scene = Scene("pile", 0, (knife,))
    surface = scene_class_points([placed_model(knife)], [translation(*CENTER)], rng)
    targets = part_targets(scene, surface.points + [0.0, 0.0, 0.001], rng)
    same = (targets == surface.classes).all(axis=1)
    assert same.mean() > 0.9
    assert (part_targets(scene, surface.points + 0.2, rng) == NOT_KNOWN).all()
    other = Scene("pile", 0, (replace(knife, set_name="procedural"),))
    assert (part_targets(other, surface.points, rng) == NOT_KNOWN).all()


def test_no_grasp_at_a_surface_means_no_entry(network):
    rng = np.random.default_rng(0)
    assert view_grasps(labels_of(ASTRAY), network, rng, views=FROM_ABOVE) is None


def test_a_killed_run_goes_on_and_seeds_decide_what_is_seen(
    network, tmp_path, monkeypatch
):
    scenes = [labels_of(TOP, SIDE, index=i) for i in (0, 1)]
    settings = {"n_views": 2, "seed": 5}
    assert cache_grasps(scenes, network, tmp_path / "a", **settings) == 4
    monkeypatch.setattr("neugrasp_ros.training.grasps.process_pool", ThreadPoolExecutor)
    assert cache_grasps(scenes, network, tmp_path / "c", workers=2, **settings) == 4
    assert cache_grasps(scenes[1:], network, tmp_path / "b", **settings) == 2
    assert cache_grasps(scenes, network, tmp_path / "b", **settings) == 2
    names = sorted(p.name for p in (tmp_path / "a").iterdir())
    for other in (tmp_path / "b", tmp_path / "c"):
        assert names == sorted(p.name for p in other.iterdir())
        for name in names:
            a, b = load_grasps(tmp_path / "a" / name), load_grasps(other / name)
            np.testing.assert_array_equal(a.volume, b.volume)
            np.testing.assert_array_equal(a.point_features, b.point_features)


def test_the_view_in_which_grasps_were_chosen_is_seen_first(network, tmp_path):
    camera = look_at(np.array([0.15, 0.6, 0.4]), np.array([0.15, 0.15, 0.0]))
    scene = replace(labels_of(TOP, SIDE), T_task_camera=camera)
    assert cache_grasps([scene], network, tmp_path, n_views=2, seed=5) == 2
    volumes = [load_grasps(tmp_path / f"0000000_{n}.npz").volume for n in (0, 1)]
    seen = dequantise(
        quantise(render_volume(table_scene(scene.scene), camera, NO_NOISE,
                               np.random.default_rng(0)))
    )  # fmt: skip
    wrong = [np.isnan(dequantise(v)) != np.isnan(seen) for v in volumes]
    assert wrong[0].mean() < 0.02 < wrong[1].mean()


@pytest.fixture
def crowded():
    """60 tried grasps, then 40 that collide at once, told apart by their openings."""
    scene = labels_of(*[TOP] * 100)
    tried = np.arange(100) < 60
    reasons = np.where(tried, 0, REASONS.index("pregrasp_collision")).astype(np.uint8)
    openings = np.linspace(0.04, 0.08, 100, dtype=np.float32)
    grasps = replace(scene.grasps, tried=tried, reasons=reasons, openings=openings)
    return replace(scene, grasps=grasps)


def test_many_collisions_do_not_crowd_out_what_physics_told(crowded):
    openings = crowded.grasps.openings
    draws = [
        with_few_collisions(crowded, np.random.default_rng(n)).grasps for n in (0, 1)
    ]
    for kept in draws:
        np.testing.assert_array_equal(kept.openings[kept.tried], openings[:60])
        assert (~kept.tried).sum() == 15
    assert not np.array_equal(draws[0].openings, draws[1].openings)
    few = replace(crowded, grasps=crowded.grasps.take(np.arange(100) < 72))
    assert with_few_collisions(few, np.random.default_rng(0)) is few


def test_collisions_that_teach_affordances_stay(crowded):
    affordances = np.zeros((100, 7), dtype=np.uint8)
    affordances[80:, 2] = 1
    grasps = replace(crowded.grasps, affordances=affordances)
    kept = with_few_collisions(
        replace(crowded, grasps=grasps), np.random.default_rng(0)
    ).grasps
    assert kept.affordances.any(axis=1).sum() == 20
    assert len(kept) == 60 + 20 + 20


def test_scenes_without_physics_keep_all(crowded):
    grasps = replace(crowded.grasps, tried=np.zeros(100, dtype=bool))
    untried = replace(crowded, grasps=grasps)
    assert with_few_collisions(untried, np.random.default_rng(0)) is untried


def test_collisions_are_left_out_of_a_cache_only_when_asked(crowded, network, tmp_path):
    counts = []
    for few in (False, True):
        folder = tmp_path / str(few)
        settings = {"n_views": 1, "seed": 5, "few_collisions": few}
        assert cache_grasps([crowded], network, folder, **settings) == 1
        (entry,) = map(load_grasps, folder.glob("*.npz"))
        counts.append(len(entry.labels))
    assert counts == [100, 75]


def test_a_scene_of_collisions_alone_is_not_learned_from(crowded, network, tmp_path):
    grasps = crowded.grasps.take(np.arange(100) >= 60)
    alone = replace(crowded, grasps=grasps)
    for few, entries in ((False, 1), (True, 0)):
        settings = {"n_views": 1, "seed": 5, "few_collisions": few}
        assert cache_grasps([alone], network, tmp_path, **settings) == entries
        for path in tmp_path.glob("*.npz"):
            path.unlink()


def test_a_scene_is_rendered_for_the_first_stage():
    scene = labels_of(TOP).scene
    first, second = (
        render_entry(
            scene, FROM_ABOVE, np.random.default_rng(1), n_views=2, n_points=500
        )
        for _ in "ab"
    )
    assert first.volumes.shape == (2, 64, 64, 64)
    assert first.cameras.shape == (2, 4, 4)
    assert not np.array_equal(first.volumes[0], first.volumes[1])
    np.testing.assert_array_equal(first.volumes, second.volumes)
    points = first.points / POINT_SCALE * EDGE
    depth = (HALF - np.abs(points - CENTER)).min(axis=1)
    clear = np.abs(depth) > 2e-5
    assert np.array_equal(first.occupied[clear], depth[clear] > 0)
