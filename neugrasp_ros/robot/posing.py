# SPDX-License-Identifier: Apache-2.0
"""Compiled placement of a robot's bodies, hulls and balls, and what holds them."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from neugrasp_ros.robot.bodies import Hulls, JointTree, body_poses, move_body
from neugrasp_ros.robot.obstacles import Obstacles


class World(NamedTuple):
    """The robot and what is around it.

    Attributes:
        tree: Its joints.
        hulls: Its hulls.
        body_balls: Ball around all hulls of each body, in the body frame: centre and
            radius in [m]; the base last, shape (J + 1, 4).
        obstacles: What is around it.
    """

    tree: JointTree
    hulls: Hulls
    body_balls: NDArray[np.float64]
    obstacles: Obstacles


@njit(cache=True, error_model="numpy", forceinline=True)
def _place(hulls, moved, rotations, positions, centers, axes):  # type: ignore[no-untyped-def]
    """Write the bounding boxes' centres and axes of moved bodies in the base frame."""
    own_centers, own_axes = hulls.centers, hulls.axes
    for g in range(hulls.bodies.shape[0]):
        body = hulls.bodies[g]
        if body < 0:
            body = rotations.shape[0] - 1
        if not moved[body]:
            continue
        x, y, z = own_centers[g, 0], own_centers[g, 1], own_centers[g, 2]
        for i in range(3):
            a = rotations[body, i, 0]
            b = rotations[body, i, 1]
            c = rotations[body, i, 2]
            centers[g, i] = positions[body, i] + a * x + b * y + c * z
            for j in range(3):
                axes[g, i, j] = (
                    a * own_axes[g, 0, j]
                    + b * own_axes[g, 1, j]
                    + c * own_axes[g, 2, j]
                )


@njit(cache=True, error_model="numpy", forceinline=True)
def _place_balls(own, moved, rotations, positions, balls):  # type: ignore[no-untyped-def]
    """Write the centres of the moved bodies' balls in the base frame."""
    for body in range(balls.shape[0]):
        if not moved[body]:
            continue
        x, y, z = own[body, 0], own[body, 1], own[body, 2]
        for i in range(3):
            balls[body, i] = (
                positions[body, i]
                + rotations[body, i, 0] * x
                + rotations[body, i, 1] * y
                + rotations[body, i, 2] * z
            )


@njit(cache=True, error_model="numpy", forceinline=True)
def pose_world(world, q, known, buffers):  # type: ignore[no-untyped-def]
    """Pose all bodies, or those that moved since the configuration ``known``.

    Args:
        world: Robot and obstacles.
        q: Configuration, shape (J,).
        known: The one that the buffers hold, NaN = none; becomes ``q``, shape (J,).
        buffers: Scratch from ``make_buffers``.
    """
    rotations, positions, centers, axes, balls, _, _, moved = buffers
    parents, joints = world.tree.parents, q.shape[0]
    if joints == 0 or np.isnan(known[0]):
        moved[:] = True
        body_poses(world.tree, q, rotations, positions)
    else:
        moved[joints] = False
        for k in range(joints):
            behind = parents[k] >= 0 and moved[parents[k]]
            moved[k] = behind or q[k] != known[k]
            if moved[k]:
                move_body(world.tree, q[k], k, rotations, positions)
    for k in range(joints):
        known[k] = q[k]
    _place(world.hulls, moved, rotations, positions, centers, axes)
    _place_balls(world.body_balls, moved, rotations, positions, balls)


@njit(cache=True, error_model="numpy")
def make_buffers(world, pairs):  # type: ignore[no-untyped-def]
    """Allocate scratch for a world and as many pairs of hulls."""
    joints, hulls = world.tree.parents.shape[0], world.hulls.bodies.shape[0]
    return (
        np.empty((joints + 1, 3, 3)),
        np.empty((joints + 1, 3)),
        np.empty((hulls, 3)),
        np.empty((hulls, 3, 3)),
        np.empty((joints + 1, 3)),
        np.zeros((pairs, 3)),
        np.empty((4, 3)),
        np.empty(joints + 1, dtype=np.bool_),
    )
