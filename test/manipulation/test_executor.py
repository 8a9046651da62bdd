# SPDX-License-Identifier: Apache-2.0
"""The steps of a grasp, with a robot that only writes down what it is told."""

from types import SimpleNamespace

import numpy as np
import pytest

from neugrasp_ros.errors import CanceledError, MotionError, UnreachableError
from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.manipulation.closing import least_opening, raised
from neugrasp_ros.manipulation.executor import GraspExecutor, GraspOutcome, Held
from neugrasp_ros.manipulation.mover import PlannedGrasp, Surroundings
from neugrasp_ros.motion.grasp_motion import GraspMotion
from neugrasp_ros.robot.attachment import CarriedBox
from neugrasp_ros.robot.obstacles import SolidBox

ARM = "arm_left_torso"
GRASP = np.eye(4)


class Hardware:
    def __init__(self, openings=(0.03, 0.03), moved=(False,) * 3, fail=None):
        self.done, self._fail = [], fail or {}
        self._openings, self._moved = list(openings), list(moved)

    def configuration(self):
        return np.zeros(3)

    def follow(self, group, motion):
        self.done.append(motion)
        if motion in self._fail:
            raise self._fail[motion]

    def move_jaws(self, gripper, opening):
        self.done.append(f"jaws {opening:.3f}")

    def opening(self, gripper):
        return self._openings.pop(0)

    def surroundings(self):
        return Surroundings()

    def check_stop(self):
        pass

    def has_moved(self, T):
        return self._moved.pop(0)


class Mover:
    config = SimpleNamespace(held_radius=0.1)
    robot = SimpleNamespace(
        description=SimpleNamespace(groups={ARM: SimpleNamespace(gripper="left")}),
        grippers={"left": SimpleNamespace(max_opening=0.085)},
    )
    way_home = True
    way_with_box = True
    headroom = 1.0  # [m]

    def plan_grasp(self, q, T, around, *, arms, opening):
        if not arms:
            raise UnreachableError(2, "no arm posture brings the hand there")
        return PlannedGrasp(arms[0], GraspMotion("transit", "approach", "lift"), T, 0.1)

    def hand_pose(self, q, arm):
        return np.eye(4)

    def plan_home(self, q, arm, around):
        if not self.way_home:
            self.way_home = True
            raise MotionError("the start is in collision")
        return "home"

    def plan_drop(self, q, arm, point, around, carried, check_stop):
        check_stop()
        if carried is not None and not self.way_with_box:
            raise MotionError("the start is in collision")
        return "drop" if carried is None else "careful drop"

    def leads_free(self, q, arm, motion, around, carried):
        return True

    def plan_shift(self, q, arm, shift):
        if np.linalg.norm(shift) > self.headroom:
            raise MotionError("the arm follows the line for 8 of 10 poses")
        return "shift"


def run(hardware, *, arms=(ARM,), lift=True, mover=None):
    stages = []
    executor = GraspExecutor(mover or Mover(), hardware)
    outcome = executor.execute(
        GRASP, width=0.08, arms=arms, lift=lift,
        report=lambda stage, share: stages.append(stage),
    )  # fmt: skip
    return executor, outcome, stages


def test_a_grasp_goes_through_its_stages_and_the_object_into_the_box():
    hardware = Hardware()
    executor, outcome, stages = run(hardware)
    assert outcome.kind is GraspOutcome.GRASPED
    assert outcome.opening == 0.03
    assert stages == ["plan", "pregrasp", "approach", "close", "lift"]
    steps = ["jaws 0.080", "transit", "approach", "jaws 0.000", "lift"]
    assert hardware.done == steps
    assert executor.held.arm == ARM
    again = executor.execute(GRASP, width=0.08, arms=(ARM,))
    assert again.kind is GraspOutcome.ABORTED
    assert "still holds" in again.message
    executor.drop()
    assert hardware.done[len(steps) :] == ["drop", "jaws 0.085", "home"]
    assert executor.held is None
    with pytest.raises(MotionError, match="no hand holds"):
        executor.drop()


def test_a_cancel_ends_the_search_for_a_way_to_the_box():
    hardware = Hardware()
    executor, _, _ = run(hardware)
    hardware.done.clear()

    def stop():
        raise CanceledError("stopped")

    hardware.check_stop = stop
    with pytest.raises(CanceledError):
        executor.drop()
    assert hardware.done == [] and executor.held.arm == ARM


class StuckOnce(Hardware):
    def follow(self, group, motion):
        first = motion == "drop" and "drop" not in self.done
        super().follow(group, motion)
        if first:
            raise MotionError("a joint is 0.17 behind")


def test_what_gets_stuck_on_the_way_to_the_box_is_tried_again_from_outside():
    hardware = StuckOnce()
    executor, _, _ = run(hardware)
    hardware.done.clear()
    executor.drop()
    assert hardware.done == ["drop", "shift", "drop", "jaws 0.085", "home"]
    assert executor.held is None


def test_what_stays_stuck_is_still_held():
    hardware = Hardware(fail={"drop": MotionError("a joint is 0.17 behind")})
    executor, _, _ = run(hardware)
    with pytest.raises(MotionError, match="behind"):
        executor.drop()
    assert executor.held.arm == ARM


def test_without_a_lift_it_ends_with_closed_jaws():
    hardware = Hardware()
    executor, outcome, _ = run(hardware, lift=False)
    assert outcome.kind is GraspOutcome.GRASPED
    assert hardware.done[-1] == "jaws 0.000"
    assert executor.held is not None


def test_nothing_between_the_jaws_is_a_miss_and_the_arm_goes_home():
    hardware = Hardware(openings=[0.0])
    executor, outcome, _ = run(hardware)
    assert outcome.kind is GraspOutcome.MISSED
    assert hardware.done[-3:] == ["jaws 0.085", "lift", "home"]
    assert executor.held is None


