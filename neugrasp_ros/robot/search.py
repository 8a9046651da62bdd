# SPDX-License-Identifier: Apache-2.0
"""Compiled search for the ways of many grasps: every arm, both sides of the hand.

A branch is an arm with a side of the hand. Each has a solution at most at a time; of
one grasp, the branches' solutions are tried from the best to the worst, and where none
works, each branch looks for another, from its next start.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from neugrasp_ros.robot.contact import FREE, HAND, SELF
from neugrasp_ros.robot.ik import reach_volume, solve_from
from neugrasp_ros.robot.posing import make_buffers
from neugrasp_ros.robot.postures import Starts, pick_starts, write_start
from neugrasp_ros.robot.seeds import may_reach
from neugrasp_ros.robot.ways import Line, Way, WayProblem, try_way

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

ALL_STARTS = 1 << 30

UNSOLVED, HITS_ITSELF, HITS_SCENE, NO_WAY, DONE = 0, 1, 2, 3, 4
"""How far a grasp got; of several tries the farthest counts."""


class ArmSearch(NamedTuple):
    """One arm in a search.

    Attributes:
        problem: What its ways keep to.
        starts: Where its inverse kinematics begins, without shared ones.
        origin: Lower corner of its reach map in the base frame in [m], shape (3,).
        cells: Where its wrist can be, shape (X, Y, Z).
        most_volume: What manipulability is a share of.
        way: Room for one way.
        picks: Room for each side's starts, as of ``pick_starts``, shape (2, K).
        costs: Scratch, shape (K,).
        q: Room for each side's joint values, shape (2, n).
    """

    problem: WayProblem
    starts: Starts
    origin: FloatArray
    cells: BoolArray
    most_volume: float
    way: Way
    picks: IntArray
    costs: FloatArray
    q: FloatArray


class Question(NamedTuple):
    """What is asked of N grasps.

    Attributes:
        targets: Poses ``T_base_tip``, those of the other side behind, (2 N, 4, 4).
        behind: Tip positions on the way back in [m], shape (N, S, 3).
        above: Tip positions on the way up in [m], shape (N, L, 3).
        begins: Configurations that hold all other joints, by arm, shape (A, N, J).
        asked: Which arms are to try, shape (A,).
        first_starts: Starts tried for every branch.
        most_starts: Starts tried in all where no branch has a solution from those.
        retries: How often the branches look for other solutions.
        travel_weight: Manipulability given up to arrive a second earlier in [1/s].
        min_manipulability: Smallest manipulability.
    """

    targets: FloatArray
    behind: FloatArray
    above: FloatArray
    begins: FloatArray
    asked: BoolArray
    first_starts: int
    most_starts: int
    retries: int
    travel_weight: float
    min_manipulability: float


class Answers(NamedTuple):
    """What comes of N grasps; but for ``progress``, of meaning where ``DONE``.

    Attributes:
        progress: How far each got, shape (N,).
        branches: Arm's number times two, one more for the half-turned hand, (N,).
        manipulability: Shape (N,).
        q: Joint values at the grasp, the widest arm's n of them, shape (N, n).
        retreats: Joint values from the grasp backwards, without it, (N, S, n).
        lifts: Joint values from the grasp upwards, without it, (N, L, n).
    """

    progress: IntArray
    branches: IntArray
    manipulability: FloatArray
    q: FloatArray
    retreats: FloatArray
    lifts: FloatArray


class Branches(NamedTuple):
    """State of a grasp's branches, shape (2 A,) each.

    Attributes:
        picked: How many starts there are so far.
        used: The last start that was tried.
        alive: There is a solution.
        scores: How good it is.
        manipulability: Of it.
    """

    picked: IntArray
    used: IntArray
    alive: BoolArray
    scores: FloatArray
    manipulability: FloatArray


def no_answers(count: int, back: int, up: int, width: int) -> Answers:
    """Return room for the answers to so many grasps, S, L and n."""
    return Answers(
        progress=np.full(count, UNSOLVED),
        branches=np.full(count, -1),
        manipulability=np.full(count, np.nan),
        q=np.full((count, width), np.nan),
        retreats=np.full((count, back, width), np.nan),
        lifts=np.full((count, up, width), np.nan),
    )


@njit(cache=True, error_model="numpy")
def _pick(arm, target, side, stop, picked):  # type: ignore[no-untyped-def]
    """Pick the first starts, or all of them where more is asked for."""
    wanted = stop if picked == 0 else arm.starts.tries
    picks = arm.picks[side, :wanted]
    return pick_starts(arm.starts, target, arm.costs[:wanted], picks)


@njit(cache=True, error_model="numpy")
def _solve_on(arm, target, side, stop, state):  # type: ignore[no-untyped-def]
    """Solve for a branch from the starts behind the last; return success."""
    picked, used, number = state
    stop = min(stop, arm.starts.tries)
    if used[number] + 1 >= stop:
        return False
    if picked[number] < stop:
        picked[number] = _pick(arm, target, side, stop, picked[number])
    q = arm.q[side]
    for k in range(used[number] + 1, min(stop, picked[number])):
        used[number] = k
        write_start(arm.starts, arm.picks[side, k], q)
        turn, place = target[:3, :3], target[:3, 3]
        if solve_from(arm.problem.ik, turn, place, q, arm.way.scratch):
            return True
    return False


@njit(cache=True, error_model="numpy")
def _rate(arm, side, number, question, branches):  # type: ignore[no-untyped-def]
    """Rate a branch's solution; one that is not nimble enough does not count."""
    q, starts = arm.q[side], arm.starts
    volume = reach_volume(arm.problem.ik, q, arm.way.scratch)
    share = min(max(volume / arm.most_volume, 0.0), 1.0)
    seconds = 0.0
    for k in range(q.shape[0]):
        seconds = max(seconds, abs(q[k] - starts.towards[k]) / starts.speeds[k])
    branches.manipulability[number] = share
    branches.scores[number] = share - question.travel_weight * seconds
    branches.alive[number] = share >= question.min_manipulability


