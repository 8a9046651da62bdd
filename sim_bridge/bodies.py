# SPDX-License-Identifier: Apache-2.0
"""Descriptions that the physics engine reads, written from object models."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.transform import apply
from sim_bridge.objects.model import ObjectModel, Part

FloatArray = NDArray[np.float64]

UNUSED_INERTIA = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
"""The engine computes inertia from the collision shape and ignores this."""


def pose_tuple(
    T_world_frame: FloatArray, offset: FloatArray | None = None
) -> tuple[list[float], list[float]]:
    """Return position [m] and quaternion xyzw of one pose, as the engine wants them.

    SciPy takes a tenth of a millisecond for this, as long as a physics step.

    Args:
        T_world_frame: The pose, shape (4, 4).
        offset: Point in the frame whose position is wanted in [m]; default its origin.
    """
    rotation = T_world_frame[:3, :3]
    position = T_world_frame[:3, 3]
    if offset is not None:
        position = position + rotation @ offset
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    squares = (1 + a - e - i, 1 - a + e - i, 1 - a - e + i, 1 + a + e + i)
    largest = squares.index(max(squares))  # 4 q_k^2; the largest divides safely
    rows = (
        (squares[0], b + d, c + g, h - f),
        (b + d, squares[1], f + h, c - g),
        (c + g, f + h, squares[2], d - b),
        (h - f, c - g, d - b, squares[3]),
    )
    norm = 2.0 * math.sqrt(squares[largest])
    return position.tolist(), [value / norm for value in rows[largest]]


def transform_from(
    position: Sequence[float], quaternion: Sequence[float]
) -> FloatArray:
    """Return the pose (4, 4) of a position [m] and a unit quaternion xyzw."""
    x, y, z, w = quaternion
    xx, yy, zz = 2 * x * x, 2 * y * y, 2 * z * z
    xy, xz, yz = 2 * x * y, 2 * x * z, 2 * y * z
    wx, wy, wz = 2 * w * x, 2 * w * y, 2 * w * z
    return np.array(
        [
            [1 - yy - zz, xy - wz, xz + wy, position[0]],
            [xy + wz, 1 - xx - zz, yz - wx, position[1]],
            [xz - wy, yz + wx, 1 - xx - yy, position[2]],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def numbers(values: Sequence[float] | FloatArray) -> str:
    """Write numbers the way URDF attributes want them."""
    return " ".join(f"{float(value):.9g}" for value in values)


def origin_tag(T_parent_child: FloatArray) -> str:
    """Write a transform as a URDF ``origin`` tag (fixed-axis roll, pitch, yaw)."""
    r = T_parent_child[:3, :3].tolist()
    cosine = math.hypot(r[0][0], r[1][0])
    pitch = math.atan2(-r[2][0], cosine)
    if cosine > 1e-9:
        roll, yaw = math.atan2(r[2][1], r[2][2]), math.atan2(r[1][0], r[0][0])
    else:  # roll and yaw turn about the same axis: roll does it all
        roll, yaw = math.atan2(-r[1][2], r[1][1]), 0.0
    rpy = numbers((roll, pitch, yaw))
    return f'<origin xyz="{numbers(T_parent_child[:3, 3])}" rpy="{rpy}"/>'


def box_tag(half_extents: Sequence[float] | FloatArray) -> str:
    """Write a box geometry from its half extents in [m]."""
    return f'<box size="{numbers(2.0 * np.asarray(half_extents))}"/>'


def collision_tag(T_link_shape: FloatArray, geometry: str) -> str:
    """Write a collision element."""
    return (
        f"<collision>{origin_tag(T_link_shape)}"
        f"<geometry>{geometry}</geometry></collision>"
    )


def inertial_tag(center: Sequence[float] | FloatArray, mass: float) -> str:
    """Write the mass in [kg] at the centre of mass in [m] of a link."""
    return (
        f'<inertial><origin xyz="{numbers(center)}"/>'
        f'<mass value="{mass:.9g}"/>{UNUSED_INERTIA}</inertial>'
    )


def write_object_urdf(model: ObjectModel, folder: Path, stem: str) -> Path:
    """Write an object as one link with one collision element per primitive.

    All hulls go into one OBJ file, a group each: the engine makes a convex hull of
    every group, so concave objects keep their cavities.

    Args:
        model: The object.
        folder: Where to write.
        stem: File name without ending.

    Returns:
        Path of the URDF.
    """
    hulls = [part for part in model.parts if part.vertices is not None]
    elements = [
        collision_tag(part.pose, _primitive_geometry(part))
        for part in model.parts
        if part.vertices is None
    ]
    if hulls:
        mesh = folder / f"{stem}.obj"
        mesh.write_text(_hull_groups(hulls))
        elements.append(collision_tag(np.eye(4), f'<mesh filename="{mesh.name}"/>'))
    urdf = folder / f"{stem}.urdf"
    urdf.write_text(
        f'<robot name="object"><link name="base">'
        f"{inertial_tag(model.center_of_mass, model.mass)}"
        f"{''.join(elements)}</link></robot>"
    )
    return urdf


def _primitive_geometry(part: Part) -> str:
    if part.kind == "box":
        return box_tag(part.size)
    if part.kind == "sphere":
        return f'<sphere radius="{part.size[0]:.9g}"/>'
    radius, length = part.size
    return f'<{part.kind} radius="{radius:.9g}" length="{length:.9g}"/>'


def _hull_groups(hulls: Sequence[Part]) -> str:
    """Write hulls as OBJ groups; faces only list the points, each about once."""
    lines = []
    first = 1  # OBJ counts from one, through all groups
    for index, part in enumerate(hulls):
        points = apply(part.pose, np.asarray(part.vertices))
        lines.append(f"o hull_{index}")
        lines += [f"v {numbers(point)}" for point in points]
        count = len(points)
        for start in range(0, count, 3):
            corners = [first + (start + k) % count for k in range(3)]
            lines.append(f"f {corners[0]} {corners[1]} {corners[2]}")
        first += count
    return "\n".join(lines) + "\n"
