# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.geometry.transform import (
    apply,
    canonical_gripper,
    flip_gripper,
    invert,
    look_at,
    make_transform,
    pose_from,
    random_rotation,
    to_position_quaternion,
    translation,
)


def random_transforms(count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    rotations = np.stack([random_rotation(rng) for _ in range(count)])
    return make_transform(rotations, rng.normal(size=(count, 3)))


def level_hand(x_axis: list[float], approach: list[float]) -> np.ndarray:
    x, z = np.array(x_axis, dtype=float), np.array(approach, dtype=float)
    return make_transform(np.stack([x, np.cross(z, x), z], axis=-1), np.zeros(3))


def test_a_transform_and_its_inverse_cancel():
    T = random_transforms(5).reshape(5, 1, 4, 4)
    np.testing.assert_allclose(
        invert(T) @ T, np.broadcast_to(np.eye(4), T.shape), atol=1e-12
    )


def test_composition_is_associative_with_application():
    a, b = random_transforms(2)
    points = np.random.default_rng(1).normal(size=(7, 3))
    np.testing.assert_allclose(apply(a @ b, points), apply(a, apply(b, points)))


def test_a_batch_maps_each_set_of_points_with_its_own_transform():
    T = random_transforms(3)
    points = np.random.default_rng(2).normal(size=(3, 4, 3))
    for i in range(3):
        np.testing.assert_allclose(apply(T, points)[i], apply(T[i], points[i]))


def test_a_single_point_keeps_its_shape():
    T = translation(1.0, 2.0, 3.0)
    np.testing.assert_allclose(apply(T, np.array([0.5, 0.0, 0.0])), [1.5, 2.0, 3.0])


def test_applying_leaves_the_points_alone():
    points = np.ones((2, 3))
    apply(translation(1.0, 0.0, 0.0), points)
    assert (points == 1.0).all()


def test_points_of_another_width_are_rejected():
    with pytest.raises(
        ShapeError, match=r"expected shape \(\.\.\., N, 3\), got \(5, 2"
    ):
        apply(np.eye(4), np.zeros((5, 2)))


def test_random_rotations_are_proper_and_follow_the_seed():
    rotations = random_transforms(20)[:, :3, :3]
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)
    np.testing.assert_allclose(
        rotations @ rotations.transpose(0, 2, 1),
        np.broadcast_to(np.eye(3), rotations.shape),
        atol=1e-12,
    )
    assert np.array_equal(random_transforms(2, seed=4), random_transforms(2, seed=4))


def test_positions_and_quaternions_round_trip():
    T = random_transforms(6).reshape(2, 3, 4, 4)
    position, quaternion = to_position_quaternion(T)
    assert position.shape == (2, 3, 3)
    assert quaternion.shape == (2, 3, 4)
    np.testing.assert_allclose(pose_from(position, quaternion), T, atol=1e-12)


def test_quaternions_are_xyzw_and_need_not_be_unit():
    about_z = pose_from(np.zeros(3), np.array([0.0, 0.0, 3.0, 3.0]))
    np.testing.assert_allclose(about_z[:3, 0], [0, 1, 0], atol=1e-12)


def test_positions_are_copies():
    T = random_transforms(1)
    to_position_quaternion(T)[0][:] = 0.0
    assert np.abs(T[0, :3, 3]).min() > 0


def test_a_camera_looks_at_its_target_with_the_image_upright():
    eye, target = np.array([1.0, 1.0, 1.0]), np.array([0.0, 1.0, 0.0])
    T = look_at(eye, target)
    x, y, z = T[:3, :3].T
    np.testing.assert_allclose(z, np.array([-1, 0, -1]) / np.sqrt(2))
    np.testing.assert_allclose(x, [0, 1, 0], atol=1e-12)  # right of who looks along -x
    assert y[2] < 0  # image rows grow downwards
    np.testing.assert_allclose(np.linalg.det(T[:3, :3]), 1.0)
    np.testing.assert_allclose(T[:3, 3], eye)


def test_looking_straight_down_takes_x_from_the_parent():
    T = look_at(np.array([0.2, 0.3, 1.0]), np.array([0.2, 0.3, 0.0]))
    np.testing.assert_allclose(T[:3, :3], np.diag([1.0, -1.0, -1.0]), atol=1e-12)


def test_a_flip_turns_half_about_the_approach_and_undoes_itself():
    T = random_transforms(4)
    flipped = flip_gripper(T)
    half_turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    np.testing.assert_allclose(flipped, T @ half_turn)
    assert np.array_equal(flip_gripper(flipped), T)


def test_a_pose_and_its_twin_have_one_canonical_pose():
    T = random_transforms(50)
    canonical = canonical_gripper(T)
    assert np.array_equal(canonical, canonical_gripper(flip_gripper(T)))
    assert (canonical[:, 2, 0] <= 0).all()
    assert np.array_equal(canonical_gripper(canonical), canonical)


@pytest.mark.parametrize(
    ("x_axis", "approach"),
    [
        ([1, 0, 0], [0, 0, -1]),
        ([0, 1, 0], [0, 0, -1]),
        ([0.6, -0.8, 1e-12], [0, 0, -1]),
        ([0, -1, 0], [1, 0, 0]),
        ([1e-12, 1, -1e-12], [1, 0, 0]),
    ],
)
def test_ties_are_broken_alike_for_both_twins(x_axis, approach):
    T = level_hand(x_axis, approach)
    twin = flip_gripper(T)
    np.testing.assert_array_equal(canonical_gripper(T), canonical_gripper(twin))


def test_canonical_poses_of_a_single_transform_and_a_batch_agree():
    T = random_transforms(3)
    assert np.array_equal(canonical_gripper(T)[1], canonical_gripper(T[1]))
