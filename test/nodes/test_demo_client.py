# SPDX-License-Identifier: Apache-2.0
"""What the demonstration's client decides without ROS running."""

from neugrasp_msgs.msg import Grasp, GraspArray

from neugrasp_ros.nodes.demo_client import (
    attempt_of,
    place_of,
    position_of,
    put_elsewhere_first,
)


def grasp(x: float, quality: float) -> Grasp:
    made = Grasp(id=f"at {x}", quality=quality)
    made.pose.position.x = x
    return made


def test_after_a_failure_another_place_comes_first() -> None:
    array = GraspArray(grasps=[grasp(0.1, 0.9), grasp(0.3, 0.8), grasp(0.12, 0.7)])
    put_elsewhere_first(array, [])
    assert [g.pose.position.x for g in array.grasps] == [0.1, 0.3, 0.12]
    put_elsewhere_first(array, [position_of(array.grasps[0])])
    assert [g.pose.position.x for g in array.grasps] == [0.3, 0.1, 0.12]


def test_the_place_of_an_attempt_is_that_of_the_grasp_carried_out() -> None:
    array = GraspArray(grasps=[grasp(0.1, 0.9), grasp(0.3, 0.8)])
    attempt = attempt_of(array.grasps[1], False, "MISSED")
    assert (attempt.quality, attempt.grasp) == (array.grasps[1].quality, "at 0.3")
    assert place_of(attempt, array).tolist() == [0.3, 0.0, 0.0]
