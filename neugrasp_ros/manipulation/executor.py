# SPDX-License-Identifier: Apache-2.0
"""A grasp carried out step by step, and what came of it.

The executor plans and decides; a ``Hardware`` moves, senses and may be told to stop.
"""

import logging
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import CanceledError, MotionError, UnreachableError
from neugrasp_ros.manipulation.closing import least_opening, raised
from neugrasp_ros.manipulation.escape import plan_escape
from neugrasp_ros.manipulation.mover import ArmMover, PlannedGrasp, Surroundings
from neugrasp_ros.manipulation.settings import ExecutorConfig
from neugrasp_ros.motion.limits import Trajectory
from neugrasp_ros.robot.attachment import CarriedBox, carried_box
from neugrasp_ros.robot.reachability import Reach

FloatArray = NDArray[np.float64]
Report = Callable[[str, float], None]
"""Told the stage, and the share done 0..1."""

_log = logging.getLogger(__name__)


class GraspOutcome(IntEnum):
    """What came of a grasp; the numbers are those of the action."""

    GRASPED = 0
    MISSED = 1
    SLIPPED = 2
    ABORTED = 3
    STALE = 4
    UNREACHABLE = 5
    CANCELED = 6


class Outcome(NamedTuple):
    """The end of an execution.

    Attributes:
        kind: Which of the ends.
        message: The reason for people.
        opening: Of the jaws at the end in [m]; NaN where no arm was chosen.
    """

    kind: GraspOutcome
    message: str
    opening: float = float("nan")


class Hardware(Protocol):
    """A robot that moves, and senses."""

    def configuration(self) -> FloatArray:
        """Return the measured configuration, shape (J,)."""

    def follow(self, group: str, motion: Trajectory) -> None:
        """Carry out a motion.

        Raises:
            MotionError: If the robot could not.
            CanceledError: If it was stopped on request; it stands still by then.
        """

    def move_jaws(self, gripper: str, opening: float) -> None:
        """Bring jaws to an opening in [m], or until they hold something.

        Raises:
            CanceledError: If it was stopped on request.
        """

    def opening(self, gripper: str) -> float:
        """Return the measured opening of jaws in [m]."""

    def check_stop(self) -> None:
        """Let a search go on.

        Raises:
            CanceledError: If it shall stop.
        """

    def surroundings(self) -> Surroundings:
        """Return what is around now."""

    def has_moved(self, T_base_gripper: FloatArray) -> bool:
        """Tell whether the thing to grasp left its place since it was seen."""


class Held(NamedTuple):
    """What a hand holds.

    Attributes:
        arm: Planning group of the hand.
        T_base_gripper: Where it was taken from, shape (4, 4).
        box: Its box, None where too little of it was seen.
    """

    arm: str
    T_base_gripper: FloatArray
    box: CarriedBox | None = None


