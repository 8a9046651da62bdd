# SPDX-License-Identifier: Apache-2.0
"""Ways of an arm through the scene: to a grasp, to a box, and back to safety.

All poses are in the robot's base frame, all trajectories are those of one planning
group, at rest at both ends, inside the limits and checked against robot and scene.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import MotionError, UnreachableError
from neugrasp_ros.geometry.transform import apply, invert, make_transform
from neugrasp_ros.manipulation.settings import MoverConfig
from neugrasp_ros.motion.cartesian import line_poses, move_straight
from neugrasp_ros.motion.grasp_motion import GraspMotion, plan_grasp
from neugrasp_ros.motion.limits import Trajectory
from neugrasp_ros.motion.planner import TransitConfig, TransitPlanner
from neugrasp_ros.robot.attachment import CarriedBox, loaded_checker
from neugrasp_ros.robot.collision import CollisionChecker
from neugrasp_ros.robot.contact import FREE
from neugrasp_ros.robot.model import JointLimits, gripper_from_tcp
from neugrasp_ros.robot.obstacles import SolidBox, make_obstacles
from neugrasp_ros.robot.reachability import Reach, ReachabilityChecker

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

OWN_MARGIN = 0.02  # [m]; seen points so near to what is carried are its own
JERK_SHARE = 0.7  # a controller's polynomial between two points needs the rest
DROP_YAWS = np.linspace(0.0, 2 * np.pi, 12, endpoint=False)  # [rad]
DROP_TILTS = (0.0, 0.4)  # [rad]; of the hand, which need not hang straight down
LEAST_SEARCH = 0.05  # [s]; a shorter one is not worth its beginning
REACH_WORDS = {
    Reach.NO_IK: "no arm posture brings the hand there",
    Reach.LIMITS: "only postures beyond the joint limits bring the hand there",
    Reach.SELF_COLLISION: "the arm would hit the robot itself",
    Reach.SCENE_COLLISION: "the arm or hand would hit the scene",
    Reach.NO_APPROACH: "the straight approach or the lift is blocked",
}


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What the robot must not hit, in the base frame.

    Attributes:
        points: Seen surface in [m], shape (M, 3).
        boxes: Known solid boxes, such as furniture.
    """

    points: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    boxes: Sequence[SolidBox] = ()

    def without(self, center: FloatArray, radius: float) -> "Surroundings":
        """Return the same without the points in a ball, whose object was taken."""
        far = np.linalg.norm(self.points - center, axis=1) > radius
        return replace(self, points=self.points[far])

    def without_box(
        self, T_base_gripper: FloatArray, box: CarriedBox
    ) -> "Surroundings":
        """Return the same without the points of what a hand (4, 4) carries."""
        local = apply(invert(T_base_gripper), self.points)
        own = np.abs(local - box.center) < box.size / 2 + OWN_MARGIN
        return replace(self, points=self.points[~own.all(axis=1)])


class PlannedGrasp(NamedTuple):
    """A grasp as motion.

    Attributes:
        arm: Planning group that carries it out.
        motion: To the pre-grasp, straight ahead, and up.
        T_base_gripper: The side of the hand that was chosen, shape (4, 4).
        seconds: Time that planning took in [s].
    """

    arm: str
    motion: GraspMotion
    T_base_gripper: FloatArray
    seconds: float


