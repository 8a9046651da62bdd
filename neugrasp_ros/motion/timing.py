# SPDX-License-Identifier: Apache-2.0
"""Joint paths over time, with velocity, acceleration and jerk inside the limits.

A path is a curve q(s) of twice continuous slope. Ruckig times the one number s, from
rest to rest; the joints then move with

    q' = q_s s',   q'' = q_ss s'^2 + q_s s'',
    q''' = q_sss s'^3 + 3 q_ss s' s'' + q_s s'''

The bounds of s come from q_s alone; where the curve bends too much for them, the whole
motion is slowed down by the one factor that is needed. Ruckig is never given waypoints:
its community version would send them to a server.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from ruckig import InputParameter, Result, Ruckig, RuckigError
from ruckig import Trajectory as RuckigTrajectory
from scipy.interpolate import BSpline, make_interp_spline

from neugrasp_ros.errors import MotionError, ShapeError
from neugrasp_ros.motion.limits import Limits, Trajectory

FloatArray = NDArray[np.float64]

CHECK_STEP = 0.002  # [s]; spacing at which limits are verified
PATH_SAMPLES = 400  # at which the steepest slope of a curve is looked for
SLACK = 0.999  # of every limit, for rounding
STILL = 1e-9  # [rad] or [m]; a path shorter than this is no motion


class _Profile(NamedTuple):
    """Path length and its derivatives over time, each of shape (T,)."""

    times: FloatArray
    s: FloatArray
    speed: FloatArray
    acceleration: FloatArray


def time_line(
    start: FloatArray,
    goal: FloatArray,
    limits: Limits,
    joint_names: tuple[str, ...],
    *,
    step: float = 0.02,
) -> Trajectory:
    """Move all joints in step along the straight line between two postures.

    Args:
        start: Joint values in [rad] or [m], shape (n,).
        goal: Joint values, shape (n,).
        limits: Bounds.
        joint_names: Names of the joints.
        step: Spacing of the samples in [s].

    Raises:
        MotionError: If an end is outside the position limits.
    """
    curve = make_interp_spline([0.0, 1.0], np.stack([start, goal]), k=1)
    return time_curve(curve, limits, joint_names, step=step)


def time_points(
    points: FloatArray,
    limits: Limits,
    joint_names: tuple[str, ...],
    *,
    step: float = 0.02,
) -> Trajectory:
    """Move smoothly through close points, such as those of a straight approach.

    Args:
        points: Joint values in [rad] or [m], shape (S, n), S at least 2.
        limits: Bounds.
        joint_names: Names of the joints.
        step: Spacing of the samples in [s].

    Raises:
        ShapeError: If there are fewer than two points.
        MotionError: If the curve leaves the position limits.
    """
    if points.ndim != 2 or len(points) < 2:
        raise ShapeError("path points", "(S >= 2, n)", points.shape)
    knots = np.linspace(0.0, 1.0, len(points))
    curve = make_interp_spline(knots, points, k=min(3, len(points) - 1))
    return time_curve(curve, limits, joint_names, step=step)


def time_curve(
    curve: BSpline,
    limits: Limits,
    joint_names: tuple[str, ...],
    *,
    step: float = 0.02,
) -> Trajectory:
    """Move along a curve from rest to rest.

    Args:
        curve: Joint values over s from 0 to 1, of twice continuous slope.
        limits: Bounds.
        joint_names: Names of the joints.
        step: Spacing of the samples in [s].

    Raises:
        MotionError: If the curve leaves the position limits.
    """
    grid = np.linspace(0.0, 1.0, PATH_SAMPLES)
    positions = curve(grid)
    _require_inside(positions, limits, joint_names)
    slope = np.abs(_derivative(curve, 1, grid)).max(axis=0)
    if np.abs(positions - positions[0]).max() < STILL:
        ends = positions[[0, -1]]
        still = np.zeros_like(ends)
        return Trajectory(joint_names, np.array([0.0, step]), ends, still, still)
    bounds = [
        SLACK * float(np.min(limit / np.maximum(slope, 1e-12)))
        for limit in (limits.velocity, limits.acceleration, limits.jerk)
    ]
    profile = _time_length(bounds, CHECK_STEP)
    slower = _excess(curve, profile, bounds[2], limits)
    if slower > 1.0:
        bounds = [bound / slower**power for power, bound in enumerate(bounds, 1)]
    profile = _time_length(bounds, step)
    velocities, accelerations = _motion(curve, profile)
    return Trajectory(
        joint_names, profile.times, curve(profile.s), velocities, accelerations
    )


def calculate(request: InputParameter) -> RuckigTrajectory:
    """Let Ruckig calculate a motion from state to state.

    Raises:
        MotionError: If the request holds waypoints, which Ruckig would send to a
            server, or if there is no such motion.
    """
    if len(request.intermediate_positions):
        raise MotionError("Ruckig must not be given waypoints: they leave the machine")
    motion = RuckigTrajectory(request.degrees_of_freedom)
    try:
        result = Ruckig(request.degrees_of_freedom).calculate(request, motion)
    except RuckigError as error:
        raise MotionError(f"Ruckig refused: {error}") from error
    if result not in (Result.Working, Result.Finished):
        raise MotionError(f"Ruckig found no motion: {result}")
    return motion


def _time_length(bounds: list[float], step: float) -> _Profile:
    """Time the way from s = 0 to 1, at rest at both ends."""
    request = InputParameter(1)
    request.target_position = [1.0]
    request.max_velocity = [bounds[0]]
    request.max_acceleration = [bounds[1]]
    request.max_jerk = [bounds[2]]
    motion = calculate(request)
    count = max(2, int(np.ceil(motion.duration / step)) + 1)
    times = np.linspace(0.0, motion.duration, count)
    states = np.array([motion.at_time(time) for time in times])[:, :, 0]
    s, speed, acceleration = states.T
    return _Profile(times, np.clip(s, 0.0, 1.0), speed, acceleration)


def _motion(curve: BSpline, profile: _Profile) -> tuple[FloatArray, FloatArray]:
    """Return joint velocities and accelerations, each of shape (T, n)."""
    first = _derivative(curve, 1, profile.s)
    second = _derivative(curve, 2, profile.s)
    speed, acceleration = profile.speed[:, None], profile.acceleration[:, None]
    return first * speed, second * speed**2 + first * acceleration


def _excess(curve: BSpline, profile: _Profile, jerk: float, limits: Limits) -> float:
    """Return by which factor a motion must be slowed down to keep all limits."""
    velocities, accelerations = _motion(curve, profile)
    first, second, third = (
        np.abs(_derivative(curve, order, profile.s)) for order in (1, 2, 3)
    )
    speed, acceleration = profile.speed[:, None], np.abs(profile.acceleration[:, None])
    jerks = third * speed**3 + 3 * second * speed * acceleration + first * jerk
    return float(
        max(
            np.max(np.abs(velocities) / (SLACK * limits.velocity)),
            np.sqrt(np.max(np.abs(accelerations) / (SLACK * limits.acceleration))),
            np.cbrt(np.max(jerks / limits.jerk)),
        )
    )


def _derivative(curve: BSpline, order: int, s: FloatArray) -> FloatArray:
    if order > curve.k:
        return np.zeros((len(s), curve.c.shape[1]))
    return np.asarray(curve(s, nu=order))


def _require_inside(
    positions: FloatArray, limits: Limits, joint_names: tuple[str, ...]
) -> None:
    excess = np.maximum(limits.lower - positions, positions - limits.upper)
    row, joint = np.unravel_index(np.argmax(excess), excess.shape)
    if excess[row, joint] > STILL:
        raise MotionError(
            f"{joint_names[joint]} would be at {positions[row, joint]:.4f}, outside "
            f"[{limits.lower[joint]:.4f}, {limits.upper[joint]:.4f}]"
        )
