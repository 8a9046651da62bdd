# SPDX-License-Identifier: Apache-2.0
"""Poses that a gripper is led through: straight lines, shakes and tilts."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

FloatArray = NDArray[np.float64]


def straight_path(
    T_world_start: FloatArray, position: FloatArray, spacing: float
) -> Iterator[FloatArray]:
    """Yield poses on the straight way to a position, without the start.

    Args:
        T_world_start: Where the motion starts, shape (4, 4); its rotation is kept.
        position: Where it ends in the world in [m], shape (3,).
        spacing: Distance of neighbours in [m]; stretched so that the last one ends
            there.
    """
    start = T_world_start[:3, 3].copy()
    count = max(int(np.linalg.norm(position - start) / spacing + 1e-6), 1)
    for index in range(1, count + 1):
        pose = T_world_start.copy()
        pose[:3, 3] = start + (position - start) * (index / count)
        yield pose


def shake_path(
    T_world_start: FloatArray,
    direction: FloatArray,
    *,
    amplitude: float,
    frequency: float,
    duration: float,
    time_step: float,
) -> Iterator[FloatArray]:
    """Yield a sine motion along a direction, one pose per time step.

    Args:
        T_world_start: The middle of the motion, shape (4, 4).
        direction: Unit vector in the world, shape (3,).
        amplitude: In [m].
        frequency: In [Hz].
        duration: In [s].
        time_step: In [s].
    """
    for index in range(1, round(duration / time_step) + 1):
        phase = 2.0 * np.pi * frequency * index * time_step
        pose = T_world_start.copy()
        pose[:3, 3] += amplitude * np.sin(phase) * direction
        yield pose


def tilt_path(
    T_world_start: FloatArray,
    axis: FloatArray,
    *,
    angle: float,
    duration: float,
    time_step: float,
) -> Iterator[FloatArray]:
    """Yield one swing about the gripper's origin to +angle, to -angle, and back.

    Args:
        T_world_start: Pose before and after, shape (4, 4).
        axis: Unit vector in the world, shape (3,).
        angle: In [rad].
        duration: In [s].
        time_step: In [s].
    """
    count = round(duration / time_step)
    swing = angle * np.sin(2.0 * np.pi * np.arange(1, count + 1) / count)
    for rotation in Rotation.from_rotvec(swing[:, None] * axis).as_matrix():
        pose = T_world_start.copy()
        pose[:3, :3] = rotation @ T_world_start[:3, :3]
        yield pose
