# SPDX-License-Identifier: Apache-2.0
"""Say what grasps in a scene of labelled objects are good for."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.transform import apply, invert
from sim_bridge.objects.affordances import (
    AFFORDANCES,
    affordance_matrix,
    grasp_affordances,
)
from sim_bridge.objects.model import ObjectModel, PointLabels
from sim_bridge.objects.surface import sample_surface_evenly

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

DENSITY = 40_000.0  # surface points per [m^2]: about 80 on a mug's handle
REACH = 0.09  # no point of the closing region is farther from the pad tips [m]


def class_points(model: ObjectModel, rng: np.random.Generator) -> PointLabels:
    """Draw labelled surface points of one object, in its frame, at even density.

    An object that came with labelled points keeps those.

    Args:
        model: An object of convex parts; one whose category is not in the part table
            gives points without a class.
        rng: Source of randomness.
    """
    if model.point_labels is not None:
        return model.point_labels
    surface = sample_surface_evenly(model, DENSITY, rng)
    matrix = np.zeros((len(model.visuals), len(AFFORDANCES)), dtype=bool)
    if len(model.parts) == len(model.visuals):
        matrix = affordance_matrix(model.category, model.part_labels())
    return PointLabels(surface.points, matrix[surface.part_index])


def label_grasps(
    models: Sequence[ObjectModel],
    T_task_objects: Sequence[FloatArray],
    T_task_grippers: FloatArray,
    openings: FloatArray,
    rng: np.random.Generator,
) -> BoolArray:
    """Label grasps by the parts between their fingers, over all objects of a scene.

    Whether the grasps hold is not asked: the caller keeps the labels of those that do.

    Args:
        models: The objects, at their scale.
        T_task_objects: Where they are, each (4, 4).
        T_task_grippers: Gripper poses, shape (G, 4, 4).
        openings: Of the gripper, from pad to pad, in [m], shape (G,).
        rng: Source of randomness.

    Returns:
        Which classes each grasp affords, shape (G, 7).
    """
    drawn = [class_points(model, rng) for model in models]
    points = np.concatenate(
        [np.zeros((0, 3))]
        + [apply(T, d.points) for T, d in zip(T_task_objects, drawn, strict=True)]
    )
    classes = np.concatenate(
        [np.zeros((0, len(AFFORDANCES)), dtype=bool)] + [d.classes for d in drawn]
    )
    labels = np.zeros((len(T_task_grippers), len(AFFORDANCES)), dtype=bool)
    for row, T_task_gripper in enumerate(T_task_grippers):
        near = (np.abs(points - T_task_gripper[:3, 3]) < REACH).all(axis=1)
        points_gripper = apply(invert(T_task_gripper), points[near])
        labels[row] = grasp_affordances(
            points_gripper, classes[near], float(openings[row])
        )
    return labels
