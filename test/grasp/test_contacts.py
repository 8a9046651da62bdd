# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.geometry.finger_joint import tip_advance_at
from neugrasp_ros.geometry.grid import ScalarGrid
from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.geometry.transform import apply, make_transform
from neugrasp_ros.grasp.contacts import RAY_SPACING, expected_contacts

GRIPPERS = [load_gripper("robotiq_2f85"), load_gripper("panda")]
DOWN = np.diag([1.0, -1.0, -1.0])  # z approach points down
VOXEL = 0.3 / 64
HALF = np.array([0.02, 0.015, 0.03])  # of a box [m]
CENTER = np.array([0.15, 0.14, 0.08])


def box_field(center=CENTER) -> ScalarGrid:
    axis = (np.arange(64) + 0.5) * VOXEL
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    outside = (np.abs(points - center) - HALF).max(axis=-1)
    return ScalarGrid((-outside / VOXEL).astype(np.float32), VOXEL)


@pytest.mark.parametrize("gripper", GRIPPERS, ids=lambda g: g.name)
def test_pads_touch_the_two_faces_of_a_box(gripper):
    pose = make_transform(DOWN, CENTER + [0.0, 0.005, 0.0])  # not quite centred
    (contacts,) = expected_contacts(box_field(), pose[None], gripper)
    # the gripper's y points along -y of the task frame
    np.testing.assert_allclose(contacts[0, 1], CENTER[1] - HALF[1], atol=1e-3)
    np.testing.assert_allclose(contacts[1, 1], CENTER[1] + HALF[1], atol=1e-3)
    np.testing.assert_allclose(contacts[:, 0], CENTER[0], atol=1e-3)
    # a face is touched from the box's top down to the tips of the closed pads
    tip = tip_advance_at(gripper, 2 * HALF[1] + np.array([0.01, -0.01]))
    low = CENTER[2] - tip
    high = np.minimum(CENTER[2] + HALF[2], low + gripper.finger_depth)
    np.testing.assert_allclose(contacts[:, 2], (low + high) / 2, atol=RAY_SPACING)


def test_contacts_turn_and_move_with_the_hand():
    gripper, field = GRIPPERS[0], box_field()
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]) @ DOWN
    pose = make_transform(turn, CENTER)
    (contacts,) = expected_contacts(field, pose[None], gripper)
    assert sorted(contacts[:, 0]) == pytest.approx(
        [CENTER[0] - HALF[0], CENTER[0] + HALF[0]], abs=1e-3
    )
    local = apply(np.linalg.inv(pose), contacts)
    assert local[0, 1] > 0 > local[1, 1]


def test_what_only_closed_tips_reach_is_touched_by_a_linkage_and_not_by_a_slide():
    top = CENTER + [0.0, 0.0, HALF[2]]
    linkage, slide = GRIPPERS
    pose = make_transform(DOWN, top + [0.0, 0.0, linkage.tip_advance / 2])[None]
    assert np.isfinite(expected_contacts(box_field(), pose, linkage)).all()
    assert np.isnan(expected_contacts(box_field(), pose, slide)).all()


def test_no_contacts_beside_things_within_them_and_without_grasps():
    beside = make_transform(DOWN, CENTER + [0.1, 0.0, 0.0])
    within = make_transform(DOWN, CENTER + [0.0, 0.0425, 0.0])  # a pad is in the box
    contacts = expected_contacts(box_field(), np.array([beside, within]), GRIPPERS[0])
    assert contacts.shape == (2, 2, 3) and np.isnan(contacts).all()
    nothing = expected_contacts(box_field(), np.zeros((0, 4, 4)), GRIPPERS[0])
    assert nothing.shape == (0, 2, 3)
