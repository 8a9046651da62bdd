# SPDX-License-Identifier: Apache-2.0
"""A folder of PartNet shapes as an object set, with 3D AffordanceNet labels."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from neugrasp_ros.errors import ObjectFileError
from sim_bridge.objects.affordance_net import (
    LabelledShape,
    read_affordance_net,
    robot_scores,
)
from sim_bridge.objects.model import ObjectModel, PointLabels
from sim_bridge.objects.partnet import (
    TREE,
    Y_UP_TO_Z_UP,
    PartNetOptions,
    load_partnet,
)

META = "meta.json"
SIZES = {  # longest edge of a typical thing, reduced like the generated ones [m]
    "knife": 0.2,
    "scissors": 0.16,
    "mug": 0.11,
    "bottle": 0.18,
    "bag": 0.16,
    "earphone": 0.16,
    "hat": 0.17,
}


def find_partnet(folder: Path) -> dict[str, Path]:
    """Return the PartNet shapes one level below a folder, by name, sorted."""
    return {path.parent.name: path.parent for path in sorted(folder.glob(f"*/{TREE}"))}


def load_partnet_shape(folder: Path, set_name: str) -> ObjectModel:
    """Load one PartNet shape at its category's size.

    If a ``*.pkl`` of 3D AffordanceNet beside the shape's folder holds the same model
    id, its points and labels come with the object.

    Args:
        folder: The shape's folder; its ``meta.json`` names ``model_cat`` and
            ``model_id``.
        set_name: Name of the set that the object belongs to.

    Raises:
        ObjectFileError: If a file is missing or broken, or the category is not ours.
    """
    path = folder / META
    try:
        meta = json.loads(path.read_text(encoding="utf-8"))
        category, identifier = str(meta["model_cat"]).lower(), str(meta["model_id"])
    except OSError as error:
        raise ObjectFileError(path, f"cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError) as error:
        reason = f"expected model_cat and model_id: {error!r}"
        raise ObjectFileError(path, reason) from error
    if category not in SIZES:
        raise ObjectFileError(path, f"category {category!r}; known: {', '.join(SIZES)}")
    model = load_partnet(folder, PartNetOptions(category, SIZES[category]))
    shape = _labelled_shapes(folder.parent).get(identifier)
    labels = None if shape is None else fit_labels(shape, model)
    return replace(model, set_name=set_name, point_labels=labels)


def fit_labels(shape: LabelledShape, model: ObjectModel) -> PointLabels:
    """Lay labelled points of unknown scale over a model of the same shape.

    The bounding boxes are made to agree: both are y up in their files, and differ by
    a scale and a shift.

    Args:
        shape: Labelled points; a score above zero counts.
        model: The model, z up.
    """
    points = shape.points @ Y_UP_TO_Z_UP.T
    lower, upper = points.min(axis=0), points.max(axis=0)
    factor = np.linalg.norm(model.extents()) / np.linalg.norm(upper - lower)
    points = (points - (lower + upper) / 2) * factor + model.bounds().mean(axis=0)
    return PointLabels(points, robot_scores(shape) > 0)


@cache
def _labelled_shapes(folder: Path) -> dict[str, LabelledShape]:
    return {
        shape.shape_id: shape
        for path in sorted(folder.glob("*.pkl"))
        for shape in read_affordance_net(path)
    }
