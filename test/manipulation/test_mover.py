# SPDX-License-Identifier: Apache-2.0
"""Motion of the real robot model at a table, every sample checked."""

import time
from dataclasses import replace

import numpy as np
import pytest

from neugrasp_ros.errors import CanceledError, MotionError, UnreachableError
from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.manipulation.mover import ArmMover, Surroundings
from neugrasp_ros.robot.attachment import CarriedBox, loaded_checker
from neugrasp_ros.robot.contact import FREE
from neugrasp_ros.robot.model import load_robot
from neugrasp_ros.robot.obstacles import SolidBox, make_obstacles
from neugrasp_ros.robot.reachability import Reach, ReachabilityChecker

TABLE = SolidBox(translation(0.63, 0.0, 0.685), np.array([0.6, 0.8, 0.03]))
AROUND = Surroundings(np.zeros((0, 3)), (TABLE,))
DOWN = np.diag([1.0, -1.0, -1.0, 1.0])


def down_at(x, y, z):
    T = DOWN.copy()
    T[:3, 3] = x, y, z
    return T


@pytest.fixture(scope="module")
def mover():
    return ArmMover(ReachabilityChecker(load_robot("tiago_dual")))


@pytest.fixture(scope="module")
def planned(mover):
    return mover.plan_grasp(mover.robot.home, down_at(0.55, 0.05, 0.78), AROUND)


def require_within_limits(mover, arm, motion):
    limits = mover.robot.limits.take(mover.robot.group_indices(arm))
    slack = 1.0 + 1e-6
    assert (motion.positions >= limits.lower - 1e-9).all()
    assert (motion.positions <= limits.upper + 1e-9).all()
    assert (np.abs(motion.velocities) <= limits.velocity * slack).all()
    assert (np.abs(motion.accelerations) <= limits.acceleration * slack).all()
    dt = np.diff(motion.times)[:, None]
    jerks = np.diff(motion.accelerations, axis=0) / dt
    assert (np.abs(jerks) <= limits.jerk * slack).all()
    assert np.abs(motion.velocities[[0, -1]]).max() < 1e-9


def require_free(mover, arm, motion):
    q = np.tile(mover.robot.home, (len(motion.times), 1))
    q[:, mover.robot.group_indices(arm)] = motion.positions
    obstacles = make_obstacles(boxes=AROUND.boxes)
    codes = mover.checker.collisions.codes(q, arm, obstacles)
    assert (codes == FREE).all()


def test_a_grasp_keeps_every_limit_and_touches_nothing(mover, planned):
    for motion in (
        planned.motion.transit, planned.motion.approach, planned.motion.lift
    ):  # fmt: skip
        require_within_limits(mover, planned.arm, motion)
        require_free(mover, planned.arm, motion)


def test_the_approach_is_straight_and_ends_at_the_grasp(mover, planned):
    kinematics = mover.checker.arms[planned.arm]
    hand = kinematics.forward(planned.motion.approach.positions)
    back = hand[:, :3, 3] - hand[-1, :3, 3]
    assert np.linalg.norm(hand[-1, :3, 3] - [0.55, 0.05, 0.78]) < 1e-3
    assert np.abs(back[:, :2]).max() < 1.5e-3, "straight down"
    assert back[0, 2] == pytest.approx(0.10, abs=2e-3)
    up = kinematics.forward(planned.motion.lift.positions)[:, 2, 3]
    assert up[-1] - up[0] == pytest.approx(0.10, abs=2e-3)


def test_from_the_lift_over_the_box_and_home(mover, planned):
    q = mover.robot.home.copy()
    columns = mover.robot.group_indices(planned.arm)
    q[columns] = planned.motion.lift.positions[-1]
    side = 1.0 if "left" in planned.arm else -1.0
    point = np.array([0.34, side * 0.62, 0.80])
    drop = mover.plan_drop(q, planned.arm, point, AROUND)
    require_within_limits(mover, planned.arm, drop)
    require_free(mover, planned.arm, drop)
    end = mover.checker.arms[planned.arm].forward(drop.positions[-1])[0]
    assert np.linalg.norm(end[:3, 3] - point) < 1.5e-3
    assert end[2, 2] < -0.9, "the hand hangs"
    q[columns] = drop.positions[-1]
    home = mover.plan_home(q, planned.arm, AROUND)
    require_free(mover, planned.arm, home)
    assert home.positions[-1] == pytest.approx(mover.robot.home[columns])


def test_a_hand_shifts_straight(mover):
    q, arm = mover.robot.home, "arm_left_torso"
    shift = np.array([0.05, 0.0, 0.0])
    motion = mover.plan_shift(q, arm, shift)
    require_within_limits(mover, arm, motion)
    hand = mover.checker.arms[arm].forward(motion.positions[[0, -1]])
    assert hand[1, :3, 3] - hand[0, :3, 3] == pytest.approx(shift, abs=2e-3)


