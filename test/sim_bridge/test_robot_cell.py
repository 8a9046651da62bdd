# SPDX-License-Identifier: Apache-2.0
import numpy as np

from neugrasp_ros.geometry.transform import apply, invert
from sim_bridge.furniture import FURNITURE
from sim_bridge.robot_cell import (
    PLACE_SPREAD,
    TORSO_SPREAD,
    StanceRule,
    draw_stance,
    robot_controllers,
    robot_setup,
)

FIXED, DRAWN = StanceRule(), StanceRule(random_view=True)


def test_without_a_draw_the_robot_stands_as_told_and_looks_at_the_middle(tiago):
    stance = draw_stance(tiago, FURNITURE["shelf"], 5, FIXED)
    np.testing.assert_allclose(stance.T_base_world[:3, 3], [0.4, -0.15, 0.75])
    assert stance.q[tiago.joint_names.index("torso_lift_joint")] == FIXED.torso
    T = tiago.frame_pose(stance.q, FIXED.camera_frame)
    x, y, z = apply(invert(T), np.array([0.55, 0.0, 0.80]))
    assert z > 0.3 and abs(x / z) < 1e-3 and abs(y / z) < 1e-3


def test_a_drawn_stance_depends_on_the_seed_only_and_keeps_its_range(tiago):
    column = tiago.joint_names.index("torso_lift_joint")
    drawn = [draw_stance(tiago, FURNITURE["table"], s, DRAWN) for s in range(12)]
    again = draw_stance(tiago, FURNITURE["table"], 3, DRAWN)
    np.testing.assert_array_equal(again.q, drawn[3].q)
    places = np.array([stance.T_base_world[:2, 3] for stance in drawn])
    torsos = np.array([stance.q[column] for stance in drawn])
    assert np.abs(places - FIXED.place).max() <= PLACE_SPREAD
    assert TORSO_SPREAD[0] <= torsos.min() < torsos.max() <= TORSO_SPREAD[1]
    assert len(np.unique(places, axis=0)) == 12


def test_every_joint_of_a_group_has_one_controller_with_the_robots_limits(tiago):
    controllers, limits = robot_controllers(tiago)
    driven = [joint for joints in controllers.values() for joint in joints]
    groups = tiago.description.groups.values()
    assert len(driven) == len(set(driven))
    assert {joint for group in groups for joint in group.joints} <= set(driven)
    arm = limits["arm_left_controller"]
    rows = [tiago.joint_names.index(j) for j in controllers["arm_left_controller"]]
    np.testing.assert_array_equal(arm.velocity, tiago.limits.velocity[rows])
    assert set(limits) == set(controllers)


def test_the_setup_names_only_joints_of_the_description(tiago):
    setup = robot_setup(tiago)
    assert setup.joint_names == tiago.joint_names
    assert set(setup.jaws) == set(setup.carriages) == set(tiago.grippers)
    for slides in setup.jaws.values():
        assert set(slides) <= set(setup.joint_names)
    for carriage in setup.carriages.values():
        assert f'"{carriage}"' in setup.urdf
