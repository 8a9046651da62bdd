# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_ros.errors import ConfigError  # noqa: E402
from neugrasp_ros.nodes.trajectories import (  # noqa: E402
    Points,
    from_joint_trajectory,
    to_duration,
    to_joint_trajectory,
    to_seconds,
)

NAMES = ("a", "b")
POINTS = Points(
    np.array([0.0, 0.5]),
    np.array([[0.1, 0.2], [0.3, 0.4]]),
    np.array([[0.0, 0.0], [1.0, 2.0]]),
    np.array([[5.0, 6.0], [7.0, 8.0]]),
)


def test_points_come_back_in_the_controllers_order():
    message = to_joint_trajectory(NAMES, POINTS)
    for kept, sent in zip(from_joint_trajectory(message, NAMES), POINTS, strict=True):
        assert kept == pytest.approx(sent)
    turned = from_joint_trajectory(message, ("b", "a"))
    assert turned.positions == pytest.approx(POINTS.positions[:, ::-1])


def test_what_a_message_leaves_out_is_none():
    message = to_joint_trajectory(NAMES, POINTS)
    for point in message.points:
        point.velocities, point.accelerations = [], []
    assert from_joint_trajectory(message, NAMES)[2:] == (None, None)


def test_bad_messages_are_refused():
    message = to_joint_trajectory(NAMES, POINTS)
    with pytest.raises(ConfigError, match="expected the joints"):
        from_joint_trajectory(message, ("a", "c"))
    message.points[1].velocities = [1.0]
    with pytest.raises(ConfigError, match="velocities: expected 2 numbers"):
        from_joint_trajectory(message, NAMES)
    message.points = []
    with pytest.raises(ConfigError, match="no points"):
        from_joint_trajectory(message, NAMES)


@pytest.mark.parametrize("field", ["positions", "velocities", "accelerations"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_refused(field, value):
    message = to_joint_trajectory(NAMES, POINTS)
    setattr(message.points[1], field, [0.1, value])
    with pytest.raises(ConfigError, match=f"{field}: expected finite numbers"):
        from_joint_trajectory(message, NAMES)


def test_durations():
    assert to_seconds(to_duration(1.25)) == 1.25
    assert to_duration(0.9999999999).sec == 1
