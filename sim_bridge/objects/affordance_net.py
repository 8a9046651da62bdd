# SPDX-License-Identifier: Apache-2.0
"""Read files in the format of 3D AffordanceNet, and turn their labels into ours."""

import io
import pickle
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import ObjectFileError
from sim_bridge.objects.affordances import AFFORDANCES, affordance_index

FloatArray = NDArray[np.float64]

HUMAN_CLASSES = (
    "grasp", "contain", "lift", "openable", "layable", "sittable", "support",
    "wrap_grasp", "pourable", "move", "display", "pushable", "pull", "listen", "wear",
    "press", "cut", "stab",
)  # fmt: skip

# What a person may do where becomes what the robot can do after holding there: it
# gives by what cuts, cuts and stabs by what a person grasps. docs/affordances.md.
_CUTTING = MappingProxyType(
    {"cut": ("handover",), "stab": ("handover",), "grasp": ("cut", "stab")}
)
CATEGORY_MAP: Mapping[str, Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "Knife": _CUTTING,
        "Scissors": _CUTTING,
        "Mug": {
            "grasp": ("pour",),
            "wrap_grasp": ("wrap", "pour"),
            "contain": ("handover",),
        },
        "Bottle": {
            "grasp": ("pour",),
            "wrap_grasp": ("wrap", "pour"),
            "openable": ("handover",),
        },
        "Bag": {"grasp": ("lift",), "lift": ("lift",), "contain": ("handover",)},
        "Earphone": {"grasp": ("wear",), "wear": ("wear",), "listen": ("handover",)},
        "Hat": {"grasp": ("wear",), "wear": ("handover",)},
    }
)

ALLOWED_GLOBALS = frozenset(
    (module, name)
    for package in ("numpy.core", "numpy._core")
    for module, name in (
        (f"{package}.multiarray", "_reconstruct"),
        (f"{package}.multiarray", "scalar"),
        (f"{package}.numeric", "_frombuffer"),
    )
) | {("numpy", "ndarray"), ("numpy", "dtype"), ("_codecs", "encode")}


class LabelledShape(NamedTuple):
    """A point cloud whose points say what they are for.

    Attributes:
        shape_id: Identifier in the file.
        category: Such as ``Mug``.
        points: In the file's own unit, centred and of unit size, shape (N, 3).
        scores: Soft label of every point for :data:`HUMAN_CLASSES` in [0, 1],
            shape (N, 18).
    """

    shape_id: str
    category: str
    points: FloatArray
    scores: FloatArray


class _ArrayUnpickler(pickle.Unpickler):
    """Unpickler that knows arrays and plain values, and nothing that can run."""

    def find_class(self, module: str, name: str) -> Any:
        """Return what an array is made of; refuse everything else."""
        if (module, name) not in ALLOWED_GLOBALS:
            raise pickle.UnpicklingError(f"{module}.{name} is not allowed")
        return super().find_class(module, name)


def read_affordance_net(path: Path) -> tuple[LabelledShape, ...]:
    """Read a file of full shapes, without running anything that it may contain.

    The file is a pickled list of mappings with ``shape_id``, ``semantic class`` and
    ``full_shape``, which holds ``coordinate`` (N, 3) and ``label``: per class the
    scores of the points.

    Args:
        path: Such as ``full_shape_train_data.pkl``.

    Raises:
        ObjectFileError: If the file is missing, holds more than arrays and plain
            values, or has another structure.
    """
    try:
        entries = _ArrayUnpickler(io.BytesIO(path.read_bytes())).load()
    except OSError as error:
        raise ObjectFileError(path, f"cannot be read: {error.strerror}") from error
    except (pickle.UnpicklingError, EOFError, AttributeError, ValueError) as error:
        raise ObjectFileError(path, f"is no pickle of plain arrays: {error}") from error
    if not isinstance(entries, list):
        raise ObjectFileError(path, f"expected a list, got {type(entries).__name__}")
    return tuple(_shape(path, index, entry) for index, entry in enumerate(entries))


def _shape(path: Path, index: int, entry: Any) -> LabelledShape:
    try:
        full = entry["full_shape"]
        points = np.asarray(full["coordinate"], dtype=np.float64)
        scores = np.zeros((len(points), len(HUMAN_CLASSES)))
        for name, values in full["label"].items():
            column = np.asarray(values, dtype=np.float64).reshape(len(points))
            scores[:, HUMAN_CLASSES.index(name)] = column
        identifier, category = str(entry["shape_id"]), str(entry["semantic class"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        reason = f"entry {index} is not a labelled shape: {error!r}"
        raise ObjectFileError(path, reason) from error
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise ObjectFileError(path, f"entry {index}: expected points (N, 3)")
    return LabelledShape(identifier, category, points, scores)


def robot_scores(shape: LabelledShape) -> FloatArray:
    """Return what holding each point affords the robot, as soft labels (N, 7).

    A robot class takes the largest score of the human classes that lead to it; a
    category beyond ours affords nothing.

    Args:
        shape: A shape with human-centred scores.
    """
    scores = np.zeros((len(shape.points), len(AFFORDANCES)))
    for human, classes in CATEGORY_MAP.get(shape.category, {}).items():
        source = shape.scores[:, HUMAN_CLASSES.index(human)]
        for name in classes:
            column = affordance_index(name)
            scores[:, column] = np.maximum(scores[:, column], source)
    return scores
