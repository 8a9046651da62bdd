# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from sim_shapes import box_model, looking_down, standing

from neugrasp_ros.errors import ConfigError, UnknownNameError
from neugrasp_ros.geometry.gripper import load_gripper
from sim_bridge.gripper import SimGripper
from sim_bridge.trial import (
    TRIAL_PRESETS,
    collision_label,
    run_trial,
    run_trials,
    trial_config,
)

GRIPPERS = ("panda", "robotiq_2f85")


@pytest.fixture
def cell(make_world):
    """A box 40 x 40 x 60 mm in the middle of the table, and a hand."""

    def make(name="panda", sleeping=False):
        world = make_world(sleeping=sleeping)
        world.load_object(box_model(0.02, 0.02, 0.03), standing(0.03))
        world.wait_for_rest()
        return world, SimGripper(world, load_gripper(name))

    return make


def attempt(cell, pose, preset, name="panda"):
    config = trial_config(preset)
    world, hand = cell(name, config.sleeping)
    opening = hand.gripper.max_opening
    return run_trial(world, hand, pose, opening, config), world


@pytest.mark.parametrize("name", GRIPPERS)
@pytest.mark.parametrize("preset", ["vgn", "fast_shake", "strict"])
def test_a_box_is_grasped_from_above(cell, preset, name):
    result, world = attempt(cell, looking_down(0.15, 0.15, 0.085), preset, name)
    assert result.success, result
    assert result.object_body == world.object_ids[0]
    assert abs(result.width - 0.04) < 2e-3
    assert world.pose(result.object_body)[2, 3] > 0.15
    assert result.shake_held is (True if preset == "fast_shake" else None)


@pytest.mark.parametrize("name", GRIPPERS)
@pytest.mark.parametrize("preset", ["vgn", "fast", "strict"])
def test_a_grasp_beside_the_box_closes_on_nothing(cell, preset, name):
    result, _ = attempt(cell, looking_down(0.25, 0.15, 0.085), preset, name)
    assert not result.success
    assert result.reason == "empty"
    assert result.object_body == -1


def test_a_side_grasp_is_lifted_straight_up(cell):
    pose = np.eye(4)
    pose[:3, :3] = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # approach along +x
    pose[:3, 3] = 0.16, 0.15, 0.09
    result, world = attempt(cell, pose, "vgn")
    assert result.success, result
    np.testing.assert_allclose(
        world.pose(world.object_ids[0])[:2, 3], [0.15, 0.15], atol=5e-3
    )


def test_a_hand_that_starts_inside_the_box_is_a_pregrasp_collision(cell):
    inside = looking_down(0.15, 0.15 + 0.045, -0.02)  # finger into the box at 0.10 back
    result, _ = attempt(cell, inside, "strict")
    assert result.reason == "pregrasp_collision"


def test_fingers_into_the_table_are_table_contact(cell):
    result, _ = attempt(cell, looking_down(0.25, 0.15, 0.04), "strict")
    assert result.reason == "table_contact"
    assert 0.0 < result.stop_depth < 0.02


def test_pushing_an_object_aside_is_disturbed(cell):
    sideways = np.eye(4)
    sideways[:3, :3] = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    sideways[:3, 3] = 0.20, 0.15 + 0.045, 0.10  # one finger meets the box
    result, _ = attempt(cell, sideways, "strict")
    assert result.reason == "disturbed"
    assert result.touched


def test_an_object_caught_under_another_is_snagged(make_world):
    world = make_world()
    world.load_object(box_model(0.01, 0.05, 0.01), standing(0.01))
    world.load_object(box_model(0.03, 0.01, 0.005), standing(0.025, y=0.19))
    world.wait_for_rest()
    hand = SimGripper(world, load_gripper("panda"))
    pose = looking_down(0.15, 0.13, 0.056) @ np.array(
        [[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    )
    result = run_trial(world, hand, pose, 0.08, trial_config("strict"))
    assert result.reason in ("snagged", "slipped")


@pytest.mark.parametrize("preset", ["vgn", "fast"])
def test_every_trial_starts_from_the_same_state(cell, preset):
    world, hand = cell(sleeping=TRIAL_PRESETS[preset].sleeping)
    before = world.pose(world.object_ids[0])
    good = (looking_down(0.15, 0.15, 0.085), 0.08)
    edge = (looking_down(0.163, 0.155, 0.10), 0.08)
    results = list(
        run_trials(world, hand, [edge, good, edge, good], trial_config(preset))
    )
    for first, again in zip(results[:2], results[2:], strict=True):
        assert first.reason == again.reason
        assert abs(first.width - again.width) < 5e-5
    np.testing.assert_allclose(world.pose(world.object_ids[0]), before, atol=1e-9)


@pytest.mark.parametrize("name", GRIPPERS)
def test_the_short_cut_agrees_with_the_full_execution(cell, name):
    world, hand = cell(name, sleeping=True)
    rng = np.random.default_rng(0)
    opening = hand.gripper.max_opening
    grasps = [
        (looking_down(*(np.array([0.15, 0.15, 0.1]) + rng.normal(0, 0.02, 3))), opening)
        for _ in range(8)
    ]
    fast, full = (
        [r.success for r in run_trials(world, hand, grasps, trial_config(preset))]
        for preset in ("fast", "vgn")
    )
    assert sum(a != b for a, b in zip(fast, full, strict=True)) <= 1
    assert 0 < sum(full) < 8


def test_collision_labels_tell_where_the_open_hand_touches(cell):
    _, hand = cell()
    assert collision_label(hand, looking_down(0.15, 0.15, 0.085), 0.08) == (
        False,
        False,
        False,
    )
    onto = collision_label(hand, looking_down(0.15, 0.19, 0.085), 0.08)
    assert onto == (False, True, True)
    buried = collision_label(hand, looking_down(0.15, 0.19, 0.04), 0.08)
    assert buried.pregrasp
    narrow = collision_label(hand, looking_down(0.15, 0.15, 0.085), 0.03)
    assert narrow.grasp


def test_a_bad_preset_or_world_is_an_error(cell):
    with pytest.raises(UnknownNameError, match="gentle"):
        trial_config("gentle")
    world, hand = cell(sleeping=False)
    with pytest.raises(ConfigError, match="sleeping"):
        run_trial(
            world, hand, looking_down(0.15, 0.15, 0.1), 0.08, trial_config("fast")
        )
