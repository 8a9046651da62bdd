# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from neugrasp_ros.geometry.mesh import box_mesh
from neugrasp_ros.geometry.raycast import MeshScene
from neugrasp_ros.grasp.hypotheses import (
    choose_seeds,
    facing_contacts,
    hands_around,
    hands_onto,
    rotation_matrices,
    thin,
)

RNG_SEED = 3


@pytest.fixture
def rng():
    return np.random.default_rng(RNG_SEED)


def test_thinning_keeps_one_point_per_voxel(rng):
    points = rng.random((5000, 3))
    kept = thin(points, 0.25, rng)
    assert len(kept) == 64
    assert len(np.unique(np.floor(points[kept] / 0.25), axis=0)) == 64


def test_a_small_object_far_away_gets_a_seed(rng):
    points = np.concatenate([rng.random((3000, 3)), [[5.0, 5.0, 5.0]]])
    seeds = choose_seeds(points, 16, rng)
    assert len(set(seeds.tolist())) == 16
    assert 3000 in seeds


def test_contacts_of_a_slab_face_each_other_across_it(rng):
    scene = MeshScene([box_mesh(np.array([0.05, 0.05, 0.01]))], np.eye(4)[None])
    points, normals, _ = scene.sample_surface(6000, rng)
    cloud = np.concatenate([points, normals], axis=1)
    top = np.flatnonzero((normals[:, 2] > 0.9) & (np.abs(points[:, :2]) < 0.03).all(1))
    pairs = facing_contacts(cloud, top[:40], 0.08, 0.006, 0.5)
    assert len(pairs.seeds) == 40
    assert np.abs(pairs.middles[:, 2]).max() < 1e-9
    assert pairs.axes[:, 2].max() < -0.9
    assert np.abs(pairs.distances - 0.02).max() < 2e-3
    assert not len(facing_contacts(cloud, top[:40], 0.015, 0.006, 0.5).seeds)


def test_hands_around_an_axis_close_along_it_from_everywhere(rng):
    axes = np.array([[0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    poses = hands_around(np.zeros((2, 3)), axes, 12, rng)
    assert poses.shape == (2, 12, 4, 4)
    np.testing.assert_allclose(poses[..., :3, 1], np.repeat(axes[:, None], 12, 1))
    np.testing.assert_allclose(np.linalg.det(poses[..., :3, :3]), 1.0)
    steps = np.einsum(
        "kij,kij->ki", poses[:, :, :3, 2], np.roll(poses, 1, 1)[..., :3, 2]
    )
    np.testing.assert_allclose(steps, np.cos(np.pi / 6))


def test_hands_onto_a_point_approach_against_its_normal(rng):
    normal = np.array([[0.48, 0.6, 0.64]])
    tilts = np.array([[0.0, 0.0, 0.0], [0.0, 0.3, 0.0]])
    poses = hands_onto(np.array([[0.1, 0.2, 0.3]]), normal, tilts, 6, rng)
    assert poses.shape == (1, 12, 4, 4)
    cosines = -poses[0, :, :3, 2] @ normal[0]
    np.testing.assert_allclose(cosines.reshape(6, 2), [[1.0, np.cos(0.3)]] * 6)
    np.testing.assert_allclose(poses[0, :, :3, 3], [[0.1, 0.2, 0.3]] * 12)
    np.testing.assert_allclose(np.linalg.det(poses[0, :, :3, :3]), 1.0)


def test_rotation_vectors_become_matrices(rng):
    vectors = np.concatenate([rng.normal(size=(20, 3)), np.zeros((1, 3))])
    expected = Rotation.from_rotvec(vectors).as_matrix()
    np.testing.assert_allclose(rotation_matrices(vectors), expected, atol=1e-12)
