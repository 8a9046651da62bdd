# SPDX-License-Identifier: Apache-2.0
from types import SimpleNamespace

import numpy as np
import pytest

from neugrasp_ros.errors import ConfigError, MotionError
from neugrasp_ros.motion.planner import TransitConfig, TransitPlanner

NAMES = ("x", "y")
LIMITS = SimpleNamespace(
    lower=np.array([-1.0, -1.0]),
    upper=np.array([1.0, 1.0]),
    velocity=np.array([1.0, 0.5]),
    acceleration=np.array([4.0, 2.0]),
    jerk=np.array([30.0, 15.0]),
)
START, GOAL = np.array([-0.8, 0.0]), np.array([0.8, 0.0])


def wall(q):
    """A wall at x = 0 with a gap above y = 0.5."""
    return ~((np.abs(q[:, 0]) < 0.1) & (q[:, 1] < 0.5))


def inner_wall(q):
    """The wall less what can be cut between two checked postures."""
    return ~((np.abs(q[:, 0]) < 0.08) & (q[:, 1] < 0.48))


def nowhere(q):
    """A wall without a gap."""
    return np.abs(q[:, 0]) > 0.1


def everywhere(q):
    return np.ones(len(q), dtype=bool)


def between(points):
    share = np.linspace(0, 1, 400)[:, None]
    legs = zip(points[:-1], points[1:], strict=True)
    return np.concatenate([a + share * (b - a) for a, b in legs])


def test_free_space_needs_no_search():
    points = TransitPlanner(LIMITS, NAMES, everywhere).plan(START, GOAL)
    assert np.array_equal(points, np.stack([START, GOAL]))


@pytest.mark.parametrize("side", [1, -1])
def test_the_way_leads_through_the_gap(side):
    planner = TransitPlanner(LIMITS, NAMES, wall)
    ends = np.stack([START, GOAL])[::side]
    points = planner.plan(*ends)[::side]
    assert np.array_equal(points[0], START)
    assert np.array_equal(points[-1], GOAL)
    assert inner_wall(between(points)).all()
    assert np.all((points >= LIMITS.lower) & (points <= LIMITS.upper))


def test_the_motion_is_free_and_inside_all_limits():
    motion = TransitPlanner(LIMITS, NAMES, wall).move(START, GOAL, step=0.005)
    assert motion.positions[0] == pytest.approx(START)
    assert motion.positions[-1] == pytest.approx(GOAL)
    assert inner_wall(motion.positions).all()
    assert np.all(np.abs(motion.velocities) <= LIMITS.velocity)
    assert np.all(np.abs(motion.accelerations) <= LIMITS.acceleration)
    jerks = np.diff(motion.accelerations, axis=0) / np.diff(motion.times)[:, None]
    assert np.all(np.abs(jerks) <= LIMITS.jerk * (1 + 1e-6))


def test_rounded_corners_stay_near_the_way_and_meet_its_ends():
    planner = TransitPlanner(LIMITS, NAMES, everywhere)
    points = np.array([START, [0.0, 0.8], GOAL])
    curve = planner.round_corners(points)
    s = np.linspace(0, 1, 1000)
    assert curve(0.0) == pytest.approx(START)
    assert curve(1.0) == pytest.approx(GOAL)
    gaps = np.abs(curve(s)[:, None] - between(points)[None]).max(axis=2).min(axis=1)
    assert gaps.max() < 0.12  # one corner's worth of way
    slopes = curve(s, nu=1)
    turn = np.diff(np.arctan2(slopes[:, 1], slopes[:, 0]))
    assert np.abs(turn).max() < 0.2  # no corner left


def test_a_start_or_goal_in_collision_is_refused():
    planner = TransitPlanner(LIMITS, NAMES, wall)
    with pytest.raises(MotionError, match="goal is in collision"):
        planner.plan(START, np.array([0.0, 0.0]))
    with pytest.raises(MotionError, match="start is in collision"):
        planner.plan(np.array([0.0, 0.0]), GOAL)


def test_an_end_outside_the_limits_is_refused_by_joint():
    planner = TransitPlanner(LIMITS, NAMES, everywhere)
    with pytest.raises(MotionError, match="goal has y outside"):
        planner.plan(START, np.array([0.0, 1.5]))


def test_no_way_is_said_in_time():
    planner = TransitPlanner(LIMITS, NAMES, nowhere, TransitConfig(timeout=0.2))
    with pytest.raises(MotionError, match="no free way found in 0.2 s"):
        planner.plan(START, GOAL)


def test_absurd_options_are_refused():
    with pytest.raises(ConfigError, match="timeout"):
        TransitConfig(timeout=-1.0)
