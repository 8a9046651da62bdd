# SPDX-License-Identifier: Apache-2.0
from types import SimpleNamespace

import numpy as np
import pytest

from neugrasp_ros.errors import MotionError
from neugrasp_ros.motion.grasp_motion import plan_grasp
from neugrasp_ros.motion.planner import TransitConfig, TransitPlanner

NAMES = ("x", "y")
LIMITS = SimpleNamespace(
    lower=np.array([-1.0, -1.0]),
    upper=np.array([1.0, 1.0]),
    velocity=np.array([1.0, 0.5]),
    acceleration=np.array([4.0, 2.0]),
    jerk=np.array([30.0, 15.0]),
)
START = np.array([-0.9, -0.9])
APPROACH = np.linspace([0.0, 0.0], [0.1, 0.05], 11)
LIFT = np.linspace([0.1, 0.05], [0.1, 0.2], 11)


def test_each_motion_begins_at_rest_where_the_last_one_ends():
    planner = TransitPlanner(LIMITS, NAMES, lambda q: np.ones(len(q), dtype=bool))
    motion = plan_grasp(planner, START, APPROACH, LIFT, LIMITS, NAMES)
    parts = (motion.transit, motion.approach, motion.lift)
    assert motion.transit.positions[0] == pytest.approx(START)
    assert motion.lift.positions[-1] == pytest.approx(LIFT[-1])
    for before, after in zip(parts[:-1], parts[1:], strict=True):
        assert before.positions[-1] == pytest.approx(after.positions[0])
    for part in parts:
        assert np.abs(part.velocities[[0, -1]]).max() < 1e-9
        assert np.all(np.abs(part.velocities) <= LIMITS.velocity)
        assert np.all(np.abs(part.accelerations) <= LIMITS.acceleration)
    assert motion.duration == pytest.approx(sum(part.duration for part in parts))


def test_no_way_to_the_pregrasp_is_refused():
    planner = TransitPlanner(
        LIMITS, NAMES, lambda q: q[:, 0] < -0.5, TransitConfig(timeout=0.1)
    )
    with pytest.raises(MotionError, match="goal is in collision"):
        plan_grasp(planner, START, APPROACH, LIFT, LIMITS, NAMES)
