# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from field_shapes import hand_at, random_hands, sphere_field

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.geometry.grid_skips import BLOCK
from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.geometry.transform import apply, invert, translation
from neugrasp_ros.grasp.local_view import (
    CROP_AHEAD,
    CROP_THICKNESS,
    crop_box,
    local_rays,
    render_local_views,
)

CENTER, RADIUS = np.array([0.15, 0.15, 0.15]), 0.025
FOV = np.deg2rad(120.0)
PANDA = load_gripper("panda")
SETTINGS = {"n_points": 128, "image_size": 20, "fov": FOV}


@pytest.fixture(scope="module")
def sphere():
    return sphere_field(CENTER, RADIUS)


@pytest.fixture(scope="module")
def hands():
    return random_hands(CENTER, 12, np.random.default_rng(0))


@pytest.fixture(scope="module")
def views(sphere, hands):
    return render_local_views(sphere, hands, PANDA, **SETTINGS)


def test_points_lie_on_the_sphere_within_a_third_of_a_millimetre(views, hands):
    outward = apply(hands, views.points) - CENTER
    radii = np.linalg.norm(outward, axis=-1)
    assert (views.hits > 20).all()
    assert np.abs(radii - RADIUS).max() < 3e-4


def test_points_lie_in_the_crop_box(views):
    low, high = crop_box(PANDA, FOV)
    assert (views.points >= low - 1e-5).all()
    assert (views.points <= high + 1e-5).all()
    assert high[2] == CROP_AHEAD
    assert high[0] == CROP_THICKNESS


def test_normals_point_out_of_the_sphere_in_the_hands_own_frame(views, hands):
    outward = views.points - apply(invert(hands), np.tile(CENTER, (12, 1, 1)))
    outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    cosines = np.einsum("gpi,gpi->gp", outward, views.normals)
    assert cosines.min() > 0.98
    assert cosines.mean() > 0.998


def test_each_finger_and_the_palm_see_their_side_of_a_thing_in_the_jaws(sphere):
    hand = hand_at(CENTER + [0, 0, -0.01], [0, 0, -1], [0, 1, 0])
    view = render_local_views(sphere, hand[None], PANDA, **SETTINGS)
    outward = view.normals[0, : view.hits[0]]
    assert (outward[:, 1] > 0.9).any()  # what the left finger, at +y, will touch
    assert (outward[:, 1] < -0.9).any()
    assert (outward[:, 2] < -0.9).any()  # what faces the palm


def test_what_lies_beyond_the_pad_tips_is_not_kept():
    ahead = sphere_field(CENTER - [0, 0, 0.05], RADIUS)  # 25 mm in front of the tips
    hand = hand_at(CENTER, [0, 0, -1], [0, 1, 0])
    view = render_local_views(ahead, hand[None], PANDA, **SETTINGS)
    assert view.hits[0] == 0
    assert not view.points.any()
    assert not view.normals.any()


def test_few_hits_repeat(hands, sphere):
    many = render_local_views(
        sphere, hands[:1], PANDA, n_points=3000, image_size=20, fov=FOV
    )
    count = many.hits[0]
    assert 0 < count <= 3 * 20**2
    np.testing.assert_array_equal(
        many.points[0, count : 2 * count], many.points[0, :count]
    )
    assert len(np.unique(many.points[0], axis=0)) <= count


def test_fewer_points_are_the_first_of_more(sphere, hands, views):
    fewer = render_local_views(sphere, hands, PANDA, **SETTINGS | {"n_points": 50})
    np.testing.assert_array_equal(fewer.points, views.points[:, :50])


def test_threads_give_the_same(sphere):
    hands = random_hands(CENTER, 70, np.random.default_rng(1))
    alone, shared = (
        render_local_views(sphere, hands, PANDA, **SETTINGS, threads=n) for n in (1, 3)
    )
    for one, other in zip(alone, shared, strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_view_moves_with_the_scene(hands, views):
    """Field and hands shifted together by whole blocks look the same."""
    shift = BLOCK * 0.3 / 64 * np.array([1.0, -1.0, 1.0])
    moved = render_local_views(
        sphere_field(CENTER + shift, RADIUS),
        translation(*shift) @ hands,
        PANDA,
        **SETTINGS,
    )
    np.testing.assert_array_equal(moved.hits, views.hits)
    np.testing.assert_allclose(moved.points, views.points, atol=1e-4)


@pytest.mark.parametrize("name", ["panda", "robotiq_2f85"])
def test_rays_have_a_true_field_of_view_and_see_the_whole_jaws(name):
    gripper = load_gripper(name)
    origins, directions = local_rays(gripper, 40, FOV)
    assert origins.shape == directions.shape == (3 * 40**2, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    palm, left, right = directions.reshape(3, -1, 3)
    half = FOV / 2
    assert np.arctan(np.abs(palm[:, 1] / palm[:, 2])).max() == pytest.approx(
        half, abs=0.03
    )
    palm_eye = origins[0]
    reach = (-gripper.finger_depth - palm_eye[2]) * np.tan(half)
    assert reach >= gripper.max_opening / 2
    for rays, side in ((left, 1), (right, -1)):
        assert (rays[:, 1] * side < 0).all()  # each looks at the other


def test_rays_are_their_own_mirror_image():
    origins, directions = local_rays(PANDA, 8, FOV)
    rays = np.concatenate([origins, directions], axis=1)
    mirrored = rays * [1, -1, 1, 1, -1, 1]
    gaps = np.abs(rays[:, None] - mirrored[None]).max(axis=-1)
    assert gaps.min(axis=1).max() < 1e-12


@pytest.mark.parametrize("shape", [(4, 4), (2, 3, 4)])
def test_poses_of_another_shape_are_rejected(sphere, shape):
    with pytest.raises(ShapeError, match=r"\(G, 4, 4\)"):
        render_local_views(sphere, np.zeros(shape), PANDA, **SETTINGS)
