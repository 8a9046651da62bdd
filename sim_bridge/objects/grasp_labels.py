# SPDX-License-Identifier: Apache-2.0
"""Say what grasps in a scene of labelled objects are good for."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

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


def scene_class_points(
    models: Sequence[ObjectModel],
    T_task_objects: Sequence[FloatArray],
    rng: np.random.Generator,
) -> PointLabels:
    """Draw labelled surface points of all objects of a scene, in the task frame.

    Args:
        models: The objects, at their scale.
        T_task_objects: Where they are, each (4, 4).
        rng: Source of randomness.
    """
    drawn = [class_points(model, rng) for model in models]
    points = np.concatenate(
        [np.zeros((0, 3))]
        + [apply(T, d.points) for T, d in zip(T_task_objects, drawn, strict=True)]
    )
    classes = np.concatenate(
        [np.zeros((0, len(AFFORDANCES)), dtype=bool)] + [d.classes for d in drawn]
    )
    return PointLabels(points, classes)


def nearest_classes(
    surface: PointLabels, points: FloatArray, distance: float
) -> tuple[BoolArray, BoolArray]:
    """Return what the parts nearest to some points afford.

    Args:
        surface: Labelled surface points.
        points: In the same frame in [m], shape (N, 3).
        distance: How far away a part may be in [m].

    Returns:
        The classes (N, 7), and which points have a labelled part so near (N,).
    """
    if not len(surface.points):
        none = np.zeros((len(points), len(AFFORDANCES)), dtype=bool)
        return none, np.zeros(len(points), dtype=bool)
    _, index = cKDTree(surface.points).query(points, distance_upper_bound=distance)
    near = index < len(surface.points)
    classes = surface.classes[np.where(near, index, 0)] & near[:, None]
    return classes, np.asarray(classes.any(axis=1))


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
    points, classes = scene_class_points(models, T_task_objects, rng)
    labels = np.zeros((len(T_task_grippers), len(AFFORDANCES)), dtype=bool)
    for row, T_task_gripper in enumerate(T_task_grippers):
        near = (np.abs(points - T_task_gripper[:3, 3]) < REACH).all(axis=1)
        points_gripper = apply(invert(T_task_gripper), points[near])
        labels[row] = grasp_affordances(
            points_gripper, classes[near], float(openings[row])
        )
    return labels
