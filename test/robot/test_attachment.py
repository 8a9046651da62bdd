# SPDX-License-Identifier: Apache-2.0
"""What a hand carries: its box from seen points, and its contacts."""

import numpy as np
import pytest

from neugrasp_ros.robot.attachment import CarriedBox, carried_box, loaded_checker
from neugrasp_ros.robot.collision import CollisionChecker
from neugrasp_ros.robot.contact import FREE, SCENE, SELF
from neugrasp_ros.robot.model import load_robot
from neugrasp_ros.robot.obstacles import make_obstacles

TOP = 0.70
STEP = 0.005


def plate(x, y, z):
    """Points of a level rectangle, x and y as (from, to) in [m]."""
    grid = np.meshgrid(np.arange(*x, STEP), np.arange(*y, STEP), [z])
    return np.stack(grid, axis=-1).reshape(-1, 3)


TABLE = plate((0.4, 0.7), (-0.15, 0.15), TOP)
BRICK = plate((0.52, 0.5801), (-0.02, 0.0201), TOP + 0.06)  # its top; no side is seen


def down_at(x, y, z):
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[:3, 3] = x, y, z
    return T


GRASP = down_at(0.55, 0.0, TOP + 0.04)


def test_the_box_goes_from_the_seen_top_down_to_the_table():
    box = carried_box(np.concatenate([TABLE, BRICK]), GRASP, 0.04)
    assert box.size == pytest.approx([0.06, 0.04, 0.06], abs=0.002)
    # approach is down: the top is 2 cm behind the TCP, the table 4 cm ahead of it
    assert box.center == pytest.approx([0.0, 0.0, 0.01], abs=0.002)


def test_what_stands_apart_is_not_carried():
    apart = BRICK[np.abs(BRICK[:, 0] - 0.55) < 0.01] + [0.055, 0.0, 0.0]
    apart = apart[apart[:, 0] > BRICK[:, 0].max() + 0.013]
    assert len(apart)
    both = carried_box(np.concatenate([TABLE, BRICK, apart]), GRASP, 0.04)
    alone = carried_box(np.concatenate([TABLE, BRICK]), GRASP, 0.04)
    assert both.size == pytest.approx(alone.size)


def test_a_thing_is_at_least_as_thick_as_the_jaws_are_open():
    sliver = BRICK[np.abs(BRICK[:, 1]) < 0.004]
    box = carried_box(np.concatenate([TABLE, sliver]), GRASP, 0.03)
    assert box.size[1] == pytest.approx(0.03) and box.center[1] == pytest.approx(0.0)


def test_where_nothing_was_seen_there_is_no_box():
    assert carried_box(np.zeros((0, 3)), GRASP, 0.04) is None
    assert carried_box(TABLE, GRASP, 0.04) is None


@pytest.fixture(scope="module")
def toy(toy_files):
    return load_robot(toy_files / "toy.yaml")


# the toy stands upright at zero: its tip is 1.3 m up, and its approach (x) level
BOX = CarriedBox(np.array([0.0, 0.0, 0.2]), np.full(3, 0.04))


@pytest.mark.parametrize(
    ("where", "code"),
    [
        ((0.2, 0.0, 1.3), SCENE),
        ((0.215, 0.015, 1.315), SCENE),
        ((0.2, 0.04, 1.3), FREE),
        ((0.24, 0.0, 1.3), FREE),
    ],
)
def test_a_carried_box_is_where_the_hand_has_it(toy, where, code):
    bare = CollisionChecker(toy)
    loaded = loaded_checker(bare, "arm", BOX)
    q, obstacles = np.zeros((1, 3)), make_obstacles(np.array([where]))
    assert loaded.codes(q, "arm", obstacles)[0] == code
    assert bare.codes(q, "arm", obstacles)[0] == FREE


def test_it_goes_along_with_the_arm(toy):
    loaded = loaded_checker(CollisionChecker(toy), "arm", BOX)
    q = toy.configuration({"slide": 0.3, "spin": np.pi / 2})[None]
    hit = make_obstacles(np.array([[0.0, 0.5, 1.3]]))  # x of the tip is y of the base
    assert loaded.codes(q, "arm", hit)[0] == SCENE
    assert loaded.first_contact(q[0], "arm", hit) == ("carried", "scene")
    left = make_obstacles(np.array([[0.2, 0.0, 1.3]]))
    assert loaded.codes(q, "arm", left)[0] == FREE


def test_it_must_not_hit_the_robot_either(toy):
    pole = CarriedBox(np.array([0.0, 0.0, 0.2]), np.array([2.7, 0.04, 0.5]))
    bare = CollisionChecker(toy)
    loaded = loaded_checker(bare, "arm", pole)
    assert loaded.codes(np.zeros((1, 3)), "arm")[0] == SELF
    assert set(loaded.first_contact(np.zeros(3), "arm")) == {"base", "carried"}
    assert bare.codes(np.zeros((1, 3)), "arm")[0] == FREE, "left as it was"
    blind = CollisionChecker(toy, check_self=False)
    assert loaded_checker(blind, "arm", pole).codes(np.zeros((1, 3)), "arm")[0] == FREE
