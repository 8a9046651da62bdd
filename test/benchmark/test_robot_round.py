# SPDX-License-Identifier: Apache-2.0
"""How rounds go and end, with a robot that only writes down what it is told."""

from types import SimpleNamespace

import numpy as np
import pytest

from neugrasp_ros.benchmark.robot_detection import Found
from neugrasp_ros.benchmark.robot_hardware import Mishap
from neugrasp_ros.benchmark.robot_round import (
    FAILURES_TO_STOP,
    KINDS,
    SKIPS_TO_STOP,
    Rounds,
)
from neugrasp_ros.errors import MotionError, UnreachableError
from neugrasp_ros.manipulation.mover import PlannedGrasp, Surroundings
from neugrasp_ros.motion.grasp_motion import GraspMotion

ARM = "arm_left_torso"
FOUND = Found(np.tile(np.eye(4), (2, 1, 1)), np.array([0.9, 0.8]), (ARM, ARM))
NOTHING = Found(why="NONE_REACHABLE", codes={"NO_IK": 3})
EMPTY = Found(why="EMPTY_WORKSPACE")


class World:
    now = 5.0

    def advance(self, seconds):
        self.now += seconds


class Robot:
    """Everything that is dropped lies in the box, as long as the grip holds."""

    def __init__(self, names=("a", "b"), opening=0.03):
        self.names, self.opening_now = names, opening
        self.world, self.in_box, self.motions = World(), set(), 0
        self.seen_in = self.newest = SimpleNamespace()

    def spawn(self, kind, seed, count):
        self.scene = (kind, seed, count)
        return self.names

    def look(self):
        return self.newest

    def surroundings(self):
        return Surroundings()

    def configuration(self):
        return np.zeros(3)

    def has_moved(self, T):
        return False

    def follow(self, group, motion):
        self.motions += 1
        if motion == "drop":
            self.in_box.add(self.names[len(self.in_box)])

    def check_stop(self):
        pass

    def move_jaws(self, gripper, opening):
        pass

    def opening(self, gripper):
        return self.opening_now

    def cleared(self):
        return set(self.in_box)

    def mishap(self):
        return Mishap(1.5, "finger", {"jerk": 0.9})


class Mover:
    config = SimpleNamespace(held_radius=0.1)
    robot = SimpleNamespace(
        description=SimpleNamespace(groups={ARM: SimpleNamespace(gripper="left")}),
        grippers={"left": SimpleNamespace(max_opening=0.085)},
    )

    def __init__(self, refused=0, way=True):
        self.planning, self.refused, self.way = [], refused, way

    def plan_grasp(self, q, T, around, *, arms, opening):
        if self.refused:
            self.refused -= 1
            raise UnreachableError(2, "no arm posture")
        self.planning.append(0.25)
        return PlannedGrasp(arms[0], GraspMotion("transit", "approach", "lift"), T, 0.1)

    def plan_home(self, q, arm, around):
        return "home"

    def leads_free(self, q, arm, motion, around, carried):
        return True

    def plan_shift(self, q, arm, shift):
        return "shift"

    def plan_drop(self, q, arm, point, around, carried=None, check_stop=None):
        if not self.way:
            raise MotionError("no free way found")
        return "drop"


class Detector:
    def __init__(self, *answers):
        self.answers, self.seeds = list(answers), []

    def find(self, scene, around, q, *, seed):
        self.seeds.append(seed)
        return self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]


def rounds(robot=None, detector=None, mover=None):
    return Rounds(robot or Robot(), detector or Detector(FOUND), mover or Mover())


def test_a_round_goes_on_until_the_table_is_clear():
    robot, detector = Robot(), Detector(FOUND)
    told = []
    record = Rounds(robot, detector, Mover(), told.append).run(5, 100)
    assert robot.scene == (KINDS[5 % len(KINDS)], 105, 5)
    assert record.ended == "cleared" and record.cleared == ("a", "b")
    assert [a.cleared for a in record.attempts] == ["a", "b"]
    assert all(a.executed and a.held for a in record.attempts)
    assert record.simulated == pytest.approx(2.0), "a second's rest after each"
    assert (record.largest_contact, record.contact_link) == (1.5, "finger")
    assert len(told) == 2 and detector.seeds == [10500, 10501]


def test_a_grasp_that_the_robot_refuses_gives_way_to_the_next():
    record = rounds(Robot(("a",)), mover=Mover(refused=1)).run(0, 0)
    (attempt,) = record.attempts
    assert attempt.outcome == "GRASPED" and attempt.planning == (0.25,)


def test_what_no_arm_moved_for_is_not_executed():
    record = rounds(mover=Mover(refused=100)).run(0, 0)
    assert record.ended == "failures" and len(record.attempts) == FAILURES_TO_STOP
    assert {(a.outcome, a.executed) for a in record.attempts} == {
        ("UNREACHABLE", False)
    }


def test_jaws_that_close_on_nothing_are_a_failure():
    record = rounds(Robot(opening=0.0)).run(0, 0)
    assert record.ended == "failures"
    assert {(a.outcome, a.executed, a.held) for a in record.attempts} == {
        ("MISSED", True, False)
    }


def test_what_stays_in_the_hand_ends_the_round():
    record = rounds(mover=Mover(way=False)).run(0, 0)
    assert record.ended == "stuck"
    assert record.attempts[-1].outcome == "LOST"
    assert record.attempts[-1].message == "no free way found"


def test_without_grasps_it_looks_a_few_times_and_ends():
    record = rounds(detector=Detector(NOTHING)).run(0, 0)
    assert record.ended == "no_grasp" and not record.attempts
    assert record.skips == ["NONE_REACHABLE 3 NO_IK"] * SKIPS_TO_STOP


def test_an_empty_view_ends_it_at_once():
    record = rounds(detector=Detector(FOUND, EMPTY)).run(0, 0)
    assert record.ended == "no_grasp" and record.skips == ["EMPTY_WORKSPACE"]
    assert record.cleared == ("a",)


def test_a_record_is_plain_and_says_what_held():
    record = rounds(Robot(("a",))).run(0, 0).as_record()
    assert record["attempts"][0]["held"] is True
    assert record["limits"] == {"jerk": 0.9} and record["cleared"] == ("a",)
