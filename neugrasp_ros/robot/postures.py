# SPDX-License-Identifier: Apache-2.0
"""Stored postures of an arm, found by where they put the wrist and how they turn it.

A posture that nearly does what is asked is a far better start for inverse kinematics
than one that serves everything a little: it gets there in fewer steps, and where the
nearest few get nowhere, there is seldom a way. One look takes a few microseconds.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from neugrasp_ros.robot.ik import make_scratch, solve_from

FloatArray = NDArray[np.float64]

CELL = 0.1  # [m]; postures of one look put the wrist into one cell
PER_CELL = 96  # postures kept of one
TRAVEL = 0.05  # what a second on the way costs, in units of ``3 - trace``: 18 degrees


class PostureTable(NamedTuple):
    """Postures, cell by cell.

    Attributes:
        corner: Lower corner of the cells in the base frame in [m], shape (3,).
        shape: Number of cells along x, y, z, shape (3,).
        starts: Where each cell's postures begin, shape (X * Y * Z + 1,).
        postures: Joint values, shape (P, n).
        turns: The tip's rotation in the base frame, row by row, shape (P, 9).
    """

    corner: FloatArray
    shape: NDArray[np.int64]
    starts: NDArray[np.int64]
    postures: NDArray[np.float32]
    turns: NDArray[np.float32]


class Starts(NamedTuple):
    """Where inverse kinematics begins.

    Attributes:
        shared: Joint values tried first for every target, shape (M, n).
        table: Stored postures tried then.
        spare: Joint values tried last, where the table has too few, shape (R, n).
        wrist: The wrist in the tip frame in [m], shape (3,).
        towards: Joint values that answers had better be near to, shape (n,).
        speeds: Of the joints in [rad/s] or [m/s], shape (n,).
        tries: How many to try in all.
    """

    shared: FloatArray
    table: PostureTable
    spare: FloatArray
    wrist: FloatArray
    towards: FloatArray
    speeds: FloatArray
    tries: int


def make_table(
    postures: FloatArray, poses: FloatArray, wrist: FloatArray
) -> PostureTable:
    """Sort postures into a table; of a crowded cell the first are kept.

    Args:
        postures: Joint values, shape (P, n).
        poses: Their poses ``T_base_tip``, shape (P, 4, 4).
        wrist: The wrist in the tip frame in [m], shape (3,).
    """
    points = poses[:, :3, :3] @ wrist + poses[:, :3, 3]
    corner = points.min(axis=0)
    index = np.floor((points - corner) / CELL).astype(np.int64)
    cells = index.max(axis=0) + 1
    flat = (index[:, 0] * cells[1] + index[:, 1]) * cells[2] + index[:, 2]
    order = np.argsort(flat, kind="stable")
    begins = np.searchsorted(flat[order], flat[order])
    order = order[np.arange(len(order)) - begins < PER_CELL]
    counts = np.bincount(flat[order], minlength=int(np.prod(cells)))
    return PostureTable(
        corner=corner,
        shape=cells,
        starts=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        postures=postures[order].astype(np.float32),
        turns=poses[order, :3, :3].reshape(-1, 9).astype(np.float32),
    )


@njit(cache=True, error_model="numpy")
def _cell_of(table, wrist, target):  # type: ignore[no-untyped-def]
    """Return the number of the cell of a target's wrist; the border's if outside."""
    cell = 0
    for k in range(3):
        value = target[k, 3] - table.corner[k]
        for j in range(3):
            value += target[k, j] * wrist[j]
        number = min(max(int(np.floor(value / CELL)), 0), table.shape[k] - 1)
        cell = cell * table.shape[k] + number
    return cell


@njit(cache=True, error_model="numpy")
def _turn_cost(table, s, target):  # type: ignore[no-untyped-def]
    """Return how far posture ``s`` is turned from what is asked."""
    cost = 3.0
    for k in range(3):
        for j in range(3):
            cost -= target[k, j] * table.turns[s, 3 * k + j]
    return cost


@njit(cache=True, error_model="numpy")
def _travel_cost(table, s, towards, speeds):  # type: ignore[no-untyped-def]
    seconds = 0.0
    for k in range(towards.shape[0]):
        seconds = max(seconds, abs(table.postures[s, k] - towards[k]) / speeds[k])
    return TRAVEL * seconds


@njit(cache=True, error_model="numpy")
def pick_postures(starts, target, costs, picks):  # type: ignore[no-untyped-def]
    """Write the numbers of the best stored postures for a target, the best first.

    Args:
        starts: The postures, and what answers had better be near to.
        target: Pose ``T_base_tip``, shape (4, 4).
        costs: Scratch, shape (K,).
        picks: Receives the numbers, shape (K,).

    Returns:
        How many there are, at most K.
    """
    table, towards, speeds = starts.table, starts.towards, starts.speeds
    cell, wanted, count = _cell_of(table, starts.wrist, target), picks.shape[0], 0
    if wanted == 0:
        return 0
    for s in range(table.starts[cell], table.starts[cell + 1]):
        cost = _turn_cost(table, s, target)
        if count == wanted and cost >= costs[wanted - 1]:
            continue
        cost += _travel_cost(table, s, towards, speeds)
        if count == wanted and cost >= costs[wanted - 1]:
            continue
        place = min(count, wanted - 1)
        while place > 0 and costs[place - 1] > cost:
            costs[place] = costs[place - 1]
            picks[place] = picks[place - 1]
            place -= 1
        costs[place], picks[place] = cost, s
        count = min(count + 1, wanted)
    return count


@njit(cache=True, error_model="numpy")
def pick_starts(starts, target, costs, picks):  # type: ignore[no-untyped-def]
    """Write the numbers of the best starts, see ``pick_postures``, then spare ones.

    A spare one's number is negative, from -1 on.
    """
    found = pick_postures(starts, target, costs, picks)
    spare = min(starts.spare.shape[0], picks.shape[0] - found)
    for r in range(spare):
        picks[found + r] = -1 - r
    return found + spare


@njit(cache=True, error_model="numpy")
def write_start(starts, pick, q):  # type: ignore[no-untyped-def]
    """Write the joint values of a start that ``pick_starts`` named, shape (n,)."""
    for j in range(q.shape[0]):
        if pick >= 0:
            q[j] = starts.table.postures[pick, j]
        else:
            q[j] = starts.spare[-1 - pick, j]


@njit(cache=True, error_model="numpy")
def solve_batch(problem, starts, targets, first, solutions, used):  # type: ignore[no-untyped-def]
    """Solve for each target from the first start that leads there.

    Args:
        problem: Arm, bounds, tolerances.
        starts: Where to begin.
        targets: Poses ``T_base_tip``, shape (N, 4, 4).
        first: Start to begin with for each target, shape (N,); past the last = none.
        solutions: Receives the configurations, shape (N, n).
        used: Receives the number of the start that led there, ``starts.tries`` where
            none did.
    """
    count, shared = starts.tries, starts.shared.shape[0]
    costs, picks = np.empty(count), np.empty(count - shared, dtype=np.int64)
    scratch = make_scratch(solutions.shape[1])
    for i in range(targets.shape[0]):
        used[i], target, q = count, targets[i], solutions[i]
        if first[i] >= count:
            continue
        found = shared + pick_starts(starts, target, costs, picks)
        for k in range(first[i], found):
            if k < shared:
                q[:] = starts.shared[k]
            else:
                write_start(starts, picks[k - shared], q)
            if solve_from(problem, target[:3, :3], target[:3, 3], q, scratch):
                used[i] = k
                break
