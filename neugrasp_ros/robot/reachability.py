# SPDX-License-Identifier: Apache-2.0
"""Which grasps an arm can carry out, and if not, why.

In: gripper poses in the base frame. Out: for each a code, and for those that can be
done the arm, the side of the hand (a grasp and its half-turned twin are the same), the
joint values and the whole way: pre-grasp, straight approach, grasp, lift.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import RobotModelError, ShapeError
from neugrasp_ros.geometry.transform import flip_gripper
from neugrasp_ros.robot.collision import CollisionChecker
from neugrasp_ros.robot.kinematics import ArmKinematics
from neugrasp_ros.robot.model import RobotModel, tcp_from_gripper
from neugrasp_ros.robot.obstacles import Obstacles
from neugrasp_ros.robot.search import (
    DONE,
    HITS_ITSELF,
    HITS_SCENE,
    NO_WAY,
    UNSOLVED,
    Answers,
    ArmSearch,
    Question,
    no_answers,
    search_ways,
)
from neugrasp_ros.robot.settings import IkConfig, ReachabilityConfig
from neugrasp_ros.robot.ways import WayProblem, make_way

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


REACH_OF = np.zeros(5, dtype=np.int64)
"""The code of how far a search got."""
REACH_OF[[UNSOLVED, HITS_ITSELF, HITS_SCENE, NO_WAY, DONE]] = (
    Reach.NO_IK,
    Reach.SELF_COLLISION,
    Reach.SCENE_COLLISION,
    Reach.NO_APPROACH,
    Reach.OK,
)


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
    """One call: what is asked in compiled code's terms, and back again."""

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
        self.names = names
        self.openings: FloatArray | None = None
        self.grasps = T_base_grippers
        spacing = self.config.path_spacing
        back = max(1, round(self.config.pregrasp_distance / spacing))
        up = max(1, round(self.config.lift_distance / spacing))
        self.back = np.linspace(0, self.config.pregrasp_distance, back + 1)[1:]
        self.up = np.linspace(0, self.config.lift_distance, up + 1)[1:]

    def run(self) -> ReachResult:
        """Try the ways of each grasp, the best first, until one works."""
        collisions = self.checker.collisions
        arms = self.checker.arms.values()
        width = max(len(arm.lower) for arm in arms)
        answers = no_answers(len(self.grasps), len(self.back), len(self.up), width)
        search_ways(
            collisions.world(self.obstacles),
            tuple(self._arm_search(arm) for arm in arms),
            self._question(),
            answers,
        )
        codes = REACH_OF[answers.progress]
        self._tell_limits(codes)
        return self._result(answers, codes)

    def _arm_search(self, arm: ArmKinematics) -> ArmSearch:
        problem = WayProblem(
            scope=self.checker.collisions.scope(arm.group),
            joints=arm.indices,
            ik=arm.problem,
            max_change=self.config.max_joint_change,
            held_radius=self.config.held_radius,
        )
        joints = len(arm.lower)
        way = make_way(len(self.back), len(self.up), joints, len(self.start))
        return arm.search(problem, way, self.start[arm.indices])

    def _question(self) -> Question:
        grasps, config = self.grasps, self.config
        sides = np.concatenate([grasps, flip_gripper(grasps)])
        behind = grasps[:, None, :3, 3] - self.back[:, None] * grasps[:, None, :3, 2]
        above = np.repeat(grasps[:, None, :3, 3], len(self.up), axis=1)
        above[:, :, 2] += self.up
        return Question(
            targets=np.ascontiguousarray(tcp_from_gripper(sides)),
            behind=np.ascontiguousarray(behind),
            above=above,
            begins=np.array([self._begins(name) for name in self.checker.arms]),
            asked=np.array([name in self.names for name in self.checker.arms]),
            first_starts=config.first_starts,
            most_starts=config.most_starts,
            retries=config.retries,
            travel_weight=config.travel_weight,
            min_manipulability=config.min_manipulability,
        )

    def _begins(self, name: str) -> FloatArray:
        """Return the present configuration with an arm's jaws opened, (N, J)."""
        begins = np.tile(self.start, (len(self.grasps), 1))
        robot = self.checker.robot
        key = robot.description.groups[name].gripper
        if not key:
            return begins
        openings = self.openings
        if openings is None:  # the jaws may be closed now, but not on the approach
            openings = np.full(len(begins), robot.grippers[key].max_opening)
        for begin, opening in zip(begins, openings, strict=True):
            robot.set_opening(begin, key, opening)
        return begins

    def _tell_limits(self, codes: IntArray) -> None:
        """Mark grasps without a solution that longer joint travel would reach."""
        for name in self.names:
            rows = np.flatnonzero(codes == Reach.NO_IK)
            beyond = self.checker.arms[name].reaches_beyond_limits(self.grasps[rows])
            codes[rows[beyond]] = Reach.LIMITS

    def _result(self, answers: Answers, codes: IntArray) -> ReachResult:
        done = np.flatnonzero(codes == Reach.OK)
        q = np.full((len(codes), len(self.start)), np.nan)
        arms = np.full(len(codes), -1)
        for number, (name, arm) in enumerate(self.checker.arms.items()):
            rows = done[answers.branches[done] // 2 == number]
            if not len(rows):
                continue
            arms[rows] = self.names.index(name)
            q[rows] = self._begins(name)[rows]
            q[rows[:, None], arm.indices] = answers.q[rows, : len(arm.indices)]
        here = answers.q[:, None]
        return ReachResult(
            codes=codes,
            arms=arms,
            arm_names=self.names,
            flipped=(codes == Reach.OK) & (answers.branches % 2 == 1),
            q=q,
            manipulability=answers.manipulability,
            approach=np.concatenate([answers.retreats[:, ::-1], here], axis=1),
            lift=np.concatenate([here, answers.lifts], axis=1),
        )
