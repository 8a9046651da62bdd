# SPDX-License-Identifier: Apache-2.0
"""What the demonstration's client decides without ROS running."""

from neugrasp_msgs.msg import Grasp, GraspArray

from neugrasp_ros.nodes.demo_client import position_of, put_elsewhere_first


def grasp(x: float, quality: float) -> Grasp:
    made = Grasp(quality=quality)
    made.pose.position.x = x
    return made


def test_after_a_failure_another_place_comes_first() -> None:
    array = GraspArray(grasps=[grasp(0.1, 0.9), grasp(0.3, 0.8), grasp(0.12, 0.7)])
    put_elsewhere_first(array, [])
    assert [g.pose.position.x for g in array.grasps] == [0.1, 0.3, 0.12]
    put_elsewhere_first(array, [position_of(array.grasps[0])])
    assert [g.pose.position.x for g in array.grasps] == [0.3, 0.1, 0.12]
