# SPDX-License-Identifier: Apache-2.0
"""What a motion must keep to, and what it turns out to be."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import ShapeError

FloatArray = NDArray[np.float64]


class Limits(Protocol):
    """Bounds per joint, each of shape (n,), in [rad] or [m] and its derivatives."""

    @property
    def lower(self) -> FloatArray:
        """Smallest positions."""

    @property
    def upper(self) -> FloatArray:
        """Largest positions."""

    @property
    def velocity(self) -> FloatArray:
        """Largest speeds."""

    @property
    def acceleration(self) -> FloatArray:
        """Largest accelerations."""

    @property
    def jerk(self) -> FloatArray:
        """Largest jerks."""


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Joint motion over time, at rest at both ends.

    Attributes:
        joint_names: Names of the joints.
        times: Seconds from the start, increasing from 0, shape (T,).
        positions: In [rad] or [m], shape (T, n).
        velocities: Shape (T, n).
        accelerations: Shape (T, n).
    """

    joint_names: tuple[str, ...]
    times: FloatArray
    positions: FloatArray
    velocities: FloatArray
    accelerations: FloatArray

    def __post_init__(self) -> None:
        """Check that all arrays fit.

        Raises:
            ShapeError: If one does not.
        """
        shape = (len(self.times), len(self.joint_names))
        for name in ("positions", "velocities", "accelerations"):
            if getattr(self, name).shape != shape:
                raise ShapeError(name, str(shape), getattr(self, name).shape)

    @property
    def duration(self) -> float:
        """Length in [s]."""
        return float(self.times[-1])


def join_trajectories(first: Trajectory, second: Trajectory) -> Trajectory:
    """Return one motion after the other; the second begins where the first ends.

    Raises:
        ShapeError: If the joints are not the same.
    """
    if first.joint_names != second.joint_names:
        shape = second.positions.shape
        raise ShapeError(
            "second trajectory", f"joints {first.joint_names}", tuple(shape)
        )
    return Trajectory(
        first.joint_names,
        np.concatenate([first.times, first.duration + second.times[1:]]),
        np.concatenate([first.positions, second.positions[1:]]),
        np.concatenate([first.velocities, second.velocities[1:]]),
        np.concatenate([first.accelerations, second.accelerations[1:]]),
    )
