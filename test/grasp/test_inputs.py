# SPDX-License-Identifier: Apache-2.0
from typing import Any

import numpy as np
import pytest
from field_shapes import EDGE, SIZE, field_of, grid_points, hand_at, random_hands
from scipy.spatial import cKDTree

from neugrasp_ros.geometry.grid import ScalarGrid
from neugrasp_ros.geometry.gripper import Gripper, load_gripper
from neugrasp_ros.geometry.transform import flip_gripper
from neugrasp_ros.grasp.hand_sweep import SWEEP_FEATURES
from neugrasp_ros.grasp.inputs import (
    DISTANCE_LIMIT,
    GRIPPER_FEATURES,
    LENGTH,
    POINT_FEATURES,
    TOKEN_FEATURES,
    LocalInputs,
    assemble_inputs,
    distinct_counts,
    gripper_features,
    hand_distances,
    mirror_inputs,
    observed_at,
    perturbed,
)

PANDA = load_gripper("panda")
CENTER = np.array([0.15, 0.15, 0.12])
SUPPORT = 0.05
SEEN = np.where(grid_points()[..., 1] > 0.16, np.float32(np.nan), np.float32(0.1))


def lopsided_field() -> ScalarGrid:
    """A ball and a post beside it: no symmetry that could hide a mix-up."""
    points = grid_points()
    ball = 0.03 - np.linalg.norm(points - CENTER, axis=-1)
    post = (np.array([0.012, 0.012, 0.03]) - np.abs(points - CENTER - 0.03)).min(-1)
    return field_of(np.maximum(ball, post))


@pytest.fixture(scope="module")
def field() -> ScalarGrid:
    return lopsided_field()


def inputs_of(field: ScalarGrid, poses: np.ndarray, **changes: Any) -> LocalInputs:
    settings: dict[str, Any] = {
        "distances": SEEN,
        "widths": np.full(len(poses), 0.07),
        "gripper": PANDA,
        "n_points": 96,
        "image_size": 20,
        "fov": np.deg2rad(120.0),
        "support_height": SUPPORT,
    } | changes
    return assemble_inputs(field, T_task_grippers=poses, **settings)[0]


def distance_to_box(point: np.ndarray, center: np.ndarray, half: np.ndarray) -> float:
    """Brute force: outside by the nearest point, inside by the nearest face."""
    nearest = np.clip(point, center - half, center + half)
    outside = float(np.linalg.norm(point - nearest))
    to_faces = float((half - np.abs(point - center)).min())
    return outside if outside > 0 else -to_faces


def test_distances_to_the_hand_are_those_to_its_boxes():
    rng = np.random.default_rng(0)
    low, high = [-0.02, -0.06, -0.1], [0.02, 0.06, 0.02]
    points = rng.uniform(low, high, (3, 60, 3)).astype(np.float32)
    widths = np.array([0.0, 0.03, 0.08])
    found = hand_distances(points, widths, PANDA)
    region = np.array([PANDA.finger_thickness, 0.0, PANDA.finger_depth]) / 2
    for g, width in enumerate(widths):
        centers, halves = PANDA.boxes(width)
        centers = [*centers, np.array([0, 0, -PANDA.finger_depth / 2])]
        halves = [*halves, region + [0, width / 2, 0]]
        for p, point in enumerate(points[g]):
            expected = [
                np.clip(distance_to_box(point, c, h), -DISTANCE_LIMIT, DISTANCE_LIMIT)
                for c, h in zip(centers, halves, strict=True)
            ]
            np.testing.assert_allclose(found[g, p], expected, atol=1e-6)
    assert (found < 0).any(axis=(0, 1)).all()  # inside of each was tried


def test_a_gripper_is_described_by_what_makes_it_different():
    panda, robotiq = (
        gripper_features(load_gripper(n)) for n in ("panda", "robotiq_2f85")
    )
    assert panda.shape == (GRIPPER_FEATURES,)
    assert (panda != robotiq).all()
    np.testing.assert_allclose(panda[0] * LENGTH, PANDA.max_opening)


