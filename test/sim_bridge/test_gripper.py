# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from sim_shapes import box_model, looking_down, standing

from neugrasp_ros.errors import SimulationError
from neugrasp_ros.geometry.gripper import Gripper, load_gripper
from neugrasp_ros.geometry.transform import translation
from sim_bridge.gripper import SimGripper

GRIPPERS = ("panda", "robotiq_2f85")
WIDE = Gripper(
    name="wide",
    max_opening=0.11,
    finger_depth=0.06,
    finger_thickness=0.02,
    finger_width=0.015,
    palm_size=(0.08, 0.16, 0.10),
    mount_to_tcp=0.16,
    max_force=30.0,
)


def hand_in(world, name):
    gripper = WIDE if name == "wide" else load_gripper(name)
    return SimGripper(world, gripper)


@pytest.mark.parametrize("name", [*GRIPPERS, "wide"])
def test_a_teleported_gripper_is_where_and_as_open_as_told(make_world, name):
    hand = hand_in(make_world(), name)
    pose = looking_down(0.12, 0.16, 0.2)
    hand.teleport(pose, 0.03)
    np.testing.assert_allclose(hand.pose(), pose, atol=1e-9)
    assert abs(hand.width() - 0.03) < 1e-9


@pytest.mark.parametrize("name", [*GRIPPERS, "wide"])
def test_a_cube_ten_millimetres_behind_the_tcp_is_held_between_the_pads(
    make_world, name
):
    world = make_world()
    world.load_box(np.array([0.008, 0.008, 0.03]), standing(0.03))  # a post
    cube = world.load_object(box_model(0.01, 0.01, 0.01), standing(0.07))
    world.wait_for_rest()
    hand = hand_in(world, name)
    center = world.center_of_mass(cube)
    hand.teleport(looking_down(*center) @ translation(0, 0, 0.01), 0.05)
    hand.close()
    assert abs(hand.width() - 0.02) < 1.5e-3
    fingers = hand.finger_contacts()
    assert cube in fingers.left and cube in fingers.right


@pytest.mark.parametrize("name", GRIPPERS)
def test_a_cube_two_millimetres_ahead_of_the_open_tips_is_not_between_them(
    make_world, name
):
    world = make_world()
    world.load_object(box_model(0.01, 0.01, 0.01), standing(0.01))
    world.wait_for_rest()
    hand = hand_in(world, name)
    assert hand.query_contacts(looking_down(0.15, 0.15, 0.074), 0.05) == []
    centered = hand.query_contacts(looking_down(0.15, 0.15, 0.062), 0.018)
    assert set(world.object_ids) <= {c.body_b for c in centered}


def test_the_fingers_stay_symmetric_when_only_one_meets_the_object(make_world):
    world = make_world()
    world.load_object(box_model(0.02, 0.01, 0.02), standing(0.02, y=0.17))
    world.wait_for_rest()
    hand = hand_in(world, "panda")
    hand.teleport(looking_down(0.15, 0.15, 0.06), 0.08)
    hand.close()
    center = hand.pose()[:3, 3]
    assert np.linalg.norm(center - [0.15, 0.15, 0.06]) < 2e-3
    assert hand.width() < 0.022


def test_a_straight_motion_ends_at_its_target(make_world):
    hand = hand_in(make_world(), "panda")
    start = looking_down(0.15, 0.15, 0.25)
    hand.teleport(start, 0.08)
    path = [start @ translation(0, 0, 0.002 * (i + 1)) for i in range(25)]
    assert hand.follow(path, 4) is None
    hand.world.step(40)
    np.testing.assert_allclose(hand.pose(), path[-1], atol=5e-4)


def test_a_motion_stops_where_it_meets_the_table(make_world):
    hand = hand_in(make_world(), "panda")
    start = looking_down(0.15, 0.15, 0.10)
    hand.teleport(start, 0.08)
    path = [start @ translation(0, 0, 0.002 * (i + 1)) for i in range(35)]
    stop = hand.follow(path, 4, hand.has_contact)
    assert stop is not None
    assert abs(hand.commanded[2, 3] - 0.05) < 4e-3


def test_jaws_open_again(make_world):
    hand = hand_in(make_world(), "robotiq_2f85")
    hand.teleport(looking_down(0.15, 0.15, 0.25), 0.01)
    hand.open()
    assert abs(hand.width() - 0.085) < 1e-3


def test_an_impossible_opening_is_an_error(make_world):
    hand = hand_in(make_world(), "panda")
    with pytest.raises(SimulationError, match="0.08"):
        hand.teleport(looking_down(0.15, 0.15, 0.2), 0.2)


def test_a_removed_gripper_leaves_the_world_as_it_was(make_world):
    world = make_world()
    body = world.load_object(box_model(0.02, 0.02, 0.02), standing(0.02))
    hand = hand_in(world, "panda")
    hand.remove()
    world.step(10)
    assert world.object_ids == (body,)


@pytest.mark.parametrize("name", GRIPPERS)
def test_shut_jaws_need_no_more_steps(make_world, name):
    world = make_world()
    hand = hand_in(world, name)
    pose = looking_down(0.15, 0.15, 0.3)
    ends = []
    for shut_at in (-1.0, 0.008):
        hand.teleport(pose, 0.05)
        before = world.steps
        hand.close(shut_at=shut_at)
        ends.append((world.steps - before, hand.width()))
    assert ends[0][0] == 120
    assert ends[1][0] < 100
    assert ends[0][1] < 1e-3 < ends[1][1] < 0.008


def test_jaws_that_hold_something_take_the_whole_time(make_world):
    world = make_world()
    world.load_object(box_model(0.02, 0.02, 0.02), standing(0.02))
    hand = hand_in(world, "panda")
    hand.teleport(looking_down(0.15, 0.15, 0.065), 0.06)
    before = world.steps
    hand.close(shut_at=0.008)
    assert world.steps - before == 120
    assert abs(hand.width() - 0.04) < 2e-3
