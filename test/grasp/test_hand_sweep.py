# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from field_shapes import LIMIT, box_field, hand_at, random_hands

from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.geometry.transform import apply
from neugrasp_ros.grasp.hand_sweep import (
    FINGER_LATTICE,
    PALM_LATTICE,
    STATIONS,
    SWEEP_FEATURES,
    hand_points,
    sweep_hands,
)

PANDA = load_gripper("panda")
N = len(STATIONS)
FAR = np.array([0.15, 0.15, 0.05])  # a hand here, closing along y, touches no box below
DOWN = hand_at(FAR, [0, 0, -1], [0, 1, 0])
WIDTHS = np.array([PANDA.max_opening])


def sweep(field, pose=DOWN, widths=WIDTHS, support_height=0.0):
    return sweep_hands(field, pose[None], widths, PANDA, support_height=support_height)[
        0
    ]


def slab(height: float, y: float = 0.15, half_y: float = 0.1):
    """A slab 2 cm thick whose underside is at a height."""
    return box_field(np.array([0.15, y, height + 0.01]), np.array([0.1, half_y, 0.01]))


def test_the_lattice_fills_each_box_to_its_corners():
    points, parts = hand_points(PANDA, 0.06)
    for part, (center, half) in enumerate(zip(*PANDA.boxes(0.06), strict=True)):
        own = points[parts == part]
        np.testing.assert_allclose(own.min(axis=0), center - half, atol=1e-12)
        np.testing.assert_allclose(own.max(axis=0), center + half, atol=1e-12)
        limit = PALM_LATTICE if part == 2 else FINGER_LATTICE
        for axis in range(3):
            ticks = np.unique(np.round(own[:, axis], 9))
            assert np.diff(ticks).max() <= limit + 1e-9


def test_an_empty_world_is_all_free():
    found = sweep(box_field(np.zeros(3), np.full(3, 0.01)))
    assert found.shape == (SWEEP_FEATURES,)
    assert (found[: N + 3] == -LIMIT).all()


def test_a_box_in_the_way_is_met_at_the_stations_that_reach_it():
    """A shelf over the grasp: the hand passes it on its way down."""
    tips = FAR[2] - np.array(STATIONS)  # height of the tips at each station
    hand_top = tips + PANDA.finger_depth + PANDA.palm_size[2]
    shelf = box_field(np.array([0.15, 0.15, 0.23]), np.array([0.1, 0.1, 0.03]))
    found = sweep(shelf)[:N]
    meets, clear = hand_top > 0.205, hand_top < 0.195
    assert clear.any()
    assert meets.any()
    assert (found[meets] > 0).all()
    assert (found[clear] < 0).all()


def test_a_thing_on_the_table_is_met_only_where_the_tips_reach_it():
    plate = box_field(np.array([0.15, 0.15, 0.06]), np.array([0.1, 0.1, 0.02]))
    found = sweep(plate)[:N]
    tips = FAR[2] - np.array(STATIONS)
    assert (found[tips < 0.075] > 0).all()
    assert (found[tips > 0.09] < 0).all()


@pytest.mark.parametrize(("side", "part"), [(1, 0), (-1, 1)])
def test_the_finger_that_is_in_the_way_is_told(side, part):
    y = 0.15 + side * (PANDA.max_opening + PANDA.finger_width) / 2
    pin = box_field(np.array([0.15, y, 0.06]), np.array([0.02, 0.008, 0.015]))
    left, right, palm = sweep(pin)[N : N + 3]
    assert (left > 0) == (part == 0)
    assert (right > 0) == (part == 1)
    assert palm < 0


def test_the_palm_is_told_from_the_fingers():
    top = FAR[2] + PANDA.finger_depth
    block = box_field(np.array([0.15, 0.15, top]), np.array([0.02, 0.02, 0.02]))
    left, right, palm = sweep(block)[N : N + 3]
    assert palm > 0
    assert left < 0
    assert right < 0


def test_narrower_jaws_pass_where_wide_ones_do_not():
    y = 0.15 + (PANDA.max_opening + PANDA.finger_width) / 2
    pin = box_field(np.array([0.15, y, 0.06]), np.array([0.02, 0.008, 0.01]))
    assert sweep(pin, widths=np.array([0.08]))[N] > 0
    assert sweep(pin, widths=np.array([0.03]))[N] < 0


def test_a_point_of_the_hand_outside_the_volume_counts_for_nothing():
    field = box_field(np.array([0.29, 0.15, 0.15]), np.array([0.05, 0.2, 0.2]))
    outside = hand_at(np.array([0.45, 0.15, 0.15]), [0, 0, -1], [0, 1, 0])
    assert (sweep(field, outside)[: N + 3] == -LIMIT).all()


def test_the_lowest_corner_is_measured_from_the_support():
    tilted = hand_at(np.array([0.15, 0.15, 0.1]), [0.3, 0.2, -1], [0, 1, 0.2])
    points, _ = hand_points(PANDA, 0.08)
    lowest = apply(tilted, points)[:, 2].min()
    empty = box_field(np.zeros(3), np.full(3, 0.01))
    found = sweep(empty, tilted, support_height=0.05)[-1]
    assert found == pytest.approx(lowest - 0.05, abs=1e-6)


def test_many_hands_of_many_widths_are_swept_as_each_alone():
    rng = np.random.default_rng(0)
    hands = random_hands(np.array([0.15, 0.15, 0.1]), 70, rng)
    widths = rng.uniform(0.0, 0.1, 70)
    field = slab(0.03)
    settings = {"support_height": 0.05}
    together = sweep_hands(field, hands, widths, PANDA, **settings, threads=3)
    for i in (0, 13, 69):
        one = slice(i, i + 1)
        alone = sweep_hands(field, hands[one], widths[one], PANDA, **settings)
        np.testing.assert_array_equal(together[i], alone[0])