def test_a_motion_may_leave_what_it_touches_and_not_run_into_it(mover):
    q, arm = mover.robot.home, "arm_left_torso"
    there = mover.plan_shift(q, arm, np.array([0.08, 0.0, 0.0]))
    back = replace(there, positions=there.positions[::-1])
    hand = mover.checker.arms[arm].forward(there.positions[-1:])[0]
    palm = hand.copy()
    palm[:3, 3] -= 0.09 * hand[:3, 2]
    wall = Surroundings(boxes=(SolidBox(palm, np.full(3, 0.01)),))
    assert not mover.leads_free(q, arm, there, wall)
    assert mover.leads_free(q, arm, back, wall)
    assert mover.leads_free(q, arm, there, Surroundings())


@pytest.mark.parametrize(
    ("where", "code", "words"),
    [
        ((1.8, 0.0, 0.8), Reach.NO_IK, "no arm posture"),
        ((0.55, 0.05, 0.68), Reach.SCENE_COLLISION, "hit the scene"),
    ],
)
def test_out_of_reach_is_refused_with_its_reason(mover, where, code, words):
    with pytest.raises(UnreachableError, match=words) as refused:
        mover.plan_grasp(mover.robot.home, down_at(*where), AROUND)
    assert refused.value.code == code
    with pytest.raises(UnreachableError, match="cannot hang"):
        mover.plan_drop(
            mover.robot.home, "arm_left_torso", np.array([2.0, 0, 1.0]), AROUND
        )


def test_points_of_a_taken_object_leave_with_it():
    points = np.array([[0.0, 0, 0], [0.05, 0, 0], [0.5, 0, 0]])
    left = Surroundings(points).without(np.zeros(3), 0.1).points
    assert left.tolist() == [[0.5, 0, 0]]


def test_what_is_carried_keeps_off_the_table_on_the_whole_way(mover, planned):
    stick = CarriedBox(np.array([0.0, 0.0, 0.06]), np.array([0.10, 0.03, 0.16]))
    q, arm = mover.robot.home.copy(), planned.arm
    columns = mover.robot.group_indices(arm)
    q[columns] = planned.motion.lift.positions[-1]
    side = 1.0 if "left" in arm else -1.0
    point = np.array([0.34, side * 0.62, 0.80])
    drop = mover.plan_drop(q, arm, point, AROUND, stick)
    loaded = loaded_checker(mover.checker.collisions, arm, stick)
    along = np.tile(q, (len(drop.times), 1))
    along[:, columns] = drop.positions
    codes = loaded.codes(along, arm, make_obstacles(boxes=AROUND.boxes))
    assert (codes == FREE).all()
    low = planned.motion.approach.positions[-1]
    assert mover.is_free(q, arm, low, AROUND)
    assert not mover.is_free(q, arm, low, AROUND, stick), "it stands in the table"


def test_points_of_what_is_carried_are_no_obstacles(mover):
    box = CarriedBox(np.array([0.0, 0.0, 0.05]), np.array([0.04, 0.04, 0.10]))
    hand = mover.hand_pose(mover.robot.home, "arm_left_torso")
    inside, beside = np.array([0.0, 0.0, 0.1, 1.0]), np.array([0.06, 0.0, 0.1, 1.0])
    points = np.array([hand @ inside, hand @ beside])[:, :3]
    left = Surroundings(points).without_box(hand, box).points
    assert left == pytest.approx(points[1:])


def test_all_searches_for_a_way_to_the_box_share_one_deadline(mover, monkeypatch):
    given, postures = [], np.zeros((50, 8))

    def search(q, arm, goal, around, carried, longest):
        given.append(longest)
        time.sleep(0.05)
        raise MotionError("the start is in collision")

    monkeypatch.setattr(mover, "plan_to", search)
    monkeypatch.setattr(mover, "_hanging", lambda *_: postures)
    monkeypatch.setattr(mover, "config", replace(mover.config, drop_time=0.3))
    ask = (mover.robot.home, "arm_left_torso", np.zeros(3), AROUND)
    with pytest.raises(MotionError, match="in collision"):
        mover.plan_drop(*ask)
    assert 1 <= len(given) <= 6
    assert given[0] <= 0.3 and given == sorted(given, reverse=True)
    given.clear()

    def stop():
        if len(given) == 2:
            raise CanceledError("stopped")

    monkeypatch.setattr(mover, "config", replace(mover.config, drop_time=30.0))
    with pytest.raises(CanceledError):
        mover.plan_drop(*ask, check_stop=stop)
    assert len(given) == 2