class ArmMover:
    """Plans for all arms of a robot; planning changes nothing.

    Attributes:
        checker: Reachability, and the robot.
        config: How to move.
    """

    def __init__(
        self, checker: ReachabilityChecker, config: MoverConfig | None = None
    ) -> None:
        self.checker = checker
        self.robot = checker.robot
        self.config = config or MoverConfig()
        clearance = self.config.clearance
        self._roomy = CollisionChecker(
            self.robot,
            padding=clearance,
            jaw_padding=clearance,
            self_padding=checker.config.padding,
        )

    def limits(self, group: str) -> JointLimits:
        """Return the bounds that motions of a group keep."""
        own = self.robot.limits.take(self.robot.group_indices(group))
        return replace(
            own,
            velocity=own.velocity * self.config.speed,
            acceleration=own.acceleration * self.config.speed,
            jerk=own.jerk * self.config.speed * JERK_SHARE,
        )

    def plan_grasp(
        self,
        q: FloatArray,
        T_base_gripper: FloatArray,
        around: Surroundings,
        *,
        arms: Sequence[str] = (),
        opening: float | None = None,
    ) -> PlannedGrasp:
        """Plan to a grasp, straight ahead, and up.

        Args:
            q: Present configuration, shape (J,).
            T_base_gripper: The grasp, shape (4, 4).
            around: The scene.
            arms: Planning groups to try; empty = all.
            opening: Of the jaws on the approach in [m]; default fully open.

        Raises:
            UnreachableError: If no arm can carry it out, with the reason.
            MotionError: If there is no way to the pre-grasp.
        """
        begin = time.perf_counter()
        openings = None if opening is None else np.array([opening])
        result = self.checker.check(
            T_base_gripper[None],
            arms=tuple(arms),
            start=q,
            obstacles=make_obstacles(around.points, boxes=around.boxes),
            openings=openings,
        )
        code = Reach(int(result.codes[0]))
        if code != Reach.OK:
            raise UnreachableError(int(code), REACH_WORDS.get(code, code.name.lower()))
        arm = result.arm_of(0)
        indices = self.robot.group_indices(arm)
        width = len(indices)
        start = q.copy()
        key = self.robot.description.groups[arm].gripper
        if key:
            opened = self.robot.grippers[key].max_opening
            self.robot.set_opening(start, key, opened if opening is None else opening)
        motion = plan_grasp(
            self._planner(arm, start, around, result.approach[0, 0, :width]),
            start[indices],
            result.approach[0, :, :width],
            result.lift[0, :, :width],
            self.limits(arm),
            self.robot.description.groups[arm].joints,
        )
        grasp = self.checker.arms[arm].forward(result.q[0][indices])[0]
        return PlannedGrasp(arm, motion, grasp, time.perf_counter() - begin)

    def plan_to(
        self,
        q: FloatArray,
        group: str,
        goal: FloatArray,
        around: Surroundings,
        carried: CarriedBox | None = None,
        longest: float = np.inf,
    ) -> Trajectory:
        """Plan through free space.

        Args:
            q: Present configuration, shape (J,).
            group: Planning group that moves.
            goal: Its joint values, shape (n,).
            around: The scene.
            carried: What the group's hand carries, if anything.
            longest: Search in [s], where ``config.timeout`` is not shorter.

        Raises:
            MotionError: If an end is in collision or no way was found in time.
        """
        planner = self._planner(group, q, around, goal, carried, longest)
        start = self._inside(q[self.robot.group_indices(group)], group)
        return planner.move(start, goal, step=self.config.sample_step)

    def plan_home(self, q: FloatArray, arm: str, around: Surroundings) -> Trajectory:
        """Plan back to the resting posture.

        Raises:
            MotionError: As ``plan_to``.
        """
        goal = self.robot.home[self.robot.group_indices(arm)]
        return self.plan_to(q, arm, goal, around)

    def plan_drop(
        self,
        q: FloatArray,
        arm: str,
        point_base: FloatArray,
        around: Surroundings,
        carried: CarriedBox | None = None,
        check_stop: Callable[[], None] = lambda: None,
    ) -> Trajectory:
        """Plan until the hand hangs over a point.

        All postures over it share ``config.drop_time``.

        Args:
            q: Present configuration, shape (J,).
            arm: Planning group that moves.
            point_base: Where the TCP goes in [m], shape (3,).
            around: The scene.
            carried: What the hand carries, if anything.
            check_stop: Called before each search; raises where it was told to stop.

        Raises:
            UnreachableError: If the arm does not reach the point.
            MotionError: As ``plan_to``.
        """
        deadline = time.perf_counter() + self.config.drop_time
        goals = self._hanging(q, arm, point_base, around, carried)
        if not len(goals):
            where = np.round(point_base, 3).tolist()
            raise UnreachableError(int(Reach.NO_IK), f"{arm} cannot hang over {where}")
        problem = MotionError(f"no way to the box within {self.config.drop_time} s")
        for goal in goals:
            check_stop()
            left = deadline - time.perf_counter()
            if left < LEAST_SEARCH:
                break
            try:
                return self.plan_to(q, arm, goal, around, carried, left)
            except MotionError as error:
                problem = error
        raise problem

    def plan_shift(self, q: FloatArray, arm: str, shift_base: FloatArray) -> Trajectory:
        """Plan a straight shift of the hand without a look at the scene.

        For backing out of where a check would find contact already.

        Args:
            q: Present configuration, shape (J,).
            arm: Planning group that moves.
            shift_base: In the base frame in [m], shape (3,).

        Raises:
            MotionError: If the arm cannot follow.
        """
        kinematics = self.checker.arms[arm]
        change = self.checker.config.max_joint_change

        def follow(poses: FloatArray, start: FloatArray) -> FloatArray:
            path, reached = kinematics.follow(
                poses[None], start[None], max_change=change
            )
            return np.asarray(path[0, : reached[0]])

        own = self._inside(q[kinematics.indices], arm)
        poses = line_poses(kinematics.forward(own)[0], shift_base)
        names = self.robot.description.groups[arm].joints
        return move_straight(own, poses, follow, self.limits(arm), names)

    def hand_pose(self, q: FloatArray, arm: str) -> FloatArray:
        """Return ``T_base_gripper`` of an arm's hand in a configuration, (4, 4)."""
        kinematics = self.checker.arms[arm]
        return np.asarray(kinematics.forward(q[kinematics.indices])[0])

    def is_free(
        self,
        q: FloatArray,
        arm: str,
        posture: FloatArray,
        around: Surroundings,
        carried: CarriedBox | None = None,
    ) -> bool:
        """Tell whether an arm, and what it carries, hit nothing in a posture (n,)."""
        checker = _loaded(self.checker.collisions, arm, carried)
        return bool(_FreeCheck(checker, arm, q, around)(posture[None])[0])

    def leads_free(
        self,
        q: FloatArray,
        arm: str,
        motion: Trajectory,
        around: Surroundings,
        carried: CarriedBox | None = None,
    ) -> bool:
        """Tell whether a motion ends free, with contact at its beginning at most.

        Args:
            q: Configuration that holds all other joints, shape (J,).
            arm: Planning group that moves.
            motion: Of its joints.
            around: The scene.
            carried: What the hand carries, if anything.
        """
        checker = _loaded(self.checker.collisions, arm, carried)
        free = _FreeCheck(checker, arm, q, around)(motion.positions)
        return bool(free[-1] and (np.diff(free.astype(int)) >= 0).all())

    def _hanging(
        self,
        q: FloatArray,
        arm: str,
        point_base: FloatArray,
        around: Surroundings,
        carried: CarriedBox | None,
    ) -> FloatArray:
        """Return free postures over a point, the quickest first, shape (K, n)."""
        poses = gripper_from_tcp(np.array([_hang(point_base, y, t)
            for t in DROP_TILTS for y in DROP_YAWS]))  # fmt: skip
        kinematics = self.checker.arms[arm]
        near = q[kinematics.indices]
        found = kinematics.solve(poses, near=near)
        goals = found.q[found.reached]
        roomy = _loaded(self._roomy, arm, carried)
        goals = goals[_FreeCheck(roomy, arm, q, around)(goals)]
        seconds = np.max(np.abs(goals - near) / self.limits(arm).velocity, axis=1)
        return np.asarray(goals[np.argsort(seconds)])

    def _inside(self, values: FloatArray, group: str) -> FloatArray:
        """Return joint values that a drive's small error does not put out of limits."""
        own = self.robot.limits.take(self.robot.group_indices(group))
        return np.asarray(np.clip(values, own.lower, own.upper))

    def _planner(
        self,
        group: str,
        q: FloatArray,
        around: Surroundings,
        goal: FloatArray,
        carried: CarriedBox | None = None,
        longest: float = np.inf,
    ) -> TransitPlanner:
        """Return a planner that keeps clear, or as clear as its two ends allow."""
        config = self.config
        roomy = _loaded(self._roomy, group, carried)
        is_free = _FreeCheck(roomy, group, q, around)
        start = self._inside(q[self.robot.group_indices(group)], group)
        if not is_free(np.stack([start, goal])).all():
            tight = _loaded(self.checker.collisions, group, carried)
            is_free = _FreeCheck(tight, group, q, around)
        settings = TransitConfig(
            timeout=min(config.timeout, longest),
            check_step=config.check_step,
            shortcut_time=config.shortcut_time,
        )
        names = self.robot.description.groups[group].joints
        return TransitPlanner(self.limits(group), names, is_free, settings)


