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
from neugrasp_ros.robot.contact import FREE, HAND, SELF
from neugrasp_ros.robot.kinematics import ArmKinematics
from neugrasp_ros.robot.model import RobotModel
from neugrasp_ros.robot.obstacles import Obstacles
from neugrasp_ros.robot.settings import IkConfig, ReachabilityConfig

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

FIRST_SEEDS = 3  # tried on every grasp; the others only where these find nothing


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

    def run(self) -> ReachResult:
        """Try the ways of each grasp, the best first, until one works."""
        count = len(self.result)
        sides = np.arange(2 * count)
        ways = self._solve_all(sides, FIRST_SEEDS)
        rest = ~np.isin(sides % count, ways.grasps)
        more = self._solve_all(sides[rest], None, after=FIRST_SEEDS - 1)
        ways = _Ways(*(np.concatenate(pair) for pair in zip(ways, more, strict=True)))
        self._tell_limits(~np.isin(np.arange(count), ways.grasps))
        for attempt in range(1 + self.config.retries):
            if attempt:
                ways = self._other_solutions(ways)
            untried = np.ones(len(ways.grasps), dtype=bool)
            while len(rows := self._best_open(ways, untried)):
                untried[rows] = False
                for number in range(len(self.arms)):
                    mine = rows[ways.arms[rows] == number]
                    if len(mine):
                        self._try(number, ways.take(mine))
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
        found = arm.solve(self.poses[sides], near=near, seeds=seeds, after=after)
        q, sides = found.q[found.reached], sides[found.reached]
        speed = self.checker.robot.limits.velocity[arm.indices]
        seconds = np.max(np.abs(q - near) / speed, axis=1, initial=0.0)
        manipulability = arm.manipulability(q)
        ways = _Ways(
            grasps=sides % len(self.result),
            arms=np.full(len(sides), number),
            flipped=sides >= len(self.result),
            q=np.pad(q, ((0, 0), (0, self.result.approach.shape[2] - q.shape[1]))),
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

    def _best_open(self, ways: _Ways, untried: BoolArray) -> IntArray:
        """Return the best untried way of each grasp that is still open."""
        rows = np.flatnonzero(untried & ~self.closed[ways.grasps])
        rows = rows[np.argsort(-ways.scores[rows], kind="stable")]
        return np.asarray(rows[np.unique(ways.grasps[rows], return_index=True)[1]])

    def _try(self, number: int, ways: _Ways) -> None:
        """Check one way of each of some grasps and note how far it got."""
        ways = ways._replace(q=ways.q[:, : len(self.arms[number].lower)])
        codes = self._contacts(number, ways.q[:, None], ways)
        reach = np.where(codes == SELF, Reach.SELF_COLLISION, Reach.SCENE_COLLISION)
        reach[codes == FREE] = Reach.NO_APPROACH
        free = np.flatnonzero(codes == FREE)
        approach, lift, complete = self._paths(number, ways.take(free))
        reach[free[complete]] = Reach.OK
        self._note(number, ways, reach)
        done, n = ways.grasps[free[complete]], ways.q.shape[1]
        self.result.approach[done, :, :n] = approach[complete]
        self.result.lift[done, :, :n] = lift[complete]

    def _note(self, number: int, ways: _Ways, reach: IntArray) -> None:
        result = self.result
        better = PROGRESS[reach] > PROGRESS[result.codes[ways.grasps]]
        result.codes[ways.grasps[better]] = reach[better]
        good = ways.take(reach == Reach.OK)
        self.closed[good.grasps] = True
        result.arms[good.grasps] = number
        result.flipped[good.grasps] = good.flipped
        result.manipulability[good.grasps] = good.manipulability
        configurations = self._starts(good)
        configurations[:, self.arms[number].indices] = good.q
        result.q[good.grasps] = configurations

    def _paths(
        self, number: int, ways: _Ways
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return approach and lift as joint values, and which are whole and free."""
        arm, change = self.arms[number], self.config.max_joint_change
        grasp = self.poses[ways.grasps + len(self.result) * ways.flipped]
        behind = np.repeat(grasp[:, None], len(self.back), axis=1)
        behind[:, :, :3, 3] -= self.back[:, None] * grasp[:, None, :3, 2]
        above = np.repeat(grasp[:, None], len(self.up), axis=1)
        above[:, :, 2, 3] += self.up
        retreat, far_back = arm.follow(behind, ways.q, max_change=change)
        lift, far_up = arm.follow(above, ways.q, max_change=change)
        complete = (far_back == len(self.back)) & (far_up == len(self.up))
        rows = np.flatnonzero(complete)
        held = np.column_stack(
            [grasp[rows, :3, 3], np.full(len(rows), self.config.held_radius)]
        )
        # from the far ends, where the arm has moved most
        checked = self._contacts(number, retreat[rows, ::-1], ways.take(rows))
        rows, held = rows[checked == FREE], held[checked == FREE]
        complete[:] = False
        checked = self._contacts(number, lift[rows, ::-1], ways.take(rows), held)
        complete[rows[checked == FREE]] = True
        here = ways.q[:, None]
        approach = np.concatenate([retreat[:, ::-1], here], axis=1)
        return approach, np.concatenate([here, lift], axis=1), complete

    def _contacts(
        self,
        number: int,
        paths: FloatArray,
        ways: _Ways,
        held: FloatArray | None = None,
    ) -> IntArray:
        """Check paths; where the hand itself hits the scene, no other way helps."""
        codes = self.checker.collisions.path_codes(
            paths,
            self._starts(ways),
            self.arms[number].group,
            obstacles=self.obstacles,
            held=held,
        )
        self.closed[ways.grasps[codes == HAND]] = True
        return codes

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
