# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from sim_bridge.joint_drive import DriveLimits, Setpoint
from sim_bridge.limit_watch import LimitUse

LIMITS = DriveLimits(*(np.array(v) for v in ([-1.0], [1.0], [2.0], [4.0], [8.0])))


def point(position=0.0, velocity=0.0, acceleration=0.0, jerk=0.0):
    return Setpoint(*(np.array([v]) for v in (position, velocity, acceleration, jerk)))


def test_nothing_was_used_before_the_first_set_point():
    assert LimitUse() == (0.0, 0.0, 0.0, 0.0, 0)


@pytest.mark.parametrize(
    ("kind", "value", "used"),
    [
        ("position", 1.25, 0.25), ("position", -1.5, 0.5), ("position", 0.9, 0.0),
        ("velocity", -1.0, 0.5), ("acceleration", 8.0, 2.0), ("jerk", -8.0, 1.0),
    ],
)  # fmt: skip
def test_each_limit_has_its_own_share(kind, value, used):
    use = LimitUse().including(point(**{kind: value}), LIMITS)
    assert getattr(use, kind) == pytest.approx(used)
    assert use.samples == 1


def test_the_largest_share_stays():
    use = LimitUse().including(point(velocity=3.0), LIMITS)
    use = use.including(point(velocity=0.1, jerk=4.0), LIMITS)
    assert use == (0.0, 1.5, 0.0, 0.5, 2)