def test_observed_means_near_a_surface_that_was_seen():
    distances = np.full((4, 4, 4), np.nan, dtype=np.float32)
    distances[0], distances[1], distances[2] = 0.5, -0.7, -0.2
    points = np.array(
        [[0.1, 0.5, 0.5], [0.3, 0.5, 0.5], [0.6, 0.5, 0.5], [0.9, 0.5, 9]]
    )
    assert observed_at(distances, points, 0.25).tolist() == [True, False, True, False]


def test_inputs_have_the_promised_shapes_and_are_finite(field):
    inputs = inputs_of(field, random_hands(CENTER, 5, np.random.default_rng(0)))
    assert inputs.points_task.shape == (5, 96, 3)
    assert inputs.point_features.shape == (5, 96, POINT_FEATURES)
    assert inputs.tokens.shape == (5, TOKEN_FEATURES)
    assert inputs.hits.shape == (5,)
    assert TOKEN_FEATURES == 4 + SWEEP_FEATURES + GRIPPER_FEATURES + 2
    for array in inputs[:3]:
        assert array.dtype == np.float32
        assert np.isfinite(array).all()


def test_points_in_the_task_frame_lie_on_the_surface(field):
    inputs = inputs_of(field, random_hands(CENTER, 5, np.random.default_rng(0)))
    assert (inputs.hits > 0).all()
    assert np.abs(field.sample(inputs.points_task.astype(np.float64))).max() < 0.05


def test_features_hold_position_normal_distances_and_whether_it_was_seen(field):
    hand = hand_at(CENTER, [0, 0, -1], [0, 1, 0])[None]
    inputs = inputs_of(field, hand)
    local = inputs.point_features[0, :, :3] * LENGTH
    x, y, z = local.T  # this hand: x = y cross z points along -x of the task frame
    task = CENTER + np.stack([-x, y, -z], axis=1)
    np.testing.assert_allclose(task, inputs.points_task[0], atol=1e-6)
    normals = inputs.point_features[0, :, 3:6]
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-3)
    expected = hand_distances(local[None], np.array([0.07]), PANDA)[0] / DISTANCE_LIMIT
    np.testing.assert_allclose(inputs.point_features[0, :, 6:10], expected, atol=1e-4)
    seen = inputs.point_features[0, :, 10]
    rows = np.floor(inputs.points_task[0, :, 1] / EDGE * SIZE)
    assert np.array_equal(seen, rows <= np.floor(0.16 / EDGE * SIZE - 0.5))
    assert inputs.tokens[0, -1] == pytest.approx(seen.mean())


def test_the_token_tells_gravity_height_and_opening(field):
    hand = hand_at(np.array([0.15, 0.15, 0.1]), [0, 0, -1], [0, 1, 0])[None]
    token = inputs_of(field, hand)[2][0]
    np.testing.assert_allclose(token[:3], [0, 0, 1], atol=1e-6)  # along the approach
    assert token[3] == pytest.approx((0.1 - SUPPORT) / LENGTH)
    assert token[4 + SWEEP_FEATURES] == pytest.approx(0.07 / LENGTH)


@pytest.mark.parametrize("change", ["max_opening", "finger_depth", "tip_advance"])
def test_another_gripper_is_another_input(field, change):
    values = {f: getattr(PANDA, f) for f in PANDA.__slots__}
    other = Gripper(**values | {change: values[change] + 0.01})
    hand = random_hands(CENTER, 1, np.random.default_rng(0))
    a, b = inputs_of(field, hand), inputs_of(field, hand, gripper=other)
    assert not np.array_equal(a.tokens, b.tokens) or not np.array_equal(
        a.point_features, b.point_features
    )


def test_twin_grasps_have_identical_inputs(field):
    poses = random_hands(CENTER, 8, np.random.default_rng(3))
    straight = hand_at(CENTER, [0, 0, -1], [1, 0, 0])[
        None
    ]  # a tie of the canonical one
    poses = np.concatenate([poses, straight])
    ours, twins = inputs_of(field, poses), inputs_of(field, flip_gripper(poses))
    for one, other in zip(ours, twins, strict=True):
        np.testing.assert_array_equal(one, other)


def test_inputs_are_left_alone(field):
    poses = random_hands(CENTER, 2, np.random.default_rng(0))
    kept = poses.copy(), field.values.copy(), SEEN.copy()
    inputs_of(field, poses)
    for now, then in zip((poses, field.values, SEEN), kept, strict=True):
        np.testing.assert_array_equal(now, then)


