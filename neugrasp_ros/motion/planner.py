# SPDX-License-Identifier: Apache-2.0
"""Collision-free ways between two postures, by OMPL.

Joint values are measured in seconds at full speed, so that a slow torso counts for what
it costs. Whole edges are checked in one call, which is what makes Python fast enough.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou
from scipy.interpolate import BSpline

from neugrasp_ros.config import Checked, option
from neugrasp_ros.errors import MotionError
from neugrasp_ros.motion.limits import Limits, Trajectory, join_trajectories
from neugrasp_ros.motion.timing import time_curve, time_line

# OMPL has one generator per process and takes a seed only before its first number.
ou.RNG.setSeed(1)
ou.setLogLevel(ou.LogLevel.LOG_NONE)

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
FreeCheck = Callable[[FloatArray], BoolArray]
"""Says which postures (N, n) are free of collision, shape (N,)."""


@dataclass(frozen=True, kw_only=True)
class TransitConfig(Checked):
    """Search for a way through free space."""

    timeout: float = option(2.0, "Longest search [s]", 0.01, 60.0)
    check_step: float = option(
        0.02, "Largest change of a joint between checked postures [rad]", 0.001, 0.2
    )
    shortcut_time: float = option(0.1, "Time to shorten a way [s]", 0.0, 5.0)
    corner: float = option(
        0.12, "Way by which corners are rounded, in [s] at full speed", 0.01, 1.0
    )


class TransitPlanner:
    """Plans for one group of joints.

    Args:
        limits: Bounds of the group's joints.
        joint_names: Their names.
        is_free: Collision check.
        config: How long to search and how finely to check.
    """

    def __init__(
        self,
        limits: Limits,
        joint_names: tuple[str, ...],
        is_free: FreeCheck,
        config: TransitConfig | None = None,
    ) -> None:
        self._limits, self._names, self._is_free = limits, joint_names, is_free
        self._config = config or TransitConfig()

    def plan(self, start: FloatArray, goal: FloatArray) -> FloatArray:
        """Find corner points of a free way.

        Args:
            start: Joint values, shape (n,).
            goal: Joint values, shape (n,).

        Returns:
            Points with free straight lines between them, first the start, last the
            goal, shape (W, n).

        Raises:
            MotionError: If an end is in collision or outside its limits, or no way was
                found in time.
        """
        ends = np.stack([start, goal])
        outside = (ends < self._limits.lower) | (ends > self._limits.upper)
        for name, row, free in zip(
            ("start", "goal"), outside, self._is_free(ends), strict=True
        ):
            if row.any():
                joint = self._names[int(np.argmax(row))]
                raise MotionError(f"the {name} has {joint} outside its limits")
            if not free:
                raise MotionError(f"the {name} is in collision")
        if self.line_is_free(start, goal):
            return ends
        return self._search(start, goal)

    def move(
        self, start: FloatArray, goal: FloatArray, *, step: float = 0.02
    ) -> Trajectory:
        """Find a free way and time it: in one sweep where rounded corners stay free.

        Args:
            start: Joint values, shape (n,).
            goal: Joint values, shape (n,).
            step: Spacing of the samples in [s].

        Raises:
            MotionError: As ``plan``.
        """
        points = self.plan(start, goal)
        legs = [
            time_line(a, b, self._limits, self._names, step=step)
            for a, b in zip(points[:-1], points[1:], strict=True)
        ]
        halting = legs[0]
        for leg in legs[1:]:
            halting = join_trajectories(halting, leg)
        if len(legs) == 1:
            return halting
        curve = self.round_corners(points)
        if not self._is_free(curve(self._grid(points))).all():
            return halting
        sweep = time_curve(curve, self._limits, self._names, step=step)
        return sweep if sweep.duration < halting.duration else halting

    def line_is_free(self, start: FloatArray, goal: FloatArray) -> bool:
        """Return whether the straight line between two postures is free."""
        share = self._grid(np.stack([start, goal]))[:, None]
        return bool(self._is_free(start + share * (goal - start)).all())

    def round_corners(self, points: FloatArray) -> BSpline:
        """Return a smooth curve near the corner points, over s from 0 to 1.

        A cubic B-spline whose control points lie on the way: it leaves the way only
        within two of them of a corner, and never their hull.
        """
        dense = [points[:1]]
        for a, b in zip(points[:-1], points[1:], strict=True):
            seconds = np.linalg.norm((b - a) / self._limits.velocity)
            count = max(2, int(np.ceil(seconds / self._config.corner)))
            dense.append(a + np.linspace(0, 1, count + 1)[1:, None] * (b - a))
        control = np.concatenate(dense)
        inner = np.linspace(0.0, 1.0, len(control) - 2)
        knots = np.concatenate([[0.0] * 3, inner, [1.0] * 3])
        return BSpline(knots, control, 3)

    def _grid(self, points: FloatArray) -> FloatArray:
        """Return values of s from 0 to 1, close enough to check a way by them."""
        largest = np.abs(np.diff(points, axis=0)).max(axis=1).sum()
        count = int(np.ceil(largest / self._config.check_step)) + 1
        return np.linspace(0.0, 1.0, max(2, count))

    def _search(self, start: FloatArray, goal: FloatArray) -> FloatArray:
        speed = self._limits.velocity
        space = ob.RealVectorStateSpace(len(speed))
        bounds = ob.RealVectorBounds(len(speed))
        for k in range(len(speed)):
            bounds.setLow(k, float(self._limits.lower[k] / speed[k]))
            bounds.setHigh(k, float(self._limits.upper[k] / speed[k]))
        space.setBounds(bounds)
        setup = og.SimpleSetup(space)
        information = setup.getSpaceInformation()

        def read(state: ob.State) -> FloatArray:
            return np.array([state[k] for k in range(len(speed))]) * speed

        planner = self

        class EdgeCheck(ob.MotionValidator):
            """Checks an edge in one call."""

            def checkMotion(self, first: ob.State, second: ob.State) -> bool:
                return planner.line_is_free(read(first), read(second))

        setup.setStateValidityChecker(lambda s: bool(self._is_free(read(s)[None])[0]))
        validator = EdgeCheck(information)
        information.setMotionValidator(validator)
        setup.setPlanner(og.RRTConnect(information))
        first, last = space.allocState(), space.allocState()
        for k in range(len(speed)):
            first[k], last[k] = float(start[k] / speed[k]), float(goal[k] / speed[k])
        setup.setStartAndGoalStates(first, last)
        setup.solve(self._config.timeout)
        if not setup.haveExactSolutionPath():
            raise MotionError(f"no free way found in {self._config.timeout} s")
        if self._config.shortcut_time > 0:
            setup.simplifySolution(self._config.shortcut_time)
        points = np.array(
            [read(state) for state in setup.getSolutionPath().getStates()]
        )
        points[0], points[-1] = start, goal
        return points
