# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from neugrasp_ros.geometry.transform import translation
from sim_bridge.objects.affordances import AFFORDANCE_NAMES
from sim_bridge.objects.grasp_labels import (
    DENSITY,
    class_points,
    label_grasps,
    nearest_classes,
    scene_class_points,
)
from sim_bridge.objects.model import PointLabels
from sim_bridge.objects.shapes.assembly import Shape, assemble
from sim_bridge.objects.shapes.building import box

DOWN = np.diag([1.0, -1.0, -1.0, 1.0])  # gripper frame looking straight down
OPEN = np.full(3, 0.08)


@pytest.fixture
def knife():
    """Blade at x in [0, 0.1], handle at x in [-0.1, 0], both 2 cm wide."""
    blade = box((0.1, 0.02, 0.01), (0.05, 0, 0), "blade")
    handle = box((0.1, 0.02, 0.01), (-0.05, 0, 0), "handle")
    return assemble(Shape([blade, handle], 500), "knife", "test", "knife")


def names_of(row):
    return {name for name, on in zip(AFFORDANCE_NAMES, row, strict=True) if on}


def test_points_are_as_dense_as_promised_and_carry_their_parts_classes(knife):
    points, classes = class_points(knife, np.random.default_rng(0))
    area = 2 * (0.2 * 0.02 + 0.2 * 0.01 + 0.02 * 0.01)
    assert len(points) == pytest.approx(DENSITY * area, rel=0.05)
    assert (classes[points[:, 0] > 1e-6, 0]).all()
    assert not classes[points[:, 0] < -1e-6, 0].any()


def test_points_take_the_classes_of_the_part_beside_them(knife):
    surface = scene_class_points(
        [knife], [translation(0.1, 0.1, 0)], np.random.default_rng(0)
    )
    points = np.array([[0.15, 0.1, 0.005], [0.05, 0.1, 0.01], [0.15, 0.1, 0.05]])
    classes, near = nearest_classes(surface, points, 0.008)
    assert near.tolist() == [True, True, False]
    assert [names_of(row) for row in classes] == [{"handover"}, {"cut", "stab"}, set()]
    nothing = scene_class_points([], [], np.random.default_rng(0))
    classes, near = nearest_classes(nothing, points, 0.008)
    assert not classes.any() and not near.any()


def test_grasps_are_labelled_by_where_they_hold(knife):
    grippers = np.stack([translation(x, 0, 0) @ DOWN for x in (-0.05, 0.05, 0.3)])
    labels = label_grasps(
        [knife],
        [np.eye(4)],
        grippers,
        OPEN[: len(grippers)],
        np.random.default_rng(0),
    )
    assert [names_of(row) for row in labels] == [{"cut", "stab"}, {"handover"}, set()]


def test_labels_move_with_the_object_and_all_objects_count(knife):
    poses = [translation(0.1, 0.1, 0), translation(0.1, 0.3, 0)]
    grippers = np.stack([T @ translation(0.06, 0, 0) @ DOWN for T in poses])
    labels = label_grasps(
        [knife, knife],
        poses,
        grippers,
        OPEN[: len(grippers)],
        np.random.default_rng(0),
    )
    assert [names_of(row) for row in labels] == [{"handover"}, {"handover"}]


def test_unlabelled_objects_and_empty_scenes_afford_nothing(knife):
    plain = replace(knife, category="")
    rng = np.random.default_rng(0)
    assert not label_grasps([plain], [np.eye(4)], DOWN[None], OPEN[:1], rng).any()
    assert label_grasps([], [], DOWN[None], OPEN[:1], rng).shape == (1, 7)


def test_points_that_came_with_an_object_are_used(knife):
    classes = np.zeros((1, 7), dtype=bool)
    classes[0, AFFORDANCE_NAMES.index("wear")] = True
    odd = replace(knife, point_labels=PointLabels(np.array([[0.01, 0, 0]]), classes))
    grippers = (translation(0.02, 0, 0) @ DOWN)[None]
    labels = label_grasps(
        [odd.scaled(2.0)],
        [np.eye(4)],
        grippers,
        OPEN[: len(grippers)],
        np.random.default_rng(0),
    )
    assert names_of(labels[0]) == {"wear"}