def test_threads_give_the_same(field):
    poses = random_hands(CENTER, 66, np.random.default_rng(1))
    for one, other in zip(
        inputs_of(field, poses), inputs_of(field, poses, threads=2), strict=True
    ):
        np.testing.assert_array_equal(one, other)


def test_mirroring_twice_changes_nothing(field):
    inputs = inputs_of(field, random_hands(CENTER, 4, np.random.default_rng(0)))
    mirrored = mirror_inputs(inputs)
    assert not np.array_equal(mirrored.point_features, inputs.point_features)
    assert not np.array_equal(mirrored.tokens, inputs.tokens)
    for one, other in zip(mirror_inputs(mirrored), inputs, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("tilt", [0.0, 0.6])
def test_a_mirrored_grasp_is_the_grasp_in_the_mirrored_scene(field, tilt):
    """The hand's x-z plane is the scene's middle, and the scene is mirrored at it."""
    hand = hand_at(CENTER + [0.0, 0.01, 0.0], [0, 1, -tilt], [-1, 0, 0])[None]
    settings = {"n_points": 1200}  # all that is seen, whatever the order
    here = mirror_inputs(inputs_of(field, hand, **settings))
    mirrored = ScalarGrid(field.values[::-1], field.spacing)
    there = inputs_of(mirrored, hand, distances=SEEN[::-1], **settings)
    count = int(here.hits[0])
    assert abs(count - int(there.hits[0])) <= 2  # rays that graze may differ
    np.testing.assert_allclose(there.tokens[:, :-2], here.tokens[:, :-2], atol=1e-4)
    tree = cKDTree(there.point_features[0, :, :3])
    gaps, nearest = tree.query(here.point_features[0, :count, :3])
    close = gaps < 1e-3
    assert close.mean() > 0.98
    np.testing.assert_allclose(
        there.point_features[0][nearest[close], 6:10],
        here.point_features[0, :count][close, 6:10],
        atol=5e-3,
    )
    cosines = (
        there.point_features[0][nearest[close], 3:6]
        * here.point_features[0, :count][close, 3:6]
    ).sum(axis=1)
    assert np.median(cosines) > 0.999


def test_a_grasp_of_nothing_has_no_hits_and_finite_inputs():
    empty = field_of(np.full((SIZE,) * 3, -1.0))
    inputs = inputs_of(empty, hand_at(CENTER, [0, 0, -1], [0, 1, 0])[None])
    assert inputs.hits.tolist() == [0]
    assert all(np.isfinite(array).all() for array in inputs)


def test_perturbed_inputs_lose_points_and_move_the_rest_a_little(field):
    inputs = inputs_of(field, random_hands(CENTER, 6, np.random.default_rng(0)))
    found = perturbed(inputs, np.random.default_rng(1), dropped=0.5, jitter=0.001)
    before, after = (distinct_counts(i.points_task) for i in (inputs, found))
    np.testing.assert_array_equal(before, np.minimum(inputs.hits, 96))
    assert (after <= before).all()
    assert 0.5 < (after / before).mean() < 0.95
    np.testing.assert_array_equal(found.tokens, inputs.tokens)
    for g, count in enumerate(after):
        known = {tuple(row) for row in inputs.points_task[g].tolist()}
        assert {tuple(row) for row in found.points_task[g].tolist()} <= known
        assert len(np.unique(found.point_features[g], axis=0)) == count
        rows = [inputs.points_task[g].tolist().index(p.tolist()) for p in
                found.points_task[g]]  # fmt: skip
        gap = found.point_features[g, :, :3] - inputs.point_features[g, rows, :3]
        assert 0 < np.abs(gap * LENGTH).max() < 0.006


def test_nothing_is_perturbed_by_nothing(field):
    inputs = inputs_of(field, random_hands(CENTER, 3, np.random.default_rng(0)))
    same = perturbed(inputs, np.random.default_rng(0), dropped=0.0, jitter=0.0)
    for one, other in zip(same, inputs, strict=True):
        np.testing.assert_array_equal(one, other)