class GraspExecutor:
    """Carries out grasps, one at a time.

    Args:
        mover: Plans.
        hardware: Moves.
        config: How to go about it.

    Attributes:
        held: What is in a hand, None = nothing.
    """

    def __init__(
        self, mover: ArmMover, hardware: Hardware, config: ExecutorConfig | None = None
    ) -> None:
        self._mover, self._hardware = mover, hardware
        self._config = config or ExecutorConfig()
        self.held: Held | None = None

    def execute(
        self,
        T_base_gripper: FloatArray,
        *,
        width: float,
        arms: Sequence[str] = (),
        lift: bool = True,
        report: Report = lambda stage, share: None,
    ) -> Outcome:
        """Carry out a grasp.

        Args:
            T_base_gripper: The grasp, shape (4, 4).
            width: Opening of the jaws on the approach in [m].
            arms: Planning groups to try, the first that reaches it; empty = all.
            lift: Take the object up, too.
            report: Told of every step.
        """
        if self.held is not None:
            return Outcome(
                GraspOutcome.ABORTED, f"{self.held.arm} still holds something"
            )
        try:
            return self._run(T_base_gripper, width, tuple(arms), lift, report)
        except UnreachableError as error:
            return Outcome(GraspOutcome.UNREACHABLE, str(error))
        except CanceledError as error:
            return Outcome(GraspOutcome.CANCELED, str(error))
        except MotionError as error:
            return Outcome(GraspOutcome.ABORTED, str(error))

    def drop(self, report: Report = lambda stage, share: None) -> None:
        """Carry what is held over its arm's box, let go, and return.

        Raises:
            MotionError: If nothing is held, or there is no way.
            CanceledError: If it was stopped.
        """
        if self.held is None:
            raise MotionError("no hand holds anything")
        arm, T, box = self.held
        around = self._hardware.surroundings().without(
            T[:3, 3], self._mover.config.held_radius
        )
        if box is not None:  # it is seen in the hand by now
            q = self._hardware.configuration()
            around = around.without_box(self._mover.hand_pose(q, arm), box)
        report("carry", 0.0)
        try:
            self._hardware.follow(arm, self._way_to_box(arm, around, box))
        except MotionError as error:
            _log.info("what %s holds got stuck (%s): again from outside", arm, error)
            self._get_out(arm, around, box)
            self._carry(arm, around, box)
        report("release", 0.6)
        self._open(arm)
        self.held = None
        report("home", 0.7)
        self.go_home(arm, around)

    def _way_to_box(
        self, arm: str, around: Surroundings, box: CarriedBox | None
    ) -> Trajectory:
        """Plan until the hand hangs over its arm's box."""
        q = self._hardware.configuration()
        point = np.array(self._config.drop_point(arm))
        stop = self._hardware.check_stop
        return self._mover.plan_drop(q, arm, point, around, box, stop)

    def _carry(self, arm: str, around: Surroundings, box: CarriedBox | None) -> None:
        """Move over the box; where what is held leaves no way, as if it were not."""
        try:
            way = self._way_to_box(arm, around, box)
        except MotionError as error:
            if box is None:
                raise
            _log.info("no way for what %s holds (%s): trying without it", arm, error)
            way = self._way_to_box(arm, around, None)
        self._hardware.follow(arm, way)

    def _get_out(
        self, arm: str, around: Surroundings, box: CarriedBox | None = None
    ) -> None:
        """Move the hand out of a narrow place, as far as there is a straight way."""
        q, distance = self._hardware.configuration(), self._config.back_out
        try:
            out = plan_escape(self._mover, q, arm, distance, around=around, carried=box)
        except MotionError as error:
            _log.info("%s", error)
            return
        self._hardware.follow(arm, out)

    def go_home(self, arm: str, around: Surroundings | None = None) -> None:
        """Return to the resting posture; where that is not possible, back out first.

        Raises:
            MotionError: If there is no way.
            CanceledError: If it was stopped.
        """
        around = self._hardware.surroundings() if around is None else around
        q = self._hardware.configuration()
        try:
            home = self._mover.plan_home(q, arm, around)
        except MotionError as error:
            _log.info("no way home at once (%s): getting out first", error)
            self._get_out(arm, around)
            q = self._hardware.configuration()
            home = self._mover.plan_home(q, arm, around)
        self._hardware.follow(arm, home)

    def _run(
        self,
        T_base_gripper: FloatArray,
        width: float,
        arms: tuple[str, ...],
        lift: bool,
        report: Report,
    ) -> Outcome:
        report("plan", 0.0)
        hardware = self._hardware
        if hardware.has_moved(T_base_gripper):
            return Outcome(GraspOutcome.STALE, "the object moved since it was seen")
        around = hardware.surroundings()
        T_base_gripper = self._with_room(T_base_gripper, arms, around)
        plan = self._mover.plan_grasp(
            hardware.configuration(), T_base_gripper, around, arms=arms, opening=width
        )
        _log.info("planned for %s in %.0f ms", plan.arm, 1e3 * plan.seconds)
        self._require_closing(plan, around, width)
        self._require_room(plan, around, width)
        gripper = self._gripper(plan.arm)
        report("pregrasp", 0.1)
        hardware.move_jaws(gripper, width)
        hardware.follow(plan.arm, plan.motion.transit)
        if hardware.has_moved(T_base_gripper):
            self.go_home(plan.arm, around)
            return Outcome(
                GraspOutcome.STALE, "the object moved before the hand got there", width
            )
        return self._take(plan, around, lift, report)

    def _with_room(
        self, T_base_gripper: FloatArray, arms: tuple[str, ...], around: Surroundings
    ) -> FloatArray:
        """Return a grasp (4, 4) that leaves room for the tips of closing jaws."""
        grippers = self._mover.robot.grippers
        key = self._gripper(arms[0]) if arms else next(iter(grippers))
        return raised(grippers[key], T_base_gripper, around.boxes)

    def _require_closing(
        self, plan: PlannedGrasp, around: Surroundings, width: float
    ) -> None:
        """Refuse a grasp whose jaws have no room to close from their width.

        Raises:
            UnreachableError: If so.
        """
        least = self._least_opening(plan, around)
        if least + self._config.empty_opening >= width:
            raise UnreachableError(
                int(Reach.NO_APPROACH),
                f"the jaws could close to {least:.3f} m only, from {width:.3f} m: "
                "further their tips would press onto the furniture",
            )

    def _require_room(
        self, plan: PlannedGrasp, around: Surroundings, width: float
    ) -> None:
        """Refuse a grasp whose object would end its lift in a known box.

        Raises:
            UnreachableError: If so.
        """
        box = carried_box(around.points, plan.T_base_gripper, width)
        if box is None or not around.boxes:
            return
        q, solid = self._hardware.configuration(), Surroundings(boxes=around.boxes)
        end = plan.motion.lift.positions[-1]
        bare = self._mover.is_free(q, plan.arm, end, solid)
        if bare and not self._mover.is_free(q, plan.arm, end, solid, box):
            raise UnreachableError(
                int(Reach.NO_APPROACH), "the object would hit the furniture in the lift"
            )

    def _take(
        self, plan: PlannedGrasp, around: Surroundings, lift: bool, report: Report
    ) -> Outcome:
        """From the pre-grasp on: approach, close, lift, look at the jaws."""
        hardware, gripper = self._hardware, self._gripper(plan.arm)
        report("approach", 0.5)
        try:
            hardware.follow(plan.arm, plan.motion.approach)
        except MotionError as error:
            self._back_out(plan, around)
            kind, words = GraspOutcome.ABORTED, "on the approach"
            if hardware.has_moved(plan.T_base_gripper):
                kind = GraspOutcome.STALE
                words = "the object is not where it was seen; on the approach"
            return Outcome(kind, f"{words}: {error}")
        report("close", 0.7)
        closed = self._least_opening(plan, around)
        hardware.move_jaws(gripper, closed)
        opening = hardware.opening(gripper)
        if opening < closed + self._config.empty_opening:
            self._open(plan.arm)
            self._leave(plan, around)
            words = "the jaws closed on nothing"
            if closed > 0.0:
                words += f" down to {closed:.3f} m; further their tips would press"
            return Outcome(GraspOutcome.MISSED, words, opening)
        box = carried_box(around.points, plan.T_base_gripper, opening)
        self.held = Held(plan.arm, plan.T_base_gripper, box)
        if not lift:
            return Outcome(GraspOutcome.GRASPED, "held, not lifted", opening)
        report("lift", 0.8)
        hardware.follow(plan.arm, plan.motion.lift)
        if closed > 0.0:  # nothing is under the tips any more
            hardware.move_jaws(gripper, 0.0)
        if (opening := hardware.opening(gripper)) < self._config.empty_opening:
            self.held = None
            self._open(plan.arm)
            self.go_home(plan.arm, around)
            return Outcome(GraspOutcome.SLIPPED, "lost in the lift", opening)
        return Outcome(GraspOutcome.GRASPED, f"lifted with {plan.arm}", opening)

    def _least_opening(self, plan: PlannedGrasp, around: Surroundings) -> float:
        """Return how far the jaws may close before their tips press on something."""
        gripper = self._mover.robot.grippers[self._gripper(plan.arm)]
        return least_opening(gripper, plan.T_base_gripper, around.boxes)

    def _leave(self, plan: PlannedGrasp, around: Surroundings) -> None:
        """Up and home with empty jaws."""
        self._hardware.follow(plan.arm, plan.motion.lift)
        self.go_home(plan.arm, around)

    def _back_out(self, plan: PlannedGrasp, around: Surroundings) -> None:
        """Leave a blocked approach the way the hand came, then go home."""
        back = -self._config.back_out * plan.T_base_gripper[:3, 2]
        q = self._hardware.configuration()
        try:
            shift = self._mover.plan_shift(q, plan.arm, back)
            self._hardware.follow(plan.arm, shift)
            self.go_home(plan.arm, around)
        except MotionError as error:
            _log.warning("%s stays where it is: %s", plan.arm, error)

    def _open(self, arm: str) -> None:
        key = self._gripper(arm)
        opened = self._mover.robot.grippers[key].max_opening
        self._hardware.move_jaws(key, opened)

    def _gripper(self, arm: str) -> str:
        return self._mover.robot.description.groups[arm].gripper
