# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.geometry.mesh import box_mesh
from neugrasp_ros.geometry.raycast import MeshScene
from neugrasp_ros.geometry.transform import look_at, translation

CUBE = box_mesh(np.full(3, 0.1))
CAMERA = Intrinsics(9, 7, 20.0, 20.0, 4.0, 3.0)
ABOVE = look_at(np.array([0.0, 0.0, 1.0]), np.zeros(3))


def cubes(*positions: tuple[float, float, float], ids=None) -> MeshScene:
    poses = np.stack([translation(*p) for p in positions])
    return MeshScene([CUBE] * len(positions), poses, ids)


def test_depth_of_a_plane_is_the_same_in_all_pixels():
    plane = MeshScene([box_mesh(np.array([2.0, 2.0, 0.05]))], np.eye(4)[None])
    depth = plane.depth(CAMERA, ABOVE)
    assert depth.dtype == np.float32
    np.testing.assert_allclose(depth, np.full((7, 9), 0.95), atol=1e-6)


def test_depth_of_a_tilted_plane_is_that_of_the_rays():
    T = look_at(np.array([0.5, 0.0, 0.8]), np.zeros(3))
    plane = MeshScene([box_mesh(np.array([9.0, 9.0, 0.05]))], np.eye(4)[None])
    rays = CAMERA.ray_directions() @ T[:3, :3].T
    expected = (0.05 - T[2, 3]) / rays[..., 2]
    np.testing.assert_allclose(plane.depth(CAMERA, T), expected, rtol=1e-5)


def test_depth_and_segmentation_of_a_box_cover_its_silhouette():
    scene = cubes((0.0, 0.0, 0.0), ids=[7])
    depth, bodies = scene.depth(CAMERA, ABOVE), scene.segmentation(CAMERA, ABOVE)
    u, v = np.meshgrid(np.arange(9) - 4.0, np.arange(7) - 3.0)
    inside = (np.abs(u) * 0.9 / 20 < 0.1) & (np.abs(v) * 0.9 / 20 < 0.1)
    np.testing.assert_allclose(depth[inside], 0.9, atol=1e-6)
    assert np.isnan(depth[~inside]).all()
    assert np.array_equal(bodies, np.where(inside, 7, -1))


def test_hits_tell_distance_in_units_of_the_direction_normal_and_body():
    scene = cubes((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), ids=[3, 5])
    origins = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, -1.0], [5.0, 5.0, 5.0]])
    directions = np.array([[0.0, 0.0, -2.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    hits = scene.cast(origins, directions)
    np.testing.assert_allclose(hits.distances, [0.45, 0.9, np.inf], rtol=1e-6)
    np.testing.assert_allclose(hits.normals[:2], [[0, 0, 1], [0, 0, -1]], atol=1e-6)
    assert hits.bodies.tolist() == [3, 5, -1]


def test_normals_face_a_ray_that_comes_from_inside():
    hits = cubes((0.0, 0.0, 0.0)).cast(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(hits.normals, [[-1.0, 0.0, 0.0]], atol=1e-6)


def test_overlapping_boxes_contain_their_union():
    scene = cubes((0.0, 0.0, 0.0), (0.1, 0.0, 0.0))
    x = np.array([-0.11, -0.09, -0.01, 0.05, 0.11, 0.19, 0.21])
    points = np.stack([x, np.full(7, 0.03), np.full(7, -0.02)], axis=1)
    assert scene.contains(points).tolist() == [False, *[True] * 5, False]


def test_random_points_are_contained_as_the_box_says():
    scene = cubes((0.3, 0.2, 0.1))
    points = np.random.default_rng(0).uniform(0.0, 0.6, (400, 3))
    expected = (np.abs(points - [0.3, 0.2, 0.1]) < 0.1).all(axis=1)
    assert expected.any()
    assert np.array_equal(scene.contains(points), expected)


def test_surface_samples_lie_on_the_outside_of_the_union():
    scene = cubes((0.0, 0.0, 0.0), (0.1, 0.0, 0.0), ids=[4, 6])
    points, normals, bodies = scene.sample_surface(2000, np.random.default_rng(0))
    middles = np.array([0.05, 0.0, 0.0]), np.array([0.15, 0.1, 0.1])  # of the union
    gap = np.abs(points - middles[0]) - middles[1]
    np.testing.assert_allclose(gap.max(axis=1), 0.0, atol=1e-6)
    outward = np.take_along_axis(
        np.sign(points - middles[0]) * normals, gap.argmax(axis=1)[:, None], axis=1
    )
    np.testing.assert_allclose(outward, 1.0)
    assert set(bodies.tolist()) == {4, 6}
    # of each cube one face in six is inside the other cube
    assert len(points) / 2000 == pytest.approx(5 / 6, abs=0.03)


def test_surface_samples_follow_the_seed():
    scene = cubes((0.0, 0.0, 0.0))
    first, second = (scene.sample_surface(9, np.random.default_rng(1)) for _ in "ab")
    assert np.array_equal(first[0], second[0])


def test_an_empty_scene_shows_contains_and_samples_nothing():
    empty = MeshScene([], np.zeros((0, 4, 4)))
    assert np.isnan(empty.depth(CAMERA, ABOVE)).all()
    assert (empty.segmentation(CAMERA, ABOVE) == -1).all()
    assert not empty.contains(np.zeros((2, 3))).any()
    points, normals, bodies = empty.sample_surface(5, np.random.default_rng(0))
    assert (points.shape, normals.shape, bodies.shape) == ((0, 3), (0, 3), (0,))


@pytest.mark.parametrize(
    ("poses", "ids", "told"),
    [
        (np.eye(4)[None], None, r"poses: expected shape \(2, 4, 4\), got \(1, 4, 4\)"),
        (np.eye(4), None, "poses"),
        (np.stack([np.eye(4)] * 2), [1], r"body_ids: expected shape \(2,\)"),
    ],
)
def test_meshes_poses_and_ids_must_agree(poses, ids, told):
    with pytest.raises(ShapeError, match=told):
        MeshScene([CUBE, CUBE], poses, ids)
