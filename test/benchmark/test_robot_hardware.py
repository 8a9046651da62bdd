# SPDX-License-Identifier: Apache-2.0
"""The simulated robot without ROS: it moves, senses, looks, and says what is wrong."""

import numpy as np
import pytest

from neugrasp_ros.benchmark.robot_figures import LARGEST_FORCE
from neugrasp_ros.benchmark.robot_hardware import GOAL_TOLERANCE, SimulatedRobot
from neugrasp_ros.errors import MotionError
from neugrasp_ros.geometry.transform import invert, translation
from neugrasp_ros.manipulation.executor import GraspExecutor, GraspOutcome
from neugrasp_ros.manipulation.mover import ArmMover
from neugrasp_ros.manipulation.settings import MoverConfig
from neugrasp_ros.motion.limits import Trajectory
from neugrasp_ros.motion.timing import time_line
from neugrasp_ros.robot.collision import CollisionChecker
from neugrasp_ros.robot.model import load_robot
from neugrasp_ros.robot.reachability import ReachabilityChecker
from sim_bridge.bridge_world import BridgeScenes
from sim_bridge.furniture import BINS
from sim_bridge.robot_cell import StanceRule

pytestmark = pytest.mark.filterwarnings("ignore:Gimbal lock")

ARM = "arm_left_torso"
TABLE_TOP = 0.70


@pytest.fixture(scope="module")
def tiago():
    return load_robot("tiago_dual")


@pytest.fixture(scope="module")
def robot(tiago):
    robot = SimulatedRobot(tiago, CollisionChecker(tiago), BridgeScenes(), StanceRule())
    yield robot
    robot.close()


def move(tiago, robot, change, group=ARM):
    """Return a motion of a group's joints by a change (n,) at a share of its speed."""
    columns = tiago.group_indices(group)
    start = robot.configuration()[columns]
    limits, names = tiago.limits.take(columns), tiago.description.groups[group].joints
    return time_line(start, start + change, limits, names)


def test_joints_go_where_a_motion_ends(tiago, robot):
    robot.spawn("table", 1, 0)
    change = np.zeros(8)
    change[1:3] = 0.2, -0.1
    motion, before = move(tiago, robot, change), robot.world.now
    robot.follow(ARM, motion)
    assert robot.world.now - before >= motion.duration
    measured = robot.configuration()[tiago.group_indices(ARM)]
    assert np.abs(measured - motion.positions[-1]).max() < GOAL_TOLERANCE
    assert robot.motions == 1


def test_a_joint_without_controller_is_refused(robot):
    values = np.zeros((2, 1))
    motion = Trajectory(("tail",), np.array([0.0, 1.0]), values, values, values)
    with pytest.raises(MotionError, match="no controller for tail"):
        robot.follow(ARM, motion)


def test_jaws_open_and_close(tiago, robot):
    robot.spawn("table", 1, 0)
    for wanted in (0.08, 0.04, 0.0):
        robot.move_jaws("left", wanted)
        assert robot.opening("left") == pytest.approx(wanted, abs=2e-3)
    assert robot.opening("right") == pytest.approx(
        tiago.grippers["right"].max_opening, abs=2e-3
    )


def test_an_arm_that_is_held_up_stops_and_says_so(tiago, robot):
    robot.spawn("table", 1, 0)
    T = robot.world.snapshot.robot.stance.T_base_world
    change = np.zeros(8)
    change[1] = -0.9 if robot.configuration()[tiago.group_indices(ARM)][1] > 0 else 0.9
    end = robot.configuration()
    end[tiago.group_indices(ARM)] += change
    hand = tiago.frame_pose(end, "gripper_left_tcp")[:3, 3]

    def block() -> None:
        world = robot.world._world
        world.load_box(np.full(3, 0.08), invert(T) @ translation(*hand))

    robot.world.do(block).result()
    with pytest.raises(MotionError, match="a joint is .* behind"):
        robot.follow(ARM, move(tiago, robot, change))
    before = robot.configuration()
    robot.world.advance(0.5)
    assert np.abs(robot.configuration() - before).max() < 0.05, "it stands"


def test_it_sees_objects_and_not_itself(robot):
    robot.spawn("table:packed", 3, 3)
    around = robot.surroundings()
    above = around.points[around.points[:, 2] > TABLE_TOP + 0.01]
    assert len(above) > 50
    snapshot = robot.world.snapshot
    T = snapshot.robot.stance.T_base_world
    places = np.array([(T @ pose)[:3, 3] for pose in snapshot.poses])
    gaps = np.linalg.norm(above[:, None] - places[None], axis=2).min(axis=1)
    assert gaps.max() < 0.2
    assert len(around.boxes) == 1 + 4 + len(BINS), "table top, legs and both bins"


def test_every_look_is_a_scene_of_its_own(robot):
    first, second = robot.look(), robot.look()
    assert second.revision == first.revision + 1 and robot.newest is second


def test_an_object_taken_away_has_moved_if_its_scene_is_known(robot):
    robot.spawn("table:packed", 3, 1)
    T = robot.world.snapshot.robot.stance.T_base_world
    grasp = np.diag([1.0, -1.0, -1.0, 1.0])
    grasp[:3, 3] = (T @ robot.world.snapshot.poses[0])[:3, 3]
    robot.seen_in = None
    assert not robot.has_moved(grasp)
    robot.seen_in = robot.look()
    assert not robot.has_moved(grasp)
    put(robot, (T @ robot.world.snapshot.poses[0])[:3, 3] + [0.0, 0.09, 0.0])
    assert robot.has_moved(grasp)
    robot.seen_in = None


def put(robot, place):
    """Move the one object to a place in the base frame."""
    T = robot.world.snapshot.robot.stance.T_base_world

    def work() -> None:
        world = robot.world._world
        (body,) = world.object_ids
        pose = world.pose(body)
        pose[:3, 3] = (invert(T) @ [*place, 1.0])[:3]
        world.set_pose(body, pose)

    robot.world.do(work).result()
    robot.world.advance(0.05)


def test_what_lies_in_a_bin_is_cleared(robot):
    (name,) = robot.spawn("table:packed", 3, 1)
    assert robot.cleared() == set()
    x, y, rim = BINS["left"].center
    put(robot, (x, y, rim - 0.1))
    assert robot.cleared() == {name}
    put(robot, (x, y, rim + 0.15))
    assert robot.cleared() == set()


def test_a_quiet_round_has_no_mishap(robot):
    robot.spawn("table", 1, 0)
    robot.world.advance(0.2)
    mishap = robot.mishap()
    assert mishap.force == 0.0 and mishap.link == ""
    assert mishap.limits["samples"] == 0


@pytest.mark.slow
def test_jaws_that_close_on_nothing_do_not_press_on_the_table(tiago, robot):
    robot.spawn("table", 1, 0)
    low = np.diag([1.0, -1.0, -1.0, 1.0])
    low[:3, 3] = 0.55, 0.1, TABLE_TOP + 0.006  # closing takes the tips 13 mm down
    mover = ArmMover(ReachabilityChecker(tiago), MoverConfig(timeout=30.0))
    outcome = GraspExecutor(mover, robot).execute(low, width=0.085)
    assert outcome.kind is GraspOutcome.MISSED, outcome.message
    assert robot.mishap().force < LARGEST_FORCE
