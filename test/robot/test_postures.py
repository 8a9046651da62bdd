# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from neugrasp_ros.geometry.transform import make_transform
from neugrasp_ros.robot import postures
from neugrasp_ros.robot.postures import (
    Starts,
    make_table,
    pick_postures,
    pick_starts,
    write_start,
)

WRIST = np.array([-0.2, 0.0, 0.0])


def pose(angle, point):
    """A tip turned about z whose wrist is at a point."""
    rotation = Rotation.from_euler("z", angle).as_matrix()
    return make_transform(rotation, np.asarray(point) - rotation @ WRIST)


ANGLES = np.array([0.0, 0.5, 1.0, 3.0, 0.0])
POINTS = np.array([[0.01, 0, 0]] * 4 + [[0.55, 0.0, 0.0]])  # the last in another cell
VALUES = np.arange(10.0).reshape(5, 2)


@pytest.fixture
def table():
    poses = np.array([pose(a, p) for a, p in zip(ANGLES, POINTS, strict=True)])
    return make_table(VALUES, poses, WRIST)


def picked(table, target, count=8, towards=(0.0, 0.0), speeds=(1e9, 1e9)):
    starts = Starts(
        np.zeros((0, 2)), table, np.zeros((0, 2)), WRIST, np.array(towards),
        np.array(speeds), count,
    )  # fmt: skip
    picks = np.full(count, -7)
    found = pick_postures(starts, target, np.empty(count), picks)
    assert (picks[found:] == -7).all()
    return table.postures[picks[:found]].tolist()


def test_postures_of_the_wrists_cell_come_the_best_turned_first(table):
    found = picked(table, pose(0.6, [0.02, 0.01, 0.01]))
    assert found == VALUES[[1, 2, 0, 3]].tolist()


def test_the_tip_may_be_elsewhere_as_long_as_the_wrist_is_there(table):
    assert picked(table, pose(2.9, [0.55, 0.0, 0.0])) == VALUES[[4]].tolist()


def test_only_the_best_are_kept(table):
    assert picked(table, pose(0.6, POINTS[0]), count=2) == VALUES[[1, 2]].tolist()
    assert picked(table, pose(0.6, POINTS[0]), count=0) == []


def test_travel_decides_between_two_turned_alike(table):
    target = pose(0.75, POINTS[0])  # between 0.5 and 1.0
    slow = (1.0, 1.0)
    near_one = picked(table, target, 1, VALUES[1], slow)
    near_two = picked(table, target, 1, VALUES[2], slow)
    assert [near_one, near_two] == [VALUES[[1]].tolist(), VALUES[[2]].tolist()]


def test_a_target_outside_looks_into_the_border_and_an_empty_cell_has_none(table):
    assert picked(table, pose(0.0, [9.0, 0.0, 0.0])) == VALUES[[4]].tolist()
    assert picked(table, pose(0.0, [0.25, 0.0, 0.0])) == []


def started(table, target, count, spare):
    starts = Starts(
        np.zeros((0, 2)), table, np.asarray(spare), WRIST, np.zeros(2),
        np.full(2, 1e9), count,
    )  # fmt: skip
    picks, q = np.empty(count, dtype=np.int64), np.empty(2)
    found = pick_starts(starts, target, np.empty(count), picks)
    values = []
    for pick in picks[:found]:
        write_start(starts, pick, q)
        values.append(q.tolist())
    return values


def test_spare_starts_follow_where_the_table_has_too_few(table):
    target, spare = pose(0.6, POINTS[0]), [[50.0, 51.0], [60.0, 61.0]]
    stored = VALUES[[1, 2, 0, 3]].tolist()
    assert started(table, target, 9, spare) == [*stored, *spare]
    assert started(table, target, 5, spare) == [*stored, spare[0]]
    assert started(table, target, 3, spare) == stored[:3]
    assert started(table, pose(0.0, [0.25, 0.0, 0.0]), 1, spare) == spare[:1]


def test_a_crowded_cell_keeps_its_first(monkeypatch):
    monkeypatch.setattr(postures, "PER_CELL", 3)
    poses = np.array([pose(0.0, [0.0, 0.0, 0.0])] * 5)
    assert make_table(VALUES, poses, WRIST).postures.tolist() == VALUES[:3].tolist()