def _loaded(
    checker: CollisionChecker, arm: str, carried: CarriedBox | None
) -> CollisionChecker:
    """Return a checker that knows what the hand carries."""
    return checker if carried is None else loaded_checker(checker, arm, carried)


class _FreeCheck:
    """Says which postures of a group are free, the other joints standing still."""

    def __init__(
        self, checker: CollisionChecker, group: str, q: FloatArray, around: Surroundings
    ) -> None:
        self._checker, self._group, self._q = checker, group, q
        self._obstacles = make_obstacles(around.points, boxes=around.boxes)

    def __call__(self, postures: FloatArray) -> BoolArray:
        """Return which postures (N, n) are free, shape (N,)."""
        codes = self._checker.path_codes(
            postures[:, None],
            np.tile(self._q, (len(postures), 1)),
            self._group,
            obstacles=self._obstacles,
        )
        return np.asarray(codes == FREE)


def _hang(point: FloatArray, yaw: float, tilt: float) -> FloatArray:
    """Return a TCP pose whose approach (x) points down, turned about and tilted."""
    c, s = np.cos(yaw), np.sin(yaw)
    x = np.array([np.sin(tilt) * c, np.sin(tilt) * s, -np.cos(tilt)])
    y = np.array([-s, c, 0.0])
    return make_transform(np.stack([x, y, np.cross(x, y)], axis=1), point)
