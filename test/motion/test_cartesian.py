# SPDX-License-Identifier: Apache-2.0
from types import SimpleNamespace

import numpy as np
import pytest

from neugrasp_ros.errors import MotionError
from neugrasp_ros.motion.cartesian import line_poses, move_straight

LENGTHS = (0.5, 0.4)
NAMES = ("shoulder", "elbow")
LIMITS = SimpleNamespace(
    lower=np.array([-3.0, 0.1]),
    upper=np.array([3.0, 3.0]),
    velocity=np.array([2.0, 2.0]),
    acceleration=np.array([4.0, 4.0]),
    jerk=np.array([30.0, 30.0]),
)


def tip(q):
    """Position of a planar arm's tip, (..., 2)."""
    a, b = LENGTHS
    x = a * np.cos(q[..., 0]) + b * np.cos(q[..., 0] + q[..., 1])
    y = a * np.sin(q[..., 0]) + b * np.sin(q[..., 0] + q[..., 1])
    return np.stack([x, y], axis=-1)


def follow(poses, q):
    """Closed-form inverse kinematics, elbow on one side; stops out of reach."""
    del q
    a, b = LENGTHS
    path = []
    for x, y in poses[:, :2, 3]:
        cosine = (x * x + y * y - a * a - b * b) / (2 * a * b)
        if abs(cosine) > 1:
            break
        elbow = np.arccos(cosine)
        shoulder = np.arctan2(y, x) - np.arctan2(
            b * np.sin(elbow), a + b * np.cos(elbow)
        )
        path.append([shoulder, elbow])
    return np.array(path).reshape(-1, 2)


def pose_at(q):
    T = np.eye(4)
    T[:2, 3] = tip(q)
    return T


START = np.array([-0.4, 1.6])


def test_poses_are_evenly_spaced_and_end_at_the_shift():
    shift = np.array([0.0, 0.07, 0.0])
    poses = line_poses(pose_at(START), shift, spacing=0.01)
    assert len(poses) == 7
    assert poses[-1, :3, 3] == pytest.approx(pose_at(START)[:3, 3] + shift)
    steps = np.diff(poses[:, :3, 3], axis=0)
    assert np.linalg.norm(steps, axis=1) == pytest.approx(0.01)
    assert np.array_equal(poses[:, :3, :3], np.repeat(np.eye(3)[None], 7, axis=0))


def test_the_tip_stays_within_a_millimetre_of_the_line():
    poses = line_poses(pose_at(START), np.array([0.1, 0.12, 0.0]))
    motion = move_straight(START, poses, follow, LIMITS, NAMES)
    line = poses[-1, :2, 3] - tip(START)
    direction = line / np.linalg.norm(line)
    way = tip(motion.positions) - tip(START)
    aside = way - np.outer(way @ direction, direction)
    assert np.linalg.norm(aside, axis=1).max() < 1e-3
    assert way[-1] == pytest.approx(line, abs=1e-6)
    assert np.all(np.diff(way @ direction) >= -1e-9)


def test_the_motion_keeps_all_limits():
    poses = line_poses(pose_at(START), np.array([0.2, 0.2, 0.0]))
    motion = move_straight(START, poses, follow, LIMITS, NAMES)
    assert np.all(np.abs(motion.velocities) <= LIMITS.velocity)
    assert np.all(np.abs(motion.accelerations) <= LIMITS.acceleration)
    jerks = np.diff(motion.accelerations, axis=0) / np.diff(motion.times)[:, None]
    assert np.all(np.abs(jerks) <= LIMITS.jerk * (1 + 1e-6))
    assert np.abs(motion.velocities[[0, -1]]).max() < 1e-9


def test_a_line_out_of_reach_is_refused_with_how_far_it_went():
    poses = line_poses(pose_at(START), np.array([1.0, 0.0, 0.0]))
    with pytest.raises(MotionError, match=r"follows the line for \d+ of 100 poses"):
        move_straight(START, poses, follow, LIMITS, NAMES)


def test_a_line_in_collision_is_refused_with_where():
    poses = line_poses(pose_at(START), np.array([0.1, 0.0, 0.0]))

    def is_free(q):
        return tip(q)[:, 0] < tip(START)[0] + 0.045

    with pytest.raises(MotionError, match="pose 5 of 11"):
        move_straight(START, poses, follow, LIMITS, NAMES, is_free=is_free)
