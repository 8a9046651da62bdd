# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.grasp.types import GraspSet


def some_grasps(count: int = 4) -> GraspSet:
    poses = np.stack([translation(i, 0, 0) for i in range(count)])
    return GraspSet(poses, np.linspace(0.01, 0.04, count))


def test_what_is_not_given_is_filled_in():
    grasps = some_grasps(3)
    assert len(grasps) == 3
    assert np.isnan(grasps.quality).all()
    assert grasps.affordances.shape == (3, 0)
    assert grasps.object_ids.tolist() == [-1, -1, -1]
    assert len(set(grasps.ids)) == 3


def test_an_empty_set_is_a_set():
    empty = GraspSet(np.zeros((0, 4, 4)), np.zeros(0))
    assert len(empty) == 0
    assert len(empty.ranked()) == 0
    assert len(some_grasps().take(np.zeros(4, dtype=bool))) == 0


@pytest.mark.parametrize(
    "chosen", [np.array([2, 0]), np.array([True, False, True, False])]
)
def test_rows_stay_together(chosen):
    grasps = some_grasps().with_scores(np.array([0.1, 0.2, 0.3, 0.4]), np.eye(4)[:, :2])
    rows = [2, 0] if chosen.dtype != bool else [0, 2]
    taken = grasps.take(chosen)
    assert taken.poses[:, 0, 3].tolist() == rows
    np.testing.assert_array_equal(taken.quality, grasps.quality[rows])
    np.testing.assert_array_equal(taken.widths, grasps.widths[rows])
    np.testing.assert_array_equal(taken.affordances, grasps.affordances[rows])
    assert taken.ids == tuple(grasps.ids[i] for i in rows)


def test_ranking_puts_the_best_first_and_the_unscored_last():
    grasps = some_grasps().with_scores(np.array([0.2, np.nan, 0.9, 0.0]))
    assert grasps.ranked().poses[:, 0, 3].tolist() == [2, 0, 3, 1]


def test_scores_are_new_and_names_are_kept():
    grasps = some_grasps(2)
    scored = grasps.with_scores(np.array([0.5, 0.6]), np.ones((2, 7)))
    assert np.isnan(grasps.quality).all()
    assert scored.ids == grasps.ids
    assert scored.affordances.shape == (2, 7)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"poses": np.eye(4)}, r"poses: expected shape \(G, 4, 4\), got \(4, 4\)"),
        ({"widths": np.zeros(3)}, r"widths: expected shape \(2, \.\.\.\), got \(3,\)"),
        ({"quality": np.zeros(1)}, "quality"),
        ({"affordances": np.zeros((3, 7))}, "affordances"),
        ({"object_ids": np.zeros(3, dtype=np.int32)}, "object_ids"),
        ({"ids": ("a",)}, "ids"),
    ],
)
def test_what_does_not_fit_the_poses_is_rejected(arguments, told):
    values = {"poses": np.stack([np.eye(4)] * 2), "widths": np.zeros(2)} | arguments
    with pytest.raises(ShapeError, match=told):
        GraspSet(**values)
