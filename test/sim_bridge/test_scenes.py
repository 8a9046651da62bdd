# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from sim_shapes import block_set

from neugrasp_ros.errors import ConfigError, UnknownNameError
from sim_bridge.objects.registry import ObjectSet
from sim_bridge.scenes import build_scene, draw_count, rebuild_scene, tray_walls
from sim_bridge.world import TABLE_HEIGHT, WORKSPACE_EDGE

BLOCKS = block_set()


def build(world, kind, seed, objects=BLOCKS, **options):
    rng = np.random.default_rng(seed)
    names = objects.names
    return build_scene(world, kind, objects, names, rng, seed=seed, **options)


def test_the_tray_has_the_benchmarks_footprint_height_and_thickness():
    walls = tray_walls()
    lower = np.min([pose[:3, 3] - half for half, pose in walls], axis=0)
    upper = np.max([pose[:3, 3] + half for half, pose in walls], axis=0)
    np.testing.assert_allclose(lower, [0.02, 0.02, TABLE_HEIGHT])
    np.testing.assert_allclose(upper, [0.28, 0.28, TABLE_HEIGHT + 0.13])
    assert sorted(2 * min(half) for half, _ in walls) == [0.0039] * 4


@pytest.mark.parametrize("kind", ["pile", "packed"])
def test_the_same_seed_gives_the_same_scene(make_world, kind):
    world = make_world(solver_iterations=50)
    first, second, other = (build(world, kind, seed) for seed in (1, 1, 2))
    assert first.as_record() == second.as_record()
    assert first.as_record() != other.as_record()


def test_a_pile_rests_inside_the_workspace_without_its_tray(make_world):
    world = make_world(solver_iterations=50)
    scene = build(world, "pile", 3)
    assert 1 <= len(scene.objects) <= 5
    assert scene.seed == 3
    for body, placed in zip(world.object_ids, scene.objects, strict=True):
        center = world.center_of_mass(body)
        assert (center >= 0).all() and (center <= WORKSPACE_EDGE).all()
        np.testing.assert_allclose(world.pose(body), placed.T_task_object)
        assert 0.8 <= placed.scale <= 1.0
        assert np.linalg.norm(world.velocity(body)) < 0.05


def test_packed_objects_stand_upright_and_apart(make_world):
    world = make_world(solver_iterations=50)
    scene = build(world, "packed", 4)
    assert len(scene.objects) >= 2
    for placed in scene.objects:
        assert 0.7 <= placed.scale <= 0.9
        assert placed.T_task_object[2, 2] > 0.99
    world.detect_collisions()
    for body in world.object_ids:
        assert {c.body_b for c in world.contacts(body)} <= {world.table}


def test_a_rebuilt_scene_is_the_recorded_one(make_world):
    scene = build(make_world(solver_iterations=50), "packed", 5)
    world = make_world()
    bodies = rebuild_scene(world, scene, {"blocks": BLOCKS})
    for body, placed in zip(bodies, scene.objects, strict=True):
        np.testing.assert_allclose(world.pose(body), placed.T_task_object, atol=1e-6)
        assert world.model(body).name == BLOCKS.load(placed.name).name
    world.wait_for_rest()
    moved = [
        np.linalg.norm(world.pose(b)[:3, 3] - p.T_task_object[:3, 3])
        for b, p in zip(bodies, scene.objects, strict=True)
    ]
    assert max(moved) < 5e-3


def test_egad_scenes_size_a_mesh_in_millimetres_to_the_gripper(make_world):
    big = replace(BLOCKS.load("cube").scaled(100 / 0.04 * 0.001), file_unit=0.001)
    egad = ObjectSet("egad", ["A0"], lambda name: big)
    world = make_world(solver_iterations=50)
    scene = build(world, "egad", 6, objects=egad, count=2)
    edges = [big.extents()[0] * placed.scale for placed in scene.objects]
    assert edges and all(0.05 < edge < 0.12 for edge in edges)
    for body in world.object_ids:
        assert [part.kind for part in world.model(body).parts] == ["hull"]


def test_the_training_count_is_poisson_plus_one():
    rng = np.random.default_rng(0)
    counts = [draw_count(rng) for _ in range(2000)]
    assert min(counts) == 1
    assert abs(np.mean(counts) - 5.0) < 0.15


def test_an_empty_scene_needs_no_names(make_world):
    world = make_world()
    empty = ObjectSet("none", [], BLOCKS.load)
    assert build(world, "empty", 0, objects=empty).objects == ()
    with pytest.raises(ConfigError, match="names"):
        build(world, "pile", 0, objects=empty)
    with pytest.raises(UnknownNameError, match="heap"):
        build(world, "heap", 0)
