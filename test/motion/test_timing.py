# SPDX-License-Identifier: Apache-2.0
from types import SimpleNamespace

import numpy as np
import pytest
from ruckig import InputParameter

from neugrasp_ros.errors import MotionError, ShapeError
from neugrasp_ros.motion.limits import Trajectory, join_trajectories
from neugrasp_ros.motion.timing import calculate, time_line, time_points

NAMES = ("torso", "shoulder", "elbow")
LIMITS = SimpleNamespace(
    lower=np.array([0.0, -2.0, -3.0]),
    upper=np.array([0.35, 2.0, 3.0]),
    velocity=np.array([0.07, 1.95, 2.35]),
    acceleration=np.array([0.3, 4.0, 4.0]),
    jerk=np.array([3.0, 30.0, 30.0]),
)


def assert_inside_limits(motion: Trajectory) -> None:
    assert np.all(motion.positions >= LIMITS.lower - 1e-9)
    assert np.all(motion.positions <= LIMITS.upper + 1e-9)
    assert np.all(np.abs(motion.velocities) <= LIMITS.velocity)
    assert np.all(np.abs(motion.accelerations) <= LIMITS.acceleration)
    steps = np.diff(motion.times)[:, None]
    jerks = np.diff(motion.accelerations, axis=0) / steps
    assert np.all(np.abs(jerks) <= LIMITS.jerk * (1 + 1e-6))


def assert_consistent(motion: Trajectory) -> None:
    """Positions are the integral of velocities, those of accelerations."""
    steps = np.diff(motion.times)[:, None]
    mean_velocity = (motion.velocities[1:] + motion.velocities[:-1]) / 2
    drift = np.diff(motion.positions, axis=0) - steps * mean_velocity
    assert np.abs(drift).max() < 30.0 * steps.max() ** 3
    mean_acceleration = (motion.accelerations[1:] + motion.accelerations[:-1]) / 2
    drift = np.diff(motion.velocities, axis=0) - steps * mean_acceleration
    assert np.abs(drift).max() < 30.0 * steps.max() ** 2


@pytest.mark.parametrize("step", [0.02, 0.001])
def test_a_line_starts_and_ends_at_rest_inside_all_limits(step):
    start, goal = np.array([0.0, -1.0, 2.0]), np.array([0.3, 1.5, -2.5])

    motion = time_line(start, goal, LIMITS, NAMES, step=step)

    assert motion.positions[0] == pytest.approx(start)
    assert motion.positions[-1] == pytest.approx(goal)
    assert np.abs(motion.velocities[[0, -1]]).max() < 1e-9
    assert_inside_limits(motion)
    assert_consistent(motion)
    # 0.3 m at 0.07 m/s: the torso sets the pace
    assert 0.3 / 0.07 < motion.duration < 0.3 / 0.07 + 1.0


def test_a_line_is_straight_in_joint_space():
    start, goal = np.array([0.1, 0.0, 0.0]), np.array([0.12, 1.0, -1.0])
    motion = time_line(start, goal, LIMITS, NAMES)
    share = (motion.positions - start) / (goal - start)
    assert np.abs(share - share[:, :1]).max() < 1e-9


@pytest.mark.parametrize("seed", range(5))
def test_a_bent_path_keeps_every_limit(seed):
    rng = np.random.default_rng(seed)
    s = np.linspace(0, 1, 25)[:, None]
    wave = np.array([0.05, 0.8, 1.2]) * np.sin(rng.uniform(2, 9, 3) * s)
    points = np.array([0.15, 0.0, 0.0]) + wave

    motion = time_points(points, LIMITS, NAMES, step=0.004)

    assert_inside_limits(motion)
    assert_consistent(motion)
    assert motion.positions[0] == pytest.approx(points[0])
    assert motion.positions[-1] == pytest.approx(points[-1])


def test_a_bent_path_uses_one_of_its_limits():
    s = np.linspace(0, 1, 25)[:, None]
    points = np.array([0.1, 0.0, 0.0]) + np.hstack([0 * s, np.sin(6 * s), s])
    motion = time_points(points, LIMITS, NAMES, step=0.002)
    used = [
        np.max(np.abs(motion.velocities) / LIMITS.velocity),
        np.max(np.abs(motion.accelerations) / LIMITS.acceleration),
        np.max(
            np.abs(np.diff(motion.accelerations, axis=0))
            / np.diff(motion.times)[:, None]
            / LIMITS.jerk
        ),
    ]
    assert max(used) > 0.5


def test_the_path_goes_through_all_points():
    s = np.linspace(0, 1, 11)[:, None]
    points = np.array([0.1, 0.0, 0.0]) + np.hstack([0 * s, s**2, s])
    motion = time_points(points, LIMITS, NAMES, step=0.001)
    gaps = np.abs(motion.positions[:, None] - points[None]).max(axis=2).min(axis=0)
    assert gaps.max() < 5e-3


def test_no_way_is_no_motion():
    q = np.array([0.1, 0.2, 0.3])
    motion = time_line(q, q, LIMITS, NAMES)
    assert motion.duration > 0
    assert np.array_equal(motion.positions, np.stack([q, q]))
    assert not motion.velocities.any()


def test_a_path_out_of_the_limits_is_refused_by_joint():
    goal = np.array([0.1, 2.5, 0.0])
    with pytest.raises(MotionError, match=r"shoulder would be at 2\.5000"):
        time_line(np.array([0.1, 0.0, 0.0]), goal, LIMITS, NAMES)


def test_waypoints_never_reach_ruckig():
    request = InputParameter(1)
    request.target_position = [1.0]
    request.max_velocity = request.max_acceleration = request.max_jerk = [1.0]
    request.intermediate_positions = [[0.5]]
    with pytest.raises(MotionError, match="waypoints"):
        calculate(request)


def test_an_impossible_request_is_refused():
    request = InputParameter(1)
    request.target_position = [1.0]
    request.max_velocity = request.max_acceleration = [1.0]
    request.max_jerk = [-1.0]
    with pytest.raises(MotionError, match="Ruckig"):
        calculate(request)


def test_one_point_is_no_path():
    with pytest.raises(ShapeError, match="path points"):
        time_points(np.zeros((1, 3)), LIMITS, NAMES)


def test_joined_motions_follow_each_other():
    a, b, c = np.zeros(3), np.array([0.1, 0.5, 0.5]), np.array([0.0, 1.0, 0.0])
    first = time_line(a, b, LIMITS, NAMES)
    second = time_line(b, c, LIMITS, NAMES)
    whole = join_trajectories(first, second)
    assert whole.duration == pytest.approx(first.duration + second.duration)
    assert np.all(np.diff(whole.times) > 0)
    assert whole.positions[-1] == pytest.approx(c)
    assert_inside_limits(whole)


def test_motions_of_other_joints_do_not_join():
    motion = time_line(np.zeros(3), np.array([0.1, 0, 0]), LIMITS, NAMES)
    other = time_line(np.zeros(3), np.array([0.1, 0, 0]), LIMITS, ("a", "b", "c"))
    with pytest.raises(ShapeError, match="second trajectory"):
        join_trajectories(motion, other)


def test_arrays_must_fit():
    with pytest.raises(ShapeError, match="velocities"):
        Trajectory(
            NAMES, np.zeros(2), np.zeros((2, 3)), np.zeros((3, 3)), np.zeros((2, 3))
        )
