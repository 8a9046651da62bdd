# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from neugrasp_ros.errors import SimulationError
from sim_bridge.robot_body import RobotBody
from sim_bridge.robot_cell import robot_setup


@pytest.fixture
def body(make_world, tiago):
    world = make_world(solver_iterations=50)
    T = np.eye(4)
    T[0, 3] = -2.0  # away from the table
    return world, RobotBody(world, robot_setup(tiago), T, tiago.home)


def hold(world, body, q, seconds=1.0):
    for _ in range(int(120 * seconds)):
        body.states()
        body.command(q, np.zeros(len(q)))
        world.step(2)
    return body.states()


def test_it_starts_where_it_is_put_and_holds_against_gravity(body, tiago):
    world, robot = body
    np.testing.assert_allclose(robot.states().positions, tiago.home, atol=1e-9)
    after = hold(world, robot, tiago.home, 0.5)
    np.testing.assert_allclose(after.positions, tiago.home, atol=0.01)
    assert np.abs(after.velocities).max() < 0.05


def test_jaws_close_together_and_stay_coupled(body, tiago):
    world, robot = body
    q = tiago.home.copy()
    tiago.set_opening(q, "left", 0.02)
    after = hold(world, robot, q)
    slides = [tiago.joint_names.index(n) for n in robot_setup(tiago).jaws["left"]]
    left, right = after.positions[slides]
    assert left + right == pytest.approx(0.02, abs=0.002)
    assert left == pytest.approx(right, abs=0.002)


def test_a_joint_that_the_description_lacks_is_named(make_world, tiago):
    setup = robot_setup(tiago)
    setup = replace(setup, joint_names=(*setup.joint_names, "tail_joint"))
    with pytest.raises(SimulationError, match="tail_joint"):
        RobotBody(make_world(), setup, np.eye(4), np.append(tiago.home, 0.0))


def test_what_it_does_not_touch_is_not_felt(body):
    world, robot = body
    world.step()
    assert robot.touches([world.table]) == []
