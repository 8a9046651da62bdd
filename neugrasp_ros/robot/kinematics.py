# SPDX-License-Identifier: Apache-2.0
"""Inverse kinematics of one arm with its torso, for many grasps at once."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.robot.chain import chain_poses
from neugrasp_ros.robot.ik import IkProblem, follow_batch, reach_volumes
from neugrasp_ros.robot.model import RobotModel, gripper_from_tcp, tcp_from_gripper
from neugrasp_ros.robot.postures import Starts, solve_batch
from neugrasp_ros.robot.search import ArmSearch
from neugrasp_ros.robot.seeds import load_knowledge, may_reach
from neugrasp_ros.robot.settings import IkConfig
from neugrasp_ros.robot.ways import Way, WayProblem

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

WIDENING = 1.0  # [rad]; past the limits, to tell why there is no solution
SLIDE_WIDENING = 0.2  # [m]


class IkSolutions(NamedTuple):
    """Answers for N grasps.

    Attributes:
        q: Joint values of the group, shape (N, n); of no meaning where not reached.
        reached: Within tolerance and inside the limits with margin, shape (N,).
        seed: Number of the start that led there, K where none did, shape (N,). With
            ``near``, that is number 0; the stored postures follow, the best first.
    """

    q: FloatArray
    reached: BoolArray
    seed: IntArray


class ArmKinematics:
    """Inverse kinematics of one planning group.

    Targets are gripper poses ``T_base_gripper`` (z approach, y closing, origin at the
    TCP). Joint values are those of the group, in its order.

    Attributes:
        group: Name of the planning group.
        indices: Where its joints stand in a configuration, shape (n,).
        lower: Lower bounds with margin in [rad] or [m], shape (n,).
        upper: Upper bounds with margin, shape (n,).
        problem: The same and more, as compiled code takes it.
    """

    def __init__(
        self,
        robot: RobotModel,
        group: str,
        config: IkConfig | None = None,
        cache: Path | None = None,
    ) -> None:
        """Prepare an arm; the first time on a machine takes some seconds.

        Args:
            robot: The robot.
            group: A planning group with a hand.
            config: Tolerances and margins.
            cache: Folder of stored postures; default the user's cache.

        Raises:
            RobotModelError: If there is no such group.
            ConfigError: If the group has no hand or is not a serial chain.
        """
        config = config or IkConfig()
        self.group = group
        self.indices = robot.group_indices(group)
        chain = robot.chain(group)
        margin = np.minimum(config.joint_margin, (chain.upper - chain.lower) / 4)
        self.lower, self.upper = chain.lower + margin, chain.upper - margin
        weights = np.where(chain.prismatic, config.slide_weight, 1.0)
        tolerance = (config.tol_position, config.tol_rotation)
        self.problem = IkProblem(
            chain, self.lower, self.upper, weights, tolerance, config.max_iterations
        )
        widening = np.where(chain.prismatic, SLIDE_WIDENING, WIDENING)
        self._widened = self.problem._replace(
            lower=chain.lower - widening, upper=chain.upper + widening
        )
        self._known = load_knowledge(self.problem, cache)
        known = self._known.cells
        self._cells = known if config.reach_map else np.ones_like(known)
        self._restarts = config.restarts
        count, rng = config.random_starts, np.random.default_rng(0)
        self._random = rng.uniform(self.lower, self.upper, (count, len(self.lower)))
        self._speeds = robot.limits.velocity[self.indices]
        self._middle = (self.lower + self.upper) / 2

    def forward(self, q: FloatArray) -> FloatArray:
        """Return gripper poses ``T_base_gripper`` (N, 4, 4) of joint values (N, n)."""
        return gripper_from_tcp(chain_poses(self.problem.chain, _rows(q)))

    def may_reach(self, T_base_grippers: FloatArray) -> BoolArray:
        """Return quickly which grasps are not out of the question, shape (N,)."""
        targets = _targets(T_base_grippers)
        inside = np.empty(len(targets), dtype=np.bool_)
        _look_up(targets, self._known.wrist, self._known.origin, self._cells, inside)
        return inside

    def solve(
        self,
        T_base_grippers: FloatArray,
        *,
        near: FloatArray | None = None,
        towards: FloatArray | None = None,
        after: IntArray | None = None,
        seeds: int | None = None,
    ) -> IkSolutions:
        """Find a configuration for each grasp.

        Args:
            T_base_grippers: Gripper poses, shape (N, 4, 4).
            near: Joint values (n,) to start from first, such as the current ones.
            towards: Joint values (n,) near which answers are preferred; default
                ``near``, and without it, the middle of the limits.
            after: Last start that was used for each grasp, shape (N,), to get another
                solution than that one's.
            seeds: How many starts to stop at; default all.

        Returns:
            Solutions inside the limits with margin.
        """
        targets = _targets(T_base_grippers)
        shared = np.zeros((0, len(self.lower)))
        if near is not None:
            shared = np.clip(near, self.lower, self.upper)[None]
            towards = near if towards is None else towards
        count = len(shared) + self._restarts
        count = count if seeds is None else min(count, seeds)
        starts = self._starts(count, shared[:count], towards)
        first = np.zeros(len(targets), dtype=np.int64)
        if after is not None:
            first = np.minimum(np.asarray(after, dtype=np.int64) + 1, count)
        first[~self.may_reach(T_base_grippers)] = count
        q = np.zeros((len(targets), len(self.lower)))
        used = np.empty(len(targets), dtype=np.int64)
        solve_batch(self.problem, starts, targets, first, q, used)
        return IkSolutions(q, used < count, used)

    def _starts(
        self, count: int, shared: FloatArray, towards: FloatArray | None
    ) -> Starts:
        towards = self._middle if towards is None else np.asarray(towards)
        return Starts(
            shared=np.ascontiguousarray(shared, dtype=np.float64),
            table=self._known.table,
            spare=np.concatenate([towards[None], self._random]),
            wrist=self._known.wrist,
            towards=towards,
            speeds=self._speeds,
            tries=count,
        )

    def search(self, problem: WayProblem, way: Way, towards: FloatArray) -> ArmSearch:
        """Return this arm as a search for whole ways takes it.

        Args:
            problem: What its ways keep to.
            way: Room for one.
            towards: Joint values (n,) near which answers are preferred.
        """
        joints, count = len(self.lower), self._restarts
        return ArmSearch(
            problem=problem,
            starts=self._starts(count, np.zeros((0, joints)), towards),
            origin=self._known.origin,
            cells=self._cells,
            most_volume=float(self._known.best_manipulability),
            way=way,
            picks=np.empty((2, count), dtype=np.int64),
            costs=np.empty(count),
            q=np.empty((2, joints)),
        )

    def reaches_beyond_limits(self, T_base_grippers: FloatArray) -> BoolArray:
        """Return which grasps a longer joint travel would reach, shape (N,)."""
        targets = _targets(T_base_grippers)
        q = np.zeros((len(targets), len(self.lower)))
        used = np.empty(len(targets), dtype=np.int64)
        starts = self._starts(1, q[:0], None)
        first = np.zeros(len(targets), dtype=np.int64)
        solve_batch(self._widened, starts, targets, first, q, used)
        return np.asarray(used < 1)

    def follow(
        self, T_base_grippers: FloatArray, starts: FloatArray, *, max_change: float
    ) -> tuple[FloatArray, IntArray]:
        """Follow paths of close poses, each solved from the pose before.

        Args:
            T_base_grippers: Gripper poses, shape (N, S, 4, 4).
            starts: Joint values before each path's first pose, shape (N, n).
            max_change: Largest change of a joint between two poses in [rad] or [m].

        Returns:
            Joint values (N, S, n), and how many poses of each path were reached (N,).
        """
        count, length = T_base_grippers.shape[:2]
        targets = tcp_from_gripper(T_base_grippers)
        paths = np.zeros((count, length, len(self.lower)))
        reached = np.zeros(count, dtype=np.int64)
        starts = np.ascontiguousarray(starts)
        follow_batch(self.problem, targets, starts, max_change, paths, reached)
        return paths, reached

    def manipulability(self, q: FloatArray) -> FloatArray:
        """Return sqrt(det(J J^T)) of joint values (N, n) over the arm's best, 0..1."""
        rows = _rows(q)
        volumes = np.empty(len(rows))
        reach_volumes(self.problem, rows, volumes)
        return np.asarray(np.clip(volumes / self._known.best_manipulability, 0.0, 1.0))


def _rows(q: FloatArray) -> FloatArray:
    return np.ascontiguousarray(np.atleast_2d(q), dtype=np.float64)


def _targets(T_base_grippers: FloatArray) -> FloatArray:
    if T_base_grippers.ndim != 3 or T_base_grippers.shape[1:] != (4, 4):
        raise ShapeError("gripper poses", "(N, 4, 4)", T_base_grippers.shape)
    return np.ascontiguousarray(tcp_from_gripper(T_base_grippers))


@njit(cache=True, error_model="numpy")
def _look_up(targets, wrist, origin, cells, inside):  # type: ignore[no-untyped-def]
    """Write whether the wrist of each target pose lies in a cell of the reach map."""
    for i in range(targets.shape[0]):
        inside[i] = may_reach(targets[i], wrist, origin, cells)
