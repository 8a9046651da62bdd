# SPDX-License-Identifier: Apache-2.0
"""Both orders of score and reach, with a planner and a robot that are made up."""

from dataclasses import replace

import numpy as np
import pytest

from neugrasp_ros.benchmark.robot_detection import SUPPORT_HEIGHT, Detector
from neugrasp_ros.fusion.tsdf import TsdfVolume
from neugrasp_ros.geometry.transform import flip_gripper, translation
from neugrasp_ros.grasp.types import GraspSet
from neugrasp_ros.manipulation.mover import Surroundings
from neugrasp_ros.manipulation.scene_watch import SeenScene
from neugrasp_ros.robot.reachability import Reach

VOXEL, TRUNCATION = 0.3 / 64, 4 * 0.3 / 64
T_BASE_TASK = translation(0.4, -0.15, 0.65)
Q = np.zeros(3)


def seen(top) -> SeenScene:
    """A level surface at a height of the task frame in [m]."""
    heights = (np.arange(64) + 0.5) * VOXEL - top
    column = np.clip(heights / TRUNCATION, -1, 1).astype(np.float32)
    values = np.broadcast_to(column, (64, 64, 64)).copy()
    volume = TsdfVolume(values, np.ones((64,) * 3, np.uint8), VOXEL, TRUNCATION, 1)
    return SeenScene(volume, T_BASE_TASK, 3, 0)


THINGS = seen(SUPPORT_HEIGHT + 0.08)


class Planner:
    """Proposes a grasp every 5 cm; their qualities are given."""

    def __init__(self, quality) -> None:
        self.quality, self.scored = np.array(quality, dtype=float), []

    def encode(self, volume, revision):
        return revision

    def sample(self, encoded, *, max_candidates, seed):
        count = min(max_candidates, len(self.quality))
        poses = np.array([translation(0.05 * k, 0.0, 0.1) for k in range(count)])
        return GraspSet(poses.reshape(-1, 4, 4), np.full(count, 0.08))

    def evaluate(self, encoded, grasps, *, deadline):
        self.scored.append(grasps.ids)
        rows = [int(name[1:]) for name in grasps.ids]
        return replace(grasps, quality=self.quality[rows])


class Result:
    def __init__(self, codes, flipped) -> None:
        self.codes, self.flipped = codes, flipped
        self.reachable = codes == Reach.OK

    def arm_of(self, row):
        return "left" if self.reachable[row] else ""


class Checker:
    """Reaches what is less than 12 cm from the corner of the task frame along x."""

    def __init__(self, turned=False) -> None:
        self.turned, self.starts = turned, []

    def check(self, T_base_gripper, *, start, obstacles):
        self.starts.append(start)
        near = T_base_gripper[:, 0, 3] - T_BASE_TASK[0, 3] < 0.12
        codes = np.where(near, Reach.OK, Reach.NO_IK)
        return Result(codes, np.full(len(codes), self.turned))


def find(planner, checker=None, scene=THINGS, candidates=256, **options):
    detector = Detector(planner, checker or Checker(), candidates)
    return detector.find(scene, Surroundings(), Q, seed=1, **options)


def test_reachable_good_grasps_come_best_first_in_the_base_frame():
    planner = Planner([0.6, 0.9, 0.4, 0.8, 0.7])
    found = find(planner)
    assert found.quality.tolist() == [0.9, 0.6] and found.arms == ("left", "left")
    expected = [T_BASE_TASK @ translation(x, 0.0, 0.1) for x in (0.05, 0.0)]
    assert found.poses == pytest.approx(np.array(expected))
    assert (found.sampled, found.scored, found.why) == (5, 5, "")
    assert found.codes == {"OK": 2, "NO_IK": 2}, "of the good ones"
    assert set(found.seconds) == {"proposing", "scoring", "reachability"}


def test_reach_first_scores_only_what_is_reached():
    planner = Planner([0.6, 0.9, 0.4, 0.8, 0.7])
    found = find(planner, reach_first=True)
    assert planner.scored == [("g0000", "g0001", "g0002")]
    assert found.quality.tolist() == [0.9, 0.6]
    assert found.codes == {"OK": 3, "NO_IK": 2}, "of all proposed"


def test_the_half_turned_twin_is_answered_where_that_is_reached():
    found = find(Planner([0.9]), Checker(turned=True))
    plain = find(Planner([0.9]))
    assert found.poses == pytest.approx(flip_gripper(plain.poses))


def test_what_was_not_scored_in_time_is_not_answered():
    found = find(Planner([0.9, np.nan]))
    assert found.scored == 1 and len(found.poses) == 1


@pytest.mark.parametrize("reach_first", [False, True])
@pytest.mark.parametrize(
    ("quality", "why"),
    [
        ([0.1, 0.1, 0.1, 0.1], "NONE_ABOVE_QUALITY"),
        ([0.1, 0.1, 0.1, 0.9], "NONE_REACHABLE"),
        ([], "NO_CANDIDATES"),
    ],
)
def test_without_grasps_it_says_why(quality, why, reach_first):
    found = find(Planner(quality), reach_first=reach_first)
    if reach_first and why == "NONE_REACHABLE":
        why = "NONE_ABOVE_QUALITY"  # the good one was left out before
    assert found.why == why and not len(found.poses)


def test_nothing_above_the_support_is_an_empty_workspace():
    planner = Planner([0.9])
    assert find(planner, scene=seen(SUPPORT_HEIGHT)).why == "EMPTY_WORKSPACE"
    assert not planner.scored
