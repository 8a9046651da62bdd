# SPDX-License-Identifier: Apache-2.0
"""Rigid transforms as plain 4x4 arrays.

``T_a_b`` is the pose of frame b in frame a: ``p_a = T_a_b @ p_b``, so neighbours
cancel in ``T_a_c = T_a_b @ T_b_c``. The frames of this project:

* ``task``: corner of the workspace cube, z up, coordinates in [0, edge].
* ``camera``: optical frame, z forward, x right, y down (REP 103 ``_optical``).
* ``gripper``: z approach, y closing, x = y cross z; origin at the midpoint of the pad
  tips with open jaws (the TCP), so the palm is at negative z.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from neugrasp_ros.errors import ShapeError

FloatArray = NDArray[np.float64]


def make_transform(rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """Assemble transforms from rotation matrices and translations.

    Args:
        rotation: Rotation matrices, shape (..., 3, 3).
        translation: Translations in [m], shape (..., 3), broadcast against them.

    Returns:
        Transforms, shape (..., 4, 4).
    """
    rotation = np.asarray(rotation, dtype=np.float64)
    translation = np.asarray(translation, dtype=np.float64)
    batch = np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    transform = np.zeros((*batch, 4, 4))
    transform[..., :3, :3] = rotation
    transform[..., :3, 3] = translation
    transform[..., 3, 3] = 1.0
    return transform


def translation(x: float, y: float, z: float) -> FloatArray:
    """Return the pure translation by (x, y, z) in [m], shape (4, 4)."""
    return make_transform(np.eye(3), np.array([x, y, z]))


def invert(T_a_b: FloatArray) -> FloatArray:
    """Return ``T_b_a`` for rigid transforms of shape (..., 4, 4)."""
    rotation = np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    return make_transform(
        rotation, -np.einsum("...ij,...j->...i", rotation, T_a_b[..., :3, 3])
    )


def apply(T_a_b: FloatArray, points_b: FloatArray) -> FloatArray:
    """Map points from frame b to frame a.

    Args:
        T_a_b: Transforms, shape (..., 4, 4).
        points_b: Points in frame b in [m], shape (..., N, 3).

    Returns:
        Points in frame a in [m], shape (..., N, 3).

    Raises:
        ShapeError: If the last axis of the points is not 3.
    """
    points_b = np.asarray(points_b, dtype=np.float64)
    if points_b.ndim < 1 or points_b.shape[-1] != 3:
        raise ShapeError("points", "(..., N, 3)", points_b.shape)
    if points_b.ndim == 1:
        return T_a_b[..., :3, :3] @ points_b + T_a_b[..., :3, 3]
    rotated = points_b @ np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    return np.asarray(rotated + T_a_b[..., None, :3, 3])


def pose_from(position: FloatArray, quaternion: FloatArray) -> FloatArray:
    """Assemble transforms from positions and quaternions.

    Args:
        position: Positions in [m], shape (..., 3).
        quaternion: Quaternions (x, y, z, w), any non-zero length, shape (..., 4).

    Returns:
        Transforms, shape (..., 4, 4).
    """
    quaternion = np.asarray(quaternion, dtype=np.float64)
    matrices = Rotation.from_quat(quaternion.reshape(-1, 4)).as_matrix()
    return make_transform(matrices.reshape(*quaternion.shape[:-1], 3, 3), position)


def to_position_quaternion(T_a_b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Split transforms into positions (..., 3) in [m] and quaternions xyzw (..., 4)."""
    rotation = T_a_b[..., :3, :3]
    quaternion = Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_quat()
    return T_a_b[..., :3, 3].copy(), quaternion.reshape(*T_a_b.shape[:-2], 4)


def look_at(
    eye: FloatArray, target: FloatArray, up: tuple[float, float, float] = (0, 0, 1)
) -> FloatArray:
    """Place an optical frame at ``eye`` whose z axis points to ``target``.

    The image's upward direction is as near to ``up`` as it can be; looking along
    ``up`` itself, the frame's x axis is taken nearest to the parent's x axis.

    Args:
        eye: Camera centre in the parent frame in [m], shape (3,).
        target: Point looked at in the parent frame in [m], shape (3,).
        up: Direction that is up in the image.

    Returns:
        Pose ``T_parent_camera``, shape (4, 4).
    """
    eye = np.asarray(eye, dtype=np.float64)
    z = np.asarray(target, dtype=np.float64) - eye
    z = z / np.linalg.norm(z)
    x = np.cross(z, np.asarray(up, dtype=np.float64))
    if np.linalg.norm(x) < 1e-9:
        x = np.eye(3)[0] - z[0] * z
    x = x / np.linalg.norm(x)
    return make_transform(np.stack([x, np.cross(z, x), z], axis=-1), eye)


def flip_gripper(T_a_gripper: FloatArray) -> FloatArray:
    """Turn gripper poses of shape (..., 4, 4) half a turn about their approach axis.

    A two-finger grasp and its twin are the same grasp.
    """
    flipped = T_a_gripper.copy()
    flipped[..., :3, :2] *= -1.0
    return flipped


def canonical_gripper(T_a_gripper: FloatArray) -> FloatArray:
    """Return, of each pose and its twin, the one whose x axis points downwards.

    With z approach and y closing, that keeps the top of the hand up: the published
    frame's z axis is ``-x`` of ours. Ties (x horizontal) are broken by x's x, then y
    component, so that a pose and its twin always give the same result.

    Args:
        T_a_gripper: Gripper poses in a frame whose z is up, shape (..., 4, 4).

    Returns:
        Poses of the same shape.
    """
    x = np.round(T_a_gripper[..., :3, 0], 9)
    decisive = np.where(x[..., 2] != 0, x[..., 2], x[..., 0])
    decisive = np.where(decisive != 0, decisive, x[..., 1])
    twin = flip_gripper(T_a_gripper)
    return np.where((decisive > 0)[..., None, None], twin, T_a_gripper)


def random_rotation(rng: np.random.Generator) -> FloatArray:
    """Draw a uniformly distributed rotation matrix, shape (3, 3)."""
    return np.asarray(Rotation.random(rng=rng).as_matrix())
