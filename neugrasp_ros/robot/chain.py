# SPDX-License-Identifier: Apache-2.0
"""A serial arm as plain arrays: forward kinematics and geometric Jacobian.

Every joint axis is turned to its local z at construction, so that the kernels need two
column operations per joint:

    T_base_tip(q) = P_0 Z(q_0) P_1 Z(q_1) ... Z(q_{n-1}) P_n

with Z(q) a turn about z by q, or a shift along z by q.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from neugrasp_ros.errors import ShapeError

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class SerialChain(NamedTuple):
    """Joints from base to tip, all axes along local z (see ``make_chain``).

    Attributes:
        rotations: Constant rotation before each joint, then before the tip, shape
            (n + 1, 3, 3).
        offsets: Constant translations likewise in [m], shape (n + 1, 3).
        prismatic: Which joints slide, shape (n,).
        lower: Lower limits in [rad] or [m], shape (n,).
        upper: Upper limits, shape (n,).
    """

    rotations: FloatArray
    offsets: FloatArray
    prismatic: BoolArray
    lower: FloatArray
    upper: FloatArray


def make_chain(
    placements: FloatArray,
    axes: FloatArray,
    prismatic: BoolArray,
    *,
    lower: FloatArray,
    upper: FloatArray,
) -> SerialChain:
    """Assemble a chain from the way a URDF gives it.

    Args:
        placements: Pose of each joint frame in the previous one (the first in the
            base), then of the tip in the last, shape (n + 1, 4, 4).
        axes: Unit axis of each joint in its own frame, shape (n, 3).
        prismatic: Which joints slide, shape (n,).
        lower: Lower limits in [rad] or [m], shape (n,).
        upper: Upper limits, shape (n,).

    Raises:
        ShapeError: If the lengths do not fit each other.
    """
    count = len(prismatic)
    if placements.shape != (count + 1, 4, 4):
        raise ShapeError("placements", f"({count + 1}, 4, 4)", placements.shape)
    if axes.shape != (count, 3):
        raise ShapeError("axes", f"({count}, 3)", axes.shape)
    rotations = placements[:, :3, :3].copy()
    offsets = placements[:, :3, 3].copy()
    for i, axis in enumerate(axes):
        turn = turn_z_to(axis)
        rotations[i] = rotations[i] @ turn
        rotations[i + 1] = turn.T @ rotations[i + 1]
        offsets[i + 1] = turn.T @ offsets[i + 1]
    return SerialChain(
        np.ascontiguousarray(rotations),
        np.ascontiguousarray(offsets),
        np.asarray(prismatic, dtype=np.bool_),
        np.ascontiguousarray(lower, dtype=np.float64),
        np.ascontiguousarray(upper, dtype=np.float64),
    )


def turn_z_to(axis: FloatArray) -> FloatArray:
    """Return a rotation whose third column is ``axis``."""
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


@njit(cache=True, error_model="numpy")
def append_pose(rotation, position, steps, offsets, k):  # type: ignore[no-untyped-def]
    """Multiply a pose, in place, by the k-th of some constant ones.

    A row is not taken out of the arrays: that costs more than the product.
    """
    x, y, z = offsets[k, 0], offsets[k, 1], offsets[k, 2]
    for i in range(3):
        a, b, c = rotation[i, 0], rotation[i, 1], rotation[i, 2]
        position[i] += a * x + b * y + c * z
        rotation[i, 0] = a * steps[k, 0, 0] + b * steps[k, 1, 0] + c * steps[k, 2, 0]
        rotation[i, 1] = a * steps[k, 0, 1] + b * steps[k, 1, 1] + c * steps[k, 2, 1]
        rotation[i, 2] = a * steps[k, 0, 2] + b * steps[k, 1, 2] + c * steps[k, 2, 2]


@njit(cache=True, error_model="numpy")
def tip_and_axes(chain, q, rotation, position, axes, origins):  # type: ignore[no-untyped-def]
    """Write the tip's pose and all joint axes and origins in the base frame.

    Args:
        chain: The arm.
        q: Joint values, shape (n,).
        rotation: Receives the tip's rotation, shape (3, 3).
        position: Receives the tip's position in [m], shape (3,).
        axes: Receives the joint axes, shape (n, 3).
        origins: Receives the joint origins in [m], shape (n, 3).
    """
    steps, offsets = chain.rotations, chain.offsets
    for i in range(3):
        position[i] = 0.0
        for j in range(3):
            rotation[i, j] = 1.0 if i == j else 0.0
    for k in range(q.shape[0]):
        append_pose(rotation, position, steps, offsets, k)
        value = q[k]
        if chain.prismatic[k]:
            for i in range(3):
                axes[k, i] = rotation[i, 2]
                position[i] += value * rotation[i, 2]
                origins[k, i] = position[i]
            continue
        c, s = np.cos(value), np.sin(value)
        for i in range(3):
            axes[k, i] = rotation[i, 2]
            origins[k, i] = position[i]
            x, y = rotation[i, 0], rotation[i, 1]
            rotation[i, 0] = c * x + s * y
            rotation[i, 1] = c * y - s * x
    append_pose(rotation, position, steps, offsets, q.shape[0])


@njit(cache=True, error_model="numpy")
def fill_jacobian(chain, position, axes, origins, jacobian):  # type: ignore[no-untyped-def]
    """Write the geometric Jacobian (linear rows first) at the tip, shape (6, n)."""
    for k in range(axes.shape[0]):
        x, y, z = axes[k, 0], axes[k, 1], axes[k, 2]
        if chain.prismatic[k]:
            jacobian[0, k], jacobian[1, k], jacobian[2, k] = x, y, z
            jacobian[3, k] = jacobian[4, k] = jacobian[5, k] = 0.0
        else:
            u = position[0] - origins[k, 0]
            v = position[1] - origins[k, 1]
            w = position[2] - origins[k, 2]
            jacobian[0, k] = y * w - z * v
            jacobian[1, k] = z * u - x * w
            jacobian[2, k] = x * v - y * u
            jacobian[3, k], jacobian[4, k], jacobian[5, k] = x, y, z


@njit(cache=True, error_model="numpy")
def chain_poses(chain, configurations):  # type: ignore[no-untyped-def]
    """Return tip poses ``T_base_tip`` (N, 4, 4) of configurations (N, n)."""
    count, joints = configurations.shape
    poses = np.zeros((count, 4, 4))
    axes, origins = np.empty((joints, 3)), np.empty((joints, 3))
    for i in range(count):
        tip_and_axes(
            chain,
            configurations[i],
            poses[i, :3, :3],
            poses[i, :3, 3],
            axes,
            origins,
        )
        poses[i, 3, 3] = 1.0
    return poses


@njit(cache=True, error_model="numpy")
def chain_jacobians(chain, configurations):  # type: ignore[no-untyped-def]
    """Return geometric Jacobians at the tip (N, 6, n), linear rows first."""
    count, joints = configurations.shape
    jacobians = np.empty((count, 6, joints))
    rotation, position = np.empty((3, 3)), np.empty(3)
    axes, origins = np.empty((joints, 3)), np.empty((joints, 3))
    for i in range(count):
        tip_and_axes(chain, configurations[i], rotation, position, axes, origins)
        fill_jacobian(chain, position, axes, origins, jacobians[i])
    return jacobians
