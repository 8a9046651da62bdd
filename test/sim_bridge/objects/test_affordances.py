# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import numpy as np
import pytest

from neugrasp_ros.errors import ShapeError, UnknownAffordanceError
from sim_bridge.objects.affordances import (
    AFFORDANCE_NAMES,
    CLOSING_REGION,
    PART_TABLE,
    affordance_index,
    affordance_matrix,
    grasp_affordances,
    part_affordances,
)

DOCS = Path(__file__).parents[3] / "docs" / "affordances.md"


def names_of(mask):
    return {name for name, on in zip(AFFORDANCE_NAMES, mask, strict=True) if on}


def classes(category, *labels):
    return affordance_matrix(category, labels)


def test_classes_stand_in_the_published_order():
    assert AFFORDANCE_NAMES == (
        "handover", "cut", "stab", "lift", "wrap", "pour", "wear",
    )  # fmt: skip
    assert [affordance_index(name) for name in AFFORDANCE_NAMES] == list(range(7))
    with pytest.raises(UnknownAffordanceError, match="known: cut, handover"):
        affordance_index("throw")


def test_table_uses_known_classes_and_every_class_has_a_part():
    used = {
        n for parts in PART_TABLE.values() for names in parts.values() for n in names
    }
    assert used == set(AFFORDANCE_NAMES)
    assert all(names for parts in PART_TABLE.values() for names in parts.values())


def test_unknown_category_or_part_affords_nothing():
    assert part_affordances("mug", "handle") == {"pour"}
    assert part_affordances("mug", "wing") == frozenset()
    assert part_affordances("rocket", "handle") == frozenset()


def test_matrix_has_a_row_per_part():
    matrix = affordance_matrix("knife", ["handle", "blade", ""])
    assert [names_of(row) for row in matrix] == [{"cut", "stab"}, {"handover"}, set()]


def test_closing_region_is_the_published_box_seen_from_the_tips():
    z_published = np.array([-0.0026, -0.0024, 0.0524, 0.0526])
    points = np.column_stack([np.zeros((4, 2)), z_published - 0.0502])
    inside = CLOSING_REGION.contains(points, 0.08)
    assert inside.tolist() == [False, True, True, False]
    sides = np.array([[0, 0.0424, 0], [0, -0.0426, 0], [0.0099, 0, 0], [0.0101, 0, 0]])
    assert CLOSING_REGION.contains(sides, 0.08).tolist() == [True, False, True, False]
    assert not CLOSING_REGION.contains(sides[:1], 0.06).any()


def test_majority_part_decides_and_outside_points_do_not_count():
    points = np.zeros((10, 3))
    points[6:, 2] = -0.2
    rows = np.repeat(classes("knife", "handle", "blade"), [4, 6], axis=0)
    assert names_of(grasp_affordances(points, rows, 0.08)) == {"cut", "stab"}
    assert names_of(grasp_affordances(np.zeros((10, 3)), rows, 0.08)) == {"handover"}


def test_ties_keep_all_classes():
    rows = np.repeat(classes("mug", "handle", "rim"), 3, axis=0)
    got = grasp_affordances(np.zeros((6, 3)), rows, 0.08)
    assert names_of(got) == {"pour", "handover"}


def test_counts_add_over_objects_and_parts_that_share_a_class():
    rows = np.concatenate(
        [np.repeat(classes("mug", "body", "handle"), [2, 2], axis=0),
         np.repeat(classes("knife", "blade"), 3, axis=0)]
    )  # fmt: skip
    assert names_of(grasp_affordances(np.zeros((7, 3)), rows, 0.08)) == {"pour"}


def test_grasp_on_nothing_labelled_affords_nothing():
    far = np.full((4, 3), 1.0)
    assert not grasp_affordances(far, classes("mug", *["body"] * 4), 0.08).any()
    none = grasp_affordances(np.zeros((0, 3)), np.zeros((0, 7), dtype=bool), 0.08)
    assert not none.any()


def test_wrong_shapes_are_refused():
    with pytest.raises(ShapeError, match=r"\(4, 7\)"):
        grasp_affordances(np.zeros((4, 3)), np.zeros((3, 7), dtype=bool), 0.08)


def test_document_shows_the_table_of_the_code():
    rows = {
        tuple(cell.strip() for cell in line.strip("| \n").split("|")[:3])
        for line in DOCS.read_text(encoding="utf-8").splitlines()
        if line.startswith("|")
    }
    for category, parts in PART_TABLE.items():
        for label, names in parts.items():
            ordered = ", ".join(n for n in AFFORDANCE_NAMES if n in names)
            assert (category, f"`{label}`", ordered) in rows
