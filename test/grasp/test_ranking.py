# SPDX-License-Identifier: Apache-2.0
import numpy as np
from scipy.spatial.transform import Rotation

from neugrasp_ros.geometry.transform import flip_gripper, make_transform
from neugrasp_ros.grasp.ranking import distinct, quality_after_failures, spread


def turned(angle, x=0.0):
    rotation = Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()
    return make_transform(rotation, np.array([x, 0.0, 0.0]))


def test_near_copies_and_twins_leave_the_best():
    poses = np.stack([turned(0.0), turned(0.1), flip_gripper(turned(0.1, 0.005))])
    assert distinct(poses, np.array([0.1, 0.9, 0.5]), 0.02, 0.35).tolist() == [1]


def test_far_or_turned_grasps_stay_best_first():
    poses = np.stack([turned(0.0), turned(0.5), turned(0.0, 0.021)])
    kept = distinct(poses, np.array([0.1, 0.9, 0.5]), 0.02, 0.35)
    assert kept.tolist() == [1, 2, 0]


def test_every_region_gives_its_best_before_any_gives_its_second():
    positions = np.array([[0.01, 0, 0], [0.02, 0, 0], [0.03, 0, 0], [0.25, 0, 0]])
    scores = np.array([0.9, 0.8, 0.7, 0.1])
    assert spread(positions, scores, 0.1, 3).tolist() == [0, 3, 1]
    assert len(spread(positions, scores, 0.1, 9)) == 4


def test_nothing_spreads_to_nothing():
    assert len(spread(np.zeros((0, 3)), np.zeros(0), 0.1, 5)) == 0
    assert len(distinct(np.zeros((0, 4, 4)), np.zeros(0), 0.02, 0.3)) == 0


def test_every_failure_nearby_costs_quality():
    positions = np.array([[0.0, 0, 0], [0.05, 0, 0], [0.2, 0, 0]])
    quality = np.array([0.9, 0.95, 0.7])
    none = quality_after_failures(positions, quality, np.zeros((0, 3)))
    np.testing.assert_allclose(none, quality)
    one = quality_after_failures(positions, quality, np.array([[0.01, 0, 0]]))
    np.testing.assert_allclose(one, [0.6, 0.65, 0.7])
    two = quality_after_failures(positions, quality, np.array([[0.01, 0, 0]] * 2))
    np.testing.assert_allclose(two, [0.3, 0.35, 0.7])
    assert quality.tolist() == [0.9, 0.95, 0.7]
    nothing = quality_after_failures(np.zeros((0, 3)), np.zeros(0), positions[:1])
    assert nothing.size == 0
