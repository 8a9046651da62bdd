# SPDX-License-Identifier: Apache-2.0
"""Grasps as a structure of arrays."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import ShapeError

FloatArray = NDArray[np.float64]


def _empty_labels() -> FloatArray:
    return np.zeros((0, 0))


@dataclass(frozen=True, eq=False, slots=True)
class GraspSet:
    """G grasps of one gripper, best first once they are ranked.

    Attributes:
        poses: Poses ``T_task_gripper``, shape (G, 4, 4).
        widths: Jaw opening to command before the approach in [m], shape (G,).
        quality: Probability of success, shape (G,); NaN = not scored.
        affordances: Probability per affordance class, shape (G, A); A = 0: none.
        object_ids: Instance label of the grasped object, shape (G,); -1 = unknown.
        ids: Name of each grasp, unique in the set and kept through every stage.
    """

    poses: FloatArray
    widths: FloatArray
    quality: FloatArray = field(default_factory=lambda: np.zeros(0))
    affordances: FloatArray = field(default_factory=_empty_labels)
    object_ids: NDArray[np.int32] = field(
        default_factory=lambda: np.zeros(0, dtype=np.int32)
    )
    ids: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Fill what is not given and check that all shapes agree.

        Raises:
            ShapeError: If an array does not fit the number of poses.
        """
        if self.poses.ndim != 3 or self.poses.shape[1:] != (4, 4):
            raise ShapeError("poses", "(G, 4, 4)", self.poses.shape)
        n = len(self.poses)
        fill = object.__setattr__
        if n and not len(self.quality):
            fill(self, "quality", np.full(n, np.nan))
        if n and not len(self.object_ids):
            fill(self, "object_ids", np.full(n, -1, dtype=np.int32))
        if len(self.affordances) != n and not self.affordances.size:
            fill(self, "affordances", np.zeros((n, 0)))
        if n and not self.ids:
            fill(self, "ids", tuple(f"g{i:04d}" for i in range(n)))
        for name in ("widths", "quality", "affordances", "object_ids", "ids"):
            if len(getattr(self, name)) != n:
                raise ShapeError(name, f"({n}, ...)", (len(getattr(self, name)),))

    def __len__(self) -> int:
        """Return the number of grasps."""
        return len(self.poses)

    def take(self, indices: NDArray[np.int64] | NDArray[np.bool_]) -> "GraspSet":
        """Return the grasps at ``indices`` (integers in order, or a mask)."""
        rows = np.arange(len(self))[np.asarray(indices)]
        return GraspSet(
            self.poses[rows],
            self.widths[rows],
            self.quality[rows],
            self.affordances[rows],
            self.object_ids[rows],
            tuple(self.ids[i] for i in rows),
        )

    def with_scores(
        self, quality: FloatArray, affordances: FloatArray | None = None
    ) -> "GraspSet":
        """Return the same grasps with new scores, shapes (G,) and (G, A)."""
        if affordances is None:
            affordances = np.zeros((len(self), 0))
        return replace(self, quality=quality, affordances=affordances)

    def ranked(self) -> "GraspSet":
        """Return the grasps by falling quality; not scored ones last."""
        return self.take(np.argsort(-np.nan_to_num(self.quality, nan=-1.0)))
