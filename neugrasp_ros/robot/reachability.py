# SPDX-License-Identifier: Apache-2.0
"""Which grasps an arm can carry out, and if not, why.

In: gripper poses in the base frame. Out: for each a code, and for those that can be
done the arm, the side of the hand (a grasp and its half-turned twin are the same), the
joint values and the whole way: pre-grasp, straight approach, grasp, lift.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import RobotModelError, ShapeError
from neugrasp_ros.geometry.transform import flip_gripper
from neugrasp_ros.robot.collision import CollisionChecker
from neugrasp_ros.robot.contact import FREE, SELF
from neugrasp_ros.robot.kinematics import ArmKinematics
from neugrasp_ros.robot.model import RobotModel, tcp_from_gripper
from neugrasp_ros.robot.obstacles import Obstacles
from neugrasp_ros.robot.settings import IkConfig, ReachabilityConfig
from neugrasp_ros.robot.ways import UNTRIED, WayProblem, Ways, no_answers, try_ways

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


class Reach(IntEnum):
    """Why a grasp can or cannot be reached; the numbers are those of the message."""

    UNKNOWN = 0
    OK = 1
    NO_IK = 2
    LIMITS = 3
    SELF_COLLISION = 4
    SCENE_COLLISION = 5
    NO_APPROACH = 6


PROGRESS = np.array([0, 6, 1, 2, 3, 4, 5])
"""How far a code got, by its number: of several tries the farthest is reported."""
BY_PROGRESS = np.argsort(PROGRESS)
"""The code that got so far."""


@dataclass(frozen=True, slots=True, eq=False)
class ReachResult:
    """Answers for N grasps; fields but the codes have a value only where ``OK``.

    Attributes:
        codes: ``Reach`` numbers, shape (N,).
        arms: Number of the arm in ``arm_names``, -1 = none, shape (N,).
        arm_names: The planning groups that were tried.
        flipped: The half-turned twin is the one that is reached, shape (N,).
        q: Configurations at the grasp, shape (N, J); NaN where there is none.
        manipulability: 0..1, 1 = best, NaN where there is none, shape (N,).
        approach: Joint values of the arm's group from pre-grasp to grasp, (N, S, n).
        lift: Joint values of the arm's group from the grasp upwards, (N, L, n).
    """

    codes: IntArray
    arms: IntArray
    arm_names: tuple[str, ...]
    flipped: BoolArray
    q: FloatArray
    manipulability: FloatArray
    approach: FloatArray
    lift: FloatArray

    def __len__(self) -> int:
        """Return the number of grasps."""
        return len(self.codes)

    @property
    def reachable(self) -> BoolArray:
        """Which grasps can be carried out, shape (N,)."""
        return np.asarray(self.codes == Reach.OK)

    def arm_of(self, index: int) -> str:
        """Return the name of the arm for one grasp, empty if there is none."""
        number = self.arms[index]
        return self.arm_names[number] if number >= 0 else ""


class _Ways(NamedTuple):
    """Ways to try, K of them: a grasp, an arm, a side and a configuration."""

    grasps: IntArray
    arms: IntArray
    flipped: BoolArray
    q: FloatArray
    seeds: IntArray
    manipulability: FloatArray
    scores: FloatArray

    def take(self, keep: NDArray[np.generic]) -> "_Ways":
        return _Ways(*(array[keep] for array in self))


class ReachabilityChecker:
    """Checks grasps for a robot; holds what does not change between calls.

    Attributes:
        robot: The robot.
        arms: Kinematics of each arm, by planning group.
        collisions: The collision checker.
        config: What is asked for.
    """

    def __init__(
        self,
        robot: RobotModel,
        config: ReachabilityConfig | None = None,
        ik: IkConfig | None = None,
    ) -> None:
        """Prepare all arms of the robot; the first time on a machine takes seconds."""
        self.robot = robot
        self.config = config or ReachabilityConfig()
        self.arms = {n: ArmKinematics(robot, n, ik) for n in robot.description.arms}
        self.collisions = CollisionChecker(
            robot,
            padding=self.config.padding,
            jaw_padding=self.config.jaw_padding,
            check_self=self.config.check_self_collision,
        )

    def check(
        self,
        T_base_grippers: FloatArray,
        *,
        arms: Sequence[str] = (),
        start: FloatArray | None = None,
        obstacles: Obstacles | None = None,
        openings: FloatArray | None = None,
    ) -> ReachResult:
        """Find for each grasp an arm, a side and a way.

        Args:
            T_base_grippers: Gripper poses, shape (N, 4, 4).
            arms: Planning groups to try; empty = all.
            start: Present configuration (J,): where the other joints stay, and where
                the arm comes from. Default ``robot.home``.
            obstacles: The scene; None = free space.
            openings: Jaw opening during the approach in [m], shape (N,); default open.

        Raises:
            ShapeError: If the poses are not (N, 4, 4).
            RobotModelError: If an arm is not one of the robot's.
        """
        if T_base_grippers.ndim != 3 or T_base_grippers.shape[1:] != (4, 4):
            raise ShapeError("gripper poses", "(N, 4, 4)", T_base_grippers.shape)
        names = tuple(arms) or tuple(self.arms)
        for name in names:
            if name not in self.arms:
                raise RobotModelError("arm", name, self.arms)
        start = self.robot.home if start is None else start
        search = _Search(self, T_base_grippers, names, start, obstacles)
        if openings is not None:
            search.openings = np.asarray(openings, dtype=np.float64)
        return search.run()


class _Search:
    """One call: the grasps, their answers so far, and how to find the rest."""

    def __init__(
        self,
        checker: ReachabilityChecker,
        T_base_grippers: FloatArray,
        names: tuple[str, ...],
        start: FloatArray,
        obstacles: Obstacles | None,
    ) -> None:
        self.checker, self.config, self.start = checker, checker.config, start
        self.obstacles = obstacles if self.config.check_scene_collision else None
        self.arms = [checker.arms[name] for name in names]
        self.problems = tuple(self._problem(arm) for arm in self.arms)
        self.openings: FloatArray | None = None
        # both sides of every grasp, the twins behind
        self.poses = np.concatenate([T_base_grippers, flip_gripper(T_base_grippers)])
        count, spacing = len(T_base_grippers), self.config.path_spacing
        back = max(1, round(self.config.pregrasp_distance / spacing))
        up = max(1, round(self.config.lift_distance / spacing))
        self.back = np.linspace(0, self.config.pregrasp_distance, back + 1)[1:]
        self.up = np.linspace(0, self.config.lift_distance, up + 1)[1:]
        self.closed = np.zeros(count, dtype=bool)  # answered for good
        width = max(len(arm.lower) for arm in self.arms)
        self.result = ReachResult(
            codes=np.full(count, Reach.NO_IK, dtype=np.int64),
            arms=np.full(count, -1, dtype=np.int64),
            arm_names=names,
            flipped=np.zeros(count, dtype=bool),
            q=np.full((count, len(start)), np.nan),
            manipulability=np.full(count, np.nan),
            approach=np.full((count, back + 1, width), np.nan),
            lift=np.full((count, up + 1, width), np.nan),
        )

    def _problem(self, arm: ArmKinematics) -> WayProblem:
        collisions = self.checker.collisions
        return WayProblem(
            world=collisions.world(self.obstacles),
            scope=collisions.scope(arm.group),
            joints=arm.indices,
            ik=arm.problem,
            max_change=self.config.max_joint_change,
            held_radius=self.config.held_radius,
        )

    def run(self) -> ReachResult:
        """Try the ways of each grasp, the best first, until one works."""
        count = len(self.result)
        sides = np.arange(2 * count)
        first = self.config.first_starts
        ways = self._solve_all(sides, first)
        rest = ~np.isin(sides % count, ways.grasps)
        more = self._solve_all(sides[rest], self.config.most_starts, after=first - 1)
        ways = _Ways(*(np.concatenate(pair) for pair in zip(ways, more, strict=True)))
        self._tell_limits(~np.isin(np.arange(count), ways.grasps))
        self._try(ways)
        for _ in range(self.config.retries):
            ways = self._other_solutions(ways)
            self._try(ways)
        return self.result

    def _solve_all(self, sides: IntArray, seeds: int | None, after: int = -1) -> _Ways:
        """Solve some sides with every arm, from the seeds behind ``after``."""
        width = self.result.approach.shape[2]
        nothing = np.zeros(0, dtype=np.int64)
        parts = [
            _Ways(
                nothing, nothing, nothing.astype(bool), np.zeros((0, width)), nothing,
                np.zeros(0), np.zeros(0),
            )
        ]  # fmt: skip
        for number in range(len(self.arms)):
            skipped = np.full(len(sides), after)
            parts.append(self._solve(number, sides, seeds=seeds, after=skipped))
        return _Ways(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))

    def _solve(
        self,
        number: int,
        sides: IntArray,
        *,
        seeds: int | None = None,
        after: IntArray | None = None,
    ) -> _Ways:
        """Solve some sides with one arm, keeping what is nimble enough."""
        arm = self.arms[number]
        near = self.start[arm.indices]
        found = arm.solve(self.poses[sides], towards=near, seeds=seeds, after=after)
        q, sides = found.q[found.reached], sides[found.reached]
        speed = self.checker.robot.limits.velocity[arm.indices]
        seconds = np.max(np.abs(q - near) / speed, axis=1, initial=0.0)
        manipulability = arm.manipulability(q)
        more = self.result.approach.shape[2] - q.shape[1]  # another arm's joints
        ways = _Ways(
            grasps=sides % len(self.result),
            arms=np.full(len(sides), number),
            flipped=sides >= len(self.result),
            q=np.pad(q, ((0, 0), (0, more)), constant_values=np.nan),
            seeds=found.seed[found.reached],
            manipulability=manipulability,
            scores=manipulability - self.config.travel_weight * seconds,
        )
        return ways.take(manipulability >= self.config.min_manipulability)

    def _other_solutions(self, ways: _Ways) -> _Ways:
        """Solve the ways of the open grasps again, from the seeds that are left."""
        ways = ways.take(~self.closed[ways.grasps])
        parts = [ways.take(np.zeros(0, dtype=np.int64))]
        for number in range(len(self.arms)):
            mine = ways.take(ways.arms == number)
            sides = mine.grasps + len(self.result) * mine.flipped
            parts.append(self._solve(number, sides, after=mine.seeds))
        return _Ways(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))

    def _tell_limits(self, unsolved: BoolArray) -> None:
        """Mark grasps without a solution that longer joint travel would reach."""
        for arm in self.arms:
            rows = np.flatnonzero(unsolved & (self.result.codes == Reach.NO_IK))
            beyond = arm.reaches_beyond_limits(self.poses[rows])
            self.result.codes[rows[beyond]] = Reach.LIMITS

    def _try(self, ways: _Ways) -> None:
        """Try the ways of each open grasp, the best first, and note how far they got.

        Where the hand itself hits the scene, no other way helps.
        """
        ways = ways.take(np.lexsort([-ways.scores, ways.grasps]))
        asked = self._walks(ways)
        answers = no_answers(asked)
        try_ways(self.problems, asked, self.closed, answers)
        at_grasp, on_way = answers.at_grasp, answers.on_way
        reach = np.where(at_grasp == SELF, Reach.SELF_COLLISION, Reach.SCENE_COLLISION)
        reach[at_grasp == FREE] = Reach.NO_APPROACH
        reach[at_grasp == UNTRIED] = Reach.UNKNOWN
        good = (at_grasp == FREE) & (on_way == FREE)
        reach[good] = Reach.OK
        result, done = self.result, ways.grasps[good]
        farthest = PROGRESS[result.codes]
        np.maximum.at(farthest, ways.grasps, PROGRESS[reach])
        result.codes[:] = BY_PROGRESS[farthest]
        result.arms[done] = ways.arms[good]
        result.flipped[done] = ways.flipped[good]
        result.manipulability[done] = ways.manipulability[good]
        result.approach[done, :-1] = answers.retreats[good, ::-1]
        result.approach[done, -1] = result.lift[done, 0] = ways.q[good]
        result.lift[done, 1:] = answers.lifts[good]
        result.q[done] = asked.starts[good]
        for number, arm in enumerate(self.arms):
            rows = done[ways.arms[good] == number]
            n = len(arm.indices)
            result.q[rows[:, None], arm.indices] = result.lift[rows, 0, :n]

    def _walks(self, ways: _Ways) -> Ways:
        """Return the ways as compiled code takes them."""
        grasp = self.poses[ways.grasps + len(self.result) * ways.flipped]
        above = np.repeat(grasp[:, None, :3, 3], len(self.up), axis=1)
        above[:, :, 2] += self.up
        return Ways(
            grasps=ways.grasps,
            arms=ways.arms,
            starts=self._starts(ways),
            q=ways.q,
            targets=tcp_from_gripper(grasp),
            behind=grasp[:, None, :3, 3] - self.back[:, None] * grasp[:, None, :3, 2],
            above=above,
        )

    def _starts(self, ways: _Ways) -> FloatArray:
        """Return the present configuration, with the jaws opened for each grasp."""
        starts = np.tile(self.start, (len(ways.grasps), 1))
        if self.openings is None:
            return starts
        robot = self.checker.robot
        for row, (grasp, arm) in enumerate(zip(ways.grasps, ways.arms, strict=True)):
            key = robot.description.groups[self.result.arm_names[arm]].gripper
            if key:
                robot.set_opening(starts[row], key, self.openings[grasp])
        return starts
