# SPDX-License-Identifier: Apache-2.0
"""Which part of a thing lets the robot do what; the table of docs/affordances.md."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import ShapeError, UnknownAffordanceError

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class Affordance(NamedTuple):
    """A class of what can be done after a grasp.

    Attributes:
        name: Its name in queries and messages.
        description: What the robot can do next.
    """

    name: str
    description: str


AFFORDANCES: tuple[Affordance, ...] = (
    Affordance("handover", "give it to a person, who finds the part to hold free"),
    Affordance("cut", "cut with it: its edge is free and the hand is on its grip"),
    Affordance("stab", "pierce with it: its point is free and the hand is on its grip"),
    Affordance("lift", "carry it hanging under the hand, its weight below the fingers"),
    Affordance("wrap", "hold it firmly around its body"),
    Affordance("pour", "tilt it and pour: its mouth is free"),
    Affordance("wear", "put it on a person: the side that meets the body is free"),
)
AFFORDANCE_NAMES: tuple[str, ...] = tuple(item.name for item in AFFORDANCES)

PART_TABLE: Mapping[str, Mapping[str, frozenset[str]]] = MappingProxyType(
    {
        "knife": {
            "handle": frozenset({"cut", "stab"}),
            "blunt_handle": frozenset({"cut"}),
            "blade": frozenset({"handover"}),
        },
        "scissors": {
            "handle": frozenset({"cut", "stab"}),
            "blunt_handle": frozenset({"cut"}),
            "blade": frozenset({"handover"}),
        },
        "mug": {
            "handle": frozenset({"pour"}),
            "body": frozenset({"wrap", "pour"}),
            "rim": frozenset({"handover"}),
        },
        "bottle": {
            "body": frozenset({"wrap", "pour"}),
            "neck": frozenset({"handover"}),
            "handle": frozenset({"pour", "lift"}),
            "loop": frozenset({"lift"}),
        },
        "bag": {
            "handle": frozenset({"lift"}),
            "strap": frozenset({"lift", "wear"}),
            "opening": frozenset({"lift"}),
            "body": frozenset({"handover"}),
        },
        "earphone": {
            "headband": frozenset({"wear"}),
            "stem": frozenset({"wear"}),
            "cup": frozenset({"handover"}),
            "plug": frozenset({"handover"}),
            "cable": frozenset({"lift"}),
        },
        "hat": {
            "crown": frozenset({"wear"}),
            "brim": frozenset({"wear"}),
            "edge": frozenset({"handover"}),
            "bobble": frozenset({"wear", "lift"}),
        },
    }
)


class ClosingRegion(NamedTuple):
    """The box in the gripper frame (origin at the pad tips) that a grasp holds.

    The rule of the authors' labels: along the approach from 2.5 mm behind their grasp
    frame, which is 50.2 mm behind the tips, to 52.5 mm before it.

    Attributes:
        back: Lowest z in [m].
        front: Highest z in [m].
        closing_margin: Added to half the opening on either side in [m].
        half_thickness: Of the box along x in [m].
    """

    back: float = -0.0502 - 0.0025
    front: float = -0.0502 + 0.0525
    closing_margin: float = 0.0025
    half_thickness: float = 0.01

    def contains(self, points_gripper: FloatArray, opening: float) -> BoolArray:
        """Tell which points lie between the fingers.

        Args:
            points_gripper: In the gripper frame in [m], shape (..., N, 3).
            opening: Of the gripper, from pad to pad, in [m].

        Returns:
            Mask of shape (..., N).
        """
        x, y, z = np.moveaxis(points_gripper, -1, 0)
        half = opening / 2 + self.closing_margin
        along = (z > self.back) & (z < self.front)
        return np.asarray(
            along & (np.abs(y) < half) & (np.abs(x) < self.half_thickness)
        )


CLOSING_REGION = ClosingRegion()


def affordance_index(name: str) -> int:
    """Return the column of a class.

    Raises:
        UnknownAffordanceError: If there is no such class.
    """
    if name not in AFFORDANCE_NAMES:
        raise UnknownAffordanceError("affordance", name, AFFORDANCE_NAMES)
    return AFFORDANCE_NAMES.index(name)


def part_affordances(category: str, label: str) -> frozenset[str]:
    """Return the classes that a grasp on a part affords.

    Args:
        category: Such as ``mug``; one beyond the table affords nothing.
        label: Label of the part, such as ``handle``.
    """
    return PART_TABLE.get(category, {}).get(label, frozenset())


def affordance_matrix(category: str, labels: Sequence[str]) -> BoolArray:
    """Return which class each part affords, shape (parts, 7).

    Args:
        category: Category of the object.
        labels: Label of each of its parts.
    """
    matrix = np.zeros((len(labels), len(AFFORDANCES)), dtype=bool)
    for row, label in enumerate(labels):
        for name in part_affordances(category, label):
            matrix[row, affordance_index(name)] = True
    return matrix


def grasp_affordances(
    points_gripper: FloatArray,
    point_classes: BoolArray,
    opening: float,
    region: ClosingRegion = CLOSING_REGION,
) -> BoolArray:
    """Label one grasp by the surface between its fingers.

    Counts the points of every class inside the closing region; the class with the
    most wins, and so do those with as many.

    Args:
        points_gripper: Surface points of all objects, evenly spread, in the gripper
            frame in [m], shape (N, 3).
        point_classes: Which class each point's part affords, shape (N, 7): rows of
            :func:`affordance_matrix`.
        opening: Of the gripper, from pad to pad, in [m].
        region: What counts as held.

    Returns:
        Which classes the grasp affords, shape (7,); none if it holds no labelled point.

    Raises:
        ShapeError: If the shapes do not fit.
    """
    if point_classes.shape != (len(points_gripper), len(AFFORDANCES)):
        expected = f"({len(points_gripper)}, {len(AFFORDANCES)})"
        raise ShapeError("point classes", expected, point_classes.shape)
    held = region.contains(points_gripper, opening)
    counts = point_classes[held].sum(axis=0)
    return np.asarray((counts == counts.max()) & (counts > 0))
