# SPDX-License-Identifier: Apache-2.0
"""One round of the whole robot: look, choose, grasp, drop, until nothing is left."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.benchmark.robot_detection import MAX_CANDIDATES, Detector, Found
from neugrasp_ros.benchmark.robot_hardware import SimulatedRobot
from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.errors import CanceledError, MotionError, UnreachableError
from neugrasp_ros.manipulation.executor import GraspExecutor, GraspOutcome
from neugrasp_ros.manipulation.mover import ArmMover, PlannedGrasp, Surroundings
from neugrasp_ros.manipulation.settings import MoverConfig
from neugrasp_ros.pipeline import GraspPlanner, use_threads
from neugrasp_ros.robot.model import load_robot
from neugrasp_ros.robot.reachability import ReachabilityChecker
from sim_bridge.bridge_world import BridgeScenes

FloatArray = NDArray[np.float64]

KINDS = ("table:pile", "shelf:packed", "cupboard:pile", "table:packed")
GRIPPER = "robotiq_2f85"
OBJECTS = 5
TRIED = 3  # grasps of one detection, where the robot refuses the first
FAILURES_TO_STOP = 4  # in a row
SKIPS_TO_STOP = 3  # detections without a grasp
PATIENCE = 30.0  # [s] for a way, by the wall clock: other work shares the machine
REST = 1.0  # [s] that objects may take to come to rest


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotAttempt:
    """One grasp that the robot was asked for.

    Attributes:
        outcome: Name of the executor's outcome, or ``LOST`` on the way to the box.
        message: What it said.
        executed: Whether an arm moved for it.
        cleared: The object that lies in the box now; empty = none.
        arm: Planning group that the detection chose.
        quality: Promised probability of success.
        T_base_gripper: The upper three rows of the pose, row by row (12 numbers).
        planning: Seconds of planning, by the clock of this thread.
        motions: Arm motions carried out.
        simulated: Simulated time that it took in [s].
    """

    outcome: str
    message: str
    executed: bool
    cleared: str
    arm: str
    quality: float
    T_base_gripper: tuple[float, ...]
    planning: tuple[float, ...]
    motions: int
    simulated: float

    @property
    def held(self) -> bool:
        """Whether something was in the hand after the lift."""
        return self.outcome in (GraspOutcome.GRASPED.name, "LOST")


@dataclass(slots=True)
class RobotRound:
    """What came of a round; plain values.

    Attributes:
        index: Number of the round.
        kind: Furniture and scene kind.
        seed: Seed of scene and stance.
        objects: Names of the objects at the start.
        cleared: Names of those in the boxes at the end.
        ended: ``cleared``, ``failures``, ``no_grasp`` or ``stuck``.
        attempts: The attempts in order.
        skips: Why detections gave no grasp.
        detections: Seconds per stage of each detection.
        largest_contact: Force of robot and furniture in [N], the largest of the round.
        contact_link: Link that felt it.
        limits: The most that set points used of the joints' limits.
        simulated: Length in simulated seconds.
        wall: Length in seconds.
    """

    index: int
    kind: str
    seed: int
    objects: tuple[str, ...]
    cleared: tuple[str, ...] = ()
    ended: str = ""
    attempts: list[RobotAttempt] = field(default_factory=list)
    skips: list[str] = field(default_factory=list)
    detections: list[dict[str, float]] = field(default_factory=list)
    largest_contact: float = 0.0
    contact_link: str = ""
    limits: dict[str, float] = field(default_factory=dict)
    simulated: float = 0.0
    wall: float = 0.0

    def as_record(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        record = asdict(self)
        for attempt, own in zip(record["attempts"], self.attempts, strict=True):
            attempt["held"] = own.held
        return record


class TimedMover(ArmMover):
    """A mover that remembers how long it planned grasps.

    Attributes:
        planning: Seconds of this thread per call, since the last ``clear``.
    """

    planning: list[float]

    def plan_grasp(
        self,
        q: FloatArray,
        T_base_gripper: FloatArray,
        around: Surroundings,
        *,
        arms: Sequence[str] = (),
        opening: float | None = None,
    ) -> PlannedGrasp:
        """Plan, see ``ArmMover``; note the time where there is a plan."""
        begin = time.thread_time()
        plan = super().plan_grasp(q, T_base_gripper, around, arms=arms, opening=opening)
        self.planning.append(time.thread_time() - begin)
        return plan


class Rounds:
    """Runs rounds with one robot.

    Args:
        robot: The robot and its world.
        detector: Finds grasps.
        mover: Plans.
        say: Told of every attempt.

    Attributes:
        robot: As given.
        detector: As given.
    """

    def __init__(
        self,
        robot: SimulatedRobot,
        detector: Detector,
        mover: TimedMover,
        say: Callable[[str], None] = lambda line: None,
    ) -> None:
        self.robot, self.detector, self._mover = robot, detector, mover
        self._say = say

    def run(self, index: int, seed: int, kinds: Sequence[str] = KINDS) -> RobotRound:
        """Run a round; it depends on nothing but its number and the seed."""
        robot, begin = self.robot, time.perf_counter()
        kind, scene_seed = kinds[index % len(kinds)], seed + index
        names = robot.spawn(kind, scene_seed, OBJECTS)
        record = RobotRound(index, kind, scene_seed, names)
        start = robot.world.now
        executor = GraspExecutor(self._mover, robot)
        failures = 0
        while not record.ended:
            found = self._detect(record)
            if found is None:
                continue
            attempt = self._attempt(executor, found)
            record.attempts.append(attempt)
            told = f"{attempt.outcome}: {attempt.message}"
            self._say(f"{kind} {scene_seed}: {told} {attempt.cleared}".rstrip())
            failures = 0 if attempt.cleared else failures + 1
            left = set(record.objects) - robot.cleared()
            if not left:
                record.ended = "cleared"
            elif executor.held is not None:
                record.ended = "stuck"
            elif failures >= FAILURES_TO_STOP:
                record.ended = "failures"
        record.cleared = tuple(sorted(robot.cleared()))
        mishap = robot.mishap()
        record.largest_contact, record.contact_link, record.limits = mishap
        record.simulated = robot.world.now - start
        record.wall = time.perf_counter() - begin
        return record

    def _detect(self, record: RobotRound) -> Found | None:
        """Look and find grasps; without one, note why, and end after a few."""
        robot = self.robot
        number = len(record.detections)
        found = self.detector.find(
            robot.look(),
            robot.surroundings(),
            robot.configuration(),
            seed=record.seed * 100 + number,
        )
        record.detections.append(dict(found.seconds))
        if not found.why:
            return found
        words = ", ".join(f"{count} {name}" for name, count in found.codes.items())
        record.skips.append(f"{found.why} {words}".strip())
        if found.why == "EMPTY_WORKSPACE" or len(record.skips) >= SKIPS_TO_STOP:
            record.ended = "no_grasp"
        return None

    def _attempt(self, executor: GraspExecutor, found: Found) -> RobotAttempt:
        """Have the robot carry out the best grasp that it does not refuse."""
        robot, mover = self.robot, self._mover
        before, start = robot.cleared(), robot.world.now
        robot.seen_in = robot.newest
        mover.planning, robot.motions = [], 0
        for row in range(min(TRIED, len(found.poses))):
            gripper = mover.robot.description.groups[found.arms[row]].gripper
            outcome = executor.execute(
                found.poses[row],
                width=mover.robot.grippers[gripper].max_opening,
                arms=(found.arms[row],),
            )
            if robot.motions or outcome.kind is GraspOutcome.STALE:
                break
        name, message = outcome.kind.name, outcome.message
        if outcome.kind is GraspOutcome.GRASPED and (lost := self._drop(executor)):
            name, message = "LOST", lost
        robot.world.advance(REST)
        new = sorted(robot.cleared() - before)
        if name == GraspOutcome.GRASPED.name and not new:
            name, message = "LOST", "not in the box"
        return RobotAttempt(
            outcome=name,
            message=message,
            executed=robot.motions > 0,
            cleared=new[0] if new else "",
            arm=found.arms[row],
            quality=float(found.quality[row]),
            T_base_gripper=tuple(np.round(found.poses[row][:3].ravel(), 5).tolist()),
            planning=tuple(mover.planning),
            motions=robot.motions,
            simulated=robot.world.now - start,
        )

    def _drop(self, executor: GraspExecutor) -> str:
        """Bring what is held to its box; return why not, empty if done."""
        try:
            executor.drop()
        except (MotionError, UnreachableError, CanceledError) as error:
            return str(error)
        return ""


@contextmanager
def open_rounds(
    say: Callable[[str], None], candidates: int = MAX_CANDIDATES
) -> Iterator[Rounds]:
    """Load robot, world and planner; end the world afterwards."""
    use_threads(1)
    robot = load_robot("tiago_dual")
    checker = ReachabilityChecker(robot)
    planner = GraspPlanner(PlannerConfig(gripper=GRIPPER, threads=1))
    simulated = SimulatedRobot(robot, checker.collisions, BridgeScenes())
    try:
        detector = Detector(planner, checker, candidates)
        patient = MoverConfig(timeout=PATIENCE)
        yield Rounds(simulated, detector, TimedMover(checker, patient), say)
    finally:
        simulated.close()