def test_what_is_lost_in_the_lift_has_slipped():
    hardware = Hardware(openings=[0.03, 0.0])
    executor, outcome, _ = run(hardware)
    assert outcome.kind is GraspOutcome.SLIPPED
    assert hardware.done[-1] == "home"
    assert executor.held is None


def test_an_object_that_moved_is_left_alone():
    hardware = Hardware(moved=[True])
    assert run(hardware)[1].kind is GraspOutcome.STALE
    assert hardware.done == []
    hardware = Hardware(moved=[False, True])
    assert run(hardware)[1].kind is GraspOutcome.STALE
    assert hardware.done[-1] == "home"


def test_out_of_reach_is_told_before_anything_moves():
    hardware = Hardware()
    _, outcome, _ = run(hardware, arms=())
    assert outcome.kind is GraspOutcome.UNREACHABLE
    assert "no arm posture" in outcome.message
    assert hardware.done == []


def test_a_cancel_leaves_the_arm_where_it_stands():
    hardware = Hardware(fail={"transit": CanceledError("stopped")})
    _, outcome, _ = run(hardware)
    assert outcome.kind is GraspOutcome.CANCELED
    assert hardware.done[-1] == "transit"


def test_a_blocked_approach_is_backed_out_of():
    hardware = Hardware(fail={"approach": MotionError("a joint is behind")})
    _, outcome, _ = run(hardware)
    assert outcome.kind is GraspOutcome.ABORTED
    assert "on the approach" in outcome.message
    assert hardware.done[-2:] == ["shift", "home"]


def test_after_a_blocked_approach_it_looks_whether_the_object_is_still_there():
    behind = MotionError("a joint is behind")
    hardware = Hardware(fail={"approach": behind}, moved=[False, False, True])
    _, outcome, _ = run(hardware)
    assert outcome.kind is GraspOutcome.STALE
    assert "not where it was seen" in outcome.message
    assert "a joint is behind" in outcome.message
    assert hardware.done[-2:] == ["shift", "home"]


def test_with_no_way_home_the_hand_gets_out_first():
    hardware, mover = Hardware(), Mover()
    mover.way_home = False
    GraspExecutor(mover, hardware).go_home(ARM)
    assert hardware.done == ["shift", "home"]


BOX = CarriedBox(np.zeros(3), np.full(3, 0.05))


def test_what_is_carried_keeps_clear_on_the_way_to_the_box():
    hardware = Hardware()
    executor = GraspExecutor(Mover(), hardware)
    executor.held = Held(ARM, GRASP, BOX)
    executor.drop()
    assert hardware.done == ["careful drop", "jaws 0.085", "home"]


def test_a_carried_object_that_leaves_no_way_is_moved_out_and_then_ventured():
    hardware, mover = Hardware(), Mover()
    mover.way_with_box = False
    executor = GraspExecutor(mover, hardware)
    executor.held = Held(ARM, GRASP, BOX)
    executor.drop()
    assert hardware.done == ["shift", "drop", "jaws 0.085", "home"]


class LowMover(Mover):
    """Grasps 5 mm over a table, where the tips of a closing 2F-85 would press."""

    robot = SimpleNamespace(
        description=SimpleNamespace(groups={ARM: SimpleNamespace(gripper="left")}),
        grippers={"left": load_gripper("robotiq_2f85")},
    )


TABLE = SolidBox(translation(0.0, 0.0, 0.0), np.array([1.0, 1.0, 0.02]))


@pytest.mark.parametrize(
    ("further", "kind"), [(0.03, GraspOutcome.GRASPED), (0.0, GraspOutcome.MISSED)]
)
def test_over_a_table_jaws_close_as_far_as_their_tips_do_not_press(further, kind):
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[2, 3] = 0.015
    mover = LowMover()
    hand = mover.robot.grippers["left"]
    least = least_opening(hand, raised(hand, T, [TABLE]), [TABLE])
    hardware = Hardware(openings=[least + further, 0.03])
    hardware.surroundings = lambda: Surroundings(boxes=(TABLE,))
    executor = GraspExecutor(mover, hardware)
    outcome = executor.execute(T, width=0.08, arms=(ARM,))
    assert outcome.kind is kind and least > 0.02
    assert f"jaws {least:.3f}" in hardware.done
    assert ("would press" in outcome.message) == (kind is GraspOutcome.MISSED)
    if kind is GraspOutcome.GRASPED:
        assert hardware.done[-2:] == ["lift", "jaws 0.000"], (
            "with all force, in the air"
        )


def test_jaws_that_cannot_close_are_told_before_anything_moves():
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[2, 3] = 0.005  # the tips are in the table at any opening
    hardware = Hardware()
    hardware.surroundings = lambda: Surroundings(boxes=(TABLE,))
    outcome = GraspExecutor(LowMover(), hardware).execute(T, width=0.08, arms=(ARM,))
    assert outcome.kind is GraspOutcome.UNREACHABLE
    assert "close to 0.085 m only, from 0.080 m" in outcome.message
    assert hardware.done == []


@pytest.mark.parametrize(("headroom", "rises"), [(0.06, ["shift"]), (0.04, [])])
def test_a_hand_gets_out_as_far_as_its_arm_can(headroom, rises):
    hardware, mover = Hardware(), Mover()
    mover.way_with_box, mover.headroom = False, headroom
    executor = GraspExecutor(mover, hardware)
    executor.held = Held(ARM, GRASP, BOX)
    executor.drop()
    assert hardware.done == [*rises, "drop", "jaws 0.085", "home"]
