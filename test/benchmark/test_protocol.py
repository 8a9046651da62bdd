# SPDX-License-Identifier: Apache-2.0
import json

import numpy as np
import pytest
from sim_shapes import block_set, looking_down

from neugrasp_ros.benchmark.protocol import Plan, Suite, nearest_object, run_round
from neugrasp_ros.errors import ConfigError, EmptySceneError, UnknownNameError
from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.grasp.types import GraspSet
from sim_bridge.objects.registry import ObjectSet
from sim_bridge.scene import PlacedObject, Scene

SETS = {"blocks": block_set()}
NOTHING = Plan(GraspSet(np.zeros((0, 4, 4)), np.zeros(0)))


def suite(**changes):
    values = {"scene": "packed", "objects": "blocks", "part": "all", "count": 1}
    return Suite(**{**values, **changes})


def grasp_from_above(look, rng):
    """Grasp the first object across its shorter horizontal edge, knowing its pose."""
    mesh, pose = look.truth.meshes[0], look.truth.poses[0]
    lower, upper = mesh.bounds()
    center = pose @ [*(lower + upper) / 2, 1.0]
    across = int(np.argmin((upper - lower)[:2]))
    grasp = looking_down(*center[:2], max(center[2] - 0.005, 0.058))
    grasp[:3, 1] = pose[:3, across]
    grasp[:3, 0] = np.cross(grasp[:3, 1], grasp[:3, 2])
    return Plan(GraspSet(grasp[None], np.array([0.08]), np.array([0.9])), {"a": 0.1}, 1)


def grasp_the_air(look, rng):
    poses = looking_down(0.15, 0.15, 0.3)[None]
    return Plan(GraspSet(poses, np.array([0.08]), np.array([0.5])))


@pytest.mark.slow
def test_what_an_oracle_tries_changes_nothing():
    told = []

    def choose(look, rng):
        good = grasp_from_above(look, rng)
        pair = np.concatenate([looking_down(0.15, 0.15, 0.3)[None], good.grasps.poses])
        held = look.holds(GraspSet(pair, np.full(2, 0.08)))
        told.extend([next(held), next(held)])
        held.close()
        return good

    plain, tried = (
        run_round(suite(), 0, policy, None, SETS)
        for policy in (grasp_from_above, choose)
    )
    assert told == [False, True]
    assert tried.attempts[0].success
    assert tried.attempts[0].T_task_gripper == plain.attempts[0].T_task_gripper
    assert tried.n_successes == plain.n_successes == 1


@pytest.mark.slow
@pytest.mark.parametrize("protocol", ["vgn", "strict"])
def test_a_policy_that_knows_the_scene_clears_it(protocol):
    seen = []
    record = run_round(
        suite(protocol=protocol),
        0,
        grasp_from_above,
        lambda record, attempt: seen.append((record, attempt)),
        SETS,
    )
    assert record.ended == "cleared", record
    assert record.n_successes == record.n_objects == 1
    assert record.attempts[0].object_name == record.scene["objects"][0]["name"]
    assert seen[0][0] == record.attempts[0]
    assert len(seen[0][1].scene.objects) == 1
    assert set(record.attempts[0].timings) == {"a", "plan"}
    json.dumps(record.as_record())


def test_two_failures_in_a_row_end_a_round_and_are_remembered():
    memories = []

    def policy(look, rng):
        memories.append(len(look.failed))
        return grasp_the_air(look, rng)

    record = run_round(suite(), 1, policy, sets=SETS)
    assert record.ended == "failures"
    assert [a.reason for a in record.attempts] == ["empty", "empty"]
    assert memories == [0, 1]


@pytest.mark.parametrize(("protocol", "n_looks"), [("vgn", 3), ("strict", 2)])
def test_empty_answers_end_a_round_after_fresh_looks(protocol, n_looks):
    views = []

    def policy(look, rng):
        views.append(look.view.T_task_camera)
        return NOTHING

    record = run_round(suite(protocol=protocol), 2, policy, sets=SETS)
    assert record.ended == "no_grasp"
    assert record.attempts == ()
    assert len(views) == n_looks
    assert not np.allclose(views[0], views[1])


def test_a_view_of_nothing_takes_the_objects_out_of_the_count():
    def policy(look, rng):
        raise EmptySceneError("nothing seen")

    record = run_round(suite(), 3, policy, sets=SETS)
    assert record.ended == "empty_view"
    assert record.n_counted == 0


@pytest.mark.slow
def test_a_round_depends_on_seed_and_index_alone():
    draws = []

    def policy(look, rng):
        draws.append((look.view.depth, rng.random()))
        return NOTHING

    strict = suite(protocol="strict")
    first, again = (run_round(strict, 4, policy, sets=SETS) for _ in range(2))
    assert first == again
    np.testing.assert_array_equal(draws[0][0], draws[2][0])
    assert draws[0][1] == draws[2][1]
    other = run_round(suite(protocol="strict", seed=1), 4, policy, sets=SETS)
    assert other.scene != first.scene


def test_unknown_protocols_and_empty_parts_are_errors():
    with pytest.raises(UnknownNameError, match="kind"):
        suite(protocol="kind")
    no_cube = ObjectSet("blocks", ["bar", "can", "ell"], SETS["blocks"].load)
    with pytest.raises(ConfigError, match="empty"):
        run_round(suite(part="val"), 0, grasp_the_air, sets={"blocks": no_cube})


def test_the_object_that_was_meant_is_the_nearest():
    placed = [
        PlacedObject("blocks", name, 1.0, translation(x, 0.1, 0.1))
        for name, x in (("left", 0.05), ("right", 0.2))
    ]
    scene = Scene("pile", 0, tuple(placed))
    assert nearest_object(scene, np.array([0.16, 0.1, 0.1])) == "right"
    assert nearest_object(Scene("pile", 0, ()), np.zeros(3)) == ""
