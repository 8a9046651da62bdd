# SPDX-License-Identifier: Apache-2.0
"""Batch inverse kinematics by damped least squares, compiled.

Each step solves, with the pose error e = (translation, rotation vector) in the base
frame, the Jacobian J, joint weights W and a damping that shrinks with the error,

    dq = W J^T (J W J^T + (mu |e|^2 + eps) I)^-1 e

and clips to the limits. A joint that a limit stops gets weight zero for one more
solve of that step. [Sugihara2011]
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from neugrasp_ros.robot.chain import SerialChain, fill_jacobian, tip_and_axes

MU, EPS = 0.02, 1e-6  # damping, relative and floor, at errors of the order of 1
POLISH = 1  # steps more once inside the tolerance, so that paths come out smooth
STALL_STEPS = 4  # in which the error must halve
MAX_STEP = 0.8  # [rad] or [m], of any joint in one iteration


class IkProblem(NamedTuple):
    """What stays the same for a batch.

    Attributes:
        chain: The arm.
        lower: Lower bounds of the solution in [rad] or [m], shape (n,).
        upper: Upper bounds, shape (n,).
        weights: Mobility of each joint, shape (n,): 1 = free, small = moves last.
        tolerance: Largest accepted errors in [m] and [rad].
        max_iterations: Steps from one seed.
    """

    chain: SerialChain
    lower: np.ndarray
    upper: np.ndarray
    weights: np.ndarray
    tolerance: tuple[float, float]
    max_iterations: int


@njit(cache=True, error_model="numpy")
def _pose_error(rotation, position, target_rotation, target_position, error):  # type: ignore[no-untyped-def]
    """Write e, in the base frame; return the two error norms in [m] and [rad]."""
    for i in range(3):
        error[i] = target_position[i] - position[i]
    # D = R_target R^T; its axis times sine, and its trace
    vx = vy = vz = 0.0
    trace = 0.0
    for k in range(3):
        tx, ty, tz = target_rotation[0, k], target_rotation[1, k], target_rotation[2, k]
        rx, ry, rz = rotation[0, k], rotation[1, k], rotation[2, k]
        trace += tx * rx + ty * ry + tz * rz
        vx += ry * tz - rz * ty
        vy += rz * tx - rx * tz
        vz += rx * ty - ry * tx
    vx, vy, vz = 0.5 * vx, 0.5 * vy, 0.5 * vz
    sine = np.sqrt(vx * vx + vy * vy + vz * vz)
    angle = np.arctan2(sine, 0.5 * (trace - 1.0))
    scale = angle / sine if sine > 1e-9 else 1.0
    error[3], error[4], error[5] = scale * vx, scale * vy, scale * vz
    distance = np.sqrt(error[0] ** 2 + error[1] ** 2 + error[2] ** 2)
    return distance, angle


@njit(cache=True, error_model="numpy", fastmath=True)
def _fill_gram(jacobian, weights, damping, matrix):  # type: ignore[no-untyped-def]
    """Write the lower half of J W J^T + damping I, shape (6, 6)."""
    joints = weights.shape[0]
    for i in range(6):
        for j in range(i + 1):
            total = 0.0
            for k in range(joints):
                total += jacobian[i, k] * weights[k] * jacobian[j, k]
            matrix[i, j] = total
        matrix[i, i] += damping


@njit(cache=True, error_model="numpy", fastmath=True)
def _solve_cholesky(matrix, right, solution):  # type: ignore[no-untyped-def]
    """Solve a positive definite 6x6 system; its lower half is overwritten.

    The diagonal ends up as the factor's inverse: a product is cheaper than a quotient.
    """
    for j in range(6):
        for k in range(j):
            for i in range(j, 6):
                matrix[i, j] -= matrix[i, k] * matrix[j, k]
        inverse = 1.0 / np.sqrt(max(matrix[j, j], 1e-18))
        matrix[j, j] = inverse
        for i in range(j + 1, 6):
            matrix[i, j] *= inverse
    for i in range(6):
        total = right[i]
        for k in range(i):
            total -= matrix[i, k] * solution[k]
        solution[i] = total * matrix[i, i]
    for i in range(5, -1, -1):
        total = solution[i]
        for k in range(i + 1, 6):
            total -= matrix[k, i] * solution[k]
        solution[i] = total * matrix[i, i]


@njit(cache=True, error_model="numpy")
def _block_at_limits(problem, q, step, mobility):  # type: ignore[no-untyped-def]
    """Take the mobility of joints that a limit stops; return whether there were any."""
    blocked = False
    for k in range(q.shape[0]):
        below = q[k] <= problem.lower[k] and step[k] < 0.0
        above = q[k] >= problem.upper[k] and step[k] > 0.0
        if mobility[k] > 0.0 and (below or above):
            mobility[k] = 0.0
            blocked = True
    return blocked


@njit(cache=True, error_model="numpy")
def _move(problem, q, jacobian, error, damping, scratch):  # type: ignore[no-untyped-def]
    """Take one damped step, in place, inside the limits."""
    matrix, solution, mobility, step = scratch
    joints = q.shape[0]
    mobility[:] = problem.weights
    for _ in range(3):
        _fill_gram(jacobian, mobility, damping, matrix)
        _solve_cholesky(matrix, error, solution)
        for k in range(joints):
            step[k] = 0.0
            for i in range(6):
                step[k] += mobility[k] * jacobian[i, k] * solution[i]
        if not _block_at_limits(problem, q, step, mobility):
            break
    largest = 0.0
    for k in range(joints):
        largest = max(largest, abs(step[k]))
    scale = min(1.0, MAX_STEP / largest) if largest > 0.0 else 1.0
    for k in range(joints):
        moved = q[k] + scale * step[k]
        q[k] = min(max(moved, problem.lower[k]), problem.upper[k])


@njit(cache=True, error_model="numpy")
def make_scratch(joints):  # type: ignore[no-untyped-def]
    """Allocate what solving for an arm of ``joints`` joints writes on its way."""
    return (
        np.empty((3, 3)),
        np.empty(3),
        np.empty((joints, 3)),
        np.empty((joints, 3)),
        np.empty((6, joints)),
        np.empty(6),
        np.empty(joints),
        (np.empty((6, 6)), np.empty(6), np.empty(joints), np.empty(joints)),
    )


@njit(cache=True, error_model="numpy")
def solve_from(problem, target_rotation, target_position, q, scratch):  # type: ignore[no-untyped-def]
    """Move ``q`` (n,), in place, until its tip is at the target; return success."""
    rotation, position, axes, origins, jacobian, error, best, equations = scratch
    checkpoint, inside = np.inf, 0
    for iteration in range(problem.max_iterations + 1):
        tip_and_axes(problem.chain, q, rotation, position, axes, origins)
        distance, angle = _pose_error(
            rotation, position, target_rotation, target_position, error
        )
        if distance < problem.tolerance[0] and angle < problem.tolerance[1]:
            if inside == POLISH:
                return True
            inside += 1
            best[:] = q
        elif inside:
            q[:] = best  # polishing left the tolerance: stay where it was kept
            return True
        size = distance + 0.3 * angle
        if not inside and iteration % STALL_STEPS == 0:
            if size > 0.5 * checkpoint:
                return False  # stuck: the next seed is the better use of time
            checkpoint = size
        fill_jacobian(problem.chain, position, axes, origins, jacobian)
        _move(problem, q, jacobian, error, MU * size * size + EPS, equations)
    if inside:
        q[:] = best
    return inside > 0


@njit(cache=True, error_model="numpy")
def follow_way(problem, targets, start, max_change, way, scratch):  # type: ignore[no-untyped-def]
    """Follow a sequence of close poses, each solved from where the last two lead.

    Args:
        problem: Arm, bounds, tolerances.
        targets: Poses ``T_base_tip``, shape (S, 4, 4).
        start: Configuration before the first pose, shape (n,).
        max_change: Largest change of a joint between two poses in [rad] or [m].
        way: Receives the configurations, shape (S, n).
        scratch: From ``make_scratch``.

    Returns:
        How many poses were reached before the way broke.
    """
    for s in range(targets.shape[0]):
        previous = way[s - 1] if s else start
        for k in range(start.shape[0]):
            # as far again as the last step
            guess = previous[k]
            if s:
                guess += previous[k] - (way[s - 2, k] if s > 1 else start[k])
            way[s, k] = min(max(guess, problem.lower[k]), problem.upper[k])
        target = targets[s]
        if not solve_from(problem, target[:3, :3], target[:3, 3], way[s], scratch):
            return s
        for k in range(start.shape[0]):
            if abs(way[s, k] - previous[k]) > max_change:
                return s
    return targets.shape[0]


@njit(cache=True, error_model="numpy")
def follow_batch(problem, targets, starts, max_change, paths, reached):  # type: ignore[no-untyped-def]
    """Follow N sequences of close poses, see ``follow_way``.

    Args:
        problem: Arm, bounds, tolerances.
        targets: Poses ``T_base_tip``, shape (N, S, 4, 4).
        starts: Configurations before the first pose, shape (N, n).
        max_change: Largest change of a joint between two poses in [rad] or [m].
        paths: Receives the configurations, shape (N, S, n).
        reached: Receives how many poses were reached before the path broke, (N,).
    """
    scratch = make_scratch(starts.shape[1])
    for i in range(targets.shape[0]):
        reached[i] = follow_way(
            problem, targets[i], starts[i], max_change, paths[i], scratch
        )


@njit(cache=True, error_model="numpy")
def reach_volume(problem, q, scratch):  # type: ignore[no-untyped-def]
    """Return sqrt(det(J J^T)) at the tip for joint values (n,)."""
    rotation, position, axes, origins, jacobian, error, free, equations = scratch
    error[:], free[:] = 0.0, 1.0
    tip_and_axes(problem.chain, q, rotation, position, axes, origins)
    fill_jacobian(problem.chain, position, axes, origins, jacobian)
    _fill_gram(jacobian, free, 0.0, equations[0])
    _solve_cholesky(equations[0], error, equations[1])
    volume = 1.0
    for k in range(6):
        volume /= equations[0][k, k]  # the factor's diagonal, inverted
    return volume


@njit(cache=True, error_model="numpy")
def reach_volumes(problem, configurations, volumes):  # type: ignore[no-untyped-def]
    """Write sqrt(det(J J^T)) at the tip.

    Args:
        problem: The arm.
        configurations: Joint values, shape (N, n).
        volumes: Receives the volumes, shape (N,).
    """
    scratch = make_scratch(configurations.shape[1])
    for i in range(configurations.shape[0]):
        volumes[i] = reach_volume(problem, configurations[i], scratch)