@njit(cache=True, error_model="numpy")
def _look_on(arms, question, i, stop, branches):  # type: ignore[no-untyped-def]
    """Solve for all branches that are alive; return whether one still is."""
    count, some = question.targets.shape[0] // 2, False
    for number in range(branches.alive.shape[0]):
        if not branches.alive[number]:
            continue
        side = number % 2
        arm, target = arms[number // 2], question.targets[i + count * side]
        state = (branches.picked, branches.used, number)
        branches.alive[number] = _solve_on(arm, target, side, stop, state)
        if branches.alive[number]:
            _rate(arm, side, number, question, branches)
        some |= branches.alive[number]
    return some


@njit(cache=True, error_model="numpy")
def _open_branches(arms, question, i, branches):  # type: ignore[no-untyped-def]
    """Bring all branches that are not out of the question to life."""
    count = question.targets.shape[0] // 2
    for number in range(branches.alive.shape[0]):
        arm, target = arms[number // 2], question.targets[i + count * (number % 2)]
        branches.alive[number] = question.asked[number // 2] and may_reach(
            target, arm.starts.wrist, arm.origin, arm.cells
        )


@njit(cache=True, error_model="numpy")
def _first_solutions(arms, question, i, branches):  # type: ignore[no-untyped-def]
    """Find the first solutions of a grasp; return whether there is one."""
    branches.picked[:], branches.used[:] = 0, -1
    _open_branches(arms, question, i, branches)
    if _look_on(arms, question, i, question.first_starts, branches):
        return True
    branches.used[:] = question.first_starts - 1
    _open_branches(arms, question, i, branches)
    return _look_on(arms, question, i, question.most_starts, branches)


@njit(cache=True, error_model="numpy")
def _best(waiting, scores):  # type: ignore[no-untyped-def]
    """Return the best of the branches that wait."""
    best = -1
    for number in range(waiting.shape[0]):
        if waiting[number] and (best < 0 or scores[number] > scores[best]):
            best = number
    return best


@njit(cache=True, error_model="numpy")
def _keep(arm, number, i, branches, answers):  # type: ignore[no-untyped-def]
    """Write down the way that works."""
    answers.branches[i] = number
    answers.manipulability[i] = branches.manipulability[number]
    n = arm.q.shape[1]
    answers.q[i, :n] = arm.q[number % 2]
    answers.retreats[i, :, :n], answers.lifts[i, :, :n] = arm.way.retreat, arm.way.lift


@njit(cache=True, error_model="numpy")
def _progress(here, on_way):  # type: ignore[no-untyped-def]
    if here == SELF:
        return HITS_ITSELF
    if here != FREE:
        return HITS_SCENE
    return DONE if on_way == FREE else NO_WAY


@njit(cache=True, error_model="numpy")
def _try_branches(arms, question, i, branches, answers, place):  # type: ignore[no-untyped-def]
    """Try the living branches, the best first; return whether the grasp is settled.

    Where the hand itself hits the scene, no other way helps.
    """
    count = answers.progress.shape[0]
    waiting = branches.alive.copy()
    while waiting.any():
        number = _best(waiting, branches.scores)
        waiting[number], side = False, number % 2
        arm, target = arms[number // 2], question.targets[i + count * side]
        start = question.begins[number // 2, i]
        line = Line(target, question.behind[i], question.above[i], start)
        here, on_way = try_way(arm.problem, line, arm.q[side], arm.way, place)
        got = _progress(here, on_way)
        answers.progress[i] = max(answers.progress[i], got)
        if got == DONE:
            _keep(arm, number, i, branches, answers)
        if got == DONE or here == HAND or (here == FREE and on_way == HAND):
            return True
    return False


@njit(cache=True, error_model="numpy")
def search_ways(world, arms, question, answers):  # type: ignore[no-untyped-def]
    """Search a way for each grasp.

    Args:
        world: Robot and obstacles.
        arms: All arms, a tuple of ``ArmSearch``; that it is always as long saves
            compiling for other lengths.
        question: What is asked.
        answers: From ``no_answers``; receives the answers.
    """
    pairs, count = 0, 2 * len(arms)
    for arm in range(len(arms)):
        pairs = max(pairs, arms[arm].problem.scope.pairs.shape[0])
    # one posed world serves all arms; what separated a pair is a guess, so it may mix
    known = np.full(question.begins.shape[2], np.nan)
    place = (world, known, make_buffers(world, pairs))
    branches = Branches(
        np.zeros(count, dtype=np.int64),
        np.zeros(count, dtype=np.int64),
        np.zeros(count, dtype=np.bool_),
        np.zeros(count),
        np.zeros(count),
    )
    for i in range(answers.progress.shape[0]):
        alive, left = _first_solutions(arms, question, i, branches), question.retries
        while alive:
            if _try_branches(arms, question, i, branches, answers, place) or left == 0:
                break
            left -= 1
            alive = _look_on(arms, question, i, ALL_STARTS, branches)
